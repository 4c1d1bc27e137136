"""raylift serve: the answers of the command line, to many clients at once."""

import base64
import functools
import http.client
import json
import operator
import os
import re
import signal
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import pytest

import raylift
from served import (
    DEMO, FAST, QUERIES, Answer, Server, cached, form, lines_of, photograph, query_form)


@pytest.fixture(scope="module")
def server(run: Path) -> Iterator[Server]:
    with Server(*cached(run)) as server:
        yield server


def problem(answer: Answer, status: int, field: str | None = None) -> str:
    """Checks that an answer tells this problem, and returns its text."""
    found, headers, body = answer
    told = json.loads(body)
    assert found == status, told
    assert headers["Content-Type"] == "application/problem+json"
    assert told["status"] == status and told.get("field") == field, told
    return str(told["detail"])


def test_answers_are_those_of_the_command_line_to_8_clients_at_once(run: Path, server: Server) -> None:
    assert server.answer_8_at_once({name: query_form(name) for name in QUERIES}) == lines_of(run)


def test_a_photograph_alone_has_an_unknown_focal_length(server: Server) -> None:
    name = sorted(QUERIES)[0]
    status, headers, body = server.ask("/v1/localize?scene=demo", *form([("image", name, photograph(name))]))
    answer = json.loads(body)
    assert status == 200 and answer["name"] == name and answer["verdict"] == "localized"
    assert "estimate;dur=" in headers["Server-Timing"]


def test_json_holds_the_image_in_base64(run: Path, server: Server) -> None:
    name = sorted(QUERIES)[0]
    body = json.dumps({"name": name, "camera": QUERIES[name], "image": base64.b64encode(photograph(name)).decode()})
    answer = server.ask("/v1/localize", body.encode(), {"Content-Type": "application/json"})
    assert answer[0] == 200 and answer[2].decode() == server.localize(name)


def test_what_it_is_and_holds(server: Server) -> None:
    assert server.ask("/healthz")[0] == server.ask("/readyz")[0] == 200
    with pytest.raises(ConnectionRefusedError):  # it listens on 127.0.0.1 alone
        socket.create_connection(("127.0.0.2", server.address[1]))
    other = {"Origin": "https://a.example"}
    assert server.ask("/healthz", headers=other)[1]["Access-Control-Allow-Origin"] is None
    assert server.ask("/v1/localize", headers=other, method="OPTIONS")[0] == 405
    scenes = json.loads(server.ask("/v1/scenes")[2])["scenes"]
    assert scenes == [{"name": "demo", "references": len(list((DEMO / "images/ref").iterdir())),
                       "geometry": ["mesh"], "calibrated": True}]
    api = json.loads(server.ask("/openapi.json")[2])
    for path in api["paths"]:
        assert server.ask(path)[0] in (200, 405)
    for reference in re.findall(r'"\$ref": "#/([^"]*)"', json.dumps(api)):
        functools.reduce(operator.getitem, reference.split("/"), api)  # there is such a part
    assert b"<title>Raylift" in server.ask("/")[2]
    server.localize(sorted(QUERIES)[0])
    metrics = server.ask("/metrics")[2].decode()
    assert 'raylift_requests_total{route="/v1/localize",status="200"}' in metrics
    assert 'raylift_verdicts_total{scene="demo",verdict="localized"}' in metrics
    assert 'raylift_stage_seconds_bucket{stage="estimate",le="+Inf"}' in metrics
    status, headers, body = server.ask("/healthz", method="HEAD")
    assert status == 200 and body == b"" and headers["Content-Length"] == "3"


