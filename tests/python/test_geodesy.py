"""Coordinates against pyproj, and what photographs say of themselves against what was written."""

import csv
import json
import pickle
import subprocess
from os import environ
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from photographs import jpeg
from scenes import DEMO, MESH
from synthetic import some

pyproj = pytest.importorskip("pyproj")

SYSTEMS = [("EPSG:4326", "EPSG:32615", (-91.9945, 46.8426)), ("EPSG:4326", "EPSG:25832", (9.9, 53.55)),
           ("EPSG:4979", "EPSG:4978", (10.8265, 51.3)), ("EPSG:4326", "EPSG:2056", (7.44, 46.95)),
           ("EPSG:4326", "EPSG:32733", (15.0, -22.9)), ("EPSG:4258", "EPSG:3035", (10.8, 51.3)),
           ("EPSG:4326", "EPSG:3857", (139.7, 35.7)), ("EPSG:4326", "EPSG:2263", (-73.98, 40.75)),
           ("EPSG:4979", "EPSG:2263+6360", (-73.98, 40.75)), ("EPSG:4326", "EPSG:27572", (2.5, 46.8))]


@pytest.mark.parametrize("source, target, place", SYSTEMS)
def test_positions_are_led_to_the_world_as_by_pyproj(tmp_path: Path, source: str, target: str,
                                                     place: tuple[float, float]) -> None:
    rng = np.random.default_rng(7)
    points = np.column_stack([rng.normal(place, 0.3, (50, 2)), rng.uniform(-50, 3000, 50)])
    names = [f"{i}.jpg" for i in range(len(points))]
    camera = "PINHOLE 40 30 40 40 20 15"
    (tmp_path / "queries.txt").write_text("".join(f"{name} {camera}\n" for name in names))
    (tmp_path / "priors.txt").write_text(f"* world_crs {target}\n" + "".join(
        f"{name} position {x!r} {y!r} {z!r} 3 3 10 crs={source}\n"
        for name, (x, y, z) in zip(names, points.tolist())))
    queries = raylift.read_queries(tmp_path / "queries.txt", priors=tmp_path / "priors.txt")
    ours = np.array([some(query.position_prior)[0] for query in queries])
    theirs = np.column_stack(pyproj.Transformer.from_crs(source, target, always_xy=True).transform(*points.T))
    if len(pyproj.CRS(target).axis_info) == 2:  # the map's unit is that of its heights
        theirs[:, 2] /= pyproj.CRS(target).axis_info[0].unit_conversion_factor
    assert np.abs(ours - theirs).max() < 1e-6


