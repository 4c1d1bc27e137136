"""Arguments of wrong types and values: each error is one line that names the argument, what was expected
and what came."""

import inspect
import os
import re
from pathlib import Path
from typing import Any, Callable

import numpy as np
import pytest

import raylift
from raylift import _core
from synthetic import CAMERA

DEMO = Path(os.environ["RAYLIFT_SOURCE"]) / "assets/demo"
MODEL, MESH = DEMO / "model", raylift.Mesh.read(DEMO / "scene.obj")
CASTER = raylift.RayCaster(MESH)
SCENE = raylift.Scene(MODEL, [MESH])
LOCALIZER = raylift.Localizer(SCENE)
PROBLEM = raylift.PoseProblem(CAMERA)
POSE = raylift.Rigid3()
PIXELS, POINTS = np.zeros((3, 2)), np.zeros((3, 3))
GRAY = np.zeros((4, 4), np.uint8)

CALLS = [
    ("params|parameters", lambda: raylift.Camera("PINHOLE", 640, 480, [1, 2])),
    ("width", lambda: raylift.Camera("PINHOLE", 640.5, 480, [500, 500, 320, 240])),
    ("width", lambda: raylift.Camera("PINHOLE", "640", 480, [500, 500, 320, 240])),  # type: ignore[arg-type]
    ("width", lambda: raylift.Camera("PINHOLE", 2**40, 480, [500, 500, 320, 240])),
    ("size", lambda: raylift.Camera("PINHOLE", -5, 480, [500, 500, 320, 240])),
    ("model", lambda: raylift.Camera("NONE", 640, 480, [1])),
    ("model", lambda: raylift.Camera(5, 640, 480, [1])),  # type: ignore[arg-type]
    ("params", lambda: raylift.Camera("PINHOLE", 640, 480)),  # type: ignore[call-arg]
    ("params", lambda: raylift.Camera("PINHOLE", 640, 480, None)),  # type: ignore[arg-type]
    ("params", lambda: raylift.Camera("PINHOLE", 640, 480, "abc")),
    ("camera", lambda: raylift.Camera.of(5)),  # type: ignore[arg-type]
    ("camera", lambda: raylift.Camera.of(None)),  # type: ignore[arg-type]
    ("camera", lambda: raylift.Camera.of({"model": "PINHOLE", "width": 1})),
    ("points", lambda: CAMERA.project(PIXELS)),
    ("points", lambda: CAMERA.project("a")),
    ("points", lambda: CAMERA.project()),  # type: ignore[call-arg]
    ("arguments", lambda: CAMERA.project(POINTS, POINTS)),  # type: ignore[call-arg]
    ("pints", lambda: CAMERA.project(pints=POINTS)),  # type: ignore[call-arg]
    ("height", lambda: CAMERA.scaled(100)),  # type: ignore[call-arg]
    ("translation", lambda: raylift.Rigid3([1, 0, 0, 0])),  # type: ignore[call-overload]
    ("rotation", lambda: raylift.Rigid3([0, 0, 0, 0], [0, 0, 0])),
    ("translation", lambda: raylift.Rigid3(np.eye(3), [0, 0])),
    ("pose", lambda: raylift.Rigid3.of(np.ones((4, 4)))),
    ("points", lambda: POSE * "a"),
    ("name", lambda: raylift.Query(5, CAMERA)),  # type: ignore[arg-type]
    ("position_prior", lambda: raylift.Query("a", CAMERA, position_prior=5)),  # type: ignore[arg-type]
    ("position_prior", lambda: raylift.Query("a", CAMERA, position_prior=([0, 0], 1))),
    ("focal_range", lambda: raylift.Query("a", CAMERA, focal_range="x")),  # type: ignore[arg-type]
    ("gravity_prior", lambda: raylift.Query("a", CAMERA, gravity_prior=([0, 0, 1], [0, 0, 1]))),  # type: ignore[arg-type]
    ("pose", lambda: raylift.PosedImage("a", CAMERA, 5)),
    ("name", lambda: raylift.PosedImage(None, CAMERA, POSE)),  # type: ignore[arg-type]
    ("points3d", lambda: raylift.PoseProblem(CAMERA, PIXELS)),
    ("point_sigmas", lambda: raylift.PoseProblem(CAMERA, PIXELS, POINTS, point_sigmas=[-1, 1, 1])),
    ("references", lambda: raylift.PoseProblem(CAMERA, references=5)),  # type: ignore[arg-type]
    ("reference", lambda: raylift.PoseProblem(CAMERA, references=[5])),  # type: ignore[list-item]
    (r"reference_clusters\[0\]", lambda: raylift.PoseProblem(CAMERA, reference_clusters=["a"])),  # type: ignore[list-item]
    ("point_references", lambda: raylift.PoseProblem(CAMERA, PIXELS, POINTS, point_references=[.5, 0, 0])),
    ("method", lambda: raylift.estimate_pose(CAMERA, method=5)),  # type: ignore[arg-type]
    ("method", lambda: raylift.estimate_pose(CAMERA, method="best")),  # type: ignore[arg-type]
    ("max_iterations", lambda: raylift.estimate_pose(CAMERA, max_iterations="a")),  # type: ignore[arg-type]
    ("confidence", lambda: raylift.estimate_pose(CAMERA, confidence=2)),
    ("treshold", lambda: raylift.estimate_pose(CAMERA, treshold=1)),  # type: ignore[call-arg]
    ("scene_calibration", lambda: raylift.estimate_pose(CAMERA, scene_calibration=5)),  # type: ignore[arg-type]
    ("problem", lambda: _core.estimate(5)),  # type: ignore[arg-type]
    ("problems", lambda: raylift.estimate_all(PROBLEM)),  # type: ignore[arg-type]
    (r"problems\[1\]", lambda: raylift.estimate_all([PROBLEM, 5])),  # type: ignore[list-item]
    ("progress", lambda: raylift.estimate_all([PROBLEM], progress=5)),  # type: ignore[arg-type]
    ("threads", lambda: raylift.estimate_all([PROBLEM], threads="all")),  # type: ignore[arg-type]
    ("cam_from_world", lambda: raylift.refine_pose(PROBLEM)),  # type: ignore[call-arg]
    ("triangle", lambda: raylift.Mesh(POINTS, [[0, 1, 7]])),
    ("colors", lambda: raylift.Mesh(POINTS, [[0, 1, 2]], colors=np.zeros((3, 3)) + .5)),
    ("colors", lambda: raylift.Mesh(POINTS, [[0, 1, 2]], colors=np.ones((3, 3)))),
    ("colors", lambda: raylift.Mesh(POINTS, [[0, 1, 2]], colors=np.eye(3, dtype=np.float32))),
    ("colors", lambda: raylift.Mesh(POINTS, [[0, 1, 2]], colors=np.full((3, 3), 256))),
    ("colors", lambda: raylift.RayCaster.of_points(POINTS, colors=np.ones((3, 3)))),
    ("colors", lambda: raylift.RayCaster.of_points(POINTS, colors=np.full((3, 3), -1))),
    ("background", lambda: CASTER.render(CAMERA, POSE, background=(300, 0, 0))),
    ("files", lambda: raylift.Mesh.read(5)),  # type: ignore[arg-type]
    ("mesh", lambda: raylift.RayCaster(None)),  # type: ignore[arg-type]
    ("build", lambda: raylift.RayCaster(MESH, build="best")),
    ("directions", lambda: CASTER.cast(POINTS, PIXELS)),
    ("products", lambda: CASTER.render(CAMERA, POSE, "depth")),
    ("supersampling", lambda: CASTER.render(CAMERA, POSE, supersampling=100)),
    ("background", lambda: CASTER.render(CAMERA, POSE, background=5)),  # type: ignore[arg-type]
    ("poses", lambda: CASTER.render_many(CAMERA, POSE)),  # type: ignore[arg-type]
    ("geometry", lambda: raylift.Scene(MODEL, 5)),  # type: ignore[arg-type]
    ("geometry", lambda: raylift.Scene(MODEL, [5])),  # type: ignore[list-item]
    ("every", lambda: raylift.Scene(MODEL, every="a")),  # type: ignore[arg-type]
    ("every", lambda: raylift.Scene(MODEL, every=0)),
    ("scene", lambda: raylift.Localizer(5)),  # type: ignore[arg-type]
    ("top_k", lambda: raylift.Localizer(SCENE, top_k=0)),
    ("matcher", lambda: raylift.Localizer(SCENE, matcher=5)),  # type: ignore[arg-type]
    ("image", lambda: LOCALIZER.localize(np.zeros((4, 4)), CAMERA)),  # type: ignore[arg-type]
    ("queries", lambda: LOCALIZER.localize_all(5)),  # type: ignore[arg-type]
    ("query, name", lambda: LOCALIZER.localize_all([(5, CAMERA)])),  # type: ignore[list-item]
    ("query, camera", lambda: LOCALIZER.localize_all([("a", None)])),  # type: ignore[list-item]
    ("reference_names", lambda: LOCALIZER.localize_matches(CAMERA, PIXELS, PIXELS, "abc")),
    ("raw_size", lambda: raylift.read_depth("a.raw", raw_size=5)),  # type: ignore[arg-type]
    ("depth", lambda: raylift.write_depth("a.npy", "a")),
    ("poses", lambda: raylift.write_poses("a.txt", [POSE])),  # type: ignore[arg-type]
    ("poses, name", lambda: raylift.write_poses("a.txt", {5: POSE})),  # type: ignore[dict-item]
    ("queries", lambda: raylift.write_queries("a.txt", 5)),  # type: ignore[arg-type]
    ("camera_id", lambda: raylift.ColmapModel().add_camera("a", CAMERA)),  # type: ignore[arg-type]
    ("color", lambda: raylift.ColmapModel().add_point3d(1, [0, 0, 0], [[1, 2]], color=[1, 2])),
    ("form", lambda: raylift.ColmapModel().write("x", form="json")),
    ("max_features", lambda: raylift.extract_features(GRAY, max_features="a")),  # type: ignore[arg-type]
    ("filter", lambda: raylift.filter_points(PROBLEM, "best")),
    ("rays", lambda: raylift.solve_p3p(PIXELS, POINTS)),
    ("maps", lambda: raylift.DepthMaps.from_arrays(5)),  # type: ignore[arg-type, call-arg]
]


@pytest.mark.parametrize("name, call", CALLS, ids=lambda one: inspect.getsource(one).strip()[:90] if callable(one) else "")
def test_wrong_arguments_are_told_in_one_line(name: str, call: Callable[..., Any], tmp_path: Path,
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((TypeError, raylift.InputError, raylift.OptionError)) as error:
        call()
    told = str(error.value)
    assert re.search(rf"(^|\W){name}\b" if name.isidentifier() else name, told), told
    assert re.search("expected|must|is none of|no such|has no direction", told), told
    assert "\n" not in told and "C++" not in told and "::" not in told and len(told) < 400


def test_no_signature_shows_types_of_cpp() -> None:
    for owner in [_core, *(one for one in vars(_core).values() if inspect.isclass(one))]:
        for name, member in vars(owner).items():
            text = (getattr(member, "__doc__", None) or "") + (getattr(getattr(member, "fget", None), "__doc__", None) or "")
            assert "::" not in text, (owner, name, text)
