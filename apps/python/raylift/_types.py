"""What arguments may be. Objects of other libraries are known by their attributes alone."""

from __future__ import annotations

import os
from typing import Any, Callable, List, Literal, Mapping, Optional, Protocol, Sequence, Tuple, TypedDict, Union

import numpy.typing

from . import _core


class _Lens(Protocol):
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def params(self) -> object: ...


class ColmapCamera(_Lens, Protocol):
    """pycolmap's cameras, and others like them."""

    @property
    def model(self) -> object: ...


class PoseLibCamera(_Lens, Protocol):
    """poselib's Camera."""

    def model_name(self) -> str: ...


class ColmapPose(Protocol):
    """pycolmap's Rigid3d, and others like it."""

    @property
    def rotation(self) -> object: ...
    @property
    def translation(self) -> object: ...


class PoseLibPose(Protocol):
    """poselib's CameraPose: q is (w, x, y, z)."""

    @property
    def q(self) -> object: ...
    @property
    def t(self) -> object: ...


class ColmapImage(Protocol):
    """pycolmap's images."""

    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> object: ...
    @property
    def cam_from_world(self) -> object: ...


class PoseLibImage(Protocol):
    """poselib's Image."""

    @property
    def camera(self) -> object: ...
    @property
    def pose(self) -> object: ...


CameraLike = Union["_core.Camera", str, Mapping[str, object], ColmapCamera, PoseLibCamera]
PoseLike = Union[
    "_core.Rigid3", ColmapPose, PoseLibPose, Mapping[str, object], numpy.typing.ArrayLike,
    Tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike],
]
PosedImageLike = Union["_core.PosedImage", Tuple[CameraLike, PoseLike], ColmapImage, PoseLibImage]
QueryLike = Union["_core.Query", Tuple[str, CameraLike]]
PathLike = Union[str, "os.PathLike[str]"]
FeaturesLike = Mapping[str, object]
"""Keypoints (N, 2) and descriptors (N, D)."""
PhotographLike = Union[PathLike, numpy.typing.NDArray[numpy.uint8], FeaturesLike]
SpecValue = Union[PathLike, float]
"""What stands after key= in --geometry, or as text after an option."""


class Reconstruction(Protocol):
    """pycolmap's Reconstruction: writes a COLMAP model into a folder."""

    def write(self, folder: str, /) -> object: ...


ModelLike = Union[PathLike, Reconstruction]
HlocConfig = Mapping[str, Mapping[str, Mapping[str, float]]]
"""hloc's: {"estimation": {"ransac": {"max_error": 12}}}."""
Descriptors = Union[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint8]]
"""A row for each keypoint; those of bytes are compared by Hamming distance."""


class OpenCvFeature2D(Protocol):
    """cv2.SIFT_create(), cv2.ORB_create() and others."""

    def detectAndCompute(self, image: numpy.typing.NDArray[numpy.uint8], mask: None, /) -> object: ...


class OpenCvMatcher(Protocol):
    """cv2.BFMatcher and others."""

    def match(self, query: Descriptors, reference: Descriptors, /) -> object: ...


class TensorExtractor(Protocol):
    """SuperPoint, DISK, ALIKED and SIFT of LightGlue."""

    def extract(self, image: Any, /) -> object: ...


class BatchMatcher(Protocol):
    """One that is called once for a query with all its references, a list: returns as many results."""

    def match_batch(self, query: Any, references: List[Any], /) -> Sequence[object]: ...


class DenseMatcher(Protocol):
    """RoMa and DKM."""

    def match(self, query: Any, reference: Any, /) -> object: ...
    def sample(self, warp: Any, certainty: Any, /) -> object: ...
    def to_pixel_coordinates(self, rows: Any, h0: int, w0: int, h1: int, w1: int, /) -> object: ...


