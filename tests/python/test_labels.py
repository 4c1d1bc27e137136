"""Ids of nodes, groups, objects, materials and kinds of surfaces, pixel by pixel, with their names."""

import json
import os
import pickle
import struct
import subprocess
from pathlib import Path
from typing import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift

NONE = 4294967295
CAMERA = "PINHOLE 64 48 32 32 32 24"  # sees x from -1 to 1 and y from -0.75 to 0.75 at z = 1
X, Y = np.meshgrid((np.arange(64) + 0.5) / 32 - 1, (np.arange(48) + 0.5) / 32 - 0.75)

OBJ = """mtllib scene.mtl
v -8 -8 10
v 0 -8 10
v 0 8 10
v -8 8 10
v 8 -8 10
v 8 8 10
v -1 -1 5
v 1 -1 5
v 1 1 5
v -1 1 5
f 7 8 9 10
o wall
usemtl brick
f 1 2 3 4
g door 1
usemtl glass
f 2 5 6 3
"""


def render(folder: Path, mesh: Path | list[Path], *options: Path | str,
           looks_down: bool = False) -> tuple[int, str]:
    pose = "0 1 0 0 0 0 20" if looks_down else "1 0 0 0 0 0 0"
    (folder / "cameras.txt").write_text(f"a.jpg {pose} {CAMERA}\n")
    meshes = mesh if isinstance(mesh, list) else [mesh]
    ended = subprocess.run([os.environ["RAYLIFT"], "render", "--cameras", folder / "cameras.txt",
                            *(f"--geometry=mesh:{each}" for each in meshes), "--products", "instance,semantic",
                            "--out", folder / "out", "--quiet", "--overwrite", *options],
                           capture_output=True, text=True, timeout=100)
    return ended.returncode, ended.stderr


def maps_of(folder: Path) -> list[NDArray[np.uint32]]:
    return [np.load(folder / "out" / product / "a.npy") for product in ("instance", "semantic")]


def names(folder: Path, product: str) -> list[tuple[int, str]]:
    lines = (folder / "out" / f"{product}.txt").read_text().splitlines()
    return [(int(line.split(" ", 1)[0]), line.split(" ", 1)[1]) for line in lines]


@pytest.fixture
def obj(tmp_path: Path) -> Path:
    (tmp_path / "scene.obj").write_text(OBJ)
    (tmp_path / "scene.mtl").write_text("newmtl brick\nKd 1 0 0\nnewmtl glass\nKd 0 0 1\n")
    return tmp_path / "scene.obj"


def wall_and_door(unnamed: int) -> NDArray[np.int64]:
    """What is seen of OBJ: the square in front has neither a group nor a material."""
    front = (abs(X) < 0.2) & (abs(Y) < 0.2)
    behind = np.where(abs(X) < 0.8, np.where(X < 0, 0, 1), NONE)
    return np.where(front, unnamed, np.where(abs(Y) < 0.8, behind, NONE))


def test_a_pickled_mesh_keeps_its_ids(obj: Path) -> None:
    mesh = raylift.Mesh.read(obj)
    again = pickle.loads(pickle.dumps(mesh))
    pose = (CAMERA, raylift.Rigid3())
    for product in "instance", "semantic":
        maps = [raylift.RayCaster(one).render(*pose, products=[product])[product] for one in (mesh, again)]
        assert (maps[0] != NONE).any() and (maps[0] == maps[1]).all()


def test_groups_and_materials_of_obj(tmp_path: Path, obj: Path) -> None:
    assert render(tmp_path, obj) == (0, "")
    for ids in maps_of(tmp_path):
        assert ids.dtype == np.uint32 and (ids == wall_and_door(NONE)).all()
    assert names(tmp_path, "instance") == [(0, "wall"), (1, "wall/door 1")]
    assert names(tmp_path, "semantic") == [(0, "brick"), (1, "glass")]


def test_png_has_16_bits(tmp_path: Path, obj: Path) -> None:
    assert render(tmp_path, obj, "--format", "instance=png") == (0, "")
    stored = raylift.read_depth(tmp_path / "out/instance/a.png")
    assert (stored == np.where(wall_and_door(NONE) == NONE, 65535, wall_and_door(NONE))).all()


