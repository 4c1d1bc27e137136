"""raylift serve: a client's walk goes on from request to request, on whatever server has the key."""

import base64
import json
import subprocess
from pathlib import Path
from typing import Any, Iterator

import pytest

import raylift
from served import DEMO, FAST, QUERIES, RAYLIFT, SCENE, Server, cached, form, lines_of
from synthetic import some

NAMES = sorted(QUERIES)
BLANK = NAMES[4]  # shows nothing, so that the walk alone tells its pose


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with photographs of a walk, its odometry and what `localize --online` makes of them."""
    folder = tmp_path_factory.mktemp("walk")
    lines = [line.split() for line in (DEMO / "ground_truth/images.txt").read_text().splitlines()]
    poses = {line[9]: line[1:8] for line in lines if len(line) == 10 and line[9] in QUERIES}
    (folder / "odometry.txt").write_text("".join(f"{name} {' '.join(poses[name])}\n" for name in NAMES))
    for name in NAMES:
        file = folder / "images" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        width, height = map(int, QUERIES[name].split()[1:3])
        file.write_bytes(f"P5 {width} {height} 255\n".encode() + b"\x80" * (width * height) if name == BLANK
                         else (DEMO / "images" / name).read_bytes())
    (folder / "key").write_bytes(bytes(range(32)))
    subprocess.run([RAYLIFT, "localize", "--scene", SCENE, "--query-images", folder / "images", "--odometry",
                    folder / "odometry.txt", "--online", "--no-doctor", "--quiet", "--out", folder / "run", *FAST],
                   check=True)
    return folder


@pytest.fixture(scope="module")
def lines(walk: Path) -> dict[str, str]:
    return lines_of(walk / "run")


def serve(walk: Path, key: str | None = "key", scene: Path = SCENE) -> Server:
    options = ("--session-key", walk / key) if key else ()
    return Server(*FAST, *cached(walk / "run"), *options, scenes=[scene])


@pytest.fixture(scope="module")
def server(walk: Path) -> Iterator[Server]:
    with serve(walk) as server:
        yield server


def session_of(walk: Path, lines: dict[str, str], name: str, token: str | None = None,
               **more: int | str) -> dict[str, Any]:
    pose = next(line.split()[1:] for line in (walk / "odometry.txt").read_text().splitlines()
                if line.startswith(name + " "))
    qvec, tvec = [float(x) for x in pose[:4]], [float(x) for x in pose[4:]]
    session = {"cam_from_odometry": {"qvec": qvec, "tvec": tvec}, "time_s": json.loads(lines[name])["walk"]["time_s"]}
    return {**session, **({"token": token} if token else {}), **more}


def ask(server: Server, walk: Path, name: str, session: dict[str, Any] | int,
        path: str = "/v1/localize") -> tuple[int, str]:
    query = {"camera": QUERIES[name], "session": session, **({} if path.endswith("batch") else {"name": name})}
    status, _, body = server.ask(path, *form([("image", name, (walk / "images" / name).read_bytes()),
                                              ("query", None, json.dumps(query).encode())]))
    return status, body.decode()


def begin(server: Server, walk: Path, lines: dict[str, str]) -> str:
    """The token after the first photograph."""
    status, body = ask(server, walk, NAMES[0], session_of(walk, lines, NAMES[0]))
    assert status == 200, body
    return str(json.loads(body)["session"]["token"])


def test_a_walk_over_two_servers_is_that_of_the_command_line(
        walk: Path, lines: dict[str, str], server: Server) -> None:
    token, found = None, {}
    with serve(walk) as other:
        for i, name in enumerate(NAMES):
            status, body = ask((server, other)[i % 2], walk, name, session_of(walk, lines, name, token))
            assert status == 200, body
            found = json.loads(body)["session"]
            line, told = body.split(',"session":')
            assert line + "}" == lines[name]
            assert json.loads(told[:-1]) == found
            token = found["token"]
    roles = {name: json.loads(line)["walk"]["role"] for name, line in lines.items()}
    assert roles[BLANK] == "rescued" and list(roles.values()).count("smoothed") > 5
    assert found["scale"] == 1
    # The odometry is the truth.
    assert found["world_from_odometry"]["tvec"] == pytest.approx([0, 0, 0], abs=0.1)
    assert len(some(token)) < 35_000


def test_a_client_walks_from_python(walk: Path, lines: dict[str, str], server: Server) -> None:
    client, token = raylift.Client(server.url), None
    for name in NAMES[:2]:
        answer = client.localize(walk / "images" / name, name=name, camera=QUERIES[name],
                                 session=session_of(walk, lines, name, token))
        token = answer.pop("session")["token"]
        assert answer == json.loads(lines[name])


def problem(answer: tuple[int, str], status: int, field: str) -> str:
    found, told = answer[0], json.loads(answer[1])
    assert (found, told.get("field")) == (status, field), told
    return str(told["detail"])


def test_tokens_that_are_no_good_are_refused(walk: Path, lines: dict[str, str],
                                             server: Server) -> None:
    token = begin(server, walk, lines)

    def go_on(token: str, server: Server = server, **more: int | str) -> tuple[int, str]:
        return ask(server, walk, NAMES[1], session_of(walk, lines, NAMES[1], token, **more))

    assert go_on(token)[0] == 200
    data = bytearray(base64.b64decode(token))
    for at in (0, 8, 20, len(data) // 2, len(data) - 1):
        forged = bytearray(data)
        forged[at] ^= 1
        problem(go_on(base64.b64encode(forged).decode()), 400, "session.token")
    for wrong in ("%%%", "AAAA", token[:-8], token + "AAAA", "A" * 100_000):
        problem(go_on(wrong), 400, "session.token")
    assert "time_s" in problem(go_on(token, time_s=-1), 400, "session.time_s")
    problem(go_on(token, scale="unknown"), 400, "session.scale")
    with serve(walk, key=None) as other:  # its key is another
        problem(go_on(token, other), 400, "session.token")
    scene = walk / "other.toml"
    text = SCENE.read_text().replace('name = "demo"', 'name = "other"')
    for path in ("model", "images", "queries.txt", "ground_truth"):
        text = text.replace(f'"{path}"', f'"{DEMO / path}"')
    scene.write_text(text.replace("mesh:scene.obj", f"mesh:{DEMO / 'scene.obj'}"))
    with serve(walk, scene=scene) as other:
        assert "another scene" in problem(go_on(token, other), 409, "session.token")


def test_what_is_wrong_with_a_session_is_named(walk: Path, lines: dict[str, str],
                                               server: Server) -> None:
    good = session_of(walk, lines, NAMES[0])

    def refused(session: dict[str, Any] | int, field: str) -> None:
        problem(ask(server, walk, NAMES[0], session), 400, field)

    refused(3, "query.session")
    refused({}, "query.session")
    refused({**good, "more": 1}, "query.session.more")
    refused({**good, "token": 3}, "query.session.token")
    refused({**good, "scale": "big"}, "query.session.scale")
    refused({**good, "time_s": "now"}, "query.session.time_s")
    refused({**good, "time_s": 1e300}, "query.session.time_s")
    pose = good["cam_from_odometry"]
    refused({**good, "cam_from_odometry": {**pose, "qvec": [2, 0, 0, 0]}}, "query.session.cam_from_odometry.qvec")
    refused({**good, "cam_from_odometry": {**pose, "tvec": [1e300, 0, 0]}}, "query.session.cam_from_odometry")
    problem(ask(server, walk, NAMES[0], good, "/v1/localize/batch"), 400, "query.session")


def test_a_key_has_32_bytes(walk: Path) -> None:
    (walk / "short").write_bytes(b"secret")
    done = subprocess.run([RAYLIFT, "serve", SCENE, "--port", "0", "--session-key", walk / "short"],
                          capture_output=True, text=True)
    assert done.returncode == 3 and "short: expected a key of 32 bytes" in done.stderr
