import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import raylift
from synthetic import CAMERA, pose, rotation


def test_camera_projects_by_its_model() -> None:
    # f (x (1 + k r^2)) + c, r = 0.5
    pixels = CAMERA.project([[0.5, 0, 1], [0.0, 0, -1]])
    assert pixels[0] == pytest.approx([320 + 500 * 0.5 * (1 - 0.05 * 0.25), 240])
    assert np.isnan(pixels[1]).all()
    rays = CAMERA.rays(pixels[:1])
    assert rays[0] == pytest.approx(np.array([0.5, 0, 1]) / np.sqrt(1.25))


def test_camera_attributes() -> None:
    assert (CAMERA.model, CAMERA.width, CAMERA.height) == ("SIMPLE_RADIAL", 640, 480)
    assert CAMERA.params.tolist() == [500, 320, 240, -0.05]
    assert CAMERA.matrix.tolist() == [[500, 0, 320], [0, 500, 240], [0, 0, 1]]
    half = CAMERA.scaled(320, 240)
    assert half.params.tolist() == [250, 160, 120, -0.05]
    assert str(CAMERA) == "SIMPLE_RADIAL 640 480 500 320 240 -0.05"
    assert pickle.loads(pickle.dumps(CAMERA)) == CAMERA
    assert CAMERA != half and CAMERA != "a camera"
    assert "SIMPLE_RADIAL" in repr(CAMERA)


@pytest.mark.parametrize("camera", [
    "SIMPLE_RADIAL 640 480 500 320 240 -0.05",
    {"model": "SIMPLE_RADIAL", "width": 640, "height": 480, "params": [500, 320, 240, -0.05]},
    SimpleNamespace(model=SimpleNamespace(name="SIMPLE_RADIAL"), width=640, height=480,
                    params=np.array([500, 320, 240, -0.05])),
    SimpleNamespace(model=2, width=640, height=480, params=(500, 320, 240, -0.05)),
    {"model": "SIMPLE_RADIAL", "width": 640.0, "height": 480.0, "params": [500, 320, 240, -0.05]},
    SimpleNamespace(model_name=lambda: "SIMPLE_RADIAL", width=640, height=480,  # PoseLib's
                    params=[500, 320, 240, -0.05]),
])
def test_cameras_of_many_kinds(camera: Any) -> None:
    assert raylift.Camera.of(camera) == CAMERA


