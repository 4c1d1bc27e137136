import pickle
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raylift
from scenes import DEMO, MESH, HlocScene
from synthetic import some


@pytest.fixture(scope="module")
def hloc(tmp_path_factory: pytest.TempPathFactory) -> HlocScene:
    return HlocScene(tmp_path_factory.mktemp("hloc"))


def lines_by_file_name(path: Path) -> list[str]:
    """As hloc names queries: by the file alone."""
    return [line.split("/")[-1] for line in path.read_text().splitlines()]


def test_poses_equal_the_programs(hloc: HlocScene, tmp_path: Path) -> None:
    found = raylift.hloc.localize(DEMO / "model", hloc.query_list, hloc.pairs, hloc.features,
                                  hloc.matches_file, tmp_path / "results.txt", geometry=MESH)
    raylift.localize(tmp_path / "out", model=DEMO / "model", queries=hloc.query_list, pairs=hloc.pairs,
                     features=hloc.features, matches=hloc.matches_file, geometry=MESH)
    assert (tmp_path / "results.txt").read_text().splitlines() == lines_by_file_name(
        tmp_path / "out/poses.txt")
    assert len(found) == len(hloc.queries)
    for name, query in found.items():
        hloc.expect_near(name, some(query.cam_from_world))


def test_logs_are_hlocs(hloc: HlocScene, tmp_path: Path) -> None:
    found = raylift.hloc.localize(hloc.scene, hloc.query_list, hloc.pairs, hloc.features,
                                  hloc.matches_file, tmp_path / "results.txt",
                                  prepend_camera_name=True, top_k=3)
    assert list(raylift.read_poses(tmp_path / "results.txt")) == list(found)
    with open(tmp_path / "results.txt_logs.pkl", "rb") as file:
        logs = pickle.load(file)
    assert set(logs) == {"features", "matches", "retrieval", "loc"}
    for name, log in logs["loc"].items():
        assert log["db"] == [r.name for r in hloc.references[:3]]
        points = len(log["3d_points"])
        assert log["keypoints_query"].shape == (points, 2)
        assert log["PnP_ret"]["num_inliers"] == log["PnP_ret"]["inliers"].sum() > 100
        assert log["PnP_ret"]["covariance"].shape == (6, 6)
        assert log["num_matches"] == found[name].counts["matched"]
        assert sum(inliers.sum() for _, _, _, inliers in shown_by_hloc(log, None, 3)) > 100


class Reconstruction:
    """What hloc's viewer looks up in pycolmap's: images and points3D by their ids."""

    def __init__(self, folder: Path) -> None:
        self.model = raylift.ColmapModel.read(folder)
        self.images = {i: self.model.image(i) for i in self.model.image_ids}
        self.tracks = {int(i): dict(self.model.track(i).tolist()) for i in self.model.points3d["ids"]}


def shown_by_hloc(log: dict[str, Any], reconstruction: Reconstruction | None,
                  top_k_db: int = 2) -> list[tuple[str, Any, Any, Any]]:
    """What hloc's visualize_loc_from_log (hloc/visualization.py) draws of a query, by its look-ups: for each
    reference its name, pixels of the query and of the reference, and which are inliers."""
    assert not log.get("covisibility_clustering", False)
    inliers = np.array(log["PnP_ret"]["inlier_mask"])
    count = len(log["db"])
    shown = []
    if reconstruction is None:
        for i in np.argsort([-np.sum(log["indices_db"][inliers] == i) for i in range(count)])[:top_k_db]:
            of_reference = log["indices_db"] == i
            shown.append((log["db"][i], log["keypoints_query"][of_reference], log["keypoints_db"][of_reference],
                          inliers[of_reference]))
        return shown
    _, of_points = log["keypoint_index_to_db"]
    assert len(of_points) == len(inliers)
    matches: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for row, (point, references) in enumerate(of_points):
        for i in references:
            matches[i].append((row, reconstruction.tracks[point][log["db"][i]]))
    for i in np.argsort([-sum(inliers[row] for row, _ in one) for one in matches])[:top_k_db]:
        image, pairs = reconstruction.images[log["db"][i]], np.array(matches[i])
        shown.append((image["name"], log["keypoints_query"][pairs[:, 0]], image["points2d"][pairs[:, 1]],
                      inliers[pairs[:, 0]]))
    return shown


