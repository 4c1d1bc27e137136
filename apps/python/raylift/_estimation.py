"""Poses from matches in arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Optional, Sequence, Tuple

from . import _core

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from ._types import CameraLike, EstimateOptions, PosedImageLike, PoseLike


def estimate_pose(
    camera: CameraLike,
    points2d: Optional[ArrayLike] = None,
    points3d: Optional[ArrayLike] = None,
    *,
    point_sigmas: Optional[ArrayLike] = None,
    point_references: Optional[ArrayLike] = None,
    point_keypoints: Optional[ArrayLike] = None,
    point_matches: Optional[ArrayLike] = None,
    references: Sequence[PosedImageLike] = (),
    query2d: Optional[ArrayLike] = None,
    reference2d: Optional[ArrayLike] = None,
    reference_index: Optional[ArrayLike] = None,
    reference_sigmas_px: Optional[ArrayLike] = None,
    query_keypoints: Optional[ArrayLike] = None,
    reference_keypoints: Optional[ArrayLike] = None,
    reference_clusters: Sequence[int] = (),
    position_prior: Optional[Tuple[ArrayLike, ArrayLike]] = None,
    gravity_prior: Optional[Tuple[ArrayLike, ArrayLike, float]] = None,
    heading_prior: Optional[Tuple[ArrayLike, ArrayLike, ArrayLike, float]] = None,
    orientation_prior: Optional[Tuple[ArrayLike, float]] = None,
    initial_pose: Optional[PoseLike] = None,
    name: str = "",
    points2D: Optional[ArrayLike] = None,
    points3D: Optional[ArrayLike] = None,
    **options: Unpack[EstimateOptions],
) -> _core.PoseEstimate:
    """The pose of a photograph from its 2D-3D matches, its 2D-2D matches with photographs whose poses
    are known, or both.

    camera: the photograph's.
    points2d, points3d: (N, 2) pixels of the photograph and (N, 3) points of the world that they show.
        Most pixels must lie inside of the camera's image.
    point_sigmas: (N,) standard deviations of the points, scene units; NaN: not known.
    point_references: (N,) index of the reference that the point was lifted from; -1: of none.
    point_matches: (N,) index of the 2D-2D match that it was lifted from; -1: of none.
    references: photographs with known poses: PosedImage, (camera, cam_from_world), or pycolmap's.
    query2d, reference2d: (M, 2) pixels of the photograph and of a reference that show the same thing.
    reference_index: (M,) which reference; may be left out where there is one.
    reference_sigmas_px: (M,) standard deviation of a reference's pixel where its pose is uncertain.
    point_keypoints, query_keypoints, reference_keypoints: (N,), (M,), (M,) indices of keypoints, where
        they are known: matches of one keypoint have equal ones. Without, equal pixels are one keypoint.
    reference_clusters: covisibility cluster of each reference, for the method "hloc".
    position_prior: (position, sigma) of the camera's center in the world, sigma one number or one per
        axis; 0: exact.
    gravity_prior: (down_in_cam, down_in_world, sigma_deg), directions of any length.
    heading_prior, orientation_prior: as of raylift.Query.
    initial_pose: cam_from_world near which the pose is; RANSAC is then left out, as in refine_pose().
    points2D, points3D: points2d and points3d by the names that pycolmap and PoseLib give them.
    name: the photograph's; random choices depend on it and on `seed` alone.
    options: as of `raylift estimate`, with its defaults: method="adaptive" (or "p3p", "e5p1", "d3p1",
        "select", "hybrid_ransac", "hloc"), score="sum_msac", lo="hybrid", alpha=0.8, refinement="robust",
        reprojection_threshold_px=8, sampson_threshold_px=2, point_sigma=0, refine_focal=False,
        focal_range=1.3, focal_sigma=None, reference_factor_sigma=None, reference_rotation_sigma_deg=None,
        reference_position_sigma=None, min_iterations=100, max_iterations=10000, confidence=0.9999,
        seed=0; scene_calibration: the file in which Localizer.write_calibration() or `raylift calibrate`
        says how noisy the matches of the photograph's scene are.

    That there is no pose is a result. Raises InputError for arrays of a wrong shape or an index out
    of range, OptionError for an option out of range.
    """
    problem = _core.PoseProblem(
        camera,
        _either("points2d", points2d, "points2D", points2D),
        _either("points3d", points3d, "points3D", points3D),
        point_sigmas=point_sigmas,
        point_references=point_references,
        point_keypoints=point_keypoints,
        point_matches=point_matches,
        references=references,
        query2d=query2d,
        reference2d=reference2d,
        reference_index=reference_index,
        reference_sigmas_px=reference_sigmas_px,
        query_keypoints=query_keypoints,
        reference_keypoints=reference_keypoints,
        reference_clusters=reference_clusters,
        position_prior=position_prior,
        gravity_prior=gravity_prior,
        heading_prior=heading_prior,
        orientation_prior=orientation_prior,
        name=name,
    )
    if initial_pose is not None:
        return _core.refine_pose(problem, initial_pose, **options)
    return _core.estimate(problem, **options)


def _either(name: str, value: Optional[ArrayLike], other_name: str,
            other: Optional[ArrayLike]) -> Optional[ArrayLike]:
    if value is not None and other is not None:
        raise _core.InputError(f"{name} and {other_name}: expected one of them, found both")
    return other if value is None else value
