"""What functions return that is a dict. A test compares them with what is returned."""

from __future__ import annotations

from typing import Dict, List, Optional, TypedDict, Union

from numpy import bool_, float32, float64, int64, uint8, uint32, uint64
from numpy.typing import NDArray

from . import _core
from ._types import Descriptors


class RayHits(TypedDict):
    """Of RayCaster.cast(), a row for each ray."""

    ray_t: NDArray[float64]
    points: NDArray[float64]
    normals: NDArray[float64]
    triangles: NDArray[int64]
    barycentric: NDArray[float64]


class Pictures(TypedDict):
    """Of RayCaster.render(): those of these that were asked for."""

    depth: NDArray[float32]
    distance: NDArray[float32]
    inverse_depth: NDArray[float32]
    points: NDArray[float32]
    normals: NDArray[float32]
    color: NDArray[uint8]
    triangle: NDArray[uint32]
    object: NDArray[uint32]
    instance: NDArray[uint32]
    semantic: NDArray[uint32]
    incidence: NDArray[float32]
    mask: NDArray[uint8]


class ViewScores(TypedDict):
    """Of RayCaster.score_views(), one number for each pose: by those of these that were given."""

    mask: NDArray[float64]
    depth: NDArray[float64]
    edges: NDArray[float64]


class LiftedPixels(TypedDict):
    """Of Geometry.lift(), a row for each pixel."""

    points: NDArray[float64]
    normals: NDArray[float64]
    depth: NDArray[float64]
    incidence_deg: NDArray[float64]
    sigma: NDArray[float64]
    depth_jump: NDArray[float64]
    back_face: NDArray[bool_]


class LiftedBySources(LiftedPixels):
    """Of Lifter.lift()."""

    source: NDArray[int64]


class ModelImage(TypedDict):
    """Of ColmapModel.image()."""

    name: str
    camera_id: int
    cam_from_world: _core.Rigid3
    points2d: NDArray[float64]
    point3d_ids: NDArray[int64]


class ModelPoints(TypedDict):
    """ColmapModel.points3d, a row for each point."""

    ids: NDArray[uint64]
    positions: NDArray[float64]
    colors: NDArray[uint8]
    errors_px: NDArray[float64]
    track_lengths: NDArray[int64]


class FoundFeatures(TypedDict):
    """Of extract_features(), a row for each keypoint."""

    keypoints: NDArray[float64]
    descriptors: NDArray[float32]
    scores: NDArray[float32]


class WrittenDepth(TypedDict):
    """Of write_depth()."""

    bytes: int
    dropped: int
    max_rounding: float


class FilterCounts(TypedDict):
    """How many points filter_points() kept, and why it dropped the others."""

    consistent: int
    dropped_by_views: int
    dropped_by_ratio: int
    dropped_by_error: int
    dropped_as_too_few: int


class StageCounts(FilterCounts):
    """LocalizedQuery.counts: what each stage left."""

    retrieved: int
    matched: int
    hit: int
    points: int
    inliers_2d3d: int
    inliers_2d2d: int


class Noise(TypedDict):
    """PoseEstimate.noise: standard deviations."""

    keypoint_px: float
    keypoint_tail: float
    depth: float
    common_depth: float
    reference_factor: float
    reference_rotation_deg: float
    reference_position: float


class AlternativePose(TypedDict):
    """Of PoseEstimate.alternatives: a pose elsewhere, and the probability that it is the right one."""

    cam_from_world: _core.Rigid3
    probability: float
    covariance: Optional[NDArray[float64]]


class Threshold(TypedDict):
    position: float
    rotation_deg: float


class Calibration(TypedDict):
    """How well covariances fit the errors."""

    poses: int
    mean_normalized_square: Optional[float]
    median_normalized_square: Optional[float]
    coverage_90_percent: Optional[float]
    median_sigmas: Optional[float]
    below_3_sigma_percent: Optional[float]


class _Evaluated(TypedDict):
    name: str
    uses_ground_truth: bool
    queries: int
    localized: int
    unknown: int
    recalls_percent: List[Optional[float]]
    median_position: Optional[float]
    median_rotation_deg: Optional[float]
    missing_names: List[str]
    unknown_names: List[str]


class Evaluated(_Evaluated, total=False):
    """A row of evaluate()'s table."""

    calibration: Calibration


