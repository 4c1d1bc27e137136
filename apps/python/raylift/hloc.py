"""For scripts that use hloc: one line in place of hloc.localize_sfm.main, and matches of any matcher.

Neither hloc nor pycolmap is imported.
"""

from __future__ import annotations

import pickle
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union, cast

import numpy as np

from . import _core

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Unpack

    from ._results import GivenMatches
    from ._types import GeometryLike, HlocConfig, HlocOptions, ModelLike, PathLike, Progress

_ALL_PAIRS = 2**31 - 1


def _open_scene(reference: Union[_core.Scene, ModelLike], geometry: Sequence[GeometryLike], images: Optional[PathLike],
                threads: int) -> _core.Scene:
    if isinstance(reference, _core.Scene):
        return reference
    return _core.Scene(reference, list(geometry), images=images, threads=threads)


def _read_model(reference: ModelLike) -> _core.ColmapModel:
    write = getattr(reference, "write", None)
    if write is None:
        return _core.ColmapModel.read(cast("PathLike", reference))
    with tempfile.TemporaryDirectory() as folder:
        write(folder)
        return _core.ColmapModel.read(folder)


class _Points:
    """The points of a COLMAP model by where they are, and the ids of its images by name."""

    def __init__(self, model: _core.ColmapModel) -> None:
        self._model = model
        self._image_ids = {model.image(image_id)["name"]: image_id for image_id in model.image_ids}
        points = model.points3d
        self._ids: Dict[bytes, List[int]] = {}
        for i, position in zip(points["ids"], points["positions"]):
            self._ids.setdefault(position.tobytes(), []).append(int(i))

    def _seen(self, position: NDArray[np.float64], image_ids: Sequence[int]) -> Tuple[int, List[int]]:
        """The point that is there and which of these images show it; none: there is no such point."""
        for point in self._ids.get(position.tobytes(), []):
            track = set(self._model.track(point)[:, 0].tolist())
            shown_in = [i for i in image_ids if i in track]
            if shown_in:
                return point, shown_in
        return -1, []

    def log(self, problem: _core.PoseProblem) -> Tuple[NDArray[np.bool_], Dict[str, object]]:
        """What hloc.localize_sfm logs of points that have ids, and which of the problem's points these are.
        hloc's viewer looks a point up in the tracks of the references in `db`, of which it expects that each
        shows some: the others are left out."""
        of_reference = [self._image_ids[image.name] for image in problem.references]
        # -1: lifted from none of them alone.
        found = [self._seen(position, of_reference if reference < 0 else [of_reference[reference]])
                 for position, reference in zip(problem.points3d, problem.point_references.tolist())]
        known = np.array([bool(shown_in) for _, shown_in in found], bool)
        points = [one for one in found if one[1]]
        db = list(dict.fromkeys(i for _, shown_in in points for i in shown_in))
        return known, {
            "db": db,
            "points3D_ids": [point for point, _ in points],
            "points3D_xyz": None,
            "keypoint_index_to_db": (problem.point_keypoints[known].tolist(),
                                     [(point, [db.index(i) for i in shown_in]) for point, shown_in in points]),
        }


def _log_of_pixels(problem: _core.PoseProblem) -> Dict[str, Any]:
    """What hloc.localize_inloc logs of points that are lifted: they have no ids, so each has its keypoint
    in a reference (-1: several)."""
    pair = problem.point_matches
    known = pair >= 0
    keypoints_db = np.full((len(pair), 2), np.nan)
    keypoints_db[known] = problem.reference2d[pair[known]]
    return {
        "db": [image.name for image in problem.references],
        "3d_points": problem.points3d,
        "keypoints_db": keypoints_db,
        "indices_db": np.where(known, problem.reference_index[pair], -1) if len(problem.query2d) else pair,
    }


def _log(result: _core.LocalizedQuery, points: Optional[_Points]) -> Dict[str, Any]:
    """What hloc logs of a query, as hloc.visualization.visualize_loc reads it: with `reconstruction` where
    the points are a model's, of which those alone are logged, without where they are lifted."""
    problem, estimate = result.problem, result.estimate
    pose = result.cam_from_world
    # hloc's viewer wants a mask of what was not localized, too.
    inliers = estimate.inliers_2d3d if pose is not None else np.zeros(len(problem.points2d), bool)
    known, of_points = (slice(None), _log_of_pixels(problem)) if points is None else points.log(problem)
    found: Dict[str, Any] = {
        "success": pose is not None,
        "num_inliers": int(inliers.sum()),
        "inliers": inliers[known],
        "inlier_mask": inliers[known],
        "confidence": result.confidence,
        "verdict": result.verdict,
    }
    if pose is not None:
        found.update(qvec=pose.qvec, tvec=pose.tvec, covariance=estimate.covariance)
    return {
        "PnP_ret": found,
        "keypoints_query": problem.points2d[known],
        "num_matches": len(problem.query2d),
        **of_points,
    }


def _threshold(ransac_thresh: Optional[float], config: Optional[HlocConfig]) -> Optional[float]:
    config = config or {}
    ransac = config.get("estimation", {}).get("ransac", {})
    for name, part, known in [("config", config.keys(), "estimation"),
                              ("config, estimation, ransac", ransac.keys(), "max_error")]:
        unknown = part - {known}
        if unknown:
            raise _core.OptionError(f"{name}: there is no counterpart of {', '.join(sorted(unknown))}")
    value = ransac.get("max_error", ransac_thresh)
    return None if value is None else float(value)


