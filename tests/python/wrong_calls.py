"""Calls each function and method of the package with wrong arguments, one at a time, the others being
right, and all at once. It writes into its working folder alone and opens no connection.

    python wrong_calls.py    # ends in "survived", or with the name that it ended in
"""

from __future__ import annotations

import ast
import contextlib
import inspect
import os
import re
import sys
import urllib.request
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple

import numpy as np

import raylift
from raylift import _core, _options, _types

DEMO = Path(os.environ["RAYLIFT_SOURCE"]) / "assets/demo"
CAMERA = raylift.Camera("PINHOLE", 64, 48, [60, 60, 32, 24])
BESIDE = raylift.Rigid3([1, 0, 0, 0], [1, 0, 0])
REFERENCES = [raylift.PosedImage("a.jpg", CAMERA, raylift.Rigid3()), raylift.PosedImage("b.jpg", CAMERA, BESIDE)]
MESH = raylift.Mesh([[-9, -9, 5], [9, -9, 5], [0, 9, 5]], [[0, 1, 2]])
PIXELS = np.array([[10.0, 10], [50, 12], [30, 40], [25, 25]])
POINTS = 5 * CAMERA.rays(PIXELS)
FEATURES = {"keypoints": PIXELS, "descriptors": np.eye(4, 8, dtype=np.float32)}
PHOTOGRAPH = np.full((48, 64), 100, np.uint8)
PROBLEM = raylift.PoseProblem(CAMERA, PIXELS, POINTS, references=REFERENCES, query2d=PIXELS, reference2d=PIXELS,
                              reference_index=[0, 0, 0, 0])
SCENE = raylift.Scene.of(REFERENCES, [MESH])
LOCALIZER = raylift.Localizer(SCENE, reference_features={"a.jpg": FEATURES, "b.jpg": FEATURES})
RESULT = LOCALIZER.localize_matches(CAMERA, PIXELS, PIXELS, ["a.jpg"] * 4)
DEPTH = np.full((48, 64), 5, np.float32)


def model() -> raylift.ColmapModel:
    made = raylift.ColmapModel()
    made.add_camera(1, CAMERA)
    made.add_image(1, "a.jpg", 1, raylift.Rigid3(), PIXELS)
    made.add_point3d(1, [0, 0, 5], [[1, 0]])
    return made


def written() -> Path:
    model().write("model")
    return Path("model")


def tracker() -> raylift.Tracker:
    return raylift.Tracker(LOCALIZER)


# An object of each class whose methods are called.
SELVES: Dict[str, Callable[[], Any]] = {
    "Camera": lambda: CAMERA, "Rigid3": lambda: BESIDE, "Query": lambda: raylift.Query("a.jpg", CAMERA),
    "PosedImage": lambda: REFERENCES[0], "PoseProblem": lambda: PROBLEM, "PoseEstimate": lambda: RESULT.estimate,
    "Mesh": lambda: MESH, "RayCaster": lambda: raylift.RayCaster(MESH), "Geometry": lambda: raylift.Geometry(MESH),
    "DepthMaps": lambda: raylift.DepthMaps.from_arrays({"a.jpg": DEPTH}, REFERENCES),
    "SfmPoints": lambda: raylift.SfmPoints(written()), "Lifter": lambda: raylift.Lifter(MESH),
    "Scene": lambda: SCENE, "LocalizedQuery": lambda: RESULT, "Localizer": lambda: LOCALIZER, "ColmapModel": model,
    "TrackedPose": lambda: tracker().add(RESULT, cam_from_odometry=BESIDE, time=1),
    "SceneTracker": lambda: _core.SceneTracker(SCENE, "known", 0), "Tracker": tracker,
    "Client": lambda: raylift.Client("http://localhost", patience=0),
}
VALUES = [None, 5, -1, 2**70, 0.5, "nowhere", b"x", [], [1], ["a"], {}, {"a": 1}, np.zeros(3), np.full((2, 2), np.nan),
          np.zeros((2, 3), object), object(), float("nan"), print, True, (1, 2), *(make() for make in SELVES.values())]
