"""3D Tiles of other writers, at 6.4e6 m from the center of the earth, against the same mesh as PLY."""

import json
import os
import struct
import subprocess
from pathlib import Path
from typing import Any, Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from synthetic import rotation

pyproj = pytest.importorskip("pyproj")

PLACE = (9.9, 53.55, 52.25)
MILLIMETER = 1e-3


def east_north_up() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The axes and the origin of a local frame, earth-centered."""
    lon, lat = np.radians(PLACE[:2])
    axes = np.array([[-np.sin(lon), -np.sin(lat) * np.cos(lon), np.cos(lat) * np.cos(lon)],
                     [np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat) * np.sin(lon)],
                     [0, np.cos(lat), np.sin(lat)]])
    origin = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(*PLACE)
    return axes, np.array(origin)


def hills(left: float, bottom: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """A patch of 40 x 40 m, from a corner."""
    x, y = np.meshgrid(np.arange(81) * 0.5 + left, np.arange(81) * 0.5 + bottom)
    points = np.stack([x, y, 3 * np.sin(x / 5) * np.cos(y / 7)], -1).reshape(-1, 3)
    i = (np.arange(80)[:, None] * 81 + np.arange(80)).reshape(-1)
    return points, np.concatenate([np.stack([i, i + 1, i + 82], -1), np.stack([i, i + 82, i + 81], -1)])


PATCHES = [hills(x, y) for x in (-40, 0) for y in (-40, 0)]


def write_b3dm(path: Path, points: NDArray[np.float64], triangles: NDArray[np.int64],
               center: NDArray[np.float64]) -> None:
    """`center` as RTC_CENTER; the axes of the points stay, as floats, y up."""
    local = (points - center)[:, [0, 2, 1]].astype("<f4") * np.array([1, 1, -1], np.float32)
    data = local.tobytes() + triangles.astype("<u4").tobytes()
    text = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": local.nbytes},
                        {"buffer": 0, "byteOffset": local.nbytes, "byteLength": len(data) - local.nbytes}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
                       "min": local.min(0).tolist(), "max": local.max(0).tolist()},
                      {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"}]})
    text += " " * (-len(text) % 4)
    glb = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(data), len(text), b"JSON") + text.encode() \
        + struct.pack("<I4s", len(data), b"BIN\0") + data
    table = json.dumps({"BATCH_LENGTH": 0, "RTC_CENTER": list(center)})
    table += " " * (-(28 + len(table)) % 8)
    path.write_bytes(struct.pack("<4sIIIIII", b"b3dm", 1, 28 + len(table) + len(glb), len(table), 0, 0, 0)
                     + table.encode() + glb)


def write_by_numpy(folder: Path, axes: NDArray[np.float64], origin: NDArray[np.float64]) -> None:
    """Tiles in the earth's axes, each around a center of its own."""
    children = []
    for i, (points, triangles) in enumerate(PATCHES):
        center = origin + axes @ points.mean(0)
        write_b3dm(folder / f"{i}.b3dm", points @ axes.T + origin, triangles, center)
        children.append({"boundingVolume": {"sphere": [*center, 40]}, "geometricError": 0,
                         "content": {"uri": f"{i}.b3dm"}})
    root = {"boundingVolume": {"sphere": [*origin, 80]}, "geometricError": 9, "refine": "REPLACE",
            "children": children}
    (folder / "tileset.json").write_text(json.dumps({"asset": {"version": "1.0"}, "geometricError": 99, "root": root}))


def write_by_py3dtiles(folder: Path, axes: NDArray[np.float64],
                       origin: NDArray[np.float64]) -> None:
    """Tiles in the root's local frame, moved by transforms."""
    tiles = pytest.importorskip("py3dtiles.tileset")
    content = pytest.importorskip("py3dtiles.tileset.content")
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = axes, origin
    root = tiles.Tile(geometric_error=9, transform=transform, refine_mode="ADD")
    for i, (points, triangles) in enumerate(PATCHES):
        moved = np.eye(4)
        moved[:3, 3] = points.mean(0)
        local = (points - points.mean(0))[:, [0, 2, 1]] * [1, 1, -1]
        volume = tiles.BoundingVolumeBox()
        volume.set_from_list([0, 0, 0, 20, 0, 0, 0, 20, 0, 0, 0, 4])
        tile = tiles.Tile(geometric_error=0, bounding_volume=volume, transform=moved, content_uri=f"{i}.b3dm")
        tile.tile_content = content.B3dm.from_numpy_arrays(local.astype("f4"), triangles.astype("u4"))
        root.add_child(tile)
    root.bounding_volume = tiles.BoundingVolumeBox()
    root.bounding_volume.set_from_list([0, 0, 0, 40, 0, 0, 0, 40, 0, 0, 0, 4])
    tileset = tiles.TileSet(geometric_error=99)
    tileset.root_tile = root
    tileset.write_to_directory(folder / "tileset.json")


# Down from above: turned around x, and the translation of world to camera.
VIEWS = {"a": (2.6, [1, 2, 30]), "b": (np.pi, [3, -4, 45])}


def write_model(folder: Path) -> None:
    folder.mkdir()
    (folder / "cameras.txt").write_text("1 PINHOLE 320 240 250 250 160 120\n")
    (folder / "images.txt").write_text("".join(
        f"{i + 1} {np.cos(angle / 2)} {np.sin(angle / 2)} 0 0 {x} {y} {z} 1 {name}.jpg\n\n"
        for i, (name, (angle, (x, y, z))) in enumerate(VIEWS.items())))
    (folder / "points3D.txt").write_text("")


