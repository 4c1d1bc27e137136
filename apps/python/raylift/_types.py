"""What arguments may be. Objects of other libraries are known by their attributes alone."""

from __future__ import annotations

import os
from typing import Any, Callable, Literal, Mapping, Protocol, Sequence, Tuple, TypedDict, Union

import numpy.typing

from . import _core


class ColmapCamera(Protocol):
    """pycolmap's cameras, and others like them."""

    @property
    def model(self) -> Any: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def params(self) -> Any: ...


class ColmapPose(Protocol):
    """pycolmap's Rigid3d, and others like it."""

    @property
    def rotation(self) -> Any: ...
    @property
    def translation(self) -> Any: ...


class PoseLibPose(Protocol):
    """poselib's CameraPose: q is (w, x, y, z)."""

    @property
    def q(self) -> Any: ...
    @property
    def t(self) -> Any: ...


class ColmapImage(Protocol):
    """pycolmap's images."""

    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> Any: ...
    @property
    def cam_from_world(self) -> Any: ...


CameraLike = Union["_core.Camera", str, Mapping[str, Any], ColmapCamera]
PoseLike = Union[
    "_core.Rigid3", ColmapPose, PoseLibPose, Mapping[str, Any], numpy.typing.ArrayLike,
    Tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike],
]
PosedImageLike = Union["_core.PosedImage", Tuple[CameraLike, PoseLike], ColmapImage]
PathLike = Union[str, "os.PathLike[str]"]
Progress = Callable[[int, int, str], object]
"""Called with (done, total, what): 3 of 10 "queries"."""


class EstimatorOptions(TypedDict, total=False):
    """Options of the estimator, as of `raylift estimate`, whose defaults they have."""

    method: Literal["p3p", "e5p1", "d3p1", "adaptive", "select", "hybrid_ransac", "hloc"]
    score: Literal["sum_inl", "sum_inl_rat", "mult_inl", "sum_msac", "mult_msac"]
    lo: Literal["hybrid", "split"]
    alpha: float
    refinement: Literal["robust", "paper"]
    reprojection_threshold_px: float
    sampson_threshold_px: float
    point_sigma: float
    refine_focal: bool
    focal_range: float
    min_iterations: int
    max_iterations: int
    confidence: float
    seed: int


GeometryLike = Union["_core.Geometry", "_core.RayCaster", "_core.Mesh", str]
"""Geometry, or a text as the option --geometry takes it."""
