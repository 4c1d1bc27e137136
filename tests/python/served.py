"""The program's server on the demo scene, and requests to it. `served.py FOLDER` makes localize_demo()'s run."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from email.message import Message
from pathlib import Path
from typing import Sequence

RAYLIFT = os.environ["RAYLIFT"]
DEMO = Path(os.environ["RAYLIFT_SOURCE"]) / "assets/demo"
SCENE = DEMO / "scene.toml"
CRS = "EPSG:32632@500000,5400000,200"  # of localize_demo()
# Options of servers that shall answer soon.
FAST = ("--method", "p3p", "--max-features", "512", "--align-depth", "off", "--filter", "off")
QUERIES = {line.split()[0]: line.split(" ", 1)[1] for line in (DEMO / "queries.txt").read_text().splitlines()}
Request = tuple[bytes, dict[str, str]]  # a body and its headers
Answer = tuple[int, Message, bytes]


def localize_demo(out: Path) -> None:
    """The run that many tests look at, as if the demo stood in UTM's zone 32."""
    subprocess.run([RAYLIFT, "localize", "--scene", SCENE, "--crs", CRS, "--out", out, "--overwrite", "--quiet"],
                   check=True)


def photograph(name: str) -> bytes:
    return (DEMO / "images" / name).read_bytes()


def form(parts: Sequence[tuple[str, str | None, bytes]]) -> Request:
    """A body of multipart/form-data and its headers; `parts` are (name, file name or None, bytes)."""
    boundary = "raylift-test-boundary"
    body = b""
    for name, file_name, content in parts:
        disposition = f'form-data; name="{name}"' + (f'; filename="{file_name}"' if file_name else "")
        body += f"--{boundary}\r\nContent-Disposition: {disposition}\r\n\r\n".encode() + content + b"\r\n"
    return body + f"--{boundary}--\r\n".encode(), {"Content-Type": f"multipart/form-data; boundary={boundary}"}


def query_form(name: str, camera: str | None = None, file: Path | None = None) -> Request:
    """Without more than the name of the demo."""
    query = json.dumps({"name": name, "camera": camera or QUERIES[name]}).encode()
    return form([("image", "any.jpg", file.read_bytes() if file else photograph(name)), ("query", None, query)])


def cached(run: Path) -> list[Path | str]:
    """Options of a server that takes what a run has learned and cached."""
    return ["--cache", run / "cache", "--scene-calibration", run / "scene_calibration.json"]


def lines_of(run: Path) -> dict[str, str]:
    """Of queries.jsonl, by name."""
    return {json.loads(line)["name"]: line for line in (run / "queries.jsonl").read_text().splitlines()}


class Server:
    def __init__(self, *options: Path | str, scenes: Sequence[Path] = (SCENE,),
                 deadline: str = "600s") -> None:
        """The deadline is no bound that a loaded machine reaches."""
        command = [RAYLIFT, "serve", *scenes, "--port", "0", "--deadline", deadline, *options]
        self.process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)
        assert self.process.stdout and self.process.stderr
        self.stderr = self.process.stderr
        line = self.process.stdout.readline()
        if not line.startswith("listening on "):
            raise AssertionError(line + self.stderr.read())
        self.url = line.split()[-1]
        self.address = ("127.0.0.1", int(self.url.rsplit(":", 1)[1]))

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for stream in self.process.stdout, self.process.stderr:
            if stream:
                stream.close()

    def ask(self, path: str, body: bytes | None = None, headers: dict[str, str] = {},
            method: str | None = None) -> Answer:
        """The status, the headers and the body of an answer."""
        request = urllib.request.Request(self.url + path, data=body, headers=headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=600) as answer:
                return answer.status, answer.headers, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.headers, error.read()

    def localize(self, name: str) -> str:
        return self.answer(query_form(name))

    def answer(self, request: Request) -> str:
        status, _, body = self.ask("/v1/localize", *request)
        assert status == 200, body
        return body.decode()

    def answer_8_at_once(self, requests: dict[str, Request]) -> dict[str, str]:
        """Answers by name, of requests by name that each come twice, in any order."""
        asked = sorted(requests) * 2
        random.Random(0).shuffle(asked)
        with ThreadPoolExecutor(8) as clients:
            pairs = set(zip(asked, clients.map(lambda name: self.answer(requests[name]), asked)))
        assert len(pairs) == len(requests)  # the second time as the first time
        return dict(pairs)

    def raw(self, request: bytes, timeout: float = 120) -> bytes:
        """All that is answered to these bytes until the server closes, or the first part of it."""
        with socket.create_connection(self.address, timeout=timeout) as connection:
            answer = b""
            try:
                connection.sendall(request)
            except ConnectionError:  # it has answered before it has seen them all
                pass
            try:
                while part := connection.recv(65536):
                    answer += part
            except (TimeoutError, ConnectionResetError):
                pass
            return answer

    def wait_until_told(self, text: str) -> None:
        """Reads what it says on stderr until this."""
        assert any(text in line for line in self.stderr), f"{text} was not told"

    def end(self, sent: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
        """Its exit code and what it said on stderr."""
        self.process.send_signal(sent)
        _, told = self.process.communicate(timeout=600)
        return self.process.returncode, told


if __name__ == "__main__":
    localize_demo(Path(sys.argv[1]))