def test_a_table_says_what_names_are(tmp_path: Path, obj: Path) -> None:
    (tmp_path / "table.txt").write_text("# id pattern\n7 *door ?\n3 brick\n7 nothing\n")
    code, warnings = render(tmp_path, obj, "--semantics", tmp_path / "table.txt")
    assert code == 0 and "1 of 3 parts of the meshes have no id" in warnings
    assert 'nothing is called "nothing"' in warnings
    expected = wall_and_door(NONE)
    assert (maps_of(tmp_path)[1] == np.where(expected == 0, 3, np.where(expected == 1, 7, NONE))).all()
    assert names(tmp_path, "semantic") == [(3, "brick"), (7, "wall/door 1")]


@pytest.mark.parametrize("table, message", [
    ("one brick\n", "line 1: id"), ("4294967295 brick\n", "line 1: id: expected a number up to 4294967294"),
    ("1\n", 'line 1: expected "ID PATTERN"'), ("# nothing\n", "found none")])
def test_wrong_tables_are_named(tmp_path: Path, obj: Path, table: str, message: str) -> None:
    (tmp_path / "table.txt").write_text(table)
    code, error = render(tmp_path, obj, "--semantics", tmp_path / "table.txt")
    assert code == 3 and "table.txt" in error and message in error


def test_ids_beyond_16_bits_are_refused_as_png(tmp_path: Path, obj: Path) -> None:
    (tmp_path / "table.txt").write_text("65535 brick\n")
    code, error = render(tmp_path, obj, "--semantics", tmp_path / "table.txt", "--format", "png")
    assert code == 3 and "the id 65535 is beyond the 65534 of a PNG of 16 bits" in error


def test_meshes_without_names_are_refused(tmp_path: Path) -> None:
    (tmp_path / "bare.obj").write_text("".join(line + "\n" for line in OBJ.splitlines()
                                               if line[0] in "vf"))
    code, error = render(tmp_path, tmp_path / "bare.obj")
    assert code == 2 and "instance: no mesh has names of nodes" in error


def test_joined_meshes_count_on_and_share_materials(tmp_path: Path, obj: Path) -> None:
    hidden = "".join(line + "0\n" if line[:2] == "v " else line + "\n" for line in OBJ.splitlines())
    (tmp_path / "hidden.obj").write_text(hidden)  # ten times as far away
    assert render(tmp_path, [tmp_path / "hidden.obj", obj]) == (0, "")
    alone = wall_and_door(NONE)
    instances, semantics = maps_of(tmp_path)
    assert (instances == np.where(alone == NONE, NONE, alone + 2)).all() and (semantics == alone).all()
    assert names(tmp_path, "instance") == [(0, "wall"), (1, "wall/door 1"), (2, "wall"), (3, "wall/door 1")]
    assert names(tmp_path, "semantic") == [(0, "brick"), (1, "glass")]


