import os
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


def test_each_example_is_tested():
    assert {file.name for file in EXAMPLES.glob("*.py")} == set(ARGUMENTS)


@pytest.mark.parametrize("name", sorted(ARGUMENTS))
def test_example(name, tmp_path):
    places = {"DEMO": str(SOURCE / "assets/demo"), "OUT": str(tmp_path)}
    run = subprocess.run([sys.executable, EXAMPLES / name, *(places[a] for a in ARGUMENTS[name])],
                         text=True, capture_output=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert EXPECTED[name] in run.stdout, run.stdout


@pytest.mark.parametrize("name", sorted(ARGUMENTS))
def test_examples_are_short(name):
    assert len((EXAMPLES / name).read_text().splitlines()) < 40
