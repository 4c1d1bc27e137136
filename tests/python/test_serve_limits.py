"""raylift serve: who may ask, how much, and what becomes of clients that mean no good."""

import http.client
import json
import re
import signal
import socket
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Iterator

import pytest

import raylift
from served import FAST, QUERIES, SCENE, Answer, Request, Server, form, photograph, query_form
from synthetic import some

NAMES = sorted(QUERIES)
TOKEN = {"Authorization": "Bearer secret"}
HEAD = "POST /v1/localize HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer secret\r\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("limits")
    (folder / "tokens.txt").write_text("secret\nrare 1\nonce 0.001\n")
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Server]:
    with Server(*FAST, "--cache", folder / "cache", "--threads", "1", "--max-queue", "1", "--max-body-mb", "1",
                "--keep", folder / "kept", "--tokens", folder / "tokens.txt", "--cors", "https://a.example") as server:
        yield server


def ask(server: Server, name: str, path: str = "/v1/localize", **headers: str) -> Answer:
    body, of_form = query_form(name)
    return server.ask(path, body, {**TOKEN, **of_form, **headers})


def form_of_token(parts: list[tuple[str, str | None, bytes]]) -> Request:
    body, of_form = form(parts)
    return body, {**TOKEN, **of_form}


def is_well(server: Server) -> bool:
    try:
        return server.ask("/healthz")[0] == 200
    except OSError:
        return False


def status_of(answer: bytes) -> int | None:
    return int(answer.split()[1]) if answer else None


def test_tokens_say_who_may_ask_and_how_often(server: Server) -> None:
    assert server.ask("/healthz")[0] == 200
    assert server.ask("/")[0] == 200  # the page asks for a token itself
    status, headers, _ = server.ask("/v1/scenes")
    assert status == 401 and headers["WWW-Authenticate"] == "Bearer"
    assert server.ask("/v1/scenes", headers=TOKEN)[0] == 200
    rare = {"Authorization": "Bearer rare"}
    assert server.ask("/v1/scenes", headers=rare)[0] == 200
    status, headers, _ = server.ask("/v1/scenes", headers=rare)
    assert status == 429 and 0 < int(headers["Retry-After"]) <= 60


def test_pages_of_the_named_origin_may_ask(server: Server) -> None:
    def allowed(origin: str, method: str | None = None) -> tuple[int, str | None]:
        status, headers, _ = server.ask("/v1/localize", headers={"Origin": origin}, method=method)
        return status, headers["Access-Control-Allow-Origin"]

    assert allowed("https://a.example", method="OPTIONS") == (204, "https://a.example")
    assert allowed("https://b.example", method="OPTIONS")[1] is None


def test_what_is_asked_for_is_kept_under_names_of_our_own(server: Server, folder: Path) -> None:
    sent = form_of_token([("image", "../../evil.jpg", photograph(NAMES[0])), ("query", None, b'{"name": "/etc/a"}')])
    status, _, answer = server.ask("/v1/localize", *sent)
    assert status == 200 and json.loads(answer)["name"] == "/etc/a"
    kept = sorted((folder / "kept").iterdir())
    assert [file.suffix for file in kept[-2:]] == [".json", ".photograph"]
    assert kept[-1].read_bytes() == photograph(NAMES[0])
    assert all(file.name[:8].isdigit() for file in kept)


def test_a_batch_has_a_line_for_each_photograph(server: Server) -> None:
    parts = [("image", name, photograph(name)) for name in NAMES[:2]]
    sent = form_of_token([*parts, ("image", "bad.jpg", b"no photograph")])
    status, headers, answer = server.ask("/v1/localize/batch", *sent)
    assert status == 200 and headers["Content-Type"] == "application/x-ndjson"
    lines = [json.loads(line) for line in answer.splitlines()]
    assert [line["name"] for line in lines] == [*NAMES[:2], "bad.jpg"]
    assert lines[0]["verdict"] in ("localized", "doubtful") and lines[2]["problem"]["field"] == "image"
    assert server.ask("/v1/localize/batch", *form_of_token([("query", None, b"{}")]))[0] == 400