@pytest.fixture(scope="module")
def with_points(hloc: HlocScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's model with points: those of the mesh that the references' keypoints see."""
    folder = tmp_path_factory.mktemp("model")
    model, lifter = raylift.ColmapModel(), raylift.Lifter(hloc.scene.mesh)
    for i, reference in enumerate(hloc.references, start=10):
        model.add_camera(i, reference.camera)
        pixels = hloc.keypoints[reference.name] + 0.5
        model.add_image(i, reference.name, i, reference.cam_from_world, pixels)
        for row, point in enumerate(lifter.lift(reference, pixels)["points"]):
            if np.isfinite(point).all():
                model.add_point3d(10000 * i + row, point, [[i, row]])
    model.write(folder)
    return folder


def logs_of(results: Path) -> dict[str, Any]:
    with open(f"{results}_logs.pkl", "rb") as file:
        logs: dict[str, Any] = pickle.load(file)["loc"]
    return logs


@pytest.mark.parametrize("is_object", [False, True])
def test_logs_of_a_models_points_have_their_ids(
        is_object: bool, hloc: HlocScene, with_points: Path, tmp_path: Path) -> None:
    model: Any = raylift.ColmapModel.read(with_points) if is_object else with_points
    found = raylift.hloc.localize(model, hloc.query_list, hloc.pairs, hloc.features, hloc.matches_file,
                                  tmp_path / "results.txt")
    reconstruction = Reconstruction(with_points)
    for name, log in logs_of(tmp_path / "results.txt").items():
        query = found[name]
        hloc.expect_near(name, some(query.cam_from_world))
        assert set(log) == {"db", "PnP_ret", "keypoints_query", "points3D_ids", "points3D_xyz", "num_matches",
                            "keypoint_index_to_db"}
        # Each point is the mesh's where the reference's keypoint is, which the query's one is matched with.
        for reference, pixels, of_reference, inliers in shown_by_hloc(log, reconstruction, 99):
            of_query, rows = hloc.matches[name, reference]
            given = np.asarray(hloc.keypoints[name], np.float32)[of_query].astype(float) + 0.5
            expected = {tuple(pixel): row for pixel, row in zip(given.tolist(), rows)}
            for pixel, match in zip(pixels.tolist(), of_reference):
                keypoint = hloc.keypoints[reference][expected[tuple(pixel)]]
                assert keypoint + 0.5 == pytest.approx(match, abs=1e-3)
            assert len(inliers) == len(pixels) > 0
        points = reconstruction.model.points3d
        position = dict(zip(points["ids"].tolist(), points["positions"].tolist()))
        assert [position[i] for i in log["points3D_ids"]] == query.problem.points3d.tolist()
        assert log["PnP_ret"]["inlier_mask"].sum() == log["PnP_ret"]["num_inliers"] > 100


def test_points_without_an_id_are_left_out_of_logs() -> None:
    from raylift.hloc import _Points
    camera = raylift.Camera("PINHOLE", 64, 48, [60, 60, 32, 24])
    model = raylift.ColmapModel()
    model.add_camera(1, camera)
    for i, name in ((5, "a.jpg"), (6, "b.jpg"), (7, "c.jpg")):
        model.add_image(i, name, 1, raylift.Rigid3(), [[32, 24], [10, 10]])
    # Two points are at one position, each seen by another reference.
    model.add_point3d(10, [0, 0, 5], [[5, 0]])
    model.add_point3d(11, [0, 0, 5], [[6, 0]])
    model.add_point3d(12, [1, 0, 5], [[5, 1], [7, 1]])
    problem = raylift.PoseProblem(
        camera, np.full((5, 2), 20.0), [[0, 0, 5], [0, 0, 5], [1, 0, 5], [1, 0, 5], [2, 0, 5]],
        point_references=[1, 0, -1, 1, 0], references=[model.posed_images[0], model.posed_images[1]])
    known, log = _Points(model).log(problem)
    assert known.tolist() == [True, True, True, False, False]
    assert log["points3D_ids"] == [11, 10, 12] and log["db"] == [6, 5]
    assert log["keypoint_index_to_db"] == (problem.point_keypoints[:3].tolist(), [(11, [0]), (10, [1]), (12, [1])])


@pytest.mark.parametrize("geometry", ["sfm", MESH])
def test_logs_of_queries_without_a_pose_are_shown_too(
        geometry: str, hloc: HlocScene, with_points: Path, tmp_path: Path) -> None:
    import h5py
    matches_file = tmp_path / "matches.h5"
    few = {hloc.queries[0].name: 0, hloc.queries[1].name: 2}
    with h5py.File(matches_file, "w") as file:
        for (query, reference), (of_query, of_reference) in hloc.matches.items():
            rows = np.full(len(hloc.keypoints[query]), -1, np.int32)
            kept = slice(few.get(query) if reference == hloc.references[0].name else 0) if query in few else slice(None)
            rows[of_query[kept]] = of_reference[kept]
            group = file.require_group(query.replace("/", "-")).create_group(reference.replace("/", "-"))
            group["matches0"], group["matching_scores0"] = rows, np.ones(len(rows), np.float16)
    found = raylift.hloc.localize(with_points, hloc.query_list, hloc.pairs, hloc.features, matches_file,
                                  tmp_path / "results.txt", geometry=geometry)
    reconstruction = Reconstruction(with_points) if geometry == "sfm" else None
    for name, log in logs_of(tmp_path / "results.txt").items():
        assert log["PnP_ret"]["success"] == (name not in few) == bool(found[name])
        shown = shown_by_hloc(log, reconstruction)
        assert sum(inliers.sum() for _, _, _, inliers in shown) > 100 or name in few
        assert sum(len(pixels) for _, pixels, _, _ in shown) == few.get(name, sum(len(s[1]) for s in shown))


def test_options(hloc: HlocScene, tmp_path: Path) -> None:
    def localize(**options: Any) -> dict[str, raylift.LocalizedQuery]:
        return raylift.hloc.localize(DEMO / "model", hloc.query_list, hloc.pairs, hloc.features,
                                     hloc.matches_file, tmp_path / "results.txt", geometry=[MESH],
                                     **options)

    tight = {"estimation": {"ransac": {"max_error": 0.5}}}
    several: list[dict[str, Any]] = [dict(ransac_thresh=0.5), dict(config=tight), dict(reprojection_threshold_px=0.5)]
    a, b, c = (next(iter(localize(**options).values())) for options in several)
    assert (some(a.cam_from_world).matrix.tolist() == some(b.cam_from_world).matrix.tolist()
            == some(c.cam_from_world).matrix.tolist())
    clustered = next(iter(localize(covisibility_clustering=True).values()))
    of_method = next(iter(localize(method="hloc").values()))
    assert some(clustered.cam_from_world).matrix.tolist() == some(of_method.cam_from_world).matrix.tolist()
    with pytest.raises(raylift.OptionError, match="refinement"):
        localize(config={"refinement": {}})
    with pytest.raises(raylift.OptionError, match="min_num_trials"):
        localize(config={"estimation": {"ransac": {"min_num_trials": 3}}})
    with pytest.raises(raylift.OptionError, match="methods: there is no such option"):
        localize(methods="p3p")


def test_a_reconstruction_is_taken_by_its_write(hloc: HlocScene, tmp_path: Path) -> None:
    model = raylift.ColmapModel.read(DEMO / "model")
    reconstruction: Any = types.SimpleNamespace(write=lambda folder: model.write(folder))
    found = raylift.hloc.localize(reconstruction, str(hloc.query_list), hloc.pairs, hloc.features,
                                  hloc.matches_file, tmp_path / "results.txt", geometry=MESH)
    assert all(found.values())


def test_a_folder_of_pairs_is_the_same_as_hlocs_files(hloc: HlocScene, tmp_path: Path) -> None:
    """Keypoints of a query are told by their pixels, which are hloc's float32."""
    for (query, reference), (of_query, of_reference) in hloc.matches.items():
        pixels = [np.asarray(hloc.keypoints[name], np.float32) for name in (query, reference)]
        name = f"{query}__{reference}".replace("/", "-")
        np.savez(tmp_path / f"{name}.npz", mkpts0=pixels[0][of_query], mkpts1=pixels[1][of_reference],
                 mconf=np.linspace(0, 1, len(of_query)), names=np.array([query, reference]))
    of_files = raylift.Localizer(hloc.scene, features=hloc.features, matches=hloc.matches_file,
                                 pairs=hloc.pairs)
    of_folder = raylift.Localizer(hloc.scene, matches=tmp_path, pairs=hloc.pairs)
    expected = of_files.localize_all(hloc.queries)
    for name, one in of_folder.localize_all(hloc.queries).items():
        np.testing.assert_array_equal(one.problem.query2d, expected[name].problem.query2d)
        assert str(one.cam_from_world) == str(expected[name].cam_from_world)
    best = raylift.Localizer(hloc.scene, matches=tmp_path, pairs=hloc.pairs, min_match_score=0.5)
    for name, one in best.localize_all(hloc.queries).items():
        assert 0 < len(one.problem.query2d) < 0.6 * len(expected[name].problem.query2d)
        hloc.expect_near(name, some(one.cam_from_world))
