# Written by make_stubs.py; do not edit.
"""
The compiled part of raylift.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import raylift._results
import raylift._types
import typing
import typing_extensions
__all__: list[str] = ['Camera', 'ColmapModel', 'DepthMaps', 'Geometry', 'InputError', 'InputTypeError', 'Lifter', 'LocalizedQuery', 'Localizer', 'Mesh', 'OptionError', 'PYBIND11_MAJOR', 'PoseEstimate', 'PoseProblem', 'PosedImage', 'Query', 'RayCaster', 'Rigid3', 'Scene', 'SceneTracker', 'SfmPoints', 'TrackedPose', 'VERSION', 'estimate', 'estimate_all', 'extract_features', 'filter_points', 'kinds_of_options', 'merge_candidates', 'read_depth', 'read_image', 'read_poses', 'read_queries', 'refine_pose', 'run_command', 'run_program', 'solve_d3p1', 'solve_e5p1', 'solve_gp3p', 'solve_known_center', 'solve_p3p', 'solve_up2p', 'write_depth', 'write_poses', 'write_queries']
class InputError(ValueError):
    """
    Bad input: a file, or an argument's value. One line that names it, the place
    in it, what was expected and what was found.
    """
class OptionError(ValueError):
    """
    A bad option: "name = value: constraint".
    """
class InputTypeError(InputError, TypeError):
    """
    An argument of a wrong type, which is a TypeError, too.
    """
class Camera:
    """
    A camera's intrinsics, of any of COLMAP's models.

    The frame is COLMAP's: x right, y down, z forward. So are pixels: the center of the first
    one is (0.5, 0.5). Wherever a camera is an argument, the text "MODEL width height
    params...", a dict with model, width, height and params, and pycolmap's cameras serve, too.
    """
    @staticmethod
    def from_matrix(matrix: numpy.typing.ArrayLike, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> Camera:
        """
        A PINHOLE from the 3 x 3 matrix of its focal lengths and principal point, that of
        Camera.matrix. Where the center of the first pixel is (0, 0), as OpenCV's, 0.5 is to be added to
        the principal point.
        """
    @staticmethod
    def of(camera: raylift._types.CameraLike) -> Camera:
        """
        From anything that an argument `camera` may be.
        """
    def __eq__(self, other: object) -> bool:
        ...
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, model: str, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex, params: numpy.typing.ArrayLike) -> None:
        """
        From COLMAP's name of the model ("SIMPLE_RADIAL"), the image's size in pixels and the
        model's parameters in COLMAP's order.

        Raises InputError for a wrong count of parameters, or one out of its range.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def __str__(self) -> str:
        """
        "MODEL width height params..."
        """
    def project(self, points: numpy.typing.ArrayLike) -> numpy.typing.NDArray[numpy.float64]:
        """
        The pixels (N, 2) of points (N, 3) in the camera's frame; NaN where a point is behind the
        camera or outside the lens model's domain.
        """
    def rays(self, pixels: numpy.typing.ArrayLike) -> numpy.typing.NDArray[numpy.float64]:
        """
        The unit rays (N, 3) in the camera's frame through pixels (N, 2); NaN where there is none.
        """
    def scaled(self, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> Camera:
        """
        The same lens on an image of another size.
        """
    @property
    def height(self) -> int:
        """
        Pixels.
        """
    @property
    def matrix(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        3 x 3: focal lengths and principal point in pixels, without the distortion.
        """
    @property
    def model(self) -> str:
        """
        COLMAP's name of the model.
        """
    @property
    def params(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        The model's parameters in COLMAP's order.
        """
    @property
    def width(self) -> int:
        """
        Pixels.
        """
class Rigid3:
    """
    A rigid motion of space, named target_from_source: cam_from_world takes points of the world
    to the camera's frame. Products chain: a_from_c = a_from_b * b_from_c.

    Wherever a pose is an argument, a 4 x 4 or 3 x 4 matrix, a pair (qvec, tvec), a dict with
    these keys, and the poses of pycolmap and PoseLib serve, too.
    """
    @staticmethod
    def from_matrix(matrix: numpy.typing.ArrayLike) -> Rigid3:
        """
        From a 4 x 4 or 3 x 4 matrix, that of Rigid3.matrix.
        """
    @staticmethod
    def of(pose: raylift._types.PoseLike) -> Rigid3:
        """
        From anything that an argument `pose` may be.
        """
    def __array__(self, dtype: numpy.typing.DTypeLike | None = None, copy: bool | None = None) -> numpy.typing.NDArray[numpy.float64]:
        """
        The matrix, 4 x 4.
        """
    def __eq__(self, other: object) -> bool:
        """
        Equal in every number; poses that are computed differ by rounding.
        """
    def __getstate__(self) -> tuple[numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]:
        ...
    def __hash__(self) -> int:
        ...
    @typing.overload
    def __init__(self, rotation: numpy.typing.ArrayLike, translation: numpy.typing.ArrayLike) -> None:
        """
        From a quaternion (w, x, y, z) or a 3 x 3 matrix, and a translation in scene units.

        Raises InputError for what is no rotation.
        """
    @typing.overload
    def __init__(self) -> None:
        """
        The identity.
        """
    def __matmul__(self, other: Rigid3) -> Rigid3:
        ...
    @typing.overload
    def __mul__(self, other: Rigid3) -> Rigid3:  # pyright: ignore[reportOverlappingOverload]
        ...
    @typing.overload
    def __mul__(self, other: numpy.typing.ArrayLike) -> numpy.typing.NDArray[numpy.float64]:
        """
        With another motion, or with points (3,) or (N, 3) of the source.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def inverse(self) -> Rigid3:
        """
        source_from_target.
        """
    def transform(self, points: numpy.typing.ArrayLike) -> numpy.typing.NDArray[numpy.float64]:
        """
        Points (N, 3), or one (3,), of the source in the target's frame.
        """
    @property
    def center(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Of cam_from_world: the camera's center in the world (3,).
        """
    @property
    def matrix(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        4 x 4.
        """
    @property
    def qvec(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        The rotation as a unit quaternion (w, x, y, z).
        """
    @property
    def rotation(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        The rotation as a 3 x 3 matrix.
        """
    @property
    def tvec(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        The translation (3,), scene units.
        """
class Query(tuple[str, Camera]):
    """
    A photograph whose pose is looked for: its name, its camera and what is known beforehand.

    It unpacks as the pair (name, camera), which serves wherever one is an argument.
    """
    def __eq__(self, other: object) -> bool:
        """
        With another Query, or a pair.
        """
    def __new__(cls, *args: object, **kwargs: object) -> Query:
        ...
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, name: str, camera: raylift._types.CameraLike | None = None, *, images: raylift._types.PathLike | None = None, position_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike] | None = None, gravity_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, heading_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, orientation_prior: tuple[numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, range_prior: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex] | None = None, focal_sigma: typing.SupportsFloat | typing.SupportsIndex | None = None, focal_range: typing.SupportsFloat | typing.SupportsIndex = 1.0, rig: tuple[str, typing.SupportsInt | typing.SupportsIndex, raylift._types.PoseLike] | None = None) -> None:
        """
        images: in place of the camera, the folder of the photograph, whose focal length EXIF tells or
        localizing finds. position_prior: (position, sigma) of the camera's center in the world, sigma
        one number or one per axis. gravity_prior: (down_in_cam, down_in_world, sigma_deg).
        heading_prior: (right_in_cam, right_in_world, down_in_world, sigma_deg), of a compass: where y is
        north and z up, a camera that is held upright and looks h clockwise from north has (1, 0, 0) and
        (cos h, -sin h, 0). orientation_prior: (rotation, sigma_deg), of cam_from_world, a quaternion
        (w, x, y, z) or a 3 x 3 matrix. range_prior: (range, sigma), along the optical axis to the
        surface, by a laser. focal_sigma: standard deviation of the camera's focal length as a share of
        it. focal_range: it is the camera's up to this factor either way. rig: (frame, sensor,
        cam_from_rig), for photographs that a rig took at one moment, the frame, with the sensor of this
        index; what is known of the pose is that of the first sensor's.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    @property
    def camera(self) -> Camera:
        ...
    @property
    def focal_range(self) -> float:
        ...
    @property
    def focal_sigma(self) -> float | None:
        """
        None: nothing is known of it.
        """
    @property
    def gravity_prior(self) -> tuple[list[float], list[float], float] | None:
        """
        (down_in_cam, down_in_world, sigma_deg), or None.
        """
    @property
    def heading_prior(self) -> tuple[list[float], list[float], list[float], float] | None:
        """
        (right_in_cam, right_in_world, down_in_world, sigma_deg), or None.
        """
    @property
    def name(self) -> str:
        ...
    @property
    def orientation_prior(self) -> tuple[list[float], float] | None:
        """
        (quaternion, sigma_deg) of cam_from_world, (w, x, y, z); or None.
        """
    @property
    def position_prior(self) -> tuple[list[float], list[float]] | None:
        """
        (position, sigma), lists; or None.
        """
    @property
    def range_prior(self) -> tuple[float, float] | None:
        """
        (range, sigma), or None.
        """
    @property
    def rig(self) -> tuple[str, int, Rigid3] | None:
        """
        (frame, sensor, cam_from_rig) where a rig took it, or None.
        """
class PosedImage:
    """
    A reference photograph: its name, its camera and where it was taken.

    Wherever one is an argument, a pair (camera, cam_from_world) and
    pycolmap's images serve, too.
    """
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[str, Camera, Rigid3]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, name: str, camera: raylift._types.CameraLike, cam_from_world: raylift._types.PoseLike) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[str, Camera, Rigid3]) -> None:
        ...
    @property
    def cam_from_world(self) -> Rigid3:
        ...
    @property
    def camera(self) -> Camera:
        ...
    @property
    def name(self) -> str:
        """
        As in the model: a path within the image folder.
        """
class PoseProblem:
    """
    All that an estimator sees of one query: 2D-3D matches, 2D-2D matches, or both.
    """
    __hash__: typing.ClassVar[None]  # type: ignore[assignment]
    @staticmethod
    def read(file: raylift._types.PathLike) -> PoseProblem:
        """
        Raises InputError with the JSON path of what is wrong.
        """
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[str, str]:
        ...
    def __init__(self, camera: raylift._types.CameraLike, points2d: numpy.typing.ArrayLike | None = None, points3d: numpy.typing.ArrayLike | None = None, *, point_sigmas: numpy.typing.ArrayLike | None = None, point_references: numpy.typing.ArrayLike | None = None, point_keypoints: numpy.typing.ArrayLike | None = None, point_matches: numpy.typing.ArrayLike | None = None, references: collections.abc.Sequence[raylift._types.PosedImageLike] = [], query2d: numpy.typing.ArrayLike | None = None, reference2d: numpy.typing.ArrayLike | None = None, reference_index: numpy.typing.ArrayLike | None = None, reference_sigmas_px: numpy.typing.ArrayLike | None = None, query_keypoints: numpy.typing.ArrayLike | None = None, reference_keypoints: numpy.typing.ArrayLike | None = None, reference_clusters: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex] = [], position_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike] | None = None, gravity_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, heading_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, orientation_prior: tuple[numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, focal_sigma: typing.SupportsFloat | typing.SupportsIndex | None = None, name: str = '') -> None:
        """
        The arguments are those of raylift.estimate_pose(), and the camera's focal_sigma.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[str, str]) -> None:
        ...
    def write(self, file: raylift._types.PathLike) -> None:
        """
        As JSON (pose-problem/2), which `raylift estimate` reads.
        """
    @property
    def camera(self) -> Camera:
        """
        The query's.
        """
    @property
    def name(self) -> str:
        """
        The query's; estimates depend on it.
        """
    @property
    def point_keypoints(self) -> numpy.typing.NDArray[numpy.int64]:
        """
        Index of the query's keypoint (N,); -1: not known.
        """
    @property
    def point_matches(self) -> numpy.typing.NDArray[numpy.int64]:
        """
        Index of the 2D-2D match that each point was lifted from (N,); -1: none.
        """
    @property
    def point_references(self) -> numpy.typing.NDArray[numpy.int64]:
        """
        Index of the reference that each point was lifted from (N,); -1: none.
        """
    @property
    def points2d(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Query pixels (N, 2) of the 2D-3D matches.
        """
    @property
    def points3d(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Their points in the world (N, 3).
        """
    @property
    def query2d(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Query pixels (M, 2) of the 2D-2D matches.
        """
    @property
    def query_keypoints(self) -> numpy.typing.NDArray[numpy.int64]:
        """
        Index of the query's keypoint (M,); -1: not known.
        """
    @property
    def reference2d(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Their reference pixels (M, 2).
        """
    @property
    def reference_index(self) -> numpy.typing.NDArray[numpy.int64]:
        """
        Which reference (M,).
        """
    @property
    def references(self) -> list[PosedImage]:
        ...
class PoseEstimate:
    """
    What an estimator found. True where there is a pose.
    """
    __hash__: typing.ClassVar[None]  # type: ignore[assignment]
    def __bool__(self) -> bool:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> str:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: str) -> None:
        ...
    def _repr_html_(self) -> str:
        ...
    @property
    def alternatives(self) -> list[raylift._results.AlternativePose]:
        """
        Poses elsewhere that explain the matches about as well, so that the pose is doubtful; the likeliest first.
        """
    @property
    def cam_from_world(self) -> Rigid3 | None:
        """
        The pose; None where there is none.
        """
    @property
    def confidence(self) -> float:
        """
        The probability that the pose is right.
        """
    @property
    def covariance(self) -> numpy.typing.NDArray[numpy.float64] | None:
        """
        6 x 6, of a step (rotation vector in radians, translation in scene units) in the camera's
        frame: the true pose is exp(w), v after the estimated one. None where the inliers do not
        determine the pose.
        """
    @property
    def failure(self) -> str:
        """
        Why there is no pose; "ok" where there is one.
        """
    @property
    def inlier_keypoints(self) -> int:
        """
        Of the query: one counts once, in however many references.
        """
    @property
    def inlier_mask(self) -> numpy.typing.NDArray[numpy.bool_]:
        """
        Which matches agree with the pose (N + M,), bool: inliers_2d3d and inliers_2d2d.
        """
    @property
    def inliers_2d2d(self) -> numpy.typing.NDArray[numpy.bool_]:
        """
        Which 2D-2D matches agree with the pose (M,), bool.
        """
    @property
    def inliers_2d3d(self) -> numpy.typing.NDArray[numpy.bool_]:
        """
        Which 2D-3D matches agree with the pose (N,), bool.
        """
    @property
    def iterations(self) -> int:
        """
        Of RANSAC.
        """
    @property
    def noise(self) -> raylift._results.Noise | None:
        """
        What Adaptive found the matches to be worth (standard deviations), or None.
        """
    @property
    def num_inliers(self) -> int:
        """
        Of both kinds of matches.
        """
    @property
    def num_inliers_2d2d(self) -> int:
        ...
    @property
    def num_inliers_2d3d(self) -> int:
        ...
    @property
    def num_keypoints(self) -> int:
        """
        That have matches.
        """
    @property
    def position_observable(self) -> bool:
        """
        False where only the orientation is determined.
        """
    @property
    def position_sigma(self) -> float:
        """
        Standard deviation of the camera's center, scene units; 0 without a covariance.
        """
    @property
    def refined_camera(self) -> Camera | None:
        """
        The camera with the refined focal length, with refine_focal; else None.
        """
    @property
    def rotation_sigma_deg(self) -> float:
        """
        Standard deviation of the orientation, degrees; 0 without a covariance.
        """
    @property
    def solver(self) -> str:
        """
        Which minimal solver the pose comes from: "p3p", "e5p1" or "d3p1".
        """
    @property
    def verdict(self) -> str:
        """
        "localized", "doubtful" or "failed".
        """
class Mesh:
    """
    A triangle mesh.
    """
    __hash__: typing.ClassVar[None]  # type: ignore[assignment]
    @staticmethod
    def read(files: raylift._types.PathLike, *, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> Mesh:
        """
        Reads PLY, OBJ, glTF, STL, ...: a file, "a.ply+b.obj", "tiles/*.ply", a folder, or
        "mesh:PATH[,key=value...]" as the option --geometry takes it.

        Raises InputError where a file cannot be read.
        """
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __init__(self, vertices: numpy.typing.ArrayLike, triangles: numpy.typing.ArrayLike, colors: numpy.typing.ArrayLike | None = None) -> None:
        """
        From vertices (N, 3) in the world, triangles (M, 3) of indices and, where there are any,
        the vertices' colors (N, 3), uint8.

        Triangles without an area are left out, as are vertices that no triangle uses. Raises
        InputError for an index out of range.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def _repr_png_(self) -> bytes | None:
        """
        A picture of it from outside.
        """
    @property
    def colors(self) -> numpy.typing.NDArray[numpy.uint8] | None:
        """
        The vertices' colors (N, 3), uint8, or None. A view.
        """
    @property
    def has_texture(self) -> bool:
        ...
    @property
    def triangles(self) -> numpy.typing.NDArray[numpy.uint32]:
        """
        (M, 3), uint32: indices of vertices. A view.
        """
    @property
    def vertices(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        (N, 3) in the world; a copy, as they are held in float around an origin.
        """
    @property
    def warnings(self) -> list[str]:
        """
        What its reader has to say: triangles left out, a texture that is missing.
        """
class RayCaster:
    """
    Casts rays at a mesh, and renders what cameras see of it. Thread safe.
    """
    @staticmethod
    def of_points(points: numpy.typing.ArrayLike, normals: numpy.typing.ArrayLike | None = None, colors: numpy.typing.ArrayLike | None = None, *, radius: typing.SupportsFloat | typing.SupportsIndex | None = None, neighbors: typing.SupportsInt | typing.SupportsIndex = 16, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> RayCaster:
        """
        Of a point cloud (N, 3) as small discs, with the points' normals (N, 3) and colors (N, 3),
        uint8, where they are known. radius: of all discs; by default each has that of its nearest
        `neighbors`. `triangles` of cast() are indices of discs.
        """
    @staticmethod
    def of_splats(means: numpy.typing.ArrayLike, rotations: numpy.typing.ArrayLike, scales: numpy.typing.ArrayLike, opacities: numpy.typing.ArrayLike, colors: numpy.typing.ArrayLike | None = None, *, depth: str = 'median') -> RayCaster:
        """
        Of Gaussian splats: their means (N, 3), rotations (N, 4) as (w, x, y, z), standard
        deviations along their axes (N, 3), opacities (N,) and colors (N, 3) from 0 to 1. depth:
        "median", "expected" or "peak". `triangles` of cast() are indices of Gaussians.
        """
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[Mesh, str]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, mesh: raylift._types.GeometryLike, *, build: str = 'medium') -> None:
        """
        Builds the acceleration structure of a Mesh, or of a text as the option --geometry takes it:
        "mesh:...", "cloud:..." or "splat:...". build: "medium" for many views of a Mesh, "low" for
        few.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[Mesh, str]) -> None:
        ...
    def _repr_png_(self) -> bytes | None:
        """
        A picture of the mesh from outside.
        """
    def cast(self, origins: numpy.typing.ArrayLike, directions: numpy.typing.ArrayLike, *, t_near: typing.SupportsFloat | typing.SupportsIndex = 0.0, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> raylift._results.RayHits:
        """
        The nearest hits of rays from origins (N, 3), or one (1, 3) for all, along directions
        (N, 3) of any length.

        Returns a dict: ray_t (N,), in lengths of the directions, NaN where nothing is hit; points
        and normals (N, 3) in the world (unit, by the triangles' winding), triangles (N,), -1:
        none; barycentric (N, 2): point = (1 - u - v) v0 + u v1 + v v2.
        """
    def occluded(self, origins: numpy.typing.ArrayLike, directions: numpy.typing.ArrayLike, *, t_near: typing.SupportsFloat | typing.SupportsIndex = 0.0, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> numpy.typing.NDArray[numpy.bool_]:
        """
        Whether anything lies on each ray (N,), bool.
        """
    def render(self, camera: raylift._types.CameraLike, pose: raylift._types.PoseLike, products: collections.abc.Sequence[str] = ['depth'], *, threads: typing.SupportsInt | typing.SupportsIndex = 0, **kwargs: typing_extensions.Unpack[raylift._types.RenderOptions]) -> raylift._results.Pictures:
        """
        What a camera sees from a pose (cam_from_world), a dict of arrays by product:

        depth      (H, W) float32, z along the optical axis, scene units; 0: no surface
        distance   (H, W) float32, along the ray; 0: no surface
        normals    (H, W, 3) float32, unit, toward the camera; 0: no surface
        color      (H, W, 3) uint8, RGB
        triangle   (H, W) uint32, index; 4294967295: none
        object     (H, W) uint32, which of several meshes; 4294967295: none
        instance   (H, W) uint32, which node, group or city object; likewise
        semantic   (H, W) uint32, which material or kind of surface; likewise
        incidence  (H, W) float32, degrees; -1: no surface
        mask       (H, W) uint8, 255 where there is a surface

        A camera of the model EQUIRECTANGULAR sees all around; its depth is the distance.

        Options as of `raylift render`: normals_in="world" (or "camera"), shading="auto" (or
        "unlit", "headlight", "sun"), supersampling=1, background=(0, 0, 0). The arrays are the
        renderer's own memory. The same bytes for any number of threads (0: all).
        """
    def render_many(self, cameras: raylift._types.CameraLike | collections.abc.Sequence[raylift._types.CameraLike], poses: collections.abc.Sequence[raylift._types.PoseLike], products: collections.abc.Sequence[str] = ['depth'], *, threads: typing.SupportsInt | typing.SupportsIndex = 0, progress: raylift._types.Progress | None = None, **kwargs: typing_extensions.Unpack[raylift._types.RenderOptions]) -> list[raylift._results.Pictures]:
        """
        A list with the pictures of each pose, as of render(). `cameras` is one camera, or a list
        of as many as there are poses.
        """
    def sample_views(self, camera: raylift._types.CameraLike, count: typing.SupportsInt | typing.SupportsIndex = 48, *, how: str = 'around', up: numpy.typing.ArrayLike | None = None, clearance: typing.SupportsFloat | typing.SupportsIndex = 0.3, seed: typing.SupportsInt | typing.SupportsIndex = 0, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> list[Rigid3]:
        """
        Poses (cam_from_world) that see a mesh, as of `raylift views`: how="around" it from outside,
        "inside" it at eye height, "cover" its surfaces, or "walk" in it on foot, in order; up: direction
        (3,) in the world, by default the one that its surfaces tell. Fewer than `count` where there is no more room.
        """
    def score_views(self, camera: raylift._types.CameraLike, poses: collections.abc.Sequence[raylift._types.PoseLike], *, mask: numpy.typing.ArrayLike | None = None, depth: numpy.typing.ArrayLike | None = None, edges: numpy.typing.ArrayLike | None = None, depth_tolerance: typing.SupportsFloat | typing.SupportsIndex = 0.05, threads: typing.SupportsInt | typing.SupportsIndex = 0, progress: raylift._types.Progress | None = None) -> raylift._results.ViewScores:
        """
        How well many views fit what is known of a photograph, without keeping their pictures: a
        dict of (N,) arrays, one for each that is given, the larger the better.

        mask   (H, W) bool; the intersection of what both show over their union
        depth  (H, W), 0 or not finite: not known; share of the known pixels whose rendered depth
               is within depth_tolerance of it, as a share of it
        edges  (H, W), how much each pixel is an edge; its mean over the view's depth edges
        """
    @property
    def mesh(self) -> Mesh:
        """
        The Mesh.
        """
class Geometry:
    """
    A source of geometry: which point of the scene a reference's pixel shows.
    """
    def __copy__(self) -> Geometry:
        ...
    def __deepcopy__(self, memo: typing.Any) -> Geometry:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, geometry: raylift._types.GeometryLike, *, model: raylift._types.PathLike | None = None, references: collections.abc.Sequence[raylift._types.PosedImageLike] = [], threads: typing.SupportsInt | typing.SupportsIndex = 0) -> None:
        """
        From a Mesh, a RayCaster, or a text as the option --geometry takes it:
        "mesh:PATH[,key=value...]", "depth:PATH[,...]" (needs the references), "sfm[:DIR][,...]"
        (without DIR, the points of `model`). Raises OptionError for what is none.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def lift(self, reference: raylift._types.PosedImageLike, pixels: numpy.typing.ArrayLike) -> raylift._results.LiftedPixels:
        """
        The surface points that pixels (N, 2) of a reference show. A dict: points and normals (N, 3) in
        the world (unit, toward the camera), NaN where there is no surface, and outside of the image;
        and (N,) each: depth along
        the optical axis, sigma (standard deviation of the point, where it is known) in scene units,
        incidence_deg, depth_jump (largest relative jump of depth around the pixel, where it was looked
        for), back_face (bool).
        """
    @property
    def description(self) -> str:
        ...
    @property
    def interpretation(self) -> str:
        """
        How the files were read ("PNG uint16 640 x 480, z").
        """
    @property
    def warnings(self) -> list[str]:
        ...
class DepthMaps(Geometry):
    """
    Depth maps of references.
    """
    @staticmethod
    def from_arrays(maps: collections.abc.Mapping[str, numpy.typing.ArrayLike], references: collections.abc.Sequence[raylift._types.PosedImageLike], **kwargs: typing_extensions.Unpack[raylift._types.DepthMapOptions]) -> DepthMaps:
        """
        From a dict of (height, width) arrays by the references' names, of the image's size
        or another; what is not finite or not positive is no surface. They are copied.
        Keywords: kind="z" (or "ray", "inverse"), scale=1, max_depth, interpolation="edge"
        (or "nearest"), max_jump=0.05.
        """
    def __copy__(self) -> DepthMaps:
        ...
    def __deepcopy__(self, memo: typing.Any) -> DepthMaps:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, folder: raylift._types.PathLike, references: collections.abc.Sequence[raylift._types.PosedImageLike], **kwargs: raylift._types.SpecValue) -> None:
        """
        Finds the references' maps in a folder or file. Keywords are the keys of --geometry depth:...
        (preset, kind, unit, scale, pattern, ...; `raylift localize --help` lists them). Raises
        InputError where there is no map.
        """
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def _repr_png_(self) -> bytes | None:
        """
        The first reference's map, dark where it is near.
        """
    def load(self, reference: raylift._types.PosedImageLike) -> numpy.typing.NDArray[numpy.float32] | None:
        """
        The map of a reference (height, width), float32, z in scene units, 0: no surface; or None.
        It is the library's own memory, which cannot be written to.
        """
class SfmPoints(Geometry):
    """
    The points of a COLMAP model, lifted by its own keypoints.
    """
    def __copy__(self) -> SfmPoints:
        ...
    def __deepcopy__(self, memo: typing.Any) -> SfmPoints:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, model: raylift._types.PathLike, references: collections.abc.Sequence[raylift._types.PosedImageLike] = [], **kwargs: raylift._types.SpecValue) -> None:
        """
        Keywords are the keys of --geometry sfm:... (radius, min_track, ...).
        """
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
class Lifter:
    """
    Lifts keypoints of references to the scene by one source of geometry or several.
    """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __init__(self, *args: raylift._types.GeometryLike, geometry_mode: str = 'first') -> None:
        """
        Each source is a Mesh, RayCaster, DepthMaps, SfmPoints, Geometry or "mesh:PATH"; they are
        asked in order. geometry_mode: of lift_matches(), the point of the "first" that has one,
        or those of "all".
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def lift(self, reference: raylift._types.PosedImageLike, pixels: numpy.typing.ArrayLike) -> raylift._results.LiftedBySources:
        """
        The surface points that pixels (N, 2) of a reference show. A dict: points and normals (N, 3) in
        the world (unit, toward the camera), NaN where there is no surface, and outside of the image;
        and (N,) each: depth along
        the optical axis, sigma (standard deviation of the point, where it is known) in scene units,
        incidence_deg, depth_jump (largest relative jump of depth around the pixel, where it was looked
        for), back_face (bool). source: index of the source (N,), -1: none.
        """
    def lift_matches(self, problem: PoseProblem) -> PoseProblem:
        """
        The PoseProblem with the 2D-3D matches that its 2D-2D matches give, in place of its own.
        """
class Scene:
    """
    What photographs are localized in: references with known poses, and
    the geometry that their keypoints are lifted by.
    """
    @staticmethod
    def of(references: collections.abc.Sequence[raylift._types.PosedImageLike], geometry: collections.abc.Sequence[raylift._types.GeometryLike] = [], *, images: raylift._types.PathLike | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> Scene:
        """
        From references in memory.
        """
    @staticmethod
    def read(file: raylift._types.PathLike, *, geometry: collections.abc.Sequence[str] = [], threads: typing.SupportsInt | typing.SupportsIndex = 0) -> Scene:
        """
        From a scene file (TOML); geometry: names of its geometries, by default the first one.
        """
    def __copy__(self) -> Scene:
        ...
    def __deepcopy__(self, memo: typing.Any) -> Scene:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, model: raylift._types.ModelLike, geometry: collections.abc.Sequence[raylift._types.GeometryLike] = [], *, images: raylift._types.PathLike | None = None, model_poses: str = 'cam_from_world', every: typing.SupportsInt | typing.SupportsIndex = 1, every_offset: typing.SupportsInt | typing.SupportsIndex = 0, every_per_camera: bool = False, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> None:
        """
        From a COLMAP model: a folder (text or binary), a pycolmap.Reconstruction or a ColmapModel.

        geometry: Mesh, RayCaster, Geometry, or texts as the option --geometry takes them, asked in
        order. images: folder of the references' photographs. every: only each N-th reference. Raises
        InputError where a file cannot be read.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    @property
    def geometry(self) -> list[Geometry]:
        """
        A list of Geometry.
        """
    @property
    def mesh(self) -> RayCaster:
        """
        The RayCaster of the first geometry that is a mesh, or None.
        """
    @property
    def references(self) -> list[PosedImage]:
        """
        A list of PosedImage.
        """
    @property
    def warnings(self) -> list[str]:
        ...
class LocalizedQuery:
    """
    What became of a query. True where it was localized.
    """
    __hash__: typing.ClassVar[None]  # type: ignore[assignment]
    def __bool__(self) -> bool:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[str, str, tuple[str, str]]:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[str, str, tuple[str, str]]) -> None:
        ...
    def _repr_html_(self) -> str:
        ...
    def _repr_png_(self) -> bytes | None:
        """
        The scene as the photograph's camera sees it from the pose.
        """
    @property
    def cam_from_world(self) -> Rigid3 | None:
        """
        The pose, or None.
        """
    @property
    def confidence(self) -> float:
        """
        The probability that the pose is right.
        """
    @property
    def counts(self) -> raylift._results.StageCounts:
        """
        What each stage found: references retrieved, 2D-2D matches, those lifted, points, inliers.
        """
    @property
    def estimate(self) -> PoseEstimate:
        """
        The PoseEstimate, with the covariance.
        """
    @property
    def name(self) -> str:
        ...
    @property
    def problem(self) -> PoseProblem:
        """
        The PoseProblem that was estimated, which knows what the scene's calibration says.
        """
    @property
    def reason(self) -> str:
        """
        Why there is no pose; empty where there is one.
        """
    @property
    def verdict(self) -> str:
        """
        "localized", "doubtful" or "failed".
        """
class Localizer:
    """
    Localizes photographs in a scene. Thread safe.
    """
    def __getstate__(self) -> tuple[typing.Any, ...]:
        ...
    def __init__(self, scene: Scene, *, reference_features: collections.abc.Mapping[str, raylift._types.FeaturesLike] = {}, extractor: raylift._types.Extractor | None = None, matcher: raylift._types.Matcher | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 0, **kwargs: typing_extensions.Unpack[raylift._types.LocalizerOptions]) -> None:
        """
        Options as of `raylift localize`, with its defaults: those of raylift.estimate_pose(), and
        filter="off", filter_reprojection_px=4, filter_min_views=3, filter_min_ratio=0.8,
        candidates="keep", candidates_error_px=4, candidates_min_angle_deg=1,
        geometry_mode="first", min_confidence=0, top_k=10; of the built-in front end (RootSIFT and
        VLAD, made from the scene's photographs) max_features=4096, max_ratio=0.8, cache,
        query_images; or hloc's files features, matches and pairs; or as matches alone COLMAP's
        database, or a folder of the matches of each pair (N, 4), with first_pixel=0, cell_px=0
        as of raylift.hloc.matches_from(); of matches in files, min_match_score;
        scene_calibration: the file that `raylift calibrate` or write_calibration() wrote; else
        align_depth="auto" (or "off", "scale", "affine", "grid") says how depth is corrected.
        rerender=0: rounds in which a pose is sharpened against the scene's mesh or splats, rendered
        as the query saw them.

        reference_features: features of one's own, a dict by the references' names of dicts with
        keypoints (N, 2) and descriptors (N, D) of unit length; their photographs are not read.

        extractor: called with each photograph (H, W, 3) uint8, RGB, in place of RootSIFT: OpenCV's
        Feature2D, LightGlue's extractors, or a callable that returns a dict or pair of keypoints
        and descriptors. Its features are cached under its extractor_name.

        matcher: called with a query's photograph and a reference's that RootSIFT and VLAD
        retrieved: returns rows (N, 4) of pixels, a pair of (N, 2), or a dict as LoFTR, SuperGlue
        or image-matching-models return, or what MASt3R or DUSt3R predict of photographs that
        their load_images() resized; with an extractor, it is called with what that returned, and
        may return indices (K, 2) of keypoints. One with match_batch(query, references) is called
        once for all references of a query instead, and returns a list. These are taken as they
        are: with an extractor OpenCV's DescriptorMatcher and LightGlue, without RoMa, DKM and the
        matchers of image-matching-models (vismatch). With cache and a matcher_name, matches of
        photographs in files are kept as hloc.match_dense does, by h5py; those of an extractor's
        features need its extractor_name, too.

        retrieval: how references are found: by a function that is called with each photograph and
        returns its global descriptor (D,), as raylift.onnx.GlobalDescriptor does (nothing of it is
        kept: each localize_all() and leave_one_out() describes the references anew); or "vlad"; "global"
        by global_features (hloc's global-feats file; query_global_features: that of the queries,
        where it is another one); "pose" or "overlap" by prior_poses (a COLMAP model, a pose file, or
        a dict of poses by the queries' names), the first within max_angle_deg or by the view_range
        (near, far) in scene units; or "covisibility", of leave_one_out(). All but functions and
        "vlad" are for localize_all() and leave_one_out().

        Functions are called one call at a time; pixels count as first_pixel says, by default as OpenCV's,
        whose first pixel's center is (0, 0).

        Raises OptionError for an option out of range.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[typing.Any, ...]) -> None:
        ...
    def leave_one_out(self, *, threads: typing.SupportsInt | typing.SupportsIndex = 0, progress: raylift._types.Progress | None = None) -> dict[str, LocalizedQuery]:
        """
        Each reference as a query of the others: what is to be expected where no query's pose
        is known; but retrieval="pose" or "overlap" takes the references' own poses as
        their prior poses. Returns a dict by name.
        """
    def localize(self, query: raylift._types.PhotographLike, camera: raylift._types.CameraLike | None = None, *, name: str = 'query', position_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike] | None = None, gravity_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, heading_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, orientation_prior: tuple[numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, range_prior: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex] | None = None, focal_sigma: typing.SupportsFloat | typing.SupportsIndex | None = None, focal_range: typing.SupportsFloat | typing.SupportsIndex = 1.0) -> LocalizedQuery:
        """
        One query: a photograph, (H, W) or (H, W, 3) uint8, RGB, or its file; or features, a dict
        with keypoints (N, 2) and descriptors (N, D), as the references have. Priors and focal_...
        as of raylift.Query. camera=None: of a photograph, the lens is found with the pose
        (estimate.refined_camera), near the focal length that EXIF tells where it does; or it is
        the calibration that a drone wrote.

        Returns a LocalizedQuery. Raises InputError where a photograph is not of the camera's size.
        """
    def localize_all(self, queries: collections.abc.Sequence[raylift._types.QueryLike], *, threads: typing.SupportsInt | typing.SupportsIndex = 0, progress: raylift._types.Progress | None = None) -> dict[str, LocalizedQuery]:
        """
        Many queries, Query or (name, camera) each, whose photographs or matches are in files. Of
        photographs the results are those of localize(). Returns a dict by name.
        """
    def localize_matches(self, camera: raylift._types.CameraLike, query2d: numpy.typing.ArrayLike, reference2d: numpy.typing.ArrayLike, reference_names: collections.abc.Sequence[str], *, query_keypoints: numpy.typing.ArrayLike | None = None, name: str = 'query', position_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike] | None = None, gravity_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, heading_prior: tuple[numpy.typing.ArrayLike, numpy.typing.ArrayLike, numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, orientation_prior: tuple[numpy.typing.ArrayLike, typing.SupportsFloat | typing.SupportsIndex] | None = None, range_prior: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex] | None = None, focal_sigma: typing.SupportsFloat | typing.SupportsIndex | None = None, focal_range: typing.SupportsFloat | typing.SupportsIndex = 1.0) -> LocalizedQuery:
        """
        One query by matches of one's own: pixels (M, 2) of the query and of references, and the
        references' names (M,). query_keypoints: (M,), where it is known which keypoint of the
        query a match is of. Priors and focal_... as of raylift.Query.

        Matches outside of their images are left out of the result's problem; InputError where most of
        at least 10 are, as those of resized images.
        """
    def write_calibration(self, file: raylift._types.PathLike) -> None:
        """
        Writes what is known of the scene, for the option scene_calibration and
        `raylift localize --scene-calibration`.
        """
    @property
    def scene(self) -> Scene:
        """
        The scene, with what the option scene_calibration says of it.
        """
class TrackedPose:
    """
    A photograph of a walk. True where it has a pose.
    """
    __hash__: typing.ClassVar[None]  # type: ignore[assignment]
    def __bool__(self) -> bool:
        ...
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[LocalizedQuery, str, float | None, bool, Rigid3 | None, float, Rigid3 | None, float]:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[LocalizedQuery, str, typing.SupportsFloat | typing.SupportsIndex | None, bool, Rigid3 | None, typing.SupportsFloat | typing.SupportsIndex, Rigid3 | None, typing.SupportsFloat | typing.SupportsIndex]) -> None:
        ...
    @property
    def lost_before(self) -> bool:
        """
        Whether odometry was lost since the photograph before.
        """
    @property
    def result(self) -> LocalizedQuery:
        """
        The LocalizedQuery: pose, covariance and verdict by the walk up to here.
        """
    @property
    def role(self) -> str:
        """
        "alone", "smoothed", "replaced", "rescued", "disputed" or "dropped": what the
        walk did with the photograph's own pose.
        """
    @property
    def scale(self) -> float:
        """
        Scene units per unit of the odometry.
        """
    @property
    def single_cam_from_world(self) -> Rigid3 | None:
        """
        The photograph's own pose where the walk has changed it, or None.
        """
    @property
    def single_confidence(self) -> float:
        """
        The probability that the photograph's own pose is right, by itself.
        """
    @property
    def world_from_odometry(self) -> Rigid3 | None:
        """
        The odometry's frame in the world, its translations times `scale`; None while the walk
        is not found in the map, or lost.
        """
class SceneTracker:
    """
    What raylift.Tracker is made of.
    """
    def __init__(self, scene: Scene, odometry_scale: str, min_confidence: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    def add(self, alone: LocalizedQuery, cam_from_odometry: raylift._types.PoseLike, time: typing.SupportsFloat | typing.SupportsIndex) -> TrackedPose:
        """
        The next photograph, which was localized by itself.
        """
class ColmapModel:
    """
    A COLMAP model: cameras, images and points, kept without loss.
    """
    __hash__: typing.ClassVar[None]  # type: ignore[assignment]
    @staticmethod
    def read(folder: raylift._types.PathLike) -> ColmapModel:
        """
        Text or binary. Raises InputError naming file and record.
        """
    def __eq__(self, other: object) -> bool:
        """
        Equal in all that is kept when pickled.
        """
    def __getstate__(self) -> tuple[dict[str, bytes], list[str]]:
        ...
    def __init__(self) -> None:
        """
        An empty one.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple[collections.abc.Mapping[str, bytes], collections.abc.Sequence[str]]) -> None:
        ...
    def add_camera(self, camera_id: typing.SupportsInt | typing.SupportsIndex, camera: raylift._types.CameraLike) -> None:
        ...
    def add_image(self, image_id: typing.SupportsInt | typing.SupportsIndex, name: str, camera_id: typing.SupportsInt | typing.SupportsIndex, cam_from_world: raylift._types.PoseLike, points2d: numpy.typing.ArrayLike | None = None, point3d_ids: numpy.typing.ArrayLike | None = None) -> None:
        """
        Raises InputError where the camera is not there yet, or another image has the id or name.
        """
    def add_point3d(self, point3d_id: typing.SupportsInt | typing.SupportsIndex, position: numpy.typing.ArrayLike, track: numpy.typing.ArrayLike, color: numpy.typing.ArrayLike = (0, 0, 0), error_px: typing.SupportsFloat | typing.SupportsIndex = -1.0) -> None:
        """
        track (K, 2): the image's id, and the index of its points2d, which then observes the
        point. color: red, green and blue, from 0 to 255. Raises InputError where there is no such
        keypoint, or it observes another point.
        """
    def image(self, image_id: typing.SupportsInt | typing.SupportsIndex) -> raylift._results.ModelImage:
        """
        An image as a dict: name, camera_id, cam_from_world, points2d (N, 2), point3d_ids (N,), -1:
        none.
        """
    def track(self, point3d_id: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.int64]:
        """
        What observes a point (K, 2): the image's id, and the index of its points2d.
        """
    def write(self, folder: raylift._types.PathLike, form: str = 'binary') -> None:
        """
        form: "binary" or "text".
        """
    @property
    def cameras(self) -> dict[int, Camera]:
        """
        A dict of Camera by id; a copy.
        """
    @property
    def image_ids(self) -> list[int]:
        """
        In order.
        """
    @property
    def points3d(self) -> raylift._results.ModelPoints:
        """
        A dict of arrays: ids (N,), positions (N, 3), colors (N, 3) uint8, errors_px (N,),
        track_lengths (N,); copies.
        """
    @property
    def posed_images(self) -> list[PosedImage]:
        """
        The images with their cameras, a list of PosedImage sorted by name.
        """
    @property
    def warnings(self) -> list[str]:
        ...
def estimate(problem: PoseProblem, **kwargs: typing_extensions.Unpack[raylift._types.EstimateOptions]) -> PoseEstimate:
    """
    The pose of a problem. Options as of raylift.estimate_pose(), which see.
    """
def estimate_all(problems: collections.abc.Sequence[PoseProblem], *, independent: bool = False, threads: typing.SupportsInt | typing.SupportsIndex = 0, progress: raylift._types.Progress | None = None, **kwargs: typing_extensions.Unpack[raylift._types.EstimateOptions]) -> list[PoseEstimate]:
    """
    The poses of many problems of one scene, as of `raylift estimate`: some 30 of them tell how
    noisy the scene's matches are, where no scene_calibration does and the problems, as those of
    a LocalizedQuery, do not know it. independent=True: each one's pose is that of estimate().

    threads: 0 is all; the poses are the same for any number of them.
    """
def extract_features(image: numpy.typing.ArrayLike, *, max_features: typing.SupportsInt | typing.SupportsIndex = 4096) -> raylift._results.FoundFeatures:
    """
    RootSIFT features of a photograph, (H, W) or (H, W, 3) uint8: a dict with keypoints (N, 2),
    descriptors (N, 128) float32 of unit length, scores (N,).
    """
def filter_points(problem: PoseProblem, filter: str = 'auto', *, method: str = 'adaptive', **kwargs: typing_extensions.Unpack[raylift._types.FilterThresholds]) -> tuple[PoseProblem, numpy.typing.NDArray[numpy.bool_], raylift._results.FilterCounts]:
    """
    Drops the 2D-3D matches of a PoseProblem that its references disagree on. filter: "off",
    "fixed" (with filter_reprojection_px=4, filter_min_views=3, filter_min_ratio=0.8) or
    "auto", which leaves accurate geometry alone. method: what the points are for (some keep
    the best where few are left).

    Returns the problem without them, which were kept (N,) bool, and a dict of counts.
    """
def kinds_of_options() -> dict[str, dict[str, str]]:
    """
    What each option of each command takes; make_options.py makes _options.py of it.
    """
def merge_candidates(problem: PoseProblem, **kwargs: typing_extensions.Unpack[raylift._types.CandidateOptions]) -> PoseProblem:
    """
    The PoseProblem with one 3D point per query keypoint. candidates="merge": the one that
    the references agree on best; "triangulate": from the 2D-2D matches alone; "keep": all.
    Also candidates_error_px=4, candidates_min_angle_deg=1.
    """
def read_depth(file: raylift._types.PathLike, *, layer: str = '', raw_size: tuple[typing.SupportsInt | typing.SupportsIndex, typing.SupportsInt | typing.SupportsIndex] | None = None) -> numpy.typing.NDArray[numpy.float32]:
    """
    A depth map as it is stored (height, width), float32: EXR, PNG, TIFF, PGM, NPY, NPZ,
    COLMAP's .bin, PFM, or plain floats with raw_size=(width, height). layer: the channel of an
    EXR or key of an NPZ. DepthMaps knows what the numbers mean. Raises InputError.
    """
def read_image(file: raylift._types.PathLike) -> numpy.typing.NDArray[numpy.uint8]:
    """
    A photograph (height, width, 3), uint8, RGB, without turning it by its tags.
    """
def read_poses(file: raylift._types.PathLike) -> dict[str, Rigid3]:
    """
    Lines `name qw qx qy qz tx ty tz`, world to camera: a dict of Rigid3 by name. Raises InputError
    naming the line.
    """
def read_queries(file: raylift._types.PathLike, *, images: raylift._types.PathLike | None = None, priors: raylift._types.PathLike | None = None, rigs: raylift._types.PathLike | None = None) -> list[Query]:
    """
    Lines `name MODEL width height params... [focal_sigma S]`: a list of Query, which unpack as
    (name, camera). images: folder of the photographs; a line may then be a name alone, whose
    focal length EXIF tells or localizing finds, and a folder stands for those in it. priors,
    rigs: files as of `raylift localize --priors` and `--rigs`; photographs that a rig took at
    one moment are then localized together.
    """
def refine_pose(problem: PoseProblem, cam_from_world: raylift._types.PoseLike, **kwargs: typing_extensions.Unpack[raylift._types.EstimateOptions]) -> PoseEstimate:
    """
    Refines a pose without RANSAC: on the matches near it, and then as the method does with
    RANSAC's best pose. It must be so near that some right matches lie within three thresholds.
    Options as of raylift.estimate_pose(). Returns a PoseEstimate.
    """
def run_command(arguments: collections.abc.Sequence[str], *, progress: raylift._types.Progress | None = None) -> None:
    """
    Runs a command of the program by its arguments, as a shell would.

    Raises OptionError and InputError where the program would end with such a message.
    """
def run_program(arguments: collections.abc.Sequence[str]) -> int:
    """
    The program `raylift`. Returns its exit code.
    """
def solve_d3p1(rays: numpy.typing.ArrayLike, points_in_reference: numpy.typing.ArrayLike, fourth_reference_ray: numpy.typing.ArrayLike, reference: raylift._types.PoseLike, fourth_reference: raylift._types.PoseLike) -> list[Rigid3]:
    """
    D3+1: as E5+1, but by three matches whose points (3, 3) are known in the reference's frame
    up to one factor (depth of any scale), and a fourth with another reference, by its ray (3,).
    Rays are (4, 3); up to 4 poses.
    """
def solve_e5p1(rays: numpy.typing.ArrayLike, reference_rays: numpy.typing.ArrayLike, reference: raylift._types.PoseLike, sixth_reference: raylift._types.PoseLike) -> list[Rigid3]:
    """
    E5+1: the poses (cam_from_world, up to 10) from five 2D-2D matches with one reference and a
    sixth with another: rays (6, 3) in the camera's frame and in those of the references, whose
    poses (cam_from_world) are given.
    """
def solve_gp3p(centers: numpy.typing.ArrayLike, rays: numpy.typing.ArrayLike, points3d: numpy.typing.ArrayLike) -> list[Rigid3]:
    """
    Generalized P3P: a rig's poses (rig_from_world, up to 8) from three points, each seen from
    a center of its own; centers and rays (3, 3) are in the rig's frame.
    """
def solve_known_center(rays: numpy.typing.ArrayLike, points3d: numpy.typing.ArrayLike, center: numpy.typing.ArrayLike) -> list[Rigid3]:
    """
    The pose (cam_from_world, none or one) of a camera at a known center (3,) from two points
    (2, 3) and the rays to them.
    """
def solve_p3p(rays: numpy.typing.ArrayLike, points3d: numpy.typing.ArrayLike) -> list[Rigid3]:
    """
    P3P: the poses (cam_from_world, up to 4) from three points (3, 3) and the rays to them in
    the camera's frame (3, 3), of any length (Camera.rays()). Lambda Twist.
    """
def solve_up2p(rays: numpy.typing.ArrayLike, points3d: numpy.typing.ArrayLike, down_in_cam: numpy.typing.ArrayLike, down_in_world: numpy.typing.ArrayLike) -> list[Rigid3]:
    """
    UP2P: the poses (cam_from_world, up to 2) from two points (2, 3), the rays to them and the
    direction of gravity (3,) in both frames.
    """
def write_depth(file: raylift._types.PathLike, depth: numpy.typing.ArrayLike, **kwargs: typing_extensions.Unpack[raylift._types.DepthWriteOptions]) -> raylift._results.WrittenDepth:
    """
    Writes a depth map (height, width) in the format of the file's name: .exr, .png, .tiff,
    .npy, .npz, .bin (COLMAP), .pfm. Options as of `raylift render`: sample="float" (or
    "half"), exr_compression="pxr24", png_step=0.001, out_of_range="refuse" (or "drop"),
    deflate_npz=False; layer. Returns a dict: bytes, dropped values, max_rounding.
    """
def write_poses(file: raylift._types.PathLike, poses: collections.abc.Mapping[str, raylift._types.PoseLike]) -> None:
    """
    A dict of poses (cam_from_world) by name; in its order.
    """
def write_queries(file: raylift._types.PathLike, queries: collections.abc.Sequence[raylift._types.QueryLike]) -> None:
    """
    From a list of Query, or of (name, camera).
    """
PYBIND11_MAJOR: int = 3
VERSION: str = '0.1.0'
