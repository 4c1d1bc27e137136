"""Places on the earth by raylift serve: the GeoPose Protocol of Open AR Cloud, and /v1/localize."""

import base64
import json
import subprocess
from pathlib import Path
from typing import Any, Iterator

import pytest

from served import CRS, DEMO, QUERIES, RAYLIFT, SCENE, Server, cached, photograph

FAR = "EPSG:32632@300000,5400000,200"


@pytest.fixture(scope="module")
def geoposes(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("geopose")
    subprocess.run([RAYLIFT, "export", "geopose", run, "--out", out], check=True)
    return out


@pytest.fixture(scope="module")
def server(run: Path) -> Iterator[Server]:
    with Server(*cached(run), "--crs", CRS) as server:
        yield server


def request_of(name: str, **more: object) -> dict[str, Any]:
    """What the protocol's client sends."""
    model, width, height, *params = QUERIES[name].split()
    reading = {"timestamp": 1, "sensorId": "0", "sequenceNumber": 0, "imageFormat": "JPG",
               "privacy": {"dataRetention": [], "dataAcceptableUse": [], "dataSanitizationApplied": [],
                           "dataSanitizationRequested": []},
               "size": [int(width), int(height)],
               "imageBytes": base64.b64encode(photograph(name)).decode(),
               "imageOrientation": {"mirrored": False, "rotation": 0},
               "params": {"model": model, "modelParams": [float(number) for number in params]}}
    return {"id": name, "timestamp": 1700000000123, "type": "geopose", "sensors": [{"id": "0", "type": "camera"}],
            "sensorReadings": {"cameraReadings": [reading], **more}}


def geolocation(place: dict[str, Any], accuracy: float = 0.0, east: float = 0.0,
                north: float = 0.0) -> list[dict[str, object]]:
    return [{"timestamp": 2, "sensorId": "1", "latitude": place["lat"] + north / 111e3,
             "longitude": place["lon"] + east / 73e3, "altitude": place["h"], "accuracy": accuracy,
             "altitudeAccuracy": accuracy, "heading": None, "speed": 0}]


def ask(server: Server, request: dict[str, Any], path: str = "/geopose") -> tuple[int, Any]:
    status, headers, body = server.ask(path, json.dumps(request).encode(), {
        "Content-Type": "application/json", "Accept": "application/vnd.oscp+json;version=2.0;"})
    if status != 200:
        assert headers["Content-Type"] == "application/problem+json"
    return status, json.loads(body)


def exported(geoposes: Path, name: str) -> Any:
    return json.loads((geoposes / (name + ".json")).read_text())


def test_places_are_those_that_export_writes(geoposes: Path, server: Server) -> None:
    for name in sorted(QUERIES)[:4]:
        told = json.loads(server.localize(name))
        assert told.pop("geopose") == exported(geoposes, name)
        status, answer = ask(server, request_of(name))
        assert status == 200, answer
        assert answer["geopose"] == exported(geoposes, name)
        assert answer["id"] == name and answer["timestamp"] == 1700000000123 and answer["type"] == "geopose"
        assert answer["scene"] == "demo" and answer["verdict"] == "localized"
        assert 0 < answer["accuracy"]["position"] < 0.1 and 0 < answer["accuracy"]["orientation"] < 1


def test_but_for_the_place_a_line_is_that_of_the_command_line(run: Path, server: Server) -> None:
    lines = {json.loads(line)["name"]: line for line in (run / "queries.jsonl").read_text().splitlines()}
    name = sorted(QUERIES)[0]
    line = server.localize(name)
    assert line.startswith(lines[name][:-1] + ',"geopose":')


def test_places_are_those_of_pyproj(run: Path, geoposes: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    to_earth = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    for line in (run / "queries.jsonl").read_text().splitlines():
        query = json.loads(line)
        w, x, y, z = query["cam_from_world"]["qvec"]
        t = query["cam_from_world"]["tvec"]
        rotation = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
        center = [-sum(rotation[row][i] * t[row] for row in range(3)) for i in range(3)]
        lon, lat = to_earth.transform(center[0] + 500000, center[1] + 5400000)
        place = exported(geoposes, query["name"])["position"]
        assert place["lon"] == pytest.approx(lon, abs=1e-9) and place["lat"] == pytest.approx(lat, abs=1e-9)
        assert place["h"] == pytest.approx(center[2] + 200, abs=1e-6)


def test_a_position_by_gnss_is_taken_and_does_not_spoil_the_pose(geoposes: Path, server: Server) -> None:
    name = sorted(QUERIES)[0]
    place = exported(geoposes, name)["position"]
    for key in ("geolocationReadings", "geoLocationReadings"):
        status, answer = ask(server, request_of(name, **{key: geolocation(place, accuracy=5, east=4, north=3)}))
        assert status == 200
        for axis, tolerance in (("lon", 2e-7), ("lat", 2e-7), ("h", 0.02)):  # 2 cm
            assert answer["geopose"]["position"][axis] == pytest.approx(place[axis], abs=tolerance)


def scene_file(folder: Path, name: str, crs: str) -> Path:
    file = folder / (name + ".toml")
    file.write_text(f'format = "raylift-scene/1"\nname = "{name}"\nreferences = "{DEMO}/model"\n'
                    f'images = "{DEMO}/images"\ncrs = "{crs}"\n'
                    f'[[geometry]]\nname = "mesh"\nspec = "mesh:{DEMO}/scene.obj"\n')
    return file


def test_the_nearest_scene_answers(run: Path, geoposes: Path, tmp_path: Path) -> None:
    name = sorted(QUERIES)[0]
    place = exported(geoposes, name)["position"]
    with Server("--cache", run / "cache", scenes=(scene_file(tmp_path, "far", FAR), scene_file(tmp_path, "near", CRS))) as server:
        status, answer = ask(server, request_of(name))
        assert status == 400 and answer["field"] == "scene"
        status, answer = ask(server, request_of(name, geolocationReadings=geolocation(place)))
        assert status == 200 and answer["scene"] == "near"
        status, answer = ask(server, request_of(name), "/geopose?scene=far")
        assert status == 200 and abs(answer["geopose"]["position"]["lon"] - place["lon"]) > 1
        elsewhere = geolocation({"lon": -120, "lat": 10, "h": 0})
        status, answer = ask(server, request_of(name, geolocationReadings=elsewhere))
        assert status == 404 and answer["field"] == "scene"


def test_what_is_wrong_is_told(server: Server) -> None:
    name = sorted(QUERIES)[0]
    request = request_of(name)
    assert ask(server, request, "/geopose?scene=other")[1]["field"] == "scene"
    assert ask(server, request, "/geopose?place=other")[1]["field"] == "place"
    assert ask(server, {**request, "sensorReadings": []})[1]["field"] == "body.sensorReadings"
    assert server.ask("/geopose")[0] == 405
    # A picture that shows nothing.
    gray = base64.b64encode(bytes(640 * 480)).decode()
    request["sensorReadings"]["cameraReadings"][0].update(imageFormat="GRAY8", imageBytes=gray)
    status, answer = ask(server, request)
    assert status == 422 and "not localized" in answer["detail"]


def test_a_scene_without_a_crs_has_no_place(run: Path) -> None:
    with Server(*cached(run)) as server:
        status, answer = ask(server, request_of(sorted(QUERIES)[0]))
        assert status == 404 and answer["field"] == "scene" and "CRS" in answer["detail"]
        assert "geopose" not in json.loads(server.localize(sorted(QUERIES)[0]))


def test_a_system_that_is_not_meant_for_the_scene_is_refused(run: Path) -> None:
    done = subprocess.run([RAYLIFT, "serve", SCENE, "--port", "0", "--crs", "EPSG:25832", *cached(run)],
                          capture_output=True, text=True)
    assert done.returncode == 3, done
    assert len(done.stderr.splitlines()) == 1 and "EPSG:25832" in done.stderr
