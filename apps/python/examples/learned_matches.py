"""Matches of any matcher against a mesh, without files: learned_matches.py [DEMO]"""

import sys
from pathlib import Path

import numpy as np

import raylift


def match(query: raylift.PosedImage, reference: raylift.PosedImage, caster: raylift.RayCaster) -> np.ndarray:
    """Stands in for RoMa, MASt3R, ...: N x 4 pixels, the first pixel's center being (0, 0)."""
    pixels = np.random.default_rng(0).uniform(0, reference.camera.height, (300, 2))
    points = raylift.Lifter(caster).lift(reference, pixels)["points"]
    seen = query.camera.project(query.cam_from_world.transform(points))
    inside = ((seen >= 0) & (seen < [query.camera.width, query.camera.height])).all(axis=1)
    return np.hstack([seen, pixels])[inside] - 0.5


def main(demo: Path) -> None:
    scene = raylift.Scene(demo / "model", [f"mesh:{demo / 'scene.obj'}"])
    truth = raylift.ColmapModel.read(demo / "ground_truth").posed_images[1]
    assert scene.mesh is not None
    matches = {image.name: match(truth, image, scene.mesh) for image in scene.references[:6]}
    query = raylift.Localizer(scene).localize_matches(
        truth.camera, **raylift.hloc.matches_from(matches, cell_px=1))
    assert query.cam_from_world is not None
    error = np.linalg.norm(query.cam_from_world.center - truth.cam_from_world.center)
    print(f"{query.counts['inliers_2d3d']} of {query.counts['points']} points, {error:.3f} off")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "assets/demo"))