def test_the_usual_time_is_that_of_what_was_localized(server: Server) -> None:
    def usual() -> float:
        metrics = "raylift_threads_busy 1"
        while "raylift_threads_busy 1" in metrics:  # an answer may come before its time is noted
            metrics = server.ask("/metrics", headers=TOKEN)[2].decode()
        return float(some(re.search(r"^raylift_photograph_seconds (.*)$", metrics, re.M))[1])

    assert ask(server, NAMES[0])[0] == 200
    before = usual()
    view = {"camera": QUERIES[NAMES[0]], "cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [0, 0, 0]}}
    matches = {"camera": QUERIES[NAMES[0]], "matches": []}
    assert server.ask("/v1/view", json.dumps(view).encode(), TOKEN)[0] == 200
    of_json = {**TOKEN, "Content-Type": "application/json"}
    assert server.ask("/v1/localize", b"{}", of_json)[0] == 400
    assert usual() == before > 0
    assert server.ask("/v1/localize", json.dumps(matches).encode(), of_json)[0] == 200
    of_matches = usual()
    assert of_matches < before
    assert server.ask("/v1/localize/batch", *form_of_token([("image", NAMES[0], photograph(NAMES[0]))]))[0] == 200
    assert usual() != of_matches


def test_batches_leave_room_for_others(server: Server) -> None:
    body, of_form = form([("image", name, photograph(name)) for name in NAMES[:8]])
    batch = http.client.HTTPConnection(*server.address, timeout=600)
    batch.request("POST", "/v1/localize/batch", body, {**TOKEN, **of_form})
    answer = batch.getresponse()  # its head: it is under way
    assert answer.status == 200
    status, headers, refused = server.ask("/v1/localize/batch", body, {**TOKEN, **of_form})
    assert status == 429 and headers["Retry-After"] and b"batches" in refused
    assert ask(server, NAMES[8])[0] == 200
    assert len(answer.read().splitlines()) == 8
    batch.close()


def test_each_photograph_of_a_batch_counts_for_its_token(server: Server) -> None:
    body, of_form = form([("image", name, photograph(name)) for name in NAMES[:2]])
    once = {"Authorization": "Bearer once"}
    first, second = map(json.loads, server.ask("/v1/localize/batch", body, {**once, **of_form})[2].splitlines())
    assert first["verdict"] and second["problem"]["status"] == 429


def test_photographs_beyond_the_queue_are_refused_and_all_others_answered(server: Server) -> None:
    with ThreadPoolExecutor(8) as clients:
        answers = list(clients.map(lambda i: ask(server, NAMES[i % len(NAMES)]), range(16)))
    assert {status for status, _, _ in answers} == {200, 429}
    assert all(headers["Retry-After"] == "1" for status, headers, _ in answers if status == 429)


def test_a_picture_is_refused_by_its_header(server: Server) -> None:
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 60000, 60000, 8, 0, 0, 0, 0) + b"\0" * 4
    # As large a file as its pixels would need to be believed.
    status, _, answer = server.ask("/v1/localize", *form_of_token([("image", "a.png", png + b"\0" * 900_000)]))
    assert status in (400, 413) and json.loads(answer)["field"] == "image"


def test_requests_that_end_in_two_places_are_refused(server: Server) -> None:
    both = "Content-Type: application/json\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\nGET / "
    for more in (both, both.replace("chunked", "xchunked"), both.replace("chunked", "identity"),
                 "Transfer-Encoding: chunked, identity\r\n\r\n0\r\n\r\n",
                 "Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
                 "Content-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef",
                 "Content-Length: -1\r\n\r\n", "Content-Length: 1 1\r\n\r\n", "Content-Length : 1\r\n\r\na",
                 "Host: b\r\nContent-Length: 0\r\n\r\n"):
        answer = server.raw((HEAD + more).encode())
        assert status_of(answer) == 400, more
        assert answer.count(b"HTTP/1.1 ") == 1 and b"Connection: close" in answer
    old = HEAD.replace("HTTP/1.1", "HTTP/1.0")
    assert status_of(server.raw((old + "Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n").encode())) == 400
    batch = old.replace("localize", "localize/batch") + "Content-Length: 0\r\n\r\n"
    assert status_of(server.raw(batch.encode())) == 400
    for nothing in (b"\0\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/2.0\r\nHost: a\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n"):
        assert status_of(server.raw(nothing)) == 400, nothing


