"""The package as a whole: its names, its types, its stubs."""

import copy
import inspect
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable

import numpy as np
import pytest

import raylift
from raylift import _core, _options, _types
from synthetic import CAMERA, Problem, some

SOURCE = Path(os.environ["RAYLIFT_SOURCE"])
PYTHON = SOURCE / "apps/python"
DEMO = SOURCE / "assets/demo"


def test_each_name_is_documented() -> None:
    for name in raylift.__all__:
        thing = getattr(raylift, name)
        if name != "__version__":
            assert inspect.getdoc(thing), name
        if inspect.isclass(thing) and thing.__module__ == "raylift._core":
            for method in [m for m in vars(thing) if not m.startswith("_")]:
                # Those without a description say it all by their names.
                assert inspect.getattr_static(thing, method) is not None


def test_each_name_is_tested() -> None:
    tests = "".join(file.read_text(encoding="utf-8") for file in (SOURCE / "tests/python").glob("*.py"))
    missing = [name for name in raylift.__all__ if f"raylift.{name}" not in tests]
    classes = [getattr(raylift, name) for name in raylift.__all__ if inspect.isclass(getattr(raylift, name))]
    for one in classes:
        missing += [f"{one.__name__}.{member}" for member in vars(one)
                    if not member.startswith("_") and member not in tests]
    assert missing == []


def test_an_index_shows_the_readme_without_dead_links() -> None:
    sys.path.insert(0, str(PYTHON))
    from long_description import for_an_index
    readme = (SOURCE / "README.md").read_text(encoding="utf-8")
    relative = r"\]\((?!https?://)"
    assert len(re.findall(relative, readme)) > 10
    citation = 'repository-code: "https://example.org/raylift"\nversion: 1.2.3\n'
    shown = for_an_index(readme, citation)
    assert "](https://example.org/raylift/raw/v1.2.3/assets/localized_query.jpg)" in shown
    assert "](https://example.org/raylift/blob/v1.2.3/assets/docs/pages/localize.md#walks)" in shown
    for text in shown, for_an_index(readme, "version: 1.2.3\n"):
        assert not re.search(relative, text) and "Localization](https://arxiv.org" in text
    assert "![" not in text and "A query of the demo scene" not in text and "## Two commands" in text


def test_no_other_library_is_imported() -> None:
    script = "import sys, raylift; print({'torch', 'pycolmap', 'h5py', 'cv2', 'hloc'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True, check=True)
    assert run.stdout.strip() == "set()"


@pytest.mark.parametrize("checker", [["mypy", "--cache-dir", os.devnull], ["pyright", "--pythonpath", sys.executable]],
                         ids=lambda words: words[0])
def test_types(checker: list[str]) -> None:
    """Of the package, its examples and these tests, as pyproject.toml says."""
    pytest.importorskip(checker[0])
    run = subprocess.run([sys.executable, "-m", *checker], cwd=SOURCE, text=True, capture_output=True)
    assert run.returncode == 0, run.stdout


def test_stubs_are_those_of_the_module(tmp_path: Path) -> None:
    pytest.importorskip("pybind11_stubgen")
    if _core.PYBIND11_MAJOR < 3:
        pytest.skip("the module was built with a pybind11 that tells less of types")
    subprocess.run([sys.executable, PYTHON / "make_stubs.py", tmp_path], check=True)
    assert (tmp_path / "_core.pyi").read_text() == (PYTHON / "raylift/_core.pyi").read_text(), (
        "run apps/python/make_stubs.py")


def test_options_are_those_of_the_program(tmp_path: Path) -> None:
    subprocess.run([sys.executable, PYTHON / "make_options.py", tmp_path], check=True)
    assert (tmp_path / "_options.py").read_text() == (PYTHON / "raylift/_options.py").read_text(), (
        "run apps/python/make_options.py")


@pytest.mark.parametrize("function, command", [
    ("evaluate", "evaluate"), ("compare", "compare"), ("doctor", "doctor"), ("render_dataset", "render"),
    ("color", "color"), ("import_dataset", "import"), ("experiment", "experiment"), ("localize", "localize"),
    ("export", "export"), ("retrieve", "pairs")])
def test_each_option_is_a_keyword_of_its_function(function: str, command: str) -> None:
    shown = subprocess.run([sys.executable, "-m", "raylift", command, "--help"], text=True, capture_output=True)
    names = {name.replace("-", "_") for name in re.findall(r"^  (?:-\w,)?--([\w-]+)", shown.stdout, re.MULTILINE)}
    options = getattr(_options, function.title().replace("_", "") + "Options").__annotations__
    keywords = set(inspect.signature(getattr(raylift, function)).parameters) & names
    assert not keywords & set(options) and keywords | set(options) - {"progress"} == names - {"help", "help_files"}


@pytest.mark.parametrize("options, call", [
    (_types.EstimateOptions, lambda **o: _core.estimate(_core.PoseProblem("PINHOLE 9 9 9 9 4 4"), **o)),
    (_types.LocalizerOptions, lambda **o: raylift.Localizer(raylift.Scene(DEMO / "model"), **o)),
])
def test_the_types_name_the_options_that_there_are(options: Any, call: Callable[..., Any]) -> None:
    with pytest.raises(raylift.OptionError) as error:
        call(nonsense=1)
    names = str(error.value).split("there are ")[1].split(", ")
    assert sorted(names) == sorted(options.__annotations__)