def test_what_is_wrong_with_a_request_is_named(server: Server) -> None:
    name = sorted(QUERIES)[0]
    image = ("image", "a.jpg", photograph(name))

    def ask(*parts: tuple[str, str | None, bytes], path: str = "/v1/localize") -> Answer:
        return server.ask(path, *form(parts))

    def ask_query(query: str) -> Answer:
        return ask(image, ("query", None, query.encode()))

    def ask_json(text: str) -> Answer:
        return server.ask("/v1/localize", text.encode(), {"Content-Type": "application/json"})

    assert "demo" in problem(ask(image, path="/v1/localize?scene=other"), 404, "scene")
    problem(ask(image, path="/v1/localize?where=demo"), 400, "where")
    problem(ask(("query", None, b"{}")), 400, "image")
    problem(ask(image, image), 400, "image")
    problem(ask(image, ("more", None, b"")), 400, "more")
    problem(ask(("image", "a.jpg", b"no photograph")), 400, "image")
    problem(ask(("image", "a.jpg", b"")), 400, "image")
    assert "truncated" in problem(ask(("image", "a.jpg", photograph(name)[:-5000])), 400, "image")
    problem(ask_query('{"camera": 3}'), 400, "query.camera")
    problem(ask_query('{"camera": "PINHOLE 640 480 500"}'), 400, "query.camera")
    problem(ask_query('{"camera": "PINHOLE 640 480 nan 500 320 240"}'), 400, "query.camera")
    problem(ask_query('{"camera": "PINHOLE 320 240 500 500 160 120"}'), 400, "query.camera")
    turned = b"\xff\xe1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06" + b"\0" * 7
    upright = ("query", None, b'{"camera": "PINHOLE 480 640 500 500 240 320"}')
    assert "turn the image" in problem(ask(image, upright), 400, "query.camera")
    image_of_turned = ("image", "a.jpg", image[2][:2] + turned + image[2][2:])
    assert "EXIF turns it" in problem(ask(image_of_turned, upright), 400, "query.camera")
    problem(ask_query('{"name": "a.jpg", "priors": "b.jpg position 1 2 3 4"}'), 400, "query.priors")
    problem(ask_query('{"name": "a.jpg", "priors": ["a.jpg position 1 2 nan 4"]}'), 400, "query.priors")
    problem(ask_query('{"kamera": ""}'), 400, "query.kamera")
    problem(ask_query('{"name": NaN}'), 400, "query")
    problem(ask_query('[]'), 400, "query")
    problem(ask_query('{"name": ""}'), 400, "query.name")
    problem(ask_json('{"image": "%%%"}'), 400, "image")
    problem(ask_json('{"name": "a"}'), 400, "body")
    problem(ask_json('{"image": 3}'), 400, "body.image")
    problem(ask_json("[" * 100000), 400)
    problem(ask_json('{"matches": []}'), 400, "camera")
    match = '{"camera": "PINHOLE 640 480 500 500 320 240", "matches": [%s]}'
    problem(ask_json(match % '{"reference": "no", "query_px": [], "reference_px": []}'), 400,
            "body.matches[0].reference")
    problem(ask_json(match % '{"reference": "no", "query_px": [[1, 1e999]], "reference_px": []}'), 400, "body")
    features = '{"features": {"width": 640, "height": 480, "keypoints": [[1, 2]], "descriptors": %s}}'
    problem(ask_json(features % "[]"), 400, "body.features.descriptors")
    problem(ask_json(features % "[[1, 2]]"), 400, "body.features.descriptors[0]")
    problem(server.ask("/v1/localize", b"a", {"Content-Type": "text/plain"}), 415, "Content-Type")
    problem(server.ask("/v1/localize"), 405)
    problem(server.ask("/nothing"), 404)
    problem(server.ask("/healthz", b"", method="POST"), 405)


def test_a_view_is_what_the_camera_of_an_answer_sees(server: Server, tmp_path: Path) -> None:
    import raylift
    name = sorted(QUERIES)[0]
    asked = {"camera": QUERIES[name], "cam_from_world": json.loads(server.localize(name))["cam_from_world"]}

    def view(**changes: Any) -> Any:
        return server.ask("/v1/view", json.dumps({**asked, **changes}).encode(), {"Content-Type": "application/json"})

    status, headers, body = view()
    assert status == 200 and headers["Content-Type"] == "image/jpeg"
    (tmp_path / "view.jpg").write_bytes(body)
    seen = np.asarray(raylift.read_image(tmp_path / "view.jpg"), dtype=float)
    taken = np.asarray(raylift.read_image(DEMO / "images" / name), dtype=float)
    assert seen.shape == taken.shape
    assert np.corrcoef(seen.ravel(), taken.ravel())[0, 1] > 0.8
    (tmp_path / "large.jpg").write_bytes(view(camera="PINHOLE 6000 4000 5000 5000 3000 2000")[2])
    assert raylift.read_image(tmp_path / "large.jpg").shape[:2] == (640, 960)
    # Embree itself would end the process.
    far = view(camera="PINHOLE 64 48 50 50 32 24", cam_from_world={"qvec": [1, 0, 0, 0], "tvec": [2e18, 0, 1e19]})
    assert far[0] == 200 and server.ask("/healthz")[0] == 200
    problem(view(camera="PINHOLE 640"), 400, "body.camera")
    problem(view(more=1), 400, "body.more")
    problem(view(cam_from_world={"qvec": [0, 0, 0, 0], "tvec": [0, 0, 0]}), 400, "body.cam_from_world.qvec")
    problem(view(cam_from_world={"qvec": [1, 0, 0, 0]}), 400, "body.cam_from_world")
    problem(server.ask("/v1/view?scene=no", b"{}"), 404, "scene")
    problem(server.ask("/v1/view"), 405)