Extractor = Union[Callable[[numpy.typing.NDArray[numpy.uint8]], object], OpenCvFeature2D, TensorExtractor]
"""Called with a photograph (H, W, 3): returns keypoints (N, 2) and descriptors (N, D), a dict or pair."""
Matcher = Union[Callable[[Any, Any], object], Callable[[Any], object], OpenCvMatcher, BatchMatcher, DenseMatcher]
"""Called with the photographs of a query and a reference, or with their extractor's features: returns
pixels (N, 4), or indices of keypoints (K, 2). LightGlue alone is called with one dict."""
GlobalDescriptor = Callable[[numpy.typing.NDArray[numpy.uint8]], object]
"""Called with a photograph (H, W, 3): returns a vector (D,), alike for photographs of one place."""
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
    focal_sigma: Optional[float]
    reference_factor_sigma: Optional[float]
    reference_rotation_sigma_deg: Optional[float]
    reference_position_sigma: Optional[float]
    min_iterations: int
    max_iterations: int
    confidence: float
    seed: int


class EstimateOptions(EstimatorOptions, total=False):
    """Those of one who estimates a problem, beside what its scene is known for."""

    scene_calibration: PathLike


class FilterThresholds(TypedDict, total=False):
    """Thresholds of the consistency filter, as of `raylift localize`."""

    filter_reprojection_px: float
    filter_min_views: int
    filter_min_ratio: float


class CandidateOptions(TypedDict, total=False):
    """What becomes of a keypoint's 3D points, as of `raylift localize`."""

    candidates: Literal["keep", "merge", "triangulate"]
    candidates_error_px: float
    candidates_min_angle_deg: float


class HlocOptions(EstimatorOptions, FilterThresholds, CandidateOptions, total=False):
    """Those of Localizer that hloc.localize() takes, too."""

    filter: Literal["off", "fixed", "auto"]
    geometry_mode: Literal["first", "all"]
    min_confidence: float
    max_features: int
    max_ratio: float
    cache: PathLike
    extractor_name: str
    matcher_name: str
    query_images: PathLike
    min_match_score: float
    first_pixel: float
    cell_px: float
    scene_calibration: PathLike
    align_depth: Literal["off", "scale", "affine", "grid", "auto"]
    rerender: int


class LocalizerOptions(HlocOptions, total=False):
    """Options of `raylift localize`, whose defaults they have."""

    features: PathLike
    matches: PathLike
    pairs: PathLike
    top_k: int
    retrieval: Union[Literal["vlad", "global", "pose", "overlap", "covisibility"], GlobalDescriptor]
    global_features: PathLike
    query_global_features: PathLike
    prior_poses: Union[PathLike, Mapping[str, PoseLike]]
    max_angle_deg: float
    view_range: Tuple[float, float]


class QueryOptions(TypedDict, total=False):
    """What Localizer.localize() takes beside a photograph and its camera."""

    name: str
    position_prior: Optional[Tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike]]
    gravity_prior: Optional[Tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, float]]
    heading_prior: Optional[Tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, numpy.typing.ArrayLike, float]]
    orientation_prior: Optional[Tuple[numpy.typing.ArrayLike, float]]
    range_prior: Optional[Tuple[float, float]]
    focal_sigma: Optional[float]
    focal_range: float


class ModelOptions(TypedDict, total=False):
    """How an ONNX file is read and run."""

    roles: Optional[Mapping[str, str]]
    longer_side: Optional[int]
    first_pixel: float
    providers: Optional[Sequence[str]]
    threads: int


class RenderOptions(TypedDict, total=False):
    """How pictures are rendered, as of `raylift render`."""

    shading: Literal["auto", "unlit", "headlight", "sun"]
    normals_in: Literal["world", "camera"]
    supersampling: int
    background: Tuple[int, int, int]


class DepthMapOptions(TypedDict, total=False):
    """What depth maps in memory hold, and how they are sampled."""

    kind: Literal["z", "ray", "inverse"]
    scale: float
    max_depth: float
    interpolation: Literal["edge", "nearest"]
    max_jump: float


class DepthWriteOptions(TypedDict, total=False):
    """How depth is stored, as of `raylift render`."""

    sample: Literal["float", "half"]
    exr_compression: Literal["none", "zips", "zip", "piz", "pxr24", "dwaa"]
    png_step: float
    out_of_range: Literal["refuse", "drop"]
    deflate_npz: bool
    layer: str


GeometryLike = Union["_core.Geometry", "_core.RayCaster", "_core.Mesh", str]
"""Geometry, or a text as the option --geometry takes it."""