def test_bodies_are_limited_however_they_come(server: Server) -> None:
    json_head = HEAD + "Content-Type: application/json\r\n"
    assert status_of(server.raw((json_head + "Content-Length: 2000000\r\n\r\n").encode())) == 413
    chunks = b"10000\r\n" + b"a" * 65536 + b"\r\n"
    answer = server.raw((json_head + "Transfer-Encoding: chunked\r\n\r\n").encode() + chunks * 20)
    assert status_of(answer) == 413
    assert status_of(server.raw(b"GET / HTTP/1.1\r\nA: " + b"a" * 100000 + b"\r\n\r\n")) == 431


def test_bodies_are_limited_together(folder: Path) -> None:
    with Server(*FAST, "--cache", folder / "cache", "--max-held-mb", "0.1") as server:
        status, headers, told = server.ask("/v1/localize", b" " * 200_000, {"Content-Type": "application/json"})
        assert status == 503 and headers["Retry-After"] == "1" and b"bodies" in told
        assert ask(server, NAMES[0])[0] == 200


def test_pipelined_requests_are_answered_in_their_order(server: Server) -> None:
    body, of_form = query_form(NAMES[0])
    one = (HEAD + f"Content-Type: {of_form['Content-Type']}\r\nContent-Length: {len(body)}\r\n\r\n").encode() + body
    last = b"GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n"
    answer = server.raw(one + b"GET /readyz HTTP/1.1\r\nHost: a\r\n\r\n" + last)
    assert answer.count(b"HTTP/1.1 200 OK") == 3
    assert answer.index(b'"verdict"') < answer.index(b"ok\n") and answer.endswith(b"ok\n")


def test_slow_clients_block_nobody_and_are_let_go(folder: Path) -> None:
    with Server(*FAST, "--cache", folder / "cache", "--header-deadline", "3s", "--body-deadline", "3s") as server:
        slow = [socket.create_connection(server.address, timeout=60) for _ in range(30)]
        for connection in slow[1:]:
            connection.sendall(b"POST /v1/localize HTTP/1.1\r\nHo")
        slow[0].sendall((HEAD + "Content-Type: application/json\r\nContent-Length: 50\r\n\r\n{").encode())
        assert ask(server, NAMES[0])[0] == 200
        for connection in slow:
            assert connection.recv(1) == b""
            connection.close()


TIME_TO_ASK = 0.6  # in which a connection does not give way


def connection_with_a_body(server: Server) -> socket.socket:
    """Still to come."""
    connection = socket.create_connection(server.address, timeout=60)
    connection.sendall((HEAD + "Content-Type: application/json\r\nContent-Length: 50\r\nExpect: 100-continue"
                               "\r\n\r\n").encode())
    assert connection.recv(1000).startswith(b"HTTP/1.1 100")
    return connection


def test_connections_beyond_the_limit_are_sent_away_where_none_is_idle(folder: Path) -> None:
    with Server(*FAST, "--cache", folder / "cache", "--max-connections", "5") as server:
        idle = [socket.create_connection(server.address, timeout=60) for _ in range(8)]
        assert all(connection.recv(1000) == b"" for connection in idle[:3])  # the oldest give way
        time.sleep(TIME_TO_ASK)
        reading = [connection_with_a_body(server) for _ in range(5)]
        with socket.create_connection(server.address, timeout=60) as beyond:
            assert beyond.recv(1000).startswith(b"HTTP/1.1 503")
        for connection in idle + reading:
            connection.close()
        while not is_well(server):  # until it has seen them go
            time.sleep(0.1)
        assert ask(server, NAMES[0])[0] == 200


def test_newcomers_take_no_place_from_those_that_could_not_ask_yet(folder: Path) -> None:
    with Server(*FAST, "--cache", folder / "cache", "--max-connections", "5") as server:
        reading = [connection_with_a_body(server) for _ in range(4)]
        first = socket.create_connection(server.address, timeout=60)
        with socket.create_connection(server.address, timeout=60) as beyond:
            assert beyond.recv(1000).startswith(b"HTTP/1.1 503")
        first.sendall(b"GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n")
        assert first.recv(1000).startswith(b"HTTP/1.1 200")
        time.sleep(TIME_TO_ASK)
        assert is_well(server)
        assert first.recv(1000) == b""  # it had to give way
        for connection in (first, *reading):
            connection.close()