class Evaluation(TypedDict):
    """Of evaluate()."""

    thresholds: List[Threshold]
    results: List[Evaluated]


class Finding(TypedDict):
    distortion: str
    amount: float
    severity: float
    text: str


class Explanation(TypedDict):
    """What one cause of a source's errors explains of them."""

    cause: Optional[str]
    size: List[float]
    explained_percent: float
    alike: List[str]
    error: float
    noise: float


class SurfaceScore(TypedDict):
    threshold: float
    accuracy_percent: float
    completeness_percent: float
    f_percent: float


class ComparedSource(TypedDict):
    name: str
    spec: str
    interpretation: str
    is_truth: bool
    findings: List[Finding]
    explanation: Optional[Explanation]
    scale_percent: Optional[float]
    scale_spread_percent: Optional[float]
    common_scale_by_views_percent: Optional[float]
    means: Dict[str, Optional[float]]
    surface: List[SurfaceScore]
    curves: Dict[str, List[Dict[str, float]]]
    images: List[Dict[str, Union[str, float, None]]]


class ComparedDepth(TypedDict):
    truth: Optional[str]
    advice: str
    sources: List[ComparedSource]


class Recall(TypedDict):
    """Intervals hold 95 % of what resampled queries give."""

    position: float
    rotation_deg: float
    percent: float
    interval: List[Optional[float]]
    difference_to_best: List[Optional[float]]
    verdict: str


class _ComparedPose(TypedDict):
    query: str
    position: Optional[float]
    rotation_deg: Optional[float]


class PoseCandidate(TypedDict):
    solver: str
    position: float
    rotation_deg: float
    inliers_2d2d: int
    chosen: bool


class ComparedPose(_ComparedPose, total=False):
    retrieved: int
    matched: int
    hit: int
    consistent: int
    inliers_2d3d: int
    inliers_2d2d: int
    solver: str
    candidates: List[PoseCandidate]
    keypoints: List[List[float]]


class ComparedLocalization(TypedDict):
    name: str
    method: str
    geometry: str
    align: str
    filter: str
    uses_ground_truth: bool
    recalls: List[Recall]
    median_position: Optional[float]
    queries: List[ComparedPose]


class LocalizationTable(TypedDict):
    rows: List[ComparedLocalization]


class Comparison(TypedDict):
    """Of compare()."""

    depth: ComparedDepth
    localization: Optional[LocalizationTable]


class Repair(TypedDict):
    """What to write instead."""

    geometry_keys: List[str]
    replaced_keys: List[str]
    options: List[str]


class Fit(TypedDict):
    median_px: float
    median_px_by_chance: float
    three_quarters_px: float
    three_quarters_px_by_chance: float


class FoundAlignment(TypedDict):
    mode: str
    median_before_px: float
    median_after_px: float
    warning: str


class Reading(TypedDict):
    """How well depth fits the matches where it is read in one way."""

    reading: str
    keypoints: int
    median_px: float
    share_within_5px: float
    median_own_scale_px: float
    gain: float
    standard_errors: float
    geometry_keys: List[str]
    options: List[str]


class _Diagnosis(TypedDict):
    verdict: str
    fault: str
    reason: str
    suspicious: bool
    summary: str
    repair: Repair
    matches: int
    matches_that_fit_the_poses: int
    median_epipolar_px: float
    fit: Fit
    alignment: FoundAlignment
    readings: List[Reading]


class Diagnosis(_Diagnosis, total=False):
    """Of doctor()."""

    best: str
    world_from_mesh: List[List[float]]
    mesh: str


class RenderedJob(TypedDict, total=False):
    """What was rendered, and how."""

    raylift_version: str
    mesh: Dict[str, Union[int, str]]
    cloud: Dict[str, Union[int, str]]
    splats: Dict[str, Union[int, str]]
    products: Dict[str, Dict[str, object]]


class RenderSummary(TypedDict):
    """Of render_dataset()."""

    images: int
    pixels: int
    coverage: float
    least_coverage: float
    images_without_surface: List[str]
    depth_range: Optional[List[float]]
    dropped_values: int
    bytes: int
    warnings: List[str]
    job: RenderedJob


class Doubt(TypedDict):
    name: str
    verdict: str
    confidence: float
    reason: str


