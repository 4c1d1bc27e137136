"""raylift serve on real photographs: the answers of the command line."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from served import DEMO, RAYLIFT, Server, cached, lines_of, query_form

sys.path.append(str(DEMO.parents[1] / "tests/bench"))
import bench_serve  # noqa: E402


def test_answers_are_those_of_the_command_line_to_8_clients_at_once(tmp_path: Path) -> None:
    scenes: dict[str, Any] = {name: more for name, *more in bench_serve.scenes(tmp_path)}
    if "rgbd_small" not in scenes:
        pytest.skip("rgbd_small is not in the folder RAYLIFT_TEST_DATA")
    scene, images, cameras = scenes["rgbd_small"]
    run = tmp_path / "run"
    subprocess.run([RAYLIFT, "localize", "--scene", scene, "--no-doctor", "--out", run, "--quiet"], check=True)
    with Server(*cached(run), scenes=[scene]) as server:
        requests = {name: query_form(name, camera, images / name) for name, camera in cameras.items()}
        answers = server.answer_8_at_once(requests)
    assert len(answers) == 10 and answers == lines_of(run)