def glb(nodes: Sequence[dict[str, object]]) -> bytes:
    """A square of 2 x 2 around the origin, as floats, in a file of these nodes."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    data = corners.tobytes() + np.array([0, 1, 2, 0, 2, 3], np.uint32).tobytes()
    text = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "materials": [{"name": "paint"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
                       "min": [-1, -1, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"}]})
    text += " " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(data), len(text), b"JSON") \
        + text.encode() + struct.pack("<I4s", len(data), b"BIN\0") + data


def test_nodes_of_gltf_are_instances_of_one_mesh(tmp_path: Path) -> None:
    (tmp_path / "scene.glb").write_bytes(glb([
        {"name": "street", "children": [1, 2], "translation": [0, 0, 10]},
        {"name": "left", "mesh": 0, "translation": [-4, 0, 0]},
        {"name": "right", "mesh": 0, "translation": [4, 0, 0]}]))
    assert render(tmp_path, tmp_path / "scene.glb") == (0, "")
    inside = (abs(abs(X) - 0.4) < 0.1) & (abs(Y) < 0.1)
    instances, semantics = maps_of(tmp_path)
    assert (instances == np.where(inside, np.where(X < 0, 0, 1), NONE)).all()
    assert (semantics == np.where(inside, 0, NONE)).all()
    assert names(tmp_path, "instance") == [(0, "street/left"), (1, "street/right")]
    assert names(tmp_path, "semantic") == [(0, "paint")]


CORNERS = [[x, y, z] for z in (0, 10) for x, y in [(-4, -4), (4, -4), (4, 4), (-4, 4)]]
SIDES = {"GroundSurface": [0, 3, 2, 1], "WallSurface": [0, 1, 5, 4], "RoofSurface": [4, 5, 6, 7]}


def city_json() -> str:
    return json.dumps({
        "type": "CityJSON", "version": "1.1", "transform": {"scale": [1, 1, 1], "translate": [0, 0, 0]},
        "vertices": CORNERS + [[x + 9 if x > 0 else x + 11, y, z] for x, y, z in CORNERS],
        "CityObjects": {"house": {"type": "Building", "geometry": [{
            "type": "Solid", "lod": "2", "boundaries": [[[ring] for ring in SIDES.values()]],
            "semantics": {"surfaces": [{"type": kind} for kind in SIDES], "values": [[0, 1, 2]]}}]},
            "shed": {"type": "Building", "geometry": [{
                "type": "MultiSurface", "lod": "2",
                "boundaries": [[[at + 8 for at in ring]] for ring in SIDES.values()],
                "semantics": {"surfaces": [{"type": "RoofSurface"}], "values": [None, None, 0]}}]}}})


def city_gml() -> str:
    def polygon(ring: list[int], name: str) -> str:
        points = " ".join(str(value) for at in ring + ring[:1] for value in CORNERS[at])
        return (f'<gml:Polygon gml:id="{name}"><gml:exterior><gml:LinearRing><gml:posList>{points}'
                "</gml:posList></gml:LinearRing></gml:exterior></gml:Polygon>")
    surfaces = "".join(
        f"<bldg:boundedBy><bldg:{kind}><bldg:lod2MultiSurface><gml:MultiSurface><gml:surfaceMember>"
        f"{polygon(ring, kind)}</gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface></bldg:{kind}>"
        "</bldg:boundedBy>" for kind, ring in SIDES.items())
    links = "".join(f'<gml:surfaceMember xlink:href="#{kind}"/>' for kind in SIDES)
    return ('<core:CityModel xmlns:core="c" xmlns:bldg="b" xmlns:gml="g" xmlns:xlink="x"><core:cityObjectMember>'
            '<bldg:Building gml:id="house"><bldg:lod2Solid><gml:Solid><gml:exterior><gml:CompositeSurface>'
            f"{links}</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod2Solid>{surfaces}"
            "</bldg:Building></core:cityObjectMember></core:CityModel>")


@pytest.mark.parametrize("name, text", [("a.city.json", city_json()), ("a.gml", city_gml())])
def test_kinds_of_surfaces_of_city_models(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    assert render(tmp_path, tmp_path / name, looks_down=True)[0] == 0
    instances, semantics = maps_of(tmp_path)
    kinds = dict(names(tmp_path, "semantic"))
    objects = dict(names(tmp_path, "instance"))
    roof = (abs(X) < 0.4) & (abs(Y) < 0.4)  # 10 below the camera
    assert set(kinds.values()) == set(SIDES)
    assert {kinds[number] for number in semantics[roof]} == {"RoofSurface"}
    assert {objects[number] for number in instances[roof]} == {"house"}
    shed = (X > 0.7) & (abs(Y) < 0.4)
    expected = {"shed"} if "json" in name else {NONE}
    assert {objects.get(number, NONE) for number in instances[shed]} == expected
    (tmp_path / "classes.txt").write_text("1 Roof*\n2 Wall*\n3 Ground*\n")
    render(tmp_path, tmp_path / name, "--semantics", tmp_path / "classes.txt", looks_down=True)
    assert (maps_of(tmp_path)[1][roof] == 1).all()
