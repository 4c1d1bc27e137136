"""The demo scene with features and matches that its geometry makes, in hloc's files."""

import os
import sqlite3
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

import raylift

DEMO = Path(os.environ["RAYLIFT_SOURCE"]) / "assets/demo"
MESH = f"mesh:{DEMO / 'scene.obj'}"


def truth() -> dict[str, raylift.PosedImage]:
    return {image.name: image for image in raylift.ColmapModel.read(DEMO / "ground_truth").posed_images}


class HlocScene:
    """Random pixels of references and where queries see the same points of the mesh."""

    def __init__(self, folder: Path, num_queries: int = 4, num_references: int = 8,
                 per_pair: int = 150) -> None:
        self.folder = Path(folder)
        self.truth = truth()
        self.queries = raylift.read_queries(DEMO / "queries.txt")[:num_queries]
        self.scene = raylift.Scene(DEMO / "model", [MESH])
        self.references = self.scene.references[:num_references]
        rng = np.random.default_rng(0)
        lifter = raylift.Lifter(self.scene.mesh)
        # Keypoints of an image, in hloc's pixels, and matches as pairs of their indices.
        self.keypoints: dict[str, Any] = {query.name: [] for query in self.queries}
        self.matches: dict[tuple[str, str], tuple[NDArray[np.int64], NDArray[np.int64]]] = {}
        for reference in self.references:
            camera = reference.camera
            pixels = rng.uniform([0, 0], [camera.width, camera.height], (2000, 2))
            self.keypoints[reference.name] = pixels - 0.5
            points = lifter.lift(reference, pixels)["points"]
            for name, camera in self.queries:
                pose = self.truth[name].cam_from_world
                seen = camera.project(pose.transform(points))
                with np.errstate(invalid="ignore"):
                    inside = ((seen > 0) & (seen < [camera.width, camera.height])).all(axis=1)
                of_reference = np.flatnonzero(inside)[:per_pair]
                first = len(self.keypoints[name])
                self.keypoints[name].extend(seen[of_reference] - 0.5)
                self.matches[name, reference.name] = (first + np.arange(len(of_reference)), of_reference)
        self._write()

    def _write(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        raylift.write_queries(self.query_list, self.queries)
        with h5py.File(self.features, "w") as file:
            for name, keypoints in self.keypoints.items():
                file.create_group(name)["keypoints"] = np.asarray(keypoints, np.float32).reshape(-1, 2)
        with h5py.File(self.matches_file, "w") as file, open(self.pairs, "w") as pairs:
            for (query, reference), (of_query, of_reference) in self.matches.items():
                rows = np.full(len(self.keypoints[query]), -1, np.int32)
                rows[of_query] = of_reference
                group = file.require_group(query.replace("/", "-")).create_group(reference.replace("/", "-"))
                group["matches0"] = rows
                group["matching_scores0"] = np.ones(len(rows), np.float16)
                pairs.write(f"{query} {reference}\n")

    def write_database(self, file: Path) -> None:
        """The same as COLMAP's database, as far as it is read."""
        ids = {name: i for i, name in enumerate(self.keypoints, start=1)}
        with sqlite3.connect(file) as database:
            database.executescript("""
                CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER,
                    height INTEGER, params BLOB, prior_focal_length INTEGER);
                CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);
                CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
                CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
                CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER,
                    data BLOB, config INTEGER, F BLOB, E BLOB, H BLOB);
                INSERT INTO cameras VALUES (1, 2, 640, 480, NULL, 0);""")
            for name, i in ids.items():
                pixels = np.asarray(self.keypoints[name], np.float32).reshape(-1, 2) + np.float32(0.5)
                database.execute("INSERT INTO images VALUES (?, ?, 1)", (i, name))
                database.execute("INSERT INTO keypoints VALUES (?, ?, 2, ?)", (i, len(pixels), pixels.tobytes()))
            for (query, reference), columns in self.matches.items():
                pair = sorted(zip((ids[query], ids[reference]), columns))  # the smaller id first
                rows = np.column_stack([column for _, column in pair]).astype(np.uint32)
                database.execute("INSERT INTO matches VALUES (?, ?, 2, ?)",
                                 (2147483647 * pair[0][0] + pair[1][0], len(rows), rows.tobytes()))
        database.close()

    query_list = property(lambda self: self.folder / "queries.txt")
    features = property(lambda self: self.folder / "features.h5")
    matches_file = property(lambda self: self.folder / "matches.h5")
    pairs = property(lambda self: self.folder / "pairs.txt")

    def expect_near(self, name: str, pose: raylift.Rigid3, units: float = 0.05) -> None:
        assert np.linalg.norm(pose.center - self.truth[name].cam_from_world.center) < units, name