FEW = VALUES[:12]
# What is right, by the names of functions' arguments, or of arguments.
RIGHT: Dict[str, Any] = {
    "PosedImage.cam_from_world": BESIDE, "Mesh.triangles": [[0, 1, 2]], "Mesh.vertices": MESH.vertices,
    "RayCaster.of_points.points": np.random.default_rng(0).normal(0, 1, (30, 3)), "RayCaster.render.pose": BESIDE,
    "Camera.from_matrix.matrix": CAMERA.matrix, "Rigid3.from_matrix.matrix": BESIDE.matrix,
    "Camera.params": CAMERA.params, "Camera.model": "PINHOLE", "Mesh.read.files": "triangle.obj",
    "Geometry.lift.reference": REFERENCES[0], "Geometry.geometry": MESH, "DepthMaps.folder": ".",
    "DepthMaps.references": REFERENCES, "DepthMaps.from_arrays.maps": {"a.jpg": DEPTH},
    "ColmapModel.track.point3d_id": 1, "ColmapModel.image.image_id": 1, "ColmapModel.add_camera.camera_id": 7,
    "ColmapModel.add_image.image_id": 7, "ColmapModel.add_image.name": "c.jpg",
    "ColmapModel.add_image.camera_id": 1, "ColmapModel.add_image.cam_from_world": BESIDE,
    "ColmapModel.add_point3d.point3d_id": 7, "ColmapModel.read.folder": DEMO / "model",
    "PoseProblem.read.file": "problem.json", "Scene.read.file": DEMO / "scene.toml", "Scene.model": DEMO / "model",
    "SfmPoints.model": "model", "Localizer.localize.query": FEATURES, "Tracker.add.query": FEATURES,
    "Localizer.localize_all.queries": [], "estimate_all.problems": [PROBLEM], "read_depth.file": "depth.npy",
    "read_image.file": DEMO / "images/query/query_02.jpg", "read_poses.file": "poses.txt",
    "read_queries.file": DEMO / "queries.txt", "write_depth.file": "depth.npy", "write_poses.file": "poses.txt",
    "write_queries.file": "queries.txt", "refine_pose.cam_from_world": raylift.Rigid3(), "write_poses.poses": {},
    "solve_e5p1.reference": BESIDE, "solve_d3p1.reference": BESIDE, "solve_e5p1.rays": np.eye(6, 3),
    "solve_e5p1.reference_rays": np.eye(6, 3), "solve_d3p1.rays": np.eye(4, 3),
    "solve_up2p.rays": np.eye(2, 3), "solve_up2p.points3d": POINTS[:2], "solve_known_center.rays": np.eye(2, 3),
    "solve_known_center.points3d": POINTS[:2], "Query.name": "a.jpg", "RayCaster.mesh": MESH,
    "alone": RESULT, "cam_from_odometry": BESIDE, "camera": CAMERA, "camera_id": 1, "cameras": CAMERA,
    "cam_from_world": BESIDE, "center": [0, 0, 0], "centers": np.zeros((3, 3)), "depth": DEPTH,
    "directions": np.eye(3), "down_in_cam": [0, 1, 0], "down_in_world": [0, 0, -1], "file": "out.txt",
    "folder": "out", "fourth_reference": BESIDE, "fourth_reference_ray": [0, 0, 1], "height": 48, "image": PHOTOGRAPH,
    "index": 0, "localizer": LOCALIZER, "mask": np.ones((48, 64), bool), "matrix": np.eye(4), "means": np.zeros((1, 3)),
    "memo": {}, "min_confidence": 0.0, "name": "a.jpg", "odometry_scale": "known", "opacities": [1],
    "origins": np.zeros((3, 3)), "other": BESIDE, "out": "out", "pixels": PIXELS, "points": POINTS,
    "points3d": POINTS[:3], "points_in_reference": POINTS[:3], "pose": BESIDE, "poses": [BESIDE],
    "position": [0, 0, 5], "problem": PROBLEM, "problems": [PROBLEM], "queries": [], "query2d": PIXELS,
    "rays": np.eye(3), "reference": REFERENCES[0], "reference2d": PIXELS, "reference_names": ["a.jpg"] * 4,
    "reference_rays": np.eye(6, 3), "references": REFERENCES, "rotation": [1, 0, 0, 0], "rotations": [[1, 0, 0, 0]],
    "scales": np.ones((1, 3)), "scene": SCENE, "sixth_reference": BESIDE, "track": np.zeros((0, 2), int),
    "time": 1, "translation": [0, 0, 0], "url": "http://localhost", "width": 64,
}
# What is right in addition, so that there is something to do.
ALSO = {"Localizer.localize": ["camera"], "RayCaster.score_views": ["mask"], "Query": ["camera"]}
# Those that are not called: the program itself, and what a pickle calls.
LEFT_OUT = {"run_program", "run_command", "main"}
random = np.random.default_rng(0)

Parameters = Tuple[List[str], List[str], List[str]]  # by position, that must be given, by name alone


def options_of(annotation: str) -> List[str]:
    """The names of the options that a function takes as **options: Unpack[Options]."""
    found = re.search(r"Unpack\[(?:\w+\.)*(\w+)\]", annotation)
    owner = next((module for module in (_types, _options) if found and hasattr(module, found[1])), None)
    return list(getattr(owner, found[1]).__annotations__) if found and owner else []


def of_stub(node: ast.FunctionDef) -> Parameters:
    arguments = [one.arg for one in node.args.args if one.arg not in ("self", "cls")]
    required = arguments[:len(arguments) - len(node.args.defaults)]
    alone = [one.arg for one in node.args.kwonlyargs]
    required += [one for one, value in zip(alone, node.args.kw_defaults) if value is None]
    if node.args.kwarg is not None and node.args.kwarg.annotation is not None:
        alone += options_of(ast.unparse(node.args.kwarg.annotation))
    return arguments, required, alone


