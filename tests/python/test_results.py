"""What functions return is what their types say, and no type is left open."""

import ast
import json
import os
import re
import typing
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import pytest

import raylift
from raylift import _results
from synthetic import CAMERA, Problem

SOURCE = Path(os.environ["RAYLIFT_SOURCE"])
DEMO = SOURCE / "assets/demo"
MESH = f"mesh:{DEMO / 'scene.obj'}"


def faults(value: Any, kind: Any, path: str = "") -> Iterator[str]:
    """Where a value is not of the type."""
    origin: Any = typing.get_origin(kind)
    of: Any = typing.get_args(kind)
    if hasattr(origin, "__value__"):  # NDArray of newer numpys
        origin, of = np.ndarray, (None, np.dtype[of[0]])
    if typing.is_typeddict(kind):
        if not isinstance(value, dict):
            yield f"{path}: {value!r} is no {kind}"
            return
        kinds = typing.get_type_hints(kind)
        for name in sorted(set(value) - set(kinds)):
            yield f"{path}.{name} is in no type"
        for name in sorted(kind.__required_keys__ - set(value)):
            yield f"{path}.{name} is missing"
        for name in set(value) & set(kinds):
            yield from faults(value[name], kinds[name], f"{path}.{name}")
    elif origin is np.ndarray:
        [number] = typing.get_args(of[1])
        if not isinstance(value, np.ndarray) or value.dtype != number:
            yield f"{path}: {getattr(value, 'dtype', value)} is no {number}"
    elif origin is typing.Union:
        if all(any(faults(value, one)) for one in of):
            yield f"{path}: {value!r} is none of {of}"
    elif origin in (list, dict):
        several = value.items() if origin is dict else enumerate(value)
        if type(value) is not origin:
            yield f"{path}: {value!r} is no {origin}"
        for key, one in several if type(value) is origin else ():
            yield from faults(one, of[-1], f"{path}[{key!r}]")
    elif not isinstance(value, (int, float) if kind is float else kind):
        yield f"{path}: {value!r} is no {kind}"


def of_arrays(tmp_path: Path) -> Iterator[tuple[Any, ...]]:
    problem, mesh = Problem(), raylift.Mesh.read(DEMO / "scene.obj")
    model = raylift.ColmapModel.read(DEMO / "model")
    matches = raylift.hloc.matches_from({"a": np.zeros((2, 4))}, cell_px=2)
    caster, reference = raylift.RayCaster(mesh), model.posed_images[0]
    names = [problem.references[i].name for i in problem.pairs["reference_index"]]
    localized = raylift.Localizer(raylift.Scene.of(problem.references, [mesh])).localize_matches(
        CAMERA, problem.pairs["query2d"], problem.pairs["reference2d"], names)
    with pytest.raises(raylift.OptionError) as error:
        caster.render(reference.camera, reference.cam_from_world, ["nonsense"])
    products = str(error.value).split("expected ")[1].split("|")
    view = caster.render(reference.camera, reference.cam_from_world, products)
    assert sorted(view) == sorted(products) == sorted(_results.Pictures.__annotations__)
    yield view, _results.Pictures
    yield caster.score_views(reference.camera, [reference.cam_from_world], mask=view["mask"] > 0,
                             depth=view["depth"], edges=view["depth"]), _results.ViewScores
    yield caster.cast([[0, 0, 1]], [[1, 0, 0]]), _results.RayHits
    yield raylift.Geometry(mesh).lift(reference, [[3, 3]]), _results.LiftedPixels
    yield raylift.Lifter(mesh).lift(reference, [[3, 3]]), _results.LiftedBySources
    yield model.image(model.image_ids[0]), _results.ModelImage
    yield model.points3d, _results.ModelPoints
    yield raylift.extract_features(view["color"]), _results.FoundFeatures
    yield raylift.write_depth(tmp_path / "depth.exr", view["depth"]), _results.WrittenDepth
    yield raylift.filter_points(localized.problem, "fixed")[2], _results.FilterCounts
    yield localized.counts, _results.StageCounts
    yield raylift.onnx.doctor(view["color"], matcher=lambda *_: np.tile([160.0, 120, 0, 0], (20, 1)),
                              first_pixel=0.5), _results.FirstPixel
    yield localized.estimate.noise, _results.Noise
    yield matches, _results.GivenMatches


def test_results_of_arrays(tmp_path: Path) -> None:
    for value, kind in of_arrays(tmp_path):
        assert list(faults(value, kind)) == [], kind