@pytest.mark.parametrize("wrong, message", [
    ({"model": "SIMPLE_RADIAL", "width": 640, "height": 480, "params": [500]}, "param"),
    ({"model": "PINHOLES", "width": 640, "height": 480, "params": [500]}, "PINHOLES"),
    ("PINHOLE 640", "camera"),
    ({"model": "PINHOLE", "height": 480, "params": [500, 500, 320, 240]}, "camera, width: .* None"),
    (7, "expected a raylift.Camera"),
])
def test_wrong_cameras_are_input_errors(wrong: Any, message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        raylift.Camera.of(wrong)


def test_pose_attributes() -> None:
    p = pose([0, 0, np.pi / 2], [1, 2, 3])
    assert p.center == pytest.approx([1, 2, 3])
    assert p.qvec == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert p.rotation == pytest.approx(rotation([0, 0, np.pi / 2]))
    assert p.matrix @ [1, 2, 3, 1] == pytest.approx([0, 0, 0, 1], abs=1e-12)
    assert p.transform([[2, 2, 3]])[0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert (p * p.inverse()).matrix == pytest.approx(np.eye(4), abs=1e-12)
    assert (p @ p.inverse()).matrix == pytest.approx(np.eye(4), abs=1e-12)
    assert pickle.loads(pickle.dumps(p)).qvec.tolist() == p.qvec.tolist()
    assert raylift.Rigid3().matrix.tolist() == np.eye(4).tolist()
    assert "qvec" in repr(p)


P = pose([0.3, -0.2, 0.1], [1, 2, 3])


@pytest.mark.parametrize("of", [
    P.matrix, P.matrix[:3], P.matrix.tolist(), P.matrix.astype(np.float32), (P.qvec, P.tvec),
    [list(P.qvec), list(P.tvec)], (P.rotation, P.tvec), {"qvec": P.qvec, "tvec": P.tvec},
    SimpleNamespace(q=P.qvec, t=P.tvec),
    SimpleNamespace(rotation=SimpleNamespace(matrix=lambda: P.rotation), translation=P.tvec),
    np.asfortranarray(P.matrix), P.matrix.astype(">f8"),
])
def test_poses_of_many_kinds(of: Any) -> None:
    assert raylift.Rigid3.of(of).matrix == pytest.approx(P.matrix, abs=1e-6)


@pytest.mark.parametrize("wrong", [
    np.eye(3), np.diag([1, 1, -1, 1]), 2 * np.eye(4), np.full((4, 4), np.nan), "pose",
    ([0, 0, 0, 0], [0, 0, 0]), ([1, 0, 0, 0], [0, 0]), {"qvec": [1, 0, 0, 0]},
])
def test_wrong_poses_are_input_errors(wrong: Any) -> None:
    with pytest.raises(raylift.InputError, match="pose"):
        raylift.Rigid3.of(wrong)


def test_posed_images_of_many_kinds() -> None:
    images: list[Any] = [(CAMERA, P), raylift.PosedImage("", CAMERA, P),
                  SimpleNamespace(name="", camera=CAMERA, cam_from_world=P),
                  SimpleNamespace(name="", camera=CAMERA, cam_from_world=lambda: P),
                  SimpleNamespace(camera=CAMERA, pose=P)]  # PoseLib's
    for image in images:
        problem = raylift.PoseProblem(CAMERA, references=[image])
        assert problem.references[0].camera == CAMERA
        assert problem.references[0].cam_from_world.matrix == pytest.approx(P.matrix)
    again = pickle.loads(pickle.dumps(raylift.PosedImage("a.jpg", CAMERA, P)))
    assert again.name == "a.jpg" and again.camera == CAMERA
    assert again.cam_from_world.matrix.tolist() == P.matrix.tolist()
    with pytest.raises(raylift.InputError, match="reference"):
        raylift.PoseProblem(CAMERA, references=[3])  # type: ignore[list-item]


def test_poses_do_as_those_of_pycolmap_do() -> None:
    pose = raylift.Rigid3([1, 0.1, 0.2, 0.3], [1, 2, 3])
    points = np.array([[0.0, 0, 1], [2, 3, 4]])
    assert (pose * points).tolist() == pose.transform(points).tolist()
    assert (pose * points[1]).tolist() == pose.transform(points)[1].tolist() == pose.transform(points[1]).tolist()
    assert (pose * pose.inverse()).matrix == pytest.approx(np.eye(4), abs=1e-12)
    assert np.asarray(pose).tolist() == pose.matrix.tolist() and np.asarray(pose, np.float32).dtype == np.float32
    assert pose == raylift.Rigid3([1, 0.1, 0.2, 0.3], [1, 2, 3]) and pose != raylift.Rigid3() and pose != 5
    assert len({pose, raylift.Rigid3.of(pose)}) == 1
    with pytest.raises(raylift.InputError, match=r"points: expected an array of shape \(N, 3\)"):
        pose.transform([[1, 2]])
    with pytest.raises(TypeError):
        5 @ pose  # type: ignore[operator]


def test_names_that_others_have() -> None:
    camera = raylift.Camera.from_matrix(np.array([[500, 0, 320.5], [0, 510, 240.5], [0, 0, 1]]), 640, 480)
    assert camera == raylift.Camera("PINHOLE", 640, 480, [500, 510, 320.5, 240.5])
    assert raylift.Camera.from_matrix(camera.matrix, camera.width, camera.height) == camera
    for wrong in np.eye(4), np.eye(3) + np.eye(3, k=1), 2 * np.eye(3):
        with pytest.raises(raylift.InputError, match="^matrix: expected"):
            raylift.Camera.from_matrix(wrong, 640, 480)
    for matrix in P.matrix, P.matrix[:3]:
        assert raylift.Rigid3.from_matrix(matrix).matrix == pytest.approx(P.matrix, abs=1e-15)
    with pytest.raises(raylift.InputError, match="pose: expected a 4 x 4 or 3 x 4 matrix"):
        raylift.Rigid3.from_matrix(np.eye(3))
