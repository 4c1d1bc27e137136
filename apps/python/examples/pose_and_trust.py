"""A pose from matches in arrays, and how far to trust it: pose_and_trust.py"""

import numpy as np

import raylift

camera = raylift.Camera("SIMPLE_PINHOLE", 640, 480, [500, 320, 240])
truth = raylift.Rigid3([1, 0, 0, 0], [0.1, -0.2, 0.3])
rng = np.random.default_rng(0)
points = rng.uniform([-2, -2, 4], [2, 2, 8], (200, 3))
pixels = camera.project(truth.transform(points)) + rng.normal(0, 0.5, (200, 2))
pixels[:80] = rng.uniform(0, 480, (80, 2))  # wrong matches

estimate = raylift.estimate_pose(camera, pixels, points)
print(f"{estimate.verdict} with confidence {estimate.confidence:.3f}")
print(f"{estimate.num_inliers_2d3d} of {len(points)} points agree")
if estimate.cam_from_world is not None and estimate.covariance is not None:
    print(f"center {estimate.cam_from_world.center.round(3)} +- {estimate.position_sigma:.4f}")
    # 6 x 6: the rotation vector in radians, then the translation, in the camera's frame.
    print(f"rotation +- {np.degrees(np.sqrt(estimate.covariance.diagonal()[:3])).round(4)} degrees")