DRONE = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
{attributes}/></rdf:RDF></x:xmpmeta>"""


def drone(**values: str) -> str:
    return DRONE.format(attributes=" ".join(f'drone-dji:{k}="{v}"' for k, v in values.items()))


def queries(*arguments: Path | str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([environ["RAYLIFT"], "queries", *map(str, arguments)], capture_output=True, text=True)


def lists(folder: Path) -> list[Path | str]:
    return ["--out", folder / "queries.txt", "--priors", folder / "priors.txt"]


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    folder = tmp_path / "photographs"
    folder.mkdir()
    (folder / "phone.jpg").write_bytes(jpeg(53.55, 9.9, 12.5, direction=40.0, error=6.0))
    (folder / "compass.jpg").write_bytes(jpeg(53.551, 9.901, direction=40.0, magnetic=True))
    (folder / "drone.jpg").write_bytes(jpeg(53.552, 9.902, 90.0, xmp=drone(
        GimbalYawDegree="+30.00", GimbalPitchDegree="-90.00", GimbalRollDegree="+0.00", RelativeAltitude="+40.5")))
    (folder / "rtk.jpg").write_bytes(jpeg(53.553, 9.903, 90.0, xmp=drone(
        GimbalYawDegree="-150.0", GimbalPitchDegree="-45.0", GimbalRollDegree="0", RtkFlag="50", RtkStdLon="0.1",
        RtkStdLat="0.2", RtkStdHgt="0.3", LRFTargetDistance="41.5",
        DewarpData="2024-05-01;3000,3001,8,-6,-0.1,0.02,0.001,0.002,-0.01")))
    return folder


def test_queries_of_photographs(tmp_path: Path, photographs: Path) -> None:
    result = queries(photographs, *lists(tmp_path), "--crs", "EPSG:25832")
    assert result.returncode == 0 and not result.stderr, result.stderr
    assert "phone.jpg: GPS position +-4 m, height above the sea, heading 40 deg" in result.stdout
    assert "compass.jpg: GPS position +-8 m, no height, heading 40 deg (magnetic)" in result.stdout
    assert "gimbal pitch -90.0, roll 0.0, yaw 30.0 deg, 40.5 m above its start" in result.stdout
    assert "4 photographs, 4 with a position, 4 with a heading" in result.stdout
    read = {q.name: q for q in raylift.read_queries(tmp_path / "queries.txt", priors=tmp_path / "priors.txt")}
    to_map = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    convergence = np.radians(pyproj.Proj("EPSG:25832").get_factors(9.902, 53.552).meridian_convergence)

    # The seconds have seven digits.
    position, sigma = some(read["phone.jpg"].position_prior)
    assert position == pytest.approx([*to_map.transform(9.9, 53.55), 12.5], abs=1e-3)
    assert sigma[:2] == pytest.approx([4, 4], abs=0.1)
    position, sigma = some(read["rtk.jpg"].position_prior)
    assert sigma[:2] == pytest.approx([0.1, 0.2], abs=0.01) and position[2] == pytest.approx(90)

    # Straight down: gravity is the optical axis, the image's top looks to 30 degrees from true north.
    drone = read["drone.jpg"]
    gravity, heading = some(drone.gravity_prior), some(drone.heading_prior)
    assert drone.range_prior is None
    assert gravity[0] == pytest.approx([0, 0, 1], abs=1e-9) and heading[0] == pytest.approx([1, 0, 0], abs=1e-9)
    on_map = np.radians(30) - convergence
    assert heading[1] == pytest.approx([np.cos(on_map), -np.sin(on_map), 0], abs=1e-6)
    # Half down: gravity is as much forward as down in the image.
    rtk = read["rtk.jpg"]
    assert some(rtk.gravity_prior)[0] == pytest.approx([0, np.sqrt(0.5), np.sqrt(0.5)])
    # The laser's range, in units of the map, with .2 m and .15 %; and the calibrated lens.
    scale = pyproj.Proj("EPSG:25832").get_factors(9.903, 53.553).meridional_scale
    assert rtk.range_prior == pytest.approx([41.5 * scale, 0.26225 * scale], rel=1e-4)
    assert "laser range 41.5 m, calibrated lens" in result.stdout
    assert str(rtk.camera) == "FULL_OPENCV 4096 3072 3000 3001 2056 1530 -0.1 0.02 0.001 0.002 -0.01 0 0 0"
    assert rtk.focal_sigma == 0.005 and rtk.focal_range == 1 and read["drone.jpg"].focal_range == 2
    assert pickle.loads(pickle.dumps(rtk)) == rtk


def test_photographs_that_say_nothing_or_nonsense(tmp_path: Path) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    (folder / "zero.jpg").write_bytes(jpeg(0, 0, 0))
    (folder / "far.jpg").write_bytes(jpeg(95.5, 10))
    (folder / "none.jpg").write_bytes(b"\xff\xd8" + jpeg(1, 1)[-13:])
    (folder / "scan.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x08\0\0\0\x08\x08\0\0\0\0")
    result = queries(folder, *lists(tmp_path))
    assert result.returncode == 0
    assert "scan.png: not a JPEG: tags are not read" in result.stdout
    assert "zero.jpg: GPS position of 0, 0 (no fix), not taken" in result.stdout
    assert "far.jpg: GPS position of latitude 95.5 and longitude 10 is not on the earth" in result.stdout
    assert "none.jpg: no GPS position" in result.stdout
    assert "4 photographs, 0 with a position" in result.stdout


def test_names_are_those_of_links_and_may_begin_with_dots(tmp_path: Path,
                                                          photographs: Path) -> None:
    (photographs / "link.jpg").symlink_to(photographs / "phone.jpg")
    (photographs / "..odd.jpg").write_bytes((photographs / "phone.jpg").read_bytes())
    result = queries(photographs / "link.jpg", photographs / "..odd.jpg", *lists(tmp_path), "--quiet")
    assert result.returncode == 0, result.stderr
    assert {q.name for q in raylift.read_queries(tmp_path / "queries.txt")} == {"link.jpg", "..odd.jpg"}
    result = queries(photographs / "link.jpg", *lists(tmp_path), "--query-images", photographs / "below")
    assert "expected a photograph in" in result.stderr


@pytest.mark.parametrize("crs, message", [
    ("EPSG:999999", "--crs = EPSG:999999"), ("EPSG:2193", "compass.jpg: line 1: "),
    ("EPSG:32632@1,2", "expected an origin X,Y,Z")])
def test_systems_that_do_not_fit(tmp_path: Path, photographs: Path, crs: str, message: str) -> None:
    result = queries(photographs, *lists(tmp_path), "--crs", crs)
    assert result.returncode in (2, 3) and message in result.stderr, result.stderr
    assert not (tmp_path / "priors.txt").exists()


@pytest.mark.parametrize("line, message", [
    ("a position 46.8 -91.9 200 3 crs=EPSG:4326", "its first two numbers seem to be swapped"),
    ("a position 576667 5188163 200 3 crs=EPSG:4326", "is not where EPSG:4326"),
    ("a position 1 2 3 4 crs=EPSG:1", "CRS \"EPSG:1\": expected one like"),
    ("a position 1 2 3 4 src=EPSG:4326", "sigma_y"),
    ("* world_crs EPSG:32615\n* world_crs EPSG:32615", "stands twice"),
    ("a heading 10", "sigma_deg"), ("a heading 10 3 0 0 0", "expected a direction"),
    ("a orientation 1 1 0 0 2", "quaternion of length 1")])
def test_priors_that_are_wrong(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "queries.txt").write_text("a PINHOLE 40 30 40 40 20 15\n")
    world = "" if line.startswith("*") else "* world_crs EPSG:32615\n"
    (tmp_path / "priors.txt").write_text(f"{world}{line}\n")
    with pytest.raises(raylift.InputError, match="line 2") as failure:
        raylift.read_queries(tmp_path / "queries.txt", priors=tmp_path / "priors.txt")
    assert message in str(failure.value)


ORIGIN = np.array([500000.0, 5400000.0, 200.0])  # of the run's system


def export(kind: str, run: Path, out: Path, *more: str) -> Path:
    subprocess.run([environ["RAYLIFT"], "export", kind, str(run), "--out", str(out), *more], check=True,
                   capture_output=True)
    return out


def centers(run: Path) -> tuple[dict[str, NDArray[np.float64]], dict[str, raylift.Rigid3]]:
    poses = raylift.read_poses(run / "poses.txt")
    return {name: pose.center for name, pose in poses.items()}, poses


def test_geojson_has_positions_and_ellipses(run: Path, tmp_path: Path) -> None:
    features = json.loads(export("geojson", run, tmp_path / "poses.geojson").read_text())["features"]
    points = {f["properties"]["name"]: f for f in features if f["geometry"]["type"] == "Point"}
    rings = {f["properties"]["name"]: np.array(f["geometry"]["coordinates"][0])
             for f in features if f["geometry"]["type"] == "Polygon"}
    to_degrees = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    found, _ = centers(run)
    assert set(points) == set(found)
    for name, center in found.items():
        x, y, z = center + ORIGIN
        assert points[name]["geometry"]["coordinates"] == pytest.approx([*to_degrees.transform(x, y), z], abs=1e-9)
        ring, sigma = rings[name], points[name]["properties"]
        assert (ring[0] == ring[-1]).all()
        # The farthest north of the ellipse is 2.45 standard deviations away; 36 corners miss it by little.
        north_m = np.ptp(ring[:, 1]) / 2 * 111195
        assert north_m == pytest.approx(2.4477 * sigma["sigma_north_m"], rel=0.02)


def test_geopose_is_the_camera_in_east_north_up(run: Path, tmp_path: Path) -> None:
    export("geopose", run, tmp_path / "q")
    export("geopose", run, tmp_path / "angles", "--angles")
    convergence = np.radians(pyproj.Proj("EPSG:32632").get_factors(9.0, 48.75).meridian_convergence)
    assert abs(convergence) < 1e-3  # the central meridian: the map's axes are east and north
    for name, pose in centers(run)[1].items():
        q = json.loads((tmp_path / "q" / f"{name}.json").read_text())
        angles = json.loads((tmp_path / "angles" / f"{name}.json").read_text())
        assert q["position"] == angles["position"] and 48 < q["position"]["lat"] < 49
        x, y, z, w = (q["quaternion"][k] for k in "xyzw")
        ours = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                         [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                         [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
        right, down, forward = np.asarray(pose.rotation)
        assert ours == pytest.approx(np.column_stack([forward, -right, -down]), abs=1e-4)
        yaw, pitch, roll = np.radians([angles["angles"][k] for k in ("yaw", "pitch", "roll")])

        def turn(a: float, i: int, j: int) -> Any:
            return (np.eye(3) + (np.cos(a) - 1) * (np.outer(E[i], E[i]) + np.outer(E[j], E[j]))
                    + np.sin(a) * (np.outer(E[j], E[i]) - np.outer(E[i], E[j])))

        assert turn(yaw, 0, 1) @ turn(pitch, 2, 0) @ turn(roll, 1, 2) == pytest.approx(ours, abs=1e-9)


E = np.eye(3)


def test_utm_is_in_the_system_that_is_asked_for(run: Path, tmp_path: Path) -> None:
    lines = export("utm", run, tmp_path / "utm.txt", "--to-crs", "EPSG:25833").read_text().splitlines()
    to_zone = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:25833", always_xy=True)
    found, _ = centers(run)
    assert len(lines) == len(found)
    for line in lines:
        name, *numbers = line.split()
        x, y, z = found[name] + ORIGIN
        assert [float(n) for n in numbers[4:]] == pytest.approx([*to_zone.transform(x, y), z], abs=1e-6)


def test_located_pixels_show_where_they_are(run: Path, tmp_path: Path) -> None:
    found, poses = centers(run)
    camera = {q.name: q.camera for q in raylift.read_queries(DEMO / "queries.txt")}
    name = next(iter(found))
    (tmp_path / "pixels.txt").write_text(f"{name} 320.5 240.5\n")
    command = [environ["RAYLIFT"], "locate", str(run), "--pixels", str(tmp_path / "pixels.txt")]
    rows = list(csv.DictReader(subprocess.run(command, check=True, capture_output=True,
                                              text=True).stdout.splitlines()))
    assert [row["status"] for row in rows] == ["surface"]
    point = np.array([float(rows[0][k]) for k in "xyz"])
    assert camera[name].project(poses[name].transform(point[None]))[0] == pytest.approx([320.5, 240.5], abs=1e-3)
    to_degrees = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    x, y, z = point + ORIGIN
    assert [float(rows[0][k]) for k in ("longitude", "latitude", "height")] == pytest.approx(
        [*to_degrees.transform(x, y), z], abs=1e-9)
    for line, message in (("nobody.jpg 1 2", "nobody.jpg: the run has no such photograph"),
                          (f"{name} 1e5 0", "pixel 100000 0 is not in the photograph of 640 x 480")):
        (tmp_path / "pixels.txt").write_text(line + "\n")
        failed = subprocess.run(command, capture_output=True, text=True)
        assert failed.returncode == 3 and message in failed.stderr


def test_without_a_system_nothing_is_guessed(run: Path, tmp_path: Path) -> None:
    for kind in ("geojson", "geopose", "utm"):
        failed = subprocess.run([environ["RAYLIFT"], "export", kind, str(run / "poses.txt"), "--out",
                                 str(tmp_path / "out")], capture_output=True, text=True)
        assert failed.returncode == 2 and "--crs is required" in failed.stderr


def test_errors_of_located_pixels_are_as_large_as_they_are_said_to_be(tmp_path: Path) -> None:
    """1,000 pixels of the demo: of references, each localized by the others, and of the queries."""
    rng = np.random.default_rng(3)
    caster = raylift.RayCaster(raylift.Mesh.read(DEMO / "scene.obj"))
    images = {image.name: image for image in raylift.Scene(DEMO / "model").references}
    raylift.run("localize", model=DEMO / "model", images=DEMO / "images", geometry=MESH, leave_one_out=True,
                out=tmp_path / "run")
    names = list(images)
    pixels = [(name, *rng.uniform([0, 0], [images[name].camera.width, images[name].camera.height]))
              for name in rng.choice(names, 1000)]
    (tmp_path / "pixels.txt").write_text("".join(f"{n} {float(x)!r} {float(y)!r}\n" for n, x, y in pixels))
    raylift.run("locate", str(tmp_path / "run"), pixels=tmp_path / "pixels.txt", out=tmp_path / "located.csv")
    within, count = 0, 0
    for (name, x, y), row in zip(pixels, csv.DictReader((tmp_path / "located.csv").open())):
        image = images[name]
        ray = image.camera.rays(np.array([[x, y]]))[0] @ image.cam_from_world.rotation
        hit = caster.cast(image.cam_from_world.center[None], ray[None])
        if row["status"] != "surface" or not row["xx"] or not np.isfinite(hit["ray_t"][0]):
            continue
        covariance = np.zeros((3, 3))
        covariance[np.triu_indices(3)] = [float(row[k]) for k in ("xx", "xy", "xz", "yy", "yz", "zz")]
        covariance += np.triu(covariance, 1).T
        error = np.array([float(row[k]) for k in "xyz"]) - (image.cam_from_world.center + hit["ray_t"][0] * ray)
        within += error @ np.linalg.solve(covariance, error) < 7.815  # chi squared's 95 %, three of freedom
        count += 1
    assert count > 800
    assert 0.90 <= within / count <= 0.98