def of_commands(tmp_path: Path) -> Iterator[tuple[Any, ...]]:
    queries, truth, odometry = (tmp_path / f"{name}.txt" for name in ("queries", "truth", "odometry"))
    photographs = raylift.ColmapModel.read(DEMO / "ground_truth").posed_images[:2]
    raylift.write_queries(queries, [(one.name, one.camera) for one in photographs])
    raylift.write_poses(truth, {one.name: one.cam_from_world for one in photographs})
    few: dict[str, Any] = {"max_features": 500, "queries": queries}
    world_from_odometry = raylift.Rigid3([0.5, 0.5, -0.5, 0.5], [3, -2, 1])
    raylift.write_poses(odometry, {one.name: one.cam_from_world * world_from_odometry for one in photographs})
    several: list[dict[str, Any]] = [{"method": "p3p"}, {"rerender": 1}, {"odometry": odometry}]
    for i, options in enumerate(several):
        summary = raylift.localize(tmp_path / str(i), scene=DEMO / "scene.toml", **few, **options)
        yield summary, _results.LocalizeSummary
        lines = [json.loads(line) for line in (tmp_path / str(i) / "queries.jsonl").read_text().splitlines()]
        roles = [line["walk"]["role"] for line in lines if "walk" in line]
        assert roles == (["smoothed", "smoothed"] if "odometry" in options else [])
        yield from ((line, _results.QueryLine) for line in lines)
    yield raylift.evaluate([tmp_path / "0/poses.txt", tmp_path / "1/poses.txt"], scene=DEMO / "scene.toml",
                           calibration=True), _results.Evaluation
    for geometry in MESH, MESH + ",axes=x/z/-y":
        yield raylift.doctor(DEMO / "model", geometry, images=DEMO / "images", max_features=500), _results.Diagnosis
    yield raylift.render_dataset(MESH, tmp_path / "views", model=DEMO / "model", scale=0.1,
                                 products="depth,color"), _results.RenderSummary
    yield raylift.compare(
        DEMO / "model", {"mesh": MESH, "far": MESH + ",scale=1.1"}, truth="mesh", max_side=80,
        images=DEMO / "images", ground_truth=truth, methods="p3p", report=tmp_path / "report",
        **few), _results.Comparison


def test_results_of_commands(tmp_path: Path) -> None:
    for value, kind in of_commands(tmp_path):
        assert list(faults(value, kind)) == [], kind


def types_in(node: ast.AST, owner: str) -> Iterator[tuple[str, str]]:
    """What is public in a file by its type: arguments and results of functions, members, aliases."""
    for one in ast.iter_child_nodes(node):
        if isinstance(one, ast.If):  # TYPE_CHECKING
            yield from types_in(one, owner)
        elif isinstance(one, ast.ClassDef):
            yield from types_in(one, f"{owner}.{one.name}")
        elif isinstance(one, ast.FunctionDef) and (not one.name.startswith("_") or one.name.endswith("__")):
            others = [argument for argument in (one.args.vararg, one.args.kwarg) if argument]
            for argument in [*one.args.posonlyargs, *one.args.args, *one.args.kwonlyargs, *others]:
                if argument.arg not in ("self", "cls"):
                    yield f"{owner}.{one.name}, {argument.arg}", text_of(argument.annotation)
            yield f"{owner}.{one.name}", text_of(one.returns)
        elif isinstance(one, ast.AnnAssign):
            yield f"{owner}.{ast.unparse(one.target)}", text_of(one.annotation)
        elif isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Name):
            yield f"{owner}.{one.targets[0].id}", text_of(one.value)


def text_of(kind: ast.expr | None) -> str:
    return "nothing" if kind is None else ast.unparse(kind)


# They take what the user's own extractor returns, or tensors of libraries that are not imported.
OPEN_BY_INTENT = r"_types\.(Matcher$|(TensorExtractor|BatchMatcher|DenseMatcher)\.\w+,)"
OPEN_BY_PYTHON = r"\.__(getstate|setstate|deepcopy)__(,|$)"


def open_types(files: dict[str, str]) -> list[str]:
    """The public names whose types hold Any, be it by aliases, which may be private."""
    found = [(name, kind) for file, text in files.items() for name, kind in types_in(ast.parse(text), file)
             if not re.search(OPEN_BY_INTENT, name) and not re.search(OPEN_BY_PYTHON, name)]
    opened: set[str] = set()
    while True:
        words = "|".join(["Any", *opened])
        pattern = rf"Callable\[\.\.\.|^(dict|nothing)$|\b({words})\b"
        names = [name for name, kind in found if re.search(pattern, kind)]
        aliases = {name.split(".")[1] for name in names if re.fullmatch(r"\w+\.[A-Z_]\w*", name)}
        if aliases == opened:
            return [name for name in names if not re.search(r"\._(?!_)\w+$", name)]
        opened = aliases


def test_what_is_open_is_found() -> None:
    assert open_types({"a": """
if TYPE_CHECKING:
    _Array = NDArray[Any]
    Arrays = List[_Array]
Whole = List[int]
class Options(TypedDict):
    some: Whole
    more: Dict[str, Any]
class _Model:
    def __call__(self, first: Arrays, *others: int, **options: Any) -> int: ...
    def _hidden(self, some: Any) -> Any: ...
    def __getstate__(self) -> Tuple[Any, ...]: ...
def of(some: Whole, call: Callable[..., int], none) -> List[str]: ...
"""}) == ["a.Arrays", "a.Options.more", "a._Model.__call__, first", "a._Model.__call__, options",
       "a.of, call", "a.of, none"]


def test_no_type_is_left_open() -> None:
    package = Path(raylift.__file__).parent
    files = {file.stem: file.read_text(encoding="utf-8") for file in [*package.glob("*.py"), package / "_core.pyi"]}
    assert len(files) > 10 and open_types(files) == []
