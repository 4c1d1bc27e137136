import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(os.environ["RAYLIFT_SOURCE"])
EXAMPLES = SOURCE / "apps/python/examples"
ARGUMENTS = {
    "compare_depth.py": ["DEMO", "OUT"],
    "depth_maps.py": ["DEMO", "OUT"],
    "learned_matches.py": ["DEMO"],
    "localize_photograph.py": ["DEMO"],
    "pose_and_trust.py": [],
}
EXPECTED = {
    "compare_depth.py": "scaled: mean relative error 0.10",
    "depth_maps.py": "images in",
    "learned_matches.py": "points, 0.0",
    "localize_photograph.py": "localized: taken at (11.3",
    "pose_and_trust.py": "localized with confidence 1.000",
}


def test_each_example_is_tested() -> None:
    assert {file.name for file in EXAMPLES.glob("*.py")} == set(ARGUMENTS)


@pytest.mark.parametrize("name", sorted(ARGUMENTS))
def test_example(name: str, tmp_path: Path) -> None:
    places = {"DEMO": str(SOURCE / "assets/demo"), "OUT": str(tmp_path)}
    run = subprocess.run([sys.executable, EXAMPLES / name, *(places[a] for a in ARGUMENTS[name])],
                         text=True, capture_output=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert EXPECTED[name] in run.stdout, run.stdout


@pytest.mark.parametrize("name", sorted(ARGUMENTS))
def test_examples_are_short(name: str) -> None:
    assert len((EXAMPLES / name).read_text().splitlines()) < 40


def test_notebook_by_its_code_alone() -> None:
    """Plots only where there is what draws them."""
    cells = json.loads((EXAMPLES / "demo.ipynb").read_text(encoding="utf-8"))["cells"]
    plots = importlib.util.find_spec("matplotlib") is not None
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"
            and (plots or "plot" not in cell["metadata"].get("tags", []))]
    run = subprocess.run([sys.executable, "-c", "\n".join(code)], text=True, capture_output=True,
                         cwd=EXAMPLES, env=dict(os.environ, MPLBACKEND="agg"))
    assert run.returncode == 0, run.stderr
    # OpenCV's features differ from version to version, and the last query has few.
    assert run.stdout.count("localized") == 12 and re.search("(92|100) % within 5 cm", run.stdout), run.stdout


def test_notebook_by_its_kernel() -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(EXAMPLES / "demo.ipynb", as_version=4)
    assert all(not cell.outputs for cell in notebook.cells if cell.cell_type == "code")
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(EXAMPLES)}}).execute()
    texts = [output.text for cell in notebook.cells for output in cell.get("outputs", ())
             if output.output_type == "stream"]
    assert re.search("(92|100) % within 5 cm", "".join(texts))
    assert any("image/png" in output.get("data", {}) for cell in notebook.cells
               for output in cell.get("outputs", ()))