def test_connections_that_were_answered_keep_nobody_out(folder: Path) -> None:
    with Server(*FAST, "--cache", folder / "cache", "--max-connections", "5") as server:
        answered = [socket.create_connection(server.address, timeout=60) for _ in range(5)]
        for connection in answered:
            connection.sendall(b"GET /healthz HTTP/1.0\r\n\r\n")
            assert connection.recv(1000).startswith(b"HTTP/1.1 200")
        assert all(is_well(server) for _ in range(5))
        for connection in answered:
            connection.close()


def test_a_client_asks_from_python(server: Server) -> None:
    client = raylift.Client(server.url, token="secret")
    assert [scene["name"] for scene in client.scenes()] == ["demo"]
    file = SCENE.parent / "images" / NAMES[0]
    answer = client.localize(file, name=NAMES[0], camera=QUERIES[NAMES[0]], scene="demo")
    assert answer == json.loads(ask(server, NAMES[0])[2])
    assert client.localize(file.read_bytes(), priors=["photograph focal_range 1.5"])["name"] == "photograph"
    with ThreadPoolExecutor(8) as threads:  # more than the queue takes: they come again
        assert all(one["verdict"] for one in threads.map(client.localize, [file] * 8))
    with pytest.raises(raylift.InputError, match="scene: expected demo"):
        client.localize(file, scene="a&b")
    with pytest.raises(raylift.InputError, match="Bearer"):
        raylift.Client(server.url).scenes()
    with pytest.raises(ConnectionError, match="http://127.0.0.1:9: "):  # nobody listens there
        raylift.Client("http://127.0.0.1:9").scenes()


def test_work_for_a_client_that_has_gone_is_dropped(folder: Path) -> None:
    body, of_form = query_form(NAMES[0])
    sent = (HEAD + f"Content-Type: {of_form['Content-Type']}\r\nContent-Length: {len(body)}\r\n\r\n").encode() + body
    with Server(*FAST, "--cache", folder / "cache", "--threads", "1") as server:
        def gauge(name: str) -> float:
            metrics = server.ask("/metrics")[2].decode()
            return sum(float(line.rsplit(" ", 1)[1]) for line in metrics.splitlines() if line.startswith(name))

        for _ in range(8):
            with socket.create_connection(server.address) as connection:
                connection.sendall(sent)
        assert ask(server, NAMES[0])[0] == 200  # behind all of them
        assert gauge('raylift_requests_total{route="/v1/localize",status="503"}') >= 6
        assert 1 <= gauge("raylift_verdicts_total") <= 3  # the first may have been begun


def test_work_is_given_up_at_the_deadline(folder: Path) -> None:
    with Server(*FAST, "--cache", folder / "cache", deadline="0.001s") as server:
        status, headers, answer = server.ask("/v1/localize", *query_form(NAMES[0]))
        assert status == 503 and headers["Retry-After"] == "1" and "in time" in json.loads(answer)["detail"]


def test_sighup_opens_the_scenes_anew(folder: Path) -> None:
    scene = folder / "scene.toml"
    text = SCENE.read_text()
    for path in ("model", "images", "queries.txt", "ground_truth"):
        text = text.replace(f'"{path}"', f'"{SCENE.parent / path}"')
    scene.write_text(text.replace("mesh:scene.obj", f"mesh:{SCENE.parent / 'scene.obj'}"))
    with Server(*FAST, "--cache", folder / "cache", scenes=[scene]) as server:
        before = server.ask("/v1/localize?scene=demo", *query_form(NAMES[0]))[2]
        with ThreadPoolExecutor(4) as clients:
            answers = [clients.submit(server.localize, NAMES[0]) for _ in range(24)]
            for _ in range(3):
                server.process.send_signal(signal.SIGHUP)
                server.wait_until_told("opened anew")
            assert {answer.result() for answer in answers} == {before.decode()}
        scene.write_text(scene.read_text().replace('name = "demo"', 'name = "other"'))
        server.process.send_signal(signal.SIGHUP)
        while b"other" not in server.ask("/v1/scenes")[2]:
            time.sleep(0.1)
        assert server.ask("/v1/localize?scene=demo", *query_form(NAMES[0]))[0] == 404
        assert server.ask("/v1/localize?scene=other", *query_form(NAMES[0]))[2] == before
        scene.write_text("nonsense")
        server.process.send_signal(signal.SIGHUP)
        server.wait_until_told("stay as they are")
        assert server.ask("/v1/localize?scene=other", *query_form(NAMES[0]))[2] == before
        assert server.end()[0] == 0
