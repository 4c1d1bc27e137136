# Written by make_options.py; do not edit.
"""The options of the program's commands, which its functions take as keywords."""

from __future__ import annotations

from typing import Literal, Sequence, SupportsIndex, TypedDict

from ._types import Progress, SpecValue


class ColorOptions(TypedDict, total=False):
    """Options of color(): `raylift color --help` explains them."""

    progress: Progress | None
    config: SpecValue | None
    every: SupportsIndex | None
    every_offset: SupportsIndex | None
    every_per_camera: bool
    images: SpecValue | None
    keep_exposures: bool
    max_edge: float | None
    model: SpecValue | None
    model_poses: Literal["cam_from_world", "world_from_cam", "opengl", "world_from_opengl"] | None
    quiet: bool
    threads: SupportsIndex | None


class CompareOptions(TypedDict, total=False):
    """Options of compare(): `raylift compare --help` explains them."""

    progress: Progress | None
    alignments: SpecValue | None
    cache: SpecValue | None
    candidates: Literal["keep", "merge", "triangulate"] | None
    candidates_error_px: float | None
    candidates_min_angle_deg: float | None
    cell_px: float | None
    confidence: float | None
    config: SpecValue | None
    every: SupportsIndex | None
    every_offset: SupportsIndex | None
    every_per_camera: bool
    features: SpecValue | None
    filter_min_ratio: float | None
    filter_min_views: SupportsIndex | None
    filter_reprojection_px: float | None
    filters: SpecValue | None
    first_pixel: float | None
    focal_range: float | None
    focal_sigma: float | None
    global_features: SpecValue | None
    ground_truth: SpecValue | None
    images: SpecValue | None
    matches: SpecValue | None
    max_angle_deg: float | None
    max_depth: float | None
    max_features: SupportsIndex | None
    max_iterations: SupportsIndex | None
    max_ratio: float | None
    max_side: SupportsIndex | None
    methods: SpecValue | None
    min_depth: float | None
    min_iterations: SupportsIndex | None
    min_match_score: float | None
    model_poses: Literal["cam_from_world", "world_from_cam", "opengl", "world_from_opengl"] | None
    overlaps: SupportsIndex | None
    overwrite: bool
    pairs: SpecValue | None
    point_sigma: float | None
    prior_poses: SpecValue | None
    protocol: SpecValue | None
    queries: SpecValue | None
    query_global_features: SpecValue | None
    query_images: SpecValue | None
    quiet: bool
    reference_factor_sigma: float | None
    reference_position_sigma: float | None
    reference_rotation_sigma_deg: float | None
    refine_focal: bool
    refinement: Literal["robust", "paper"] | None
    report: SpecValue | None
    reprojection_threshold_px: float | None
    resume: bool
    retrieval: Literal["vlad", "global", "pose", "overlap", "covisibility"] | None
    sampson_threshold_px: float | None
    scene: SpecValue | None
    seed: SupportsIndex | None
    surface_thresholds: float | Sequence[float] | None
    threads: SupportsIndex | None
    thresholds: SpecValue | None
    top_k: SupportsIndex | None
    truth: SpecValue | None
    view_range: float | Sequence[float] | None


class DoctorOptions(TypedDict, total=False):
    """Options of doctor(): `raylift doctor --help` explains them."""

    progress: Progress | None
    cache: SpecValue | None
    cell_px: float | None
    config: SpecValue | None
    every: SupportsIndex | None
    every_offset: SupportsIndex | None
    every_per_camera: bool
    features: SpecValue | None
    first_pixel: float | None
    global_features: SpecValue | None
    images: SpecValue | None
    matches: SpecValue | None
    max_angle_deg: float | None
    max_features: SupportsIndex | None
    max_ratio: float | None
    min_match_score: float | None
    model_poses: Literal["cam_from_world", "world_from_cam", "opengl", "world_from_opengl"] | None
    pairs: SpecValue | None
    prior_poses: SpecValue | None
    queries: SpecValue | None
    query_global_features: SpecValue | None
    query_images: SpecValue | None
    quiet: bool
    report: SpecValue | None
    retrieval: Literal["vlad", "global", "pose", "overlap", "covisibility"] | None
    scene: SpecValue | None
    threads: SupportsIndex | None
    top_k: SupportsIndex | None
    view_range: float | Sequence[float] | None