def examples_of_results() -> list[Any]:
    problem = Problem()
    mesh = raylift.Mesh.read(DEMO / "scene.obj")
    scene = raylift.Scene.of(problem.references, [mesh])
    names = [problem.references[i].name for i in problem.pairs["reference_index"]]
    matches = [problem.pairs["query2d"], problem.pairs["reference2d"], names]
    keypoints = np.tile(np.arange(200), 3)  # of those that are not known, pickles know which are equal
    localized = raylift.Localizer(scene).localize_matches(CAMERA, *matches, query_keypoints=keypoints)
    failed = raylift.Localizer(scene).localize_matches(CAMERA, *(rows[:1] for rows in matches), query_keypoints=[0])
    return [problem.references[0], localized, localized.estimate, localized.problem, failed, failed.estimate, mesh]


@pytest.mark.parametrize("one", examples_of_results(), ids=lambda one: type(one).__name__)
def test_results_pickle_copy_compare_and_show_themselves(one: Any) -> None:
    for again in pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one):
        assert again is not one and again == one and repr(again) == repr(one)
        for name in dir(one):
            value, other = getattr(one, name), getattr(again, name)
            if not name.startswith("_") and not callable(value):
                np.testing.assert_equal(other, value)
    assert one != 5 and one != raylift.Rigid3() and "object at" not in repr(one)
    if isinstance(one, raylift.Mesh):
        for picture in one._repr_png_(), raylift.RayCaster(one)._repr_png_():
            assert some(picture).startswith(b"\x89PNG") and len(some(picture)) > 10000
    elif hasattr(one, "verdict"):
        html = one._repr_html_()
        assert (one.verdict if one else "no pose") in html and len(html) < 2000


def test_what_differs_is_not_equal() -> None:
    *_, mesh = examples_of_results()
    others = [raylift.PoseProblem(CAMERA, name=name) for name in "ab"] + [
        raylift.PosedImage(name, CAMERA, raylift.Rigid3()) for name in "ab"] + [
        mesh, raylift.Mesh(mesh.vertices, mesh.triangles[:5])]
    for one, other in zip(others[::2], others[1::2]):
        assert one != other


def test_no_wrong_argument_ends_the_process(tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, SOURCE / "tests/python/wrong_calls.py"], text=True, capture_output=True,
                         cwd=tmp_path, timeout=600)
    assert run.stdout.endswith("survived\n"), run.stdout[-300:] + run.stderr


def test_a_path_that_is_none_is_named(tmp_path: Path) -> None:
    for call in (lambda: raylift.Scene(5), lambda: raylift.read_image(np.zeros((2, 2))),  # type: ignore[arg-type]
                 lambda: raylift.Mesh.read(["a.ply"]),  # type: ignore[arg-type]
                 lambda: raylift.read_poses({})):  # type: ignore[arg-type]
        for kind in raylift.InputError, TypeError:
            with pytest.raises(kind, match=r"^(model|file|files): expected a path"):
                call()


@pytest.mark.parametrize("message, call", [
    ("scene: expected a raylift.Scene, found None", lambda: raylift.Localizer(None)),  # type: ignore[arg-type]
    ("localizer: expected a raylift.Localizer, found Scene",
     lambda: raylift.Tracker(raylift.Scene(DEMO / "model"))),  # type: ignore[arg-type]
    ("url: expected a str, found int", lambda: raylift.Client(5)),  # type: ignore[arg-type]
    ("camera: expected a raylift.Camera, .* found int", lambda: raylift.Camera.of(5)),  # type: ignore[arg-type]
    ("pose: expected numbers, found str", lambda: raylift.Rigid3.of("up")),
    ("reference: expected a raylift.PosedImage, .* found int",
     lambda: raylift.PoseProblem(CAMERA, references=[3])),  # type: ignore[list-item]
    ("points: expected an array .* found str", lambda: CAMERA.project("a")),
    ("image: expected a uint8 array .* found float64", lambda: raylift.extract_features(np.zeros((9, 9)))),
    ("geometry: expected a Mesh, .* found int", lambda: raylift.Geometry(5)),  # type: ignore[arg-type]
    ("query: expected a raylift.Query .* found a str", lambda: raylift.write_queries("a", ["b"])),  # type: ignore[list-item]
    ("poses, name: expected a str, found int", lambda: raylift.write_poses("a", {5: np.eye(4)})),  # type: ignore[dict-item]
    ("name: expected a str, found 5", lambda: raylift.PosedImage(5, CAMERA, np.eye(4))),  # type: ignore[arg-type]
])
def test_a_wrong_type_is_a_type_error_and_an_input_error(message: str, call: Callable[[], Any]) -> None:
    for kind in TypeError, ValueError, raylift.InputError:
        with pytest.raises(kind, match=f"^{message}"):
            call()
    with pytest.raises(raylift.InputError) as wrong_value:
        raylift.Rigid3.of(2 * np.eye(4))
    assert not isinstance(wrong_value.value, TypeError)


def test_methods_without_an_object_are_type_errors() -> None:
    for method in raylift.Camera.__str__, raylift.Mesh._repr_png_, raylift.ColmapModel.write:
        with pytest.raises(raylift.InputError, match="expected"):
            method(None)  # type: ignore[arg-type, call-arg]


def test_a_scene_of_an_object_that_writes_a_model() -> None:
    class Reconstruction:
        def write(self, folder: str) -> None:
            raylift.ColmapModel.read(DEMO / "model").write(folder)

    there_are = len(raylift.Scene(DEMO / "model").references)
    for model in Reconstruction(), raylift.ColmapModel.read(DEMO / "model"):
        assert len(raylift.Scene(model).references) == there_are


def test_an_open_file_is_no_model(tmp_path: Path) -> None:
    with open(tmp_path / "kept.txt", "w+") as file:
        with pytest.raises(raylift.InputError, match="model: expected a path"):
            raylift.Scene(file)
    assert (tmp_path / "kept.txt").read_text() == ""
