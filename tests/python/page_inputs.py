"""What the pages' commands name beside `assets`: page_inputs.py FOLDER. It is made of the demo: files of hloc's, a
survey, a phone's scan, data sets as they are published, and networks as ONNX files.
"""

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import raylift
from photographs import jpeg
from scenes import DEMO, MESH, HlocScene
from test_onnx import FLOAT, INT64, Value, ints, node, upright_sift, write_graph

FEATURES = "feats-superpoint-n4096-r1024"


def write_hloc(folder: Path) -> None:
    """As hloc calls its files."""
    made = HlocScene(folder)
    made.features.rename(folder / f"{FEATURES}.h5")
    made.matches_file.rename(folder / f"{FEATURES}_matches-superglue_pairs.h5")
    raylift.ColmapModel.read(DEMO / "model").write(folder / "sfm")


def write_networks(folder: Path) -> None:
    """An extractor of upright SIFT, and mutual nearest neighbors in the form of LightGlue."""
    upright_sift(folder / "superpoint.onnx", 480, 640)
    inputs: list[Value] = [(f"{what}{i}", FLOAT, [1, f"n{i}", size])
                           for i in "01" for what, size in (("keypoints", 2), ("descriptors", 128))]
    nodes = [node("Transpose", ["descriptors1"], "columns", perm=[0, 2, 1]),
             node("MatMul", ["descriptors0", "columns"], "alike"),
             node("ArgMax", ["alike"], "best", axis=2, keepdims=0),
             node("ArgMax", ["alike"], "back", axis=1, keepdims=0),
             node("GatherElements", ["back", "best"], "again", axis=1),
             node("Shape", ["best"], "shape"), node("Gather", ["shape", "one"], "count"),
             node("Range", ["zero", "count", "one"], "own"),
             node("Equal", ["again", "own"], "is_mutual"),
             node("Where", ["is_mutual", "best", "none"], "matches0"),
             node("ReduceMax", ["alike"], "mscores0", axes=[2], keepdims=0)]
    outputs: list[Value] = [("matches0", INT64, [1, "n0"]), ("mscores0", FLOAT, [1, "n0"])]
    write_graph(folder / "lightglue.onnx", inputs, nodes, outputs,
                [("zero", np.array(0, np.int64)), ("one", np.array(1, np.int64)), ("none", ints(-1))])


def write_geotiff(file: Path, raster: NDArray[Any], cell: float, corner: tuple[float, float]) -> None:
    """In EPSG:25832; `corner` is the upper left one, -9999 no height."""
    colors_last = raster[..., ::-1] if raster.ndim == 3 else raster
    assert cv2.imwrite(str(file), colors_last, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    data = bytearray(file.read_bytes())
    directory = int.from_bytes(data[4:8], "little")
    count = int.from_bytes(data[directory:directory + 2], "little")
    entries = [bytes(data[directory + 2 + 12 * i:directory + 14 + 12 * i]) for i in range(count)]
    keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25832]
    tags: list[tuple[int, int, NDArray[Any]]] = [
        (33550, 12, np.array([cell, cell, 0.0])), (33922, 12, np.array([0.0, 0, 0, *corner, 0])),
        (34735, 3, np.array(keys, "<u2")), (42113, 2, np.frombuffer(b"-9999\0", np.uint8))]
    for tag, kind, values in tags:
        entries.append(np.array([tag, kind], "<u2").tobytes() + np.array([values.size, len(data)], "<u4").tobytes())
        data += values.tobytes()
    entries.sort(key=lambda entry: int.from_bytes(entry[:2], "little"))
    data[4:8] = len(data).to_bytes(4, "little")
    data += len(entries).to_bytes(2, "little") + b"".join(entries) + bytes(4)
    file.write_bytes(data)


def write_survey(folder: Path) -> None:
    """The yard as a surface model with its orthophoto, and two photographs that say where they were taken."""
    folder.mkdir()
    caster = raylift.RayCaster(MESH)
    origin, cell = (566000.0, 5935000.0), 0.1

    def from_above(camera: raylift.Camera, center: list[float]) -> tuple[NDArray[Any], NDArray[Any]]:
        down = np.diag([1.0, -1, -1])
        pictures = caster.render(camera, raylift.Rigid3(down, -down @ center), ["depth", "color"], supersampling=2)
        return pictures["depth"], pictures["color"]

    far = 2000.0
    depth, color = from_above(raylift.Camera("SIMPLE_PINHOLE", 320, 280, [far / cell, 160, 140]), [8, 6, far])
    heights = np.where(depth > 0, far - depth, -9999).astype(np.float32)
    for name, raster in (("dsm.tif", heights), ("ortho.tif", color)):
        write_geotiff(folder / name, raster, cell, (origin[0] + 8 - 16, origin[1] + 6 + 14))
    photos = folder / "photos"
    photos.mkdir()
    for i, east in enumerate((6.0, 10.0)):
        _, picture = from_above(raylift.Camera("SIMPLE_PINHOLE", 400, 300, [333, 200, 150]), [east, 6, 12])
        data = cv2.imencode(".jpg", picture[..., ::-1])[1].tobytes()
        # The yard's place, as its coordinates say.
        header = jpeg(53.559778, 9.996495 + 6e-5 * i, 12.0)
        file = photos / f"drone_{i}.jpg"
        file.write_bytes(header[:header.index(b"\xff\xc0")] + data[2:])


