"""raylift localize --server: the files of the command line from a server's answers."""

import http.server
import shutil
import subprocess
import threading
from pathlib import Path
from typing import Iterator

import pytest

from served import DEMO, QUERIES, RAYLIFT, SCENE, Server, cached


def localize(out: Path, *options: Path | str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(word) for word in (RAYLIFT, "localize", "--scene", SCENE, "--out", out, *options)],
                          capture_output=True, text=True)


@pytest.fixture(scope="module")
def server(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    tokens = tmp_path_factory.mktemp("remote") / "tokens.txt"
    tokens.write_text("secret\n")
    with Server(*cached(run), "--tokens", tokens, "--max-queue", "1", "--crs", "EPSG:25832@460000,5420000,100") as server:
        yield server


def test_results_are_those_without_a_server(run: Path, server: Server, tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("secret\n")
    # More at once than the server lets wait: some are sent again.
    done = localize(tmp_path / "out", "--server", server.url + "?scene=demo", "--token-file", token, "--threads", "8")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{len(QUERIES)} of {len(QUERIES)} queries localized\n"
    for file in ("poses.txt", "queries.jsonl"):
        assert (tmp_path / "out" / file).read_bytes() == (run / file).read_bytes()


def test_photographs_of_unknown_cameras_are_those_without_a_server(
        run: Path, server: Server, tmp_path: Path) -> None:
    (tmp_path / "token").write_text("secret")
    (tmp_path / "photos").mkdir()
    for name in sorted(QUERIES)[:2]:
        shutil.copy(DEMO / "images" / name, tmp_path / "photos")
    options: list[Path | str] = ["--queries", tmp_path / "photos", "--query-images", tmp_path / "photos"]
    local = localize(tmp_path / "local", *options, "--quiet", *cached(run))
    remote = localize(tmp_path / "remote", *options, "--server", server.url, "--token-file", tmp_path / "token")
    assert local.returncode == remote.returncode == 0, local.stderr + remote.stderr
    assert (tmp_path / "remote/poses.txt").read_bytes() == (tmp_path / "local/poses.txt").read_bytes()


class Busy(http.server.BaseHTTPRequestHandler):
    """Is busy twice, and then knows no answer."""
    asked = 0

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        Busy.asked += 1
        if Busy.asked == 2:
            self.connection.shutdown(2)
            return
        self.send_response(503 if Busy.asked == 1 else 400)
        self.send_header("Retry-After", "1")
        self.end_headers()
        self.wfile.write(b"no JSON")

    def log_message(self, format: str, *_: object) -> None:
        pass


def test_what_goes_wrong_is_one_line(server: Server, tmp_path: Path) -> None:
    def told(*options: Path | str) -> str:
        done = localize(tmp_path / "out", *options)
        assert done.returncode in (2, 3) and len(done.stderr.splitlines()) == 1, done
        assert not (tmp_path / "out").exists()
        return done.stderr

    assert "token" in told("--server", server.url)
    assert "Connection refused" in told("--server", "http://127.0.0.1:1")
    assert "proxy" in told("--server", "https://example.org")
    assert "--server = example.org: expected http://HOST:PORT" in told("--server", "example.org")
    assert "--priors does not go with --server" in told("--server", server.url, "--priors", "exif", "--crs", "EPSG:32632")
    assert "--token-file needs --server" in told("--token-file", "none")
    assert "none.txt" in told("--server", server.url, "--token-file", tmp_path / "none.txt")
    (tmp_path / "token").write_text("two words")
    assert "expected a token alone" in told("--server", server.url, "--token-file", tmp_path / "token")


def test_a_busy_server_is_asked_again(tmp_path: Path) -> None:
    with http.server.HTTPServer(("127.0.0.1", 0), Busy) as busy:
        threading.Thread(target=busy.serve_forever, daemon=True).start()
        done = localize(tmp_path / "out", "--server", f"http://127.0.0.1:{busy.server_port}", "--threads", "1")
        busy.shutdown()
    name = sorted(QUERIES)[0]
    assert done.returncode == 3
    assert done.stderr == f"raylift: {name}: the server refuses it: 400 Bad Request\n"


def test_a_former_run_is_kept_unless_it_is_to_be_overwritten(
        run: Path, server: Server, tmp_path: Path) -> None:
    done = localize(run, "--server", server.url)
    assert done.returncode == 2 and "--overwrite" in done.stderr
    token, out = tmp_path / "token", tmp_path / "out"
    token.write_text("secret")
    shutil.copytree(run, out)
    list_of_one = tmp_path / "queries.txt"
    list_of_one.write_text((DEMO / "queries.txt").read_text().splitlines()[0] + "\n")
    before = sorted(path.name for path in out.iterdir())
    options: list[Path | str] = ["--token-file", token, "--overwrite", "--queries", list_of_one]
    assert localize(out, "--server", "http://127.0.0.1:1", *options).returncode == 3
    assert sorted(path.name for path in out.iterdir()) == before  # there is nothing to take its place
    done = localize(out, "--server", server.url, *options)
    assert done.returncode == 0, done.stderr
    # The cache is none of the results, and a server may read the calibration.
    assert sorted(path.name for path in out.iterdir()) == ["cache", "poses.txt", "queries.jsonl",
                                                           "scene_calibration.json"]
    assert (out / "queries.jsonl").read_text() == (run / "queries.jsonl").read_text().splitlines(True)[0]


def test_files_that_are_of_no_run_are_kept(server: Server, tmp_path: Path) -> None:
    token, out = tmp_path / "token", tmp_path / "out"
    token.write_text("secret")
    out.mkdir()
    others = ("scene_calibration.json", "options.json", "timing.jsonl")
    for name in others:
        (out / name).write_text(name)
    for options in ([], ["--overwrite"]):
        done = localize(out, "--server", server.url, "--token-file", token, *options)
        assert done.returncode == 0, done.stderr
        assert all((out / name).read_text() == name for name in others)