class EvaluateOptions(TypedDict, total=False):
    """Options of evaluate(): `raylift evaluate --help` explains them."""

    progress: Progress | None
    calibration: bool
    check_submission: bool
    config: SpecValue | None
    csv: SpecValue | None
    dcre_csv: SpecValue | None
    geometry: SpecValue | None
    groups: SpecValue | None
    model: SpecValue | None
    names: SpecValue | Sequence[SpecValue] | None
    queries: SpecValue | None
    quiet: bool
    report: SpecValue | None
    scene: SpecValue | None
    threads: SupportsIndex | None
    times: SpecValue | None
    trajectory_json: SpecValue | None


class ExperimentOptions(TypedDict, total=False):
    """Options of experiment(): `raylift experiment --help` explains them."""

    progress: Progress | None
    config: SpecValue | None
    datasets: SpecValue | None
    dry_run: bool
    overwrite: bool
    own_features: bool
    quiet: bool
    resume: bool
    shard: SpecValue | None
    threads: SupportsIndex | None


class ExportOptions(TypedDict, total=False):
    """Options of export(): `raylift export --help` explains them."""

    progress: Progress | None
    angles: bool
    config: SpecValue | None
    crs: SpecValue | None
    frustum_size: SpecValue | None
    geometry: SpecValue | None
    max_triangles: SupportsIndex | None
    min_confidence: float | None
    model: SpecValue | None
    names: Literal["full", "file", "camera"] | None
    queries: SpecValue | None
    query_images: SpecValue | None
    quiet: bool
    threads: SupportsIndex | None
    times: SpecValue | None
    to_crs: SpecValue | None
    up: SpecValue | None


class ImportDatasetOptions(TypedDict, total=False):
    """Options of import_dataset(): `raylift import --help` explains them."""

    progress: Progress | None
    calibration: Literal["color", "raw"] | None
    camera: SpecValue | None
    config: SpecValue | None
    pgt: SpecValue | None
    query_every: SupportsIndex | None
    quiet: bool
    split: SpecValue | None


class LocalizeOptions(TypedDict, total=False):
    """Options of localize(): `raylift localize --help` explains them."""

    progress: Progress | None
    align: Literal["matches", "edges"] | None
    align_depth: Literal["off", "scale", "affine", "grid", "auto"] | None
    alpha: float | None
    cache: SpecValue | None
    cam_from_body: SpecValue | None
    candidates: Literal["keep", "merge", "triangulate"] | None
    candidates_error_px: float | None
    candidates_min_angle_deg: float | None
    cell_px: float | None
    confidence: float | None
    config: SpecValue | None
    continuous: bool
    crs: SpecValue | None
    every: SupportsIndex | None
    every_offset: SupportsIndex | None
    every_per_camera: bool
    features: SpecValue | None
    filter: Literal["off", "fixed", "auto"] | None
    filter_min_ratio: float | None
    filter_min_views: SupportsIndex | None
    filter_reprojection_px: float | None
    first_pixel: float | None
    focal_range: float | None
    focal_sigma: float | None
    geometry: SpecValue | Sequence[SpecValue] | None
    geometry_mode: Literal["first", "all"] | None
    global_features: SpecValue | None
    ground_truth: SpecValue | None
    images: SpecValue | None
    join_any_difference: bool
    join_max_difference_deg: float | None
    join_max_difference_position: float | None
    join_max_position_sigma: float | None
    join_max_rotation_sigma_deg: float | None
    join_min_inliers_2d2d: SupportsIndex | None
    join_min_inliers_2d3d: SupportsIndex | None
    leave_one_out: bool
    lo: Literal["hybrid", "split"] | None
    matches: SpecValue | None
    max_angle_deg: float | None
    max_features: SupportsIndex | None
    max_iterations: SupportsIndex | None
    max_joined: SupportsIndex | None
    max_ratio: float | None
    method: Literal["p3p", "e5p1", "d3p1", "adaptive", "select", "hybrid_ransac", "hloc"] | None
    min_confidence: float | None
    min_iterations: SupportsIndex | None
    min_match_score: float | None
    model: SpecValue | None
    model_poses: Literal["cam_from_world", "world_from_cam", "opengl", "world_from_opengl"] | None
    no_doctor: bool
    no_rematch: bool
    odometry: SpecValue | None
    odometry_scale: Literal["known", "unknown"] | None
    online: bool
    overwrite: bool
    pairs: SpecValue | None
    pictures: SupportsIndex | None
    point_sigma: float | None
    prior_poses: SpecValue | None
    priors: SpecValue | None
    queries: SpecValue | None
    query_global_features: SpecValue | None
    query_images: SpecValue | None
    quiet: bool
    reference_factor_sigma: float | None
    reference_position_sigma: float | None
    reference_rotation_sigma_deg: float | None
    refine_focal: bool
    refinement: Literal["robust", "paper"] | None
    report: SpecValue | None
    reprojection_threshold_px: float | None
    rerender: SupportsIndex | None
    resume: bool
    retrieval: Literal["vlad", "global", "pose", "overlap", "covisibility"] | None
    rigs: SpecValue | None
    sampson_threshold_px: float | None
    scene: SpecValue | None
    scene_calibration: SpecValue | None
    score: Literal["sum_inl", "sum_inl_rat", "mult_inl", "sum_msac", "mult_msac"] | None
    seed: SupportsIndex | None
    server: SpecValue | None
    shard: SpecValue | None
    threads: SupportsIndex | None
    times: SpecValue | None
    token_file: SpecValue | None
    top_k: SupportsIndex | None
    trust_joined: bool
    view_clearance: float | None
    view_eye_height: float | None
    view_fov_deg: SpecValue | None
    view_kind: Literal["auto", "inside", "around", "cover"] | None
    view_range: float | Sequence[float] | None
    view_size: SpecValue | None
    view_up: SpecValue | None
    views: SupportsIndex | None
    write_model: SpecValue | None
    write_problems: SpecValue | None