def write_scan(folder: Path) -> None:
    """The mesh with y up, as phones export it, and two photographs."""
    (folder / "photos").mkdir(parents=True)
    for file in [*DEMO.glob("*.jpg"), DEMO / "scene.mtl"]:
        (folder / file.name).symlink_to(file)
    text = (DEMO / "scene.obj").read_text(encoding="utf-8")
    turned = re.sub(r"^(vn?) (\S+) (\S+) (\S+)", lambda m: f"{m[1]} {m[2]} {m[4]} {-float(m[3])}", text,
                    flags=re.MULTILINE)
    (folder / "scan.obj").write_text(turned, encoding="utf-8")
    for name in ("query_02.jpg", "query_04.jpg"):
        (folder / "photos" / name).symlink_to(DEMO / "images/query" / name)


def write_ply(file: Path) -> None:
    mesh = raylift.Mesh.read(DEMO / "scene.obj")
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<u4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}",
              *(f"property double {axis}" for axis in "xyz"), f"element face {len(faces)}",
              "property list uchar uint vertex_indices", "end_header", ""]
    file.write_bytes("\n".join(header).encode() + mesh.vertices.astype("<f8").tobytes() + faces.tobytes())


def write_scannetpp(folder: Path) -> None:
    """Six photographs by a fisheye lens."""
    (folder / "dslr/resized_images").mkdir(parents=True)
    (folder / "scans").mkdir()
    write_ply(folder / "scans/mesh_aligned_0.05.ply")
    model = raylift.ColmapModel()
    model.add_camera(1, "OPENCV_FISHEYE 640 480 300 301 322 239 0.02 -0.01 0.003 -0.001")
    names: list[str] = []
    for image in raylift.ColmapModel.read(DEMO / "model").posed_images[::4]:
        names.append(f"DSC0175{len(names)}.JPG")
        model.add_image(len(names), names[-1], 1, image.cam_from_world)
        shutil.copy(DEMO / "images" / image.name, folder / "dslr/resized_images" / names[-1])
    model.write(folder / "dslr/colmap", "text")
    (folder / "dslr/train_test_lists.json").write_text(json.dumps({"train": names[:-1], "test": names[-1:]}))


def write_lamar(folder: Path) -> None:
    """A map's session with its mesh, and one of queries."""
    images = raylift.ColmapModel.read(DEMO / "model").posed_images
    for session, chosen in (("map", images[:6:2]), ("query_val_phone", images[1:2])):
        place = folder / "sessions" / session
        (place / "raw_data/images").mkdir(parents=True)
        lines: dict[str, list[str]] = {"sensors": [], "trajectories": [], "images": []}
        for i, image in enumerate(chosen):
            time, device = 1638000000000000 + 40000 * i, f"ios_{i}/cam"
            pose = image.cam_from_world.inverse()
            numbers = ", ".join(map(str, [*pose.qvec, *pose.tvec]))
            parameters = ", ".join(str(image.camera).split())
            lines["sensors"].append(f"{device}, name, camera, {parameters}")
            lines["trajectories"].append(f"{time}, {device}, {numbers}")
            lines["images"].append(f"{time}, {device}, images/{time}.jpg")
            shutil.copy(DEMO / "images" / image.name, place / f"raw_data/images/{time}.jpg")
        for name, rows in lines.items():
            (place / f"{name}.txt").write_text("\n".join([f"# {name}", *rows, ""]), encoding="utf-8")
    (folder / "sessions/map/proc/meshes").mkdir(parents=True)
    write_ply(folder / "sessions/map/proc/meshes/mesh.ply")


def write_page_inputs(folder: Path) -> None:
    write_hloc(folder / "outputs")
    write_networks(folder)
    write_survey(folder / "survey")
    write_scan(folder / "phone")
    write_scannetpp(folder / "scannetpp/7b6477cb95")
    write_lamar(folder / "lamar/HGE")


if __name__ == "__main__":
    write_page_inputs(Path(sys.argv[1]))
