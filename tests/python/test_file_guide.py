"""The files of `render`, read by the packages that the README.txt beside them names."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"  # before cv2 is imported

DEMO = Path(os.environ["RAYLIFT_SOURCE"]) / "assets/demo"
PNG_STEP = 0.001
PRODUCTS = {"npy": "depth,incidence,points,normals,triangle", "npz": "depth,normals,triangle",
            "exr": "depth,normals,triangle", "png": "depth,normals,triangle,color", "tiff": "depth,incidence",
            "pfm": "depth", "ply": "points"}
Files = dict[str, Path]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """By format: the folder with one image's products."""
    folders = {}
    for ending, products in PRODUCTS.items():
        folders[ending] = tmp_path_factory.mktemp(ending)
        formats = [f"--format={product}={ending}" for product in products.split(",")]
        subprocess.run([os.environ["RAYLIFT"], "render", "--model", DEMO / "model", "--geometry",
                        f"mesh:{DEMO / 'scene.obj'}", "--products", products, *formats, "--exr-compression", "zip",
                        "--scale", "0.25", "--every", "24", "--quiet", "--out", folders[ending]], check=True)
    return folders


def file_of(rendered: Files, product: str, ending: str) -> Path:
    return next((rendered[ending] / product).rglob(f"*.{ending}"))


def array(rendered: Files, product: str) -> NDArray[Any]:
    values: NDArray[Any] = np.load(file_of(rendered, product, "npy"))
    return values


def test_numpy_reads_npz(rendered: Files) -> None:
    for product, key in {"depth": "depth", "normals": "normals", "triangle": "id"}.items():
        assert (np.load(file_of(rendered, product, "npz"))[key] == array(rendered, product)).all()


def check_images(rendered: Files, read: Any, endings: list[str]) -> None:
    """`read` gives the array of a file, with the order of channels that the file has."""
    depth = array(rendered, "depth")
    assert np.abs(read(file_of(rendered, "depth", "png")) * PNG_STEP - depth).max() <= 0.501 * PNG_STEP
    ids = array(rendered, "triangle")
    assert (read(file_of(rendered, "triangle", "png")) == np.where(ids == 2**32 - 1, 65535, ids)).all()
    assert read(file_of(rendered, "color", "png")).shape == (*depth.shape, 3)
    normals = array(rendered, "normals")
    assert np.abs(read(file_of(rendered, "normals", "png")) / 127.5 - 1 - normals).max() < 0.005
    for ending in endings:
        for product in PRODUCTS[ending].split(","):
            assert (read(file_of(rendered, product, ending)) == array(rendered, product)).all()


def test_opencv_reads_images(rendered: Files) -> None:
    cv2 = pytest.importorskip("cv2")

    def read(file: Path) -> Any:
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        return image if image.ndim == 2 else image[..., ::-1]

    check_images(rendered, read, ["tiff", "pfm"])
    if re.search(r"OpenEXR: +[^N ]", cv2.getBuildInformation()):
        assert (read(file_of(rendered, "depth", "exr")) == array(rendered, "depth")).all()


def test_imageio_reads_images(rendered: Files) -> None:
    imageio = pytest.importorskip("imageio.v3")
    check_images(rendered, imageio.imread, ["tiff"])


def test_openexr_reads_exr(rendered: Files) -> None:
    openexr = pytest.importorskip("OpenEXR", "3.3")
    for product in PRODUCTS["exr"].split(","):
        with openexr.File(str(file_of(rendered, product, "exr")), separate_channels=True) as file:
            channels = [channel.pixels for _, channel in sorted(file.channels().items(), reverse=True)]  # R, G, B
        assert (np.squeeze(np.stack(channels, axis=-1)) == array(rendered, product)).all()


def test_open3d_reads_depth_and_clouds(rendered: Files) -> None:
    open3d = pytest.importorskip("open3d")
    depth = np.asarray(open3d.io.read_image(str(file_of(rendered, "depth", "png"))))
    assert np.abs(depth * PNG_STEP - array(rendered, "depth")).max() <= 0.501 * PNG_STEP
    cloud = open3d.io.read_point_cloud(str(file_of(rendered, "points", "ply")))
    points = array(rendered, "points").reshape(-1, 3)
    seen = points[np.isfinite(points[:, 0])]
    assert np.abs(np.asarray(cloud.points) - seen).max() < 1e-5
    assert cloud.has_colors() and cloud.has_normals()