def of_function(function: Callable[..., Any]) -> Parameters:
    arguments: List[str] = []
    required: List[str] = []
    alone: List[str] = []
    for name, one in inspect.signature(function).parameters.items():
        if one.kind == one.VAR_KEYWORD:
            alone += options_of(str(one.annotation))
        elif one.kind not in (one.VAR_POSITIONAL,):
            (alone if one.kind == one.KEYWORD_ONLY else arguments).append(name)
            if one.default is one.empty:
                required.append(name)
    return arguments, required, alone


def right(owner: str, name: str) -> Any:
    return next((RIGHT[key] for key in (f"{owner}.{name}", name) if key in RIGHT), None)


def rights(owner: str, parameters: Parameters) -> Dict[str, Any]:
    return {name: right(owner, name) for name in [*parameters[1], *ALSO.get(owner, [])]}


def calls(owner: str, parameters: Parameters, values: List[Any]) -> Iterator[Tuple[List[Any], Dict[str, Any]]]:
    arguments, _, alone = parameters
    for value in values:
        for n in range(1, len(arguments) + 1):
            yield [value] * n, {}
        for name in arguments + alone:
            yield [], {**rights(owner, parameters), name: value}
    for _ in range(20):
        yield [values[i] for i in random.integers(0, len(values), max(len(arguments), 1))], {}


def attack(owner: str, make: Callable[[], Optional[Callable[..., Any]]], parameters: Parameters,
           must_work: bool = True, values: List[Any] = VALUES) -> None:
    print(owner, flush=True)  # the last one is whom it ended with
    function = make()
    assert function is not None
    if must_work:
        function(**rights(owner, parameters))
    for arguments, keywords in calls(owner, parameters, values):
        function = make()
        assert function is not None
        try:
            function(*arguments, **keywords)
        except (TypeError, ValueError, LookupError, AttributeError, OSError, ImportError) as error:
            told = str(error)
            assert "C++" not in told and "Invoked with" not in told and "::" not in told, (arguments, keywords, told)
        except BaseException:
            print(owner, arguments, keywords, file=sys.stderr)
            raise


def attack_class(name: str, cls: Any, node: ast.ClassDef) -> None:
    for method in node.body:
        if not isinstance(method, ast.FunctionDef) or method.name in ("__new__", "__hash__", "__eq__", "__array__"):
            continue
        decorators = {getattr(one, "id", "") for one in method.decorator_list}
        method_name = method.name
        owner = f"{name}.{method_name}"
        parameters = of_stub(method)
        if method.name == "__init__":
            attack(name, lambda: cls, parameters, must_work=name not in ("DepthMaps", "Lifter"))
        elif method.name == "__setstate__":
            attack(owner, lambda: lambda state: cls.__new__(cls).__setstate__(state), (["state"], ["state"], []),
                   must_work=False)
        elif "staticmethod" in decorators:
            attack(owner, lambda: getattr(cls, method_name), parameters)
        elif "property" in decorators:
            print(owner, flush=True)
            for value in VALUES:
                with contextlib.suppress(TypeError):
                    getattr(cls, method_name).fget(value)
        else:
            attack(owner, lambda: getattr(SELVES[name](), method_name), parameters,
                   must_work=owner != "Localizer.write_calibration")
            # Also without an object of its own class.
            attack(owner + ", self", lambda: getattr(cls, method_name), (["self", *parameters[0]], [], []),
                   must_work=False)


def attack_core() -> None:
    stub = ast.parse((Path(raylift.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))
    for node in stub.body:
        if isinstance(node, ast.FunctionDef) and node.name not in LEFT_OUT:
            name = node.name
            attack(name, lambda: getattr(_core, name), of_stub(node))
        if isinstance(node, ast.ClassDef) and not node.name.endswith("Error"):
            attack_class(node.name, getattr(_core, node.name), node)


def attack_python() -> None:
    """What is written in Python."""
    def no_connection(*arguments: Any, **keywords: Any) -> Any:
        raise OSError("no connection is opened")

    urllib.request.urlopen = no_connection
    for owner in raylift, raylift.hloc, raylift.onnx:
        for name, one in list(vars(owner).items()):
            if name.startswith("_") or name in LEFT_OUT or not getattr(one, "__module__", "").startswith("raylift."):
                continue
            if one.__module__ == "raylift._core" or (owner is not raylift and one.__module__ != owner.__name__):
                continue
            if inspect.isclass(one):
                attack(name, lambda: one, of_function(one), must_work=False, values=FEW)
                for method, function in inspect.getmembers(one, inspect.isfunction):
                    if not method.startswith("_") and name in SELVES:
                        arguments, required, alone = of_function(function)
                        attack(f"{name}.{method}", lambda: getattr(SELVES[name](), method),
                               (arguments[1:], required[1:], alone), must_work=False, values=FEW)
            elif callable(one):
                attack(name, lambda: one, of_function(one), must_work=False, values=FEW)


if __name__ == "__main__":
    PROBLEM.write("problem.json")
    np.save("depth.npy", DEPTH)
    Path("triangle.obj").write_text("v 0 0 5\nv 1 0 5\nv 0 1 5\nf 1 2 3\n")
    raylift.write_poses("poses.txt", {})
    attack_core()
    attack_python()
    print("survived")
