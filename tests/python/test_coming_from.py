"""The page for those who come from other packages: its two columns do the same, as far as the other is here."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from scenes import DEMO
from synthetic import some

SOURCE = Path(os.environ["RAYLIFT_SOURCE"])
PARAMS = [500, 320, 240, -0.05]
CAMERA = raylift.Camera("SIMPLE_RADIAL", 640, 480, PARAMS)
CAMERA_DICT = {"model": "SIMPLE_RADIAL", "width": 640, "height": 480, "params": PARAMS}
TRUTH = raylift.Rigid3([1, 0.05, -0.02, 0.1], [0.3, -0.2, 1])
# Why two estimates of one pose differ: each stops where its own cost is least.
BY_NOISE = 0.01


def pixels(points3d: NDArray[np.float64]) -> NDArray[np.float64]:
    return CAMERA.project(TRUTH * points3d)


@pytest.fixture(scope="module")
def matches() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """With half a pixel of noise; the first 20 of 80 are wrong."""
    rng = np.random.default_rng(5)
    points3d = rng.uniform([-2, -2, 4], [2, 2, 8], (80, 3))
    points2d = pixels(points3d) + rng.normal(0, 0.5, (80, 2))
    points2d[:20] = rng.uniform([0, 0], [640, 480], (20, 2))
    return points2d, points3d


def expect_equal(ours: raylift.Rigid3 | None, theirs: Any, tolerance: float = 1e-9) -> None:
    assert np.abs(some(ours).matrix - raylift.Rigid3.of(theirs).matrix).max() < tolerance


def bearings(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def test_pycolmaps_cameras_and_poses() -> None:
    pycolmap = pytest.importorskip("pycolmap")
    theirs = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=PARAMS)
    assert raylift.Camera.of(theirs) == CAMERA
    points = np.array([[0.1, 0.2, 4], [-1, 0.5, 6]])
    seen = CAMERA.project(points)
    assert np.abs(theirs.img_from_cam(points) - seen).max() < 1e-9
    on_plane = np.column_stack([theirs.cam_from_img(seen), [1, 1]])
    assert np.abs(bearings(on_plane) - CAMERA.rays(seen)).max() < 1e-9

    w, x, y, z = TRUTH.qvec
    pose = pycolmap.Rigid3d(rotation=pycolmap.Rotation3d(np.array([x, y, z, w])), translation=TRUTH.tvec)
    expect_equal(TRUTH, pose)
    expect_equal(TRUTH.inverse(), pose.inverse())
    expect_equal(TRUTH * TRUTH, pose * pose)
    assert np.abs(TRUTH * points - pose * points).max() < 1e-9
    assert np.abs(TRUTH.matrix[:3] - pose.matrix()).max() < 1e-9
    assert np.abs(np.roll(TRUTH.qvec, -1) - pose.rotation.quat).max() < 1e-9


def test_pycolmaps_reconstructions() -> None:
    pycolmap = pytest.importorskip("pycolmap")
    theirs = pycolmap.Reconstruction(str(DEMO / "model"))
    ours = {image.name: image for image in raylift.ColmapModel.read(DEMO / "model").posed_images}
    assert set(ours) == {image.name for image in theirs.images.values()}
    for image in theirs.images.values():
        expect_equal(ours[image.name].cam_from_world, image.cam_from_world())
        assert ours[image.name].camera == raylift.Camera.of(image.camera)
    scene = raylift.Scene(theirs, [f"mesh:{DEMO / 'scene.obj'}"])
    assert {image.name: image.cam_from_world for image in scene.references} == {
        name: image.cam_from_world for name, image in ours.items()}


def test_pycolmaps_estimator(matches: tuple[NDArray[np.float64], NDArray[np.float64]]) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    points2D, points3D = matches
    camera = pycolmap.Camera(CAMERA_DICT)
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = 8
    theirs = pycolmap.estimate_and_refine_absolute_pose(points2D, points3D, camera, options, return_covariance=True)
    ours = raylift.estimate_pose(camera, points2D=points2D, points3D=points3D, method="p3p",
                                 reprojection_threshold_px=8)
    expect_equal(ours.cam_from_world, theirs["cam_from_world"], BY_NOISE)
    assert ours.num_inliers == theirs["num_inliers"] == 60
    assert (ours.inlier_mask == theirs["inlier_mask"]).all()
    assert some(ours.covariance).shape == theirs["covariance"].shape
    near = pycolmap.Rigid3d(pycolmap.Rotation3d(np.roll(TRUTH.qvec, -1)), TRUTH.tvec + 0.02)
    refined = pycolmap.refine_absolute_pose(near, points2D, points3D, theirs["inlier_mask"], camera)
    from_near = raylift.estimate_pose(camera, points2D, points3D, method="p3p", initial_pose=near)
    expect_equal(from_near.cam_from_world, refined["cam_from_world"], BY_NOISE)
    problem = raylift.PoseProblem(camera, points2D, points3D)
    expect_equal(raylift.refine_pose(problem, near, method="p3p").cam_from_world, from_near.cam_from_world)


def test_poselibs_estimators(matches: tuple[NDArray[np.float64], NDArray[np.float64]]) -> None:
    poselib = pytest.importorskip("poselib")
    points2D, points3D = matches
    pose, info = poselib.estimate_absolute_pose(points2D, points3D, CAMERA_DICT, {"max_reproj_error": 8}, {})
    ours = raylift.estimate_pose(CAMERA_DICT, points2D=points2D, points3D=points3D, method="p3p",
                                 reprojection_threshold_px=8)
    expect_equal(ours.cam_from_world, pose, BY_NOISE)
    assert np.abs(some(ours.cam_from_world).qvec - pose.q).max() < BY_NOISE
    assert np.abs(some(ours.cam_from_world).tvec - pose.t).max() < BY_NOISE
    assert (ours.inliers_2d3d == info["inliers"]).all()

    # Matches of a second photograph without points.
    reference = raylift.Rigid3([1, 0, 0.02, 0], [-0.8, 0, 0])
    in_reference = CAMERA.project(reference * points3D)
    pairs = poselib.PairwiseMatches()
    pairs.cam_id1, pairs.cam_id2 = 0, 0
    pairs.x1, pairs.x2 = in_reference[30:], points2D[30:]
    there = poselib.CameraPose()
    there.q, there.t = reference.qvec, reference.tvec
    pose, info = poselib.estimate_hybrid_pose(
        points2D[:50], points3D[:50], [pairs], CAMERA_DICT, [there], [CAMERA_DICT],
        {"max_reproj_error": 8, "max_epipolar_error": 2}, {})
    hybrid = raylift.estimate_pose(
        CAMERA_DICT, points2D[:50], points3D[:50], references=[(CAMERA_DICT, there)], query2d=points2D[30:],
        reference2d=in_reference[30:], reference_index=np.zeros(50, int), reprojection_threshold_px=8,
        sampson_threshold_px=2)
    expect_equal(hybrid.cam_from_world, pose, BY_NOISE)
    assert hybrid.num_inliers_2d3d == sum(info["inliers"])
    assert hybrid.inliers_2d2d.sum() == 50


def test_poselibs_solvers() -> None:
    poselib = pytest.importorskip("poselib")
    points3d = np.random.default_rng(6).uniform([-2, -2, 4], [2, 2, 8], (3, 3))
    rays = bearings(TRUTH * points3d)

    def expect_same(ours: list[raylift.Rigid3], theirs: list[Any]) -> None:
        """In any order."""
        found = sorted((pose.matrix.round(6).tolist() for pose in ours))
        expected = sorted(raylift.Rigid3.of(pose).matrix.round(6).tolist() for pose in theirs)
        assert len(found) == len(expected) > 0 and np.abs(np.subtract(found, expected)).max() < 1e-5

    expect_same(raylift.solve_p3p(rays, points3d), poselib.p3p(rays, points3d))
    # PoseLib's gravity is the y axis of both frames.
    upright = raylift.Rigid3([np.cos(0.2), 0, np.sin(0.2), 0], TRUTH.tvec)
    level = bearings(upright * points3d)[:2]
    expect_same(raylift.solve_up2p(level, points3d[:2], [0, 1, 0], [0, 1, 0]), poselib.up2p(level, points3d[:2]))
    centers = np.array([[0, 0, 0], [0.3, 0, 0], [0, -0.2, 0.1]])
    from_rig = bearings(TRUTH * points3d - centers)
    theirs = poselib.gp3p(centers, from_rig, points3d)
    # PoseLib's may have points behind a camera.
    ahead = [pose for pose in theirs
             if ((raylift.Rigid3.of(pose) * points3d - centers) * from_rig).sum(axis=1).min() > 0]
    expect_same(raylift.solve_gp3p(centers, from_rig, points3d), ahead)


def test_open3ds_rays(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    # Its reader of OBJ leaves out the demo's polygons.
    demo = raylift.Mesh.read(DEMO / "scene.obj")
    file = str(tmp_path / "scene.ply")
    open3d.io.write_triangle_mesh(file, open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(demo.vertices), open3d.utility.Vector3iVector(demo.triangles.astype(np.int32))))
    geometry = open3d.io.read_triangle_mesh(file)
    mesh = raylift.Mesh.read(file)
    assert (np.asarray(geometry.triangles) == mesh.triangles).all()
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(geometry))
    caster = raylift.RayCaster(mesh)
    image = raylift.ColmapModel.read(DEMO / "model").posed_images[0]  # a pinhole's
    directions = np.random.default_rng(7).normal(size=(1000, 3)).astype(np.float32)
    origins = np.broadcast_to(image.cam_from_world.center.astype(np.float32), (1000, 3))
    rays = open3d.core.Tensor(np.concatenate([origins, directions], axis=1))
    theirs = scene.cast_rays(rays)["t_hit"].numpy()
    ours = caster.cast(origins, directions)["ray_t"]
    # Open3D's rays and vertices are floats.
    assert (np.isnan(ours) == np.isinf(theirs)).all()
    assert np.abs(ours - theirs)[np.isfinite(theirs)].max() < 1e-3

    camera = image.camera
    fx, fy, cx, cy = camera.params
    # Open3D's rays go through the middle of a pixel, too, whose first is at (0.5, 0.5).
    pinhole = open3d.t.geometry.RaycastingScene.create_rays_pinhole(
        np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), image.cam_from_world.matrix, camera.width, camera.height)
    depth = scene.cast_rays(pinhole)["t_hit"].numpy()
    rendered = caster.render(camera, image.cam_from_world, ["depth"])["depth"]
    both = np.isfinite(depth) & (rendered > 0)
    assert both.mean() > 0.6 and (np.isfinite(depth) == (rendered > 0)).mean() > 0.999
    assert np.percentile(np.abs(depth - rendered)[both], 99) < 1e-3


def test_each_line_of_the_page_is_here() -> None:
    """What stands in the other package's column is called by this file."""
    page = (SOURCE / "assets/docs/pages/coming-from.md").read_text(encoding="utf-8")
    here = Path(__file__).read_text(encoding="utf-8")
    left_out = {"OffscreenRenderer"}  # needs a display's libraries
    missing = []
    for package in ("pycolmap", "PoseLib", "Open3D"):
        [section] = re.findall(rf"^## {package}\n(.*?)^## ", page, flags=re.MULTILINE | re.DOTALL)
        for column in re.findall(r"^\| (`.*?) \|", section, flags=re.MULTILINE):
            for code in re.findall(r"`(.*?)`", column):
                names = set(re.findall(r"[A-Za-z_]\w{2,}(?=\()|(?<=\.)[a-z_]\w*|(?<=\")\w+(?=\")", code))
                names |= {code} if code.isidentifier() else set()
                missing += sorted(name for name in names - left_out if not re.search(rf"\b{name}\b", here))
    assert missing == []
