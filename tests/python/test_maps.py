"""Packed maps, read by zipfile, zlib and OpenCV as their header says they are written."""

import json
import os
import struct
import subprocess
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from scenes import DEMO, MESH, truth
from synthetic import some


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("maps") / "demo.raymap"
    subprocess.run([os.environ["RAYLIFT"], "map", "pack", file, "--model", DEMO / "model", "--images",
                    DEMO / "images", "--geometry", MESH, "--every", "4", "--max-features", "800", "--quiet"],
                   check=True)
    return file


def depth_of(entry: bytes) -> NDArray[np.float64]:
    width, height, least, largest, size = struct.unpack("<IIddI", entry[:28])
    present = np.unpackbits(np.frombuffer(zlib.decompress(entry[28:28 + size]), np.uint8), bitorder="little")
    codes = np.flatnonzero(present)
    z = np.where(codes == 0, 0, np.exp(least + (largest - least) * (codes - 1) / 65534))
    picture = some(cv2.imdecode(np.frombuffer(entry[28 + size:], np.uint8), cv2.IMREAD_UNCHANGED)).astype(int)
    assert picture.shape[:2] == (height, width)
    folded = 256 * picture[..., 2] + picture[..., 1]  # red and green of BGR
    residuals = np.where(folded % 2 == 0, folded // 2, -(folded + 1) // 2)
    ranks = np.zeros((height + 1, width + 1), int)
    for y in range(height):
        for x in range(width):
            left, upper, corner = int(ranks[y + 1, x]), int(ranks[y, x + 1]), int(ranks[y, x])
            if y == 0:
                upper = corner = 0
            if x == 0:
                left = corner = 0
            predicted = min(max(left + upper - corner, min(left, upper)), max(left, upper))
            ranks[y + 1, x + 1] = (predicted + residuals[y, x]) % 65536
    return z[ranks[1:, 1:]]


def test_a_map_is_what_its_header_says(packed: Path) -> None:
    with zipfile.ZipFile(packed) as archive:
        assert archive.testzip() is None and {i.compress_type for i in archive.infolist()} == {zipfile.ZIP_STORED}
        header = json.loads(archive.read("map.json"))
        assert header["format"] == "raylift-map/1" and header["features"] == "rootsift"
        scene = raylift.Scene(DEMO / "model", [MESH], every=4)
        image = scene.references[0]
        name, *numbers = archive.read("references.txt").decode().splitlines()[0].split()
        assert name == image.name and " ".join(numbers[7:]) == str(image.camera)
        pose = image.cam_from_world
        assert [float(n) for n in numbers[4:7]] == pytest.approx(pose.matrix[:3, 3].tolist(), abs=1e-15)
        found = depth_of(archive.read(f"depth/{image.name}"))
    expected = some(scene.mesh).render(image.camera, pose)["depth"]
    assert ((found > 0) == (expected > 0)).all()
    seen = expected > 0
    step = np.log(expected[seen].max() / expected[seen].min()) / 65534
    assert np.abs(np.log(found[seen] / expected[seen])).max() <= 0.5 * step + 2e-7


def test_photographs_are_localized_in_a_map(packed: Path) -> None:
    scene = raylift.Scene.read(packed)
    assert len(scene.references) == 6
    localizer = raylift.Localizer(scene, max_features=800)
    image = truth()["query/query_02.jpg"]
    found = some(localizer.localize(DEMO / "images" / image.name, image.camera).cam_from_world)
    assert np.linalg.norm(found.center - image.cam_from_world.center) < 0.1