class Alignment(TypedDict):
    mode: str
    median_factor: float
    median_before_px: float
    median_after_px: float


class _UsedGeometry(TypedDict):
    spec: str
    interpretation: str


class UsedGeometry(_UsedGeometry, total=False):
    alignment: Alignment


class KnownNoise(TypedDict, total=False):
    sigma: float
    errors: float


class WrittenPose(TypedDict):
    """World to camera."""

    qvec: List[float]
    tvec: List[float]


class _WrittenAlternative(TypedDict):
    cam_from_world: WrittenPose
    probability: float


class WrittenAlternative(_WrittenAlternative, total=False):
    covariance: List[List[float]]


class MatchScore(TypedDict):
    matches: int
    inliers: int
    msac_cost: float


class _Session(TypedDict):
    token: str


class Session(_Session, total=False):
    """A walk's photograph: the token for the next one, and where odometry's frame is."""

    world_from_odometry: Optional[WrittenPose]
    scale: float


class Walked(TypedDict):
    """What a walk did with a photograph; single_*: its own result."""

    role: str
    time_s: Optional[float]
    lost_before: bool
    rematched: bool
    single_confidence: float
    single_cam_from_world: Optional[WrittenPose]


class _QueryLine(StageCounts):
    name: str
    status: str
    reason: str
    verdict: str
    confidence: float
    points_by_geometry: List[int]
    keypoints: int
    inlier_keypoints: int
    iterations: int


class QueryLine(_QueryLine, total=False):
    """A line of queries.jsonl; of a server, too."""

    rig: str
    keypoint_noise_px: float
    geometry_noise_px: float
    cam_from_world: WrittenPose
    solver: str
    position_observable: bool  # of a pose whose orientation alone is known: false
    score_2d3d: MatchScore
    score_2d2d: MatchScore
    ransac_value: float
    refined_value: float
    noise: Noise
    refined_camera: str
    rotation_sigma_deg: float
    position_sigma: float
    covariance: List[List[float]]
    alternatives: List[WrittenAlternative]
    rerender_rounds_kept: int
    walk: Walked
    session: Session
    geopose: Dict[str, Dict[str, float]]


class ServedScene(TypedDict):
    """Of Client.scenes()."""

    name: str
    references: int
    geometry: List[str]
    calibrated: bool


class Sharpened(TypedDict):
    """What rerendering did."""

    queries_improved: int
    rounds_kept: int


class _LocalizeSummary(TypedDict):
    queries: int
    localized: int
    verdicts: Dict[str, int]
    least_confident: List[Doubt]
    references: int
    geometry: List[UsedGeometry]
    medians: Dict[str, float]
    warnings: List[str]


class LocalizeSummary(_LocalizeSummary, total=False):
    """Of localize()."""

    scene_noise: Dict[str, Union[float, KnownNoise]]
    rerender: Sharpened


class _GraphFeatures(TypedDict):
    keypoints: NDArray[float64]
    descriptors: Descriptors
    image_size: NDArray[int64]


class GraphFeatures(_GraphFeatures, total=False):
    """Of onnx.Extractor: a photograph's features, a row for each keypoint, and its (width, height)."""

    scores: NDArray[float32]


class GraphMatches(TypedDict):
    """Of onnx.Matcher: those of these that there are. mkpts0 and mkpts1 are pixels that match, matches
    are indices, of keypoints0 and keypoints1 or of the features that were given."""

    mkpts0: NDArray[float64]
    mkpts1: NDArray[float64]
    keypoints0: NDArray[float64]
    keypoints1: NDArray[float64]
    matches: NDArray[int64]
    scores: NDArray[float32]


class _GivenMatches(TypedDict):
    query2d: NDArray[float64]
    reference2d: NDArray[float64]
    reference_names: List[str]


class GivenMatches(_GivenMatches, total=False):
    """Of hloc.matches_from(): arguments of Localizer.localize_matches()."""

    query_keypoints: NDArray[int64]


class FirstPixel(TypedDict):
    """Of onnx.doctor(): where the center of the first pixel is, its standard deviation, and which of what was
    stated, 0 and 0.5 it fits, None: none."""

    x: float
    y: float
    sigma: float
    stated: float
    fits: Optional[float]
    text: str