@pytest.mark.parametrize("write", [write_by_numpy, write_by_py3dtiles])
def test_tiles_on_the_earth_show_what_the_local_mesh_shows(tmp_path: Path,
                                                           write: Callable[..., Any]) -> None:
    axes, origin = east_north_up()
    write(tmp_path, axes, origin)
    root = json.loads((tmp_path / "tileset.json").read_text())["root"]
    # The center of the root's volume in the local frame, which py3dtiles computes anew.
    center = np.array(root["boundingVolume"]["box"][:3]) if "transform" in root else np.zeros(3)
    write_model(tmp_path / "model")
    subprocess.run([os.environ["RAYLIFT"], "render", "--model", tmp_path / "model", "--geometry",
                    f"mesh:{tmp_path / 'tileset.json'}", "--out", tmp_path, "--format", "npy", "--quiet"],
                   check=True)
    points = np.concatenate([points for points, _ in PATCHES]) - center
    triangles = np.concatenate([t + i * 81 * 81 for i, (_, t) in enumerate(PATCHES)])
    caster = raylift.RayCaster(raylift.Mesh(points, triangles))
    camera = raylift.Camera("PINHOLE", 320, 240, [250, 250, 160, 120])
    for name, (angle, translation) in VIEWS.items():
        tiles = np.load(tmp_path / "depth" / f"{name}.npy")
        local = caster.render(camera, raylift.Rigid3(rotation([angle, 0, 0]), translation))["depth"]
        seen = (tiles > 0) & (local > 0)
        assert seen.mean() > 0.99
        assert np.abs(tiles - local)[seen].max() < MILLIMETER


def test_a_map_is_asked_for_by_crs(tmp_path: Path) -> None:
    axes, origin = east_north_up()
    write_by_numpy(tmp_path, axes, origin)
    mesh = raylift.Mesh.read(f"mesh:{tmp_path / 'tileset.json'},crs=EPSG:25832@559000/5934000/10")
    on_earth = np.concatenate([points for points, _ in PATCHES]) @ axes.T + origin
    to_map = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:25832", always_xy=True)
    on_map = np.column_stack(to_map.transform(*on_earth.T)) - [559000, 5934000, 10]
    ours = mesh.vertices[np.lexsort(mesh.vertices.round(2).T)]
    theirs = on_map[np.lexsort(on_map.round(2).T)]
    # Each tile keeps its own vertices at common borders.
    assert ours.min(0) == pytest.approx(theirs.min(0), abs=MILLIMETER)
    assert ours.max(0) == pytest.approx(theirs.max(0), abs=MILLIMETER)
    assert ours.mean(0) == pytest.approx(theirs.mean(0), abs=MILLIMETER)
    for wrong, message in [("crs=EPSG:1", "EPSG:1"), ("error=-1", "error=NUMBER"), ("ortho=a", "error=METERS")]:
        with pytest.raises(raylift.OptionError, match=message):
            raylift.Mesh.read(f"mesh:{tmp_path / 'tileset.json'},{wrong}")


def test_a_scene_says_what_its_tiles_are_led_to(tmp_path: Path) -> None:
    axes, origin = east_north_up()
    (tmp_path / "town").mkdir()
    write_by_numpy(tmp_path / "town", axes, origin)
    write_model(tmp_path / "model")
    place = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:25832", always_xy=True).transform(*origin)
    crs = "EPSG:25832@{:.3f},{:.3f},{:.3f}".format(*place)
    tiles = f"mesh:{tmp_path / 'town'}"
    scene = tmp_path / "scene.toml"
    scene.write_text('format = "raylift-scene/1"\nreferences = "model"\n'
                     f'crs = "{crs}"\n[[geometry]]\nname = "town"\nspec = "mesh:town"\n')

    def depth(*arguments: Path | str) -> NDArray[np.float32]:
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        subprocess.run([os.environ["RAYLIFT"], "render", *arguments, "--out", out, "--format", "npy", "--quiet"],
                       check=True)
        return np.asarray(np.load(out / "depth" / "a.npy"))

    model: list[Path | str] = ["--model", tmp_path / "model"]
    led = depth(*model, "--geometry", f"{tiles},crs={crs.replace(',', '/')}")
    # North of the map is 0.7 degrees off.
    assert np.abs(led - depth(*model, "--geometry", tiles)).max() > 0.01
    for given in [], ["--geometry", "town"], ["--geometry", tiles]:
        assert (led == depth("--scene", scene, *given)).all()
    caster = raylift.Scene.read(scene).mesh
    camera = raylift.Camera("PINHOLE", 320, 240, [250, 250, 160, 120])
    angle, translation = VIEWS["a"]
    ours = caster.render(camera, raylift.Rigid3(rotation([angle, 0, 0]), translation))["depth"]
    assert np.abs(led - ours).max() < MILLIMETER


def test_calibrate_leads_tiles_to_the_world(tmp_path: Path) -> None:
    write_by_numpy(tmp_path, *east_north_up())
    write_model(tmp_path / "model")
    of_no_code = pyproj.CRS("EPSG:25832").to_wkt()
    ended = subprocess.run([os.environ["RAYLIFT"], "calibrate", "--model", tmp_path / "model", "--geometry",
                            f"mesh:{tmp_path / 'tileset.json'}", "--crs", of_no_code, "--leave-one-out",
                            "--images", tmp_path, "--out", tmp_path / "calibration.json"],
                           capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "the world's system is not given by such a name" in ended.stderr