def localize(
    reference_sfm: Union[_core.Scene, ModelLike],
    queries: PathLike,
    retrieval: PathLike,
    features: PathLike,
    matches: PathLike,
    results: PathLike,
    ransac_thresh: Optional[float] = None,
    covisibility_clustering: bool = False,
    prepend_camera_name: bool = False,
    config: Optional[HlocConfig] = None,
    *,
    geometry: Union[GeometryLike, Sequence[GeometryLike]] = "sfm",
    images: Optional[PathLike] = None,
    top_k: Optional[int] = None,
    threads: int = 0,
    progress: Optional[Progress] = None,
    **options: Unpack[HlocOptions],
) -> Dict[str, _core.LocalizedQuery]:
    """Takes what hloc.localize_sfm.main takes, and writes what it writes.

    reference_sfm: a COLMAP model (folder or pycolmap.Reconstruction), or a raylift.Scene.
    queries, retrieval, features, matches: hloc's files: query list with intrinsics, pairs, features.h5,
        matches.h5.
    results: file of poses; NAME_logs.pkl is written beside it, as hloc's logs (poses there are qvec and
        tvec instead of pycolmap's objects, with covariance and confidence), for
        hloc.visualization.visualize_loc: with its `reconstruction` where geometry is "sfm" and
        reference_sfm that model, without where points are lifted, which have no ids.
    ransac_thresh: inlier threshold of points, pixels; None: 8, as `raylift localize`. `config` may give
        it in its place (estimation, ransac, max_error).
    covisibility_clustering: the method "hloc" instead of "adaptive".
    prepend_camera_name: poses are named folder/file, as RobotCar's; otherwise by the file alone, as hloc
        does.
    geometry: "mesh:scene.ply", "depth:maps", ... or a list; "sfm": the model's points, as hloc.
    top_k: references per query; None: all that the pairs list.
    options: as of raylift.Localizer.

    Queries without a pose are left out, where hloc writes the pose of the first reference. Returns what
    was found, by the queries' names.
    """
    several = list(geometry) if isinstance(geometry, (list, tuple)) else [cast("GeometryLike", geometry)]
    if covisibility_clustering:
        options.setdefault("method", "hloc")
    threshold = _threshold(ransac_thresh, config)
    if threshold is not None:
        options["reprojection_threshold_px"] = threshold
    asked = _core.read_queries(queries)
    scene = _open_scene(reference_sfm, several, images, threads)
    localizer = _core.Localizer(scene, features=features, matches=matches, pairs=retrieval,
                                top_k=_ALL_PAIRS if top_k is None else top_k, **options)
    found = localizer.localize_all(asked, threads=threads, progress=progress)

    poses: Dict[str, _core.Rigid3] = {}
    for name, result in found.items():
        if result.cam_from_world is not None:
            parts = name.split("/")
            poses["/".join(parts[-2:]) if prepend_camera_name else parts[-1]] = result.cam_from_world
    results = Path(results)
    _core.write_poses(results, poses)
    is_sfm = several == ["sfm"] and not isinstance(reference_sfm, _core.Scene)
    points = _Points(_read_model(cast("ModelLike", reference_sfm))) if is_sfm else None
    logs = {"features": Path(features), "matches": Path(matches), "retrieval": Path(retrieval),
            "loc": {name: _log(result, points) for name, result in found.items()}}
    with open(f"{results}_logs.pkl", "wb") as file:
        pickle.dump(logs, file)
    return found


def matches_from(matches: Union[ArrayLike, Mapping[str, ArrayLike]], *, reference: str = "",
                 first_pixel: float = 0.0, cell_px: Optional[float] = None) -> GivenMatches:
    """Matches of any matcher (RoMa, MASt3R, LoFTR) as Localizer.localize_matches() takes them.

    matches: (N, 4), x and y in the query, then in the reference of the name `reference`; or a dict of
        such arrays by the references' names.
    first_pixel: where the matcher puts the center of the first pixel: 0, or 0.5 as COLMAP and RoMa.
    cell_px: query pixels in one cell of this size are one keypoint, in however many references, for
        dense matchers, whose pixels differ from pair to pair. None: equal pixels are.

        localizer.localize_matches(camera, **raylift.hloc.matches_from({"a.jpg": warp}))
    """
    of_reference = matches if isinstance(matches, Mapping) else {reference: matches}
    rows: List[NDArray[np.float64]] = []
    names: List[str] = []
    for name, array in of_reference.items():
        pairs = np.asarray(array, dtype=np.float64)
        if pairs.size and (pairs.ndim != 2 or pairs.shape[1] != 4):
            raise _core.InputError(
                f"matches of {name!r}: expected an array of shape (N, 4), found {pairs.shape}")
        rows.append(pairs.reshape(-1, 4) + (0.5 - first_pixel))
        names.extend([name] * len(rows[-1]))
    stacked = np.concatenate(rows) if rows else np.zeros((0, 4))
    arguments: GivenMatches = {"query2d": stacked[:, :2], "reference2d": stacked[:, 2:], "reference_names": names}
    if cell_px is not None:
        cells = np.floor(stacked[:, :2] / cell_px)
        arguments["query_keypoints"] = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
    return arguments
