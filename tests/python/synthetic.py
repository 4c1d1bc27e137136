"""Problems whose true pose is known."""

import os
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift

CAMERA = raylift.Camera("SIMPLE_RADIAL", 640, 480, [500, 320, 240, -0.05])


T = TypeVar("T")


def some(value: T | None) -> T:
    """What is not missing."""
    assert value is not None
    return value


def resident_kb() -> int:
    """The memory that the process takes; where the address sanitizer keeps what is freed, the test is left out."""
    if "libasan" in os.environ.get("LD_PRELOAD", ""):
        pytest.skip("the address sanitizer keeps what is freed")
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


def rotation(axis_angle: NDArray[np.float64] | list[float]) -> NDArray[np.float64]:
    """The matrix exp(w), by Rodrigues' formula."""
    w = np.asarray(axis_angle, float)
    angle = np.linalg.norm(w)
    if angle == 0:
        return np.eye(3)
    x, y, z = w / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k))


def pose(axis_angle: NDArray[np.float64] | list[float],
         center: NDArray[np.float64] | list[float]) -> raylift.Rigid3:
    r = rotation(axis_angle)
    return raylift.Rigid3(r, -r @ np.asarray(center, float))


def angle_deg(a: raylift.Rigid3, b: raylift.Rigid3) -> float:
    cosine = (np.trace(a.rotation @ b.rotation.T) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


class Problem:
    """Points in front of a camera, seen by it and by references around it; wrong matches at the end."""

    def __init__(self, seed: int = 1, points: int = 200, wrong: int = 60, noise_px: float = 0.5,
                 references: int = 3) -> None:
        rng = np.random.default_rng(seed)
        self.truth = pose([0.1, -0.2, 0.05], [0.3, -0.1, -0.2])
        in_cam = np.column_stack([rng.uniform(-1.5, 1.5, points), rng.uniform(-1.2, 1.2, points),
                                  rng.uniform(4, 8, points)])
        self.points3d = self.truth.inverse().transform(in_cam)
        self.points2d = CAMERA.project(in_cam) + rng.normal(0, noise_px, (points, 2))
        self.points2d[points - wrong:] = rng.uniform([0, 0], [640, 480], (wrong, 2))
        self.num_right = points - wrong
        self.references: list[raylift.PosedImage] = []
        query, reference, index = [], [], []
        for r in range(references):
            cam_from_world = pose([0, 0.05 * r, 0], [0.8 * r - 0.9, 0.2 * r, -0.3])
            self.references.append(raylift.PosedImage(f"{r}.jpg", CAMERA, cam_from_world))
            query.append(self.points2d)
            pixels = CAMERA.project(cam_from_world.transform(self.points3d))
            reference.append(pixels + rng.normal(0, noise_px, pixels.shape))
            index.append(np.full(points, r))
        self.pairs: dict[str, Any] = dict(references=self.references, query2d=np.vstack(query),
                                          reference2d=np.vstack(reference), reference_index=np.concatenate(index))

    def expect_near(self, estimate: raylift.PoseEstimate, degrees: float = 0.2,
                    units: float = 0.03) -> None:
        assert estimate, estimate
        assert angle_deg(some(estimate.cam_from_world), self.truth) < degrees
        assert np.linalg.norm(some(estimate.cam_from_world).center - self.truth.center) < units
