"""The ready files of assets/serve: their syntax, and two servers behind the proxy."""

import os
import re
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Callable

import pytest

from served import DEMO, FAST, QUERIES, RAYLIFT, SCENE, Server, query_form
from synthetic import some

FOLDER = DEMO.parent / "serve"


def test_the_ready_files_name_options_that_there_are() -> None:
    known = subprocess.run([RAYLIFT, "serve", "--help"], capture_output=True, text=True, check=True).stdout
    used = {}
    for name in ("raylift.service", "compose.yaml", "kubernetes.yaml"):
        used[name] = set(re.findall(r"--[a-z][a-z-]+", (FOLDER / name).read_text()))
        assert used[name] >= {"--scene-calibration", "--cache", "--tokens", "--session-key"}
        assert all(f"  {option} " in known for option in used[name]), used[name]
    yaml = pytest.importorskip("yaml")
    kinds = [part["kind"] for part in yaml.safe_load_all((FOLDER / "kubernetes.yaml").read_text())]
    assert kinds == ["Deployment", "Service", "HorizontalPodAutoscaler"]
    assert set(yaml.safe_load((FOLDER / "compose.yaml").read_text())["services"]) == {"raylift-1", "raylift-2", "caddy"}
    scaling = list(yaml.safe_load_all((FOLDER / "kubernetes.yaml").read_text()))[2]
    # A metric that nobody serves would keep replicas for ever.
    assert [metric["type"] for metric in scaling["spec"]["metrics"]] == ["Resource"]


def systemd_version() -> int:
    """0: it is not here."""
    if not shutil.which("systemd-analyze"):
        return 0
    told = subprocess.run(["systemd-analyze", "--version"], capture_output=True, text=True, check=True).stdout
    return int(some(re.match(r"systemd (\d+)", told))[1])


@pytest.mark.skipif(systemd_version() < 250, reason="no systemd that knows security --offline is here")
def test_the_unit_is_one_of_systemd_and_sandboxed(tmp_path: Path) -> None:
    unit = tmp_path / "raylift.service"
    unit.write_text((FOLDER / "raylift.service").read_text().replace("/usr/bin/raylift", RAYLIFT))
    checked = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True)
    assert checked.returncode == 0 and str(unit) not in checked.stderr, checked.stderr
    exposed = subprocess.run(["systemd-analyze", "security", "--offline=true", "--threshold=30", unit],
                             capture_output=True, text=True)
    assert exposed.returncode == 0, exposed.stdout


def free_port() -> int:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return int(unused.getsockname()[1])


def wait_until(holds: Callable[[], bool]) -> None:
    until = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.1)


def is_ready(server: Server) -> bool:
    try:
        return server.ask("/readyz")[0] == 200
    except OSError:
        return False


@pytest.mark.skipif(not shutil.which("caddy"), reason="Caddy is not here")
def test_two_servers_answer_behind_the_proxy_as_one(tmp_path: Path) -> None:
    subprocess.run([RAYLIFT, "calibrate", "--scene", SCENE, "--cache", tmp_path / "cache", "--out",
                    tmp_path / "calibration.json", "--quiet", *FAST], check=True)
    name, port = sorted(QUERIES)[0], free_port()
    options = (*FAST, "--cache", tmp_path / "cache", "--scene-calibration", tmp_path / "calibration.json")
    with Server(*options) as first, Server(*options, "--drain-delay", "12s") as second:
        environment = {**os.environ, "HOME": str(tmp_path), "RAYLIFT_SITE": f"http://:{port}",
                       "RAYLIFT_SERVERS": f"{first.url[7:]} {second.url[7:]}"}
        # Another Caddy of this machine may have the port of its administration.
        (tmp_path / "Caddyfile").write_text("{\n\tadmin off\n}\n" f"import {FOLDER / 'Caddyfile'}\n")
        proxy = subprocess.Popen(["caddy", "run", "--config", tmp_path / "Caddyfile", "--adapter", "caddyfile"],
                                 env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            direct, first.url = first.url, f"http://127.0.0.1:{port}"
            wait_until(lambda: is_ready(first))
            answers = {}

            def both_have_answered() -> bool:
                first.url = f"http://127.0.0.1:{port}"
                answers.update(first.answer_8_at_once({name: query_form(name)}))
                first.url = direct
                return all(b'route="/v1/localize",status="200"' in server.ask("/metrics")[2]
                           for server in (first, second))

            assert first.ask("/metrics")[0] == 404  # these are for inside
            wait_until(both_have_answered)
            assert answers[name] == first.localize(name)
            second.process.send_signal(signal.SIGTERM)
            first.url = f"http://127.0.0.1:{port}"
            while second.process.poll() is None:  # none is lost
                assert first.localize(name) == answers[name]
            assert second.process.returncode == 0
            assert first.localize(name) == answers[name]
        finally:
            proxy.terminate()
            proxy.wait()