def test_features_stand_for_the_image(server: Server) -> None:
    name = sorted(QUERIES)[0]
    features = raylift.extract_features(raylift.read_image(DEMO / "images" / name))
    asked = {"name": name, "camera": QUERIES[name],
             "features": {"width": 640, "height": 480, "keypoints": features["keypoints"].tolist(),
                          "descriptors": features["descriptors"].tolist()}}
    status, _, body = server.ask("/v1/localize", json.dumps(asked).encode(), {"Content-Type": "application/json"})
    assert status == 200, body
    # Gray of the decoder's own and gray of color round differently.
    found, expected = (json.loads(text)["cam_from_world"] for text in (body, server.localize(name)))
    for part in ("qvec", "tvec"):
        assert found[part] == pytest.approx(expected[part], abs=1e-4)


def test_a_scene_without_geometry_has_an_empty_list_of_it(run: Path, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(f'''
        format = "raylift-scene/1"
        name = "yard"
        references = "{DEMO}/model"
        images = "{DEMO}/images"
        ''')
    with Server("--cache", run / "cache", "--method", "e5p1", scenes=(scene,)) as server:
        (told,) = json.loads(server.ask("/v1/scenes")[2])["scenes"]
        assert told["name"] == "yard" and told["geometry"] == []


def test_features_that_the_scene_has_lost_are_no_fault_of_the_client(tmp_path: Path) -> None:
    name = sorted(QUERIES)[0]
    with Server("--cache", tmp_path, *FAST) as server:
        os.truncate(tmp_path / "features.h5", 4096)
        lost = server.ask("/v1/localize", *query_form(name))
        assert problem(lost, 503) == "a file of the scene cannot be read" and lost[1]["Retry-After"] == "1"
        code, told = server.end()
        assert code == 0 and f"{tmp_path}/features.h5: " in told


def test_sigterm_answers_what_is_there_and_ends_with_0(run: Path) -> None:
    with Server(*cached(run)) as server, ThreadPoolExecutor(4) as clients:
        answers = [clients.submit(server.localize, name) for name in sorted(QUERIES)[:4]]
        while b"raylift_body_bytes 0\n" in server.ask("/metrics")[2] and not all(a.done() for a in answers):
            time.sleep(0.005)
        code, _ = server.end()
        assert code == 0
        localized = [a for a in answers if a.exception() is None]
        assert localized and all(json.loads(a.result())["verdict"] == "localized" for a in localized)


def test_sigterm_ends_an_idle_server_with_0(run: Path) -> None:
    with Server(*cached(run)) as server:
        assert server.ask("/healthz")[0] == 200
        assert server.end() == (0, "")


def test_connections_end_with_their_answer_once_the_server_is_about_to_end(run: Path) -> None:
    options = (*cached(run), "--drain-delay", "600s")
    with Server(*options) as server:
        connection = http.client.HTTPConnection(*server.address, timeout=60)
        statuses = []
        while 503 not in statuses:
            connection.request("GET", "/readyz")
            answer = connection.getresponse()
            answer.read()
            statuses.append(answer.status)
            assert answer.will_close == (answer.status == 503)
            if len(statuses) == 1:
                server.process.send_signal(signal.SIGTERM)
        assert statuses[0] == 200
        assert server.end()[0] == 0  # which a second signal ends at once