class RenderDatasetOptions(TypedDict, total=False):
    """Options of render_dataset(): `raylift render --help` explains them."""

    progress: Progress | None
    background: SpecValue | None
    camera_files: SpecValue | None
    cameras: SpecValue | None
    config: SpecValue | None
    cubemap: SpecValue | None
    deflate_npz: bool
    every: SupportsIndex | None
    every_offset: SupportsIndex | None
    every_per_camera: bool
    exr_compression: Literal["none", "zips", "zip", "piz", "pxr24", "dwaa"] | None
    format: SpecValue | Sequence[SpecValue] | None
    glob: SpecValue | None
    jpeg_quality: SupportsIndex | None
    list_images: SpecValue | None
    log_json: bool
    model: SpecValue | None
    normals_in: Literal["world", "camera"] | None
    out_of_range: Literal["refuse", "drop"] | None
    overwrite: bool
    panorama: SpecValue | None
    pattern: SpecValue | None
    photographs: SpecValue | None
    png_step: float | None
    preview: bool
    quiet: bool
    report: SpecValue | None
    resume: bool
    sample: Literal["float", "half"] | None
    scale: SpecValue | None
    scene: SpecValue | None
    semantics: SpecValue | None
    shading: Literal["unlit", "headlight", "sun", "auto"] | None
    shard: SpecValue | None
    size: SpecValue | None
    supersampling: SupportsIndex | None
    threads: SupportsIndex | None


class RetrieveOptions(TypedDict, total=False):
    """Options of retrieve(): `raylift pairs --help` explains them."""

    progress: Progress | None
    cache: SpecValue | None
    config: SpecValue | None
    every: SupportsIndex | None
    every_offset: SupportsIndex | None
    every_per_camera: bool
    geometry: SpecValue | None
    global_features: SpecValue | None
    images: SpecValue | None
    max_angle_deg: float | None
    max_features: SupportsIndex | None
    model: SpecValue | None
    model_poses: Literal["cam_from_world", "world_from_cam", "opengl", "world_from_opengl"] | None
    prior_poses: SpecValue | None
    queries: SpecValue | None
    query_global_features: SpecValue | None
    query_images: SpecValue | None
    quiet: bool
    retrieval: Literal["vlad", "global", "pose", "overlap", "covisibility"] | None
    scores: SpecValue | None
    seed: SupportsIndex | None
    threads: SupportsIndex | None
    top_k: SupportsIndex | None
    view_range: float | Sequence[float] | None
