"""What raylift compare says of faults that numpy plants in the demo's true depth."""

import re
from typing import Any, Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from scenes import DEMO


def windows(depth: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    padded = np.pad(depth, side // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, (side, side))


def ray_lengths(camera: raylift.Camera) -> NDArray[np.float64]:
    y, x = np.mgrid[0:camera.height, 0:camera.width] + 0.5
    rays = camera.rays(np.column_stack([x.ravel(), y.ravel()]))
    return np.asarray(np.linalg.norm(rays / rays[:, 2:], axis=1)).reshape(x.shape)


def inverted(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda z, camera: np.where(z > 0, function(np.maximum(z, 1e-3)), 0)


def fattened(z: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    nearest = windows(np.where(z > 0, z, np.inf), side).min((2, 3))
    return np.where(nearest < 0.9 * z, nearest, z)


def flying(z: NDArray[np.float32], share: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(1)
    near = windows(np.where(z > 0, z, np.inf), 3).min((2, 3))
    far = windows(z, 3).max((2, 3))
    flies = (z > 0) & (far > 1.1 * near) & (rng.random(z.shape) < share)
    near[~flies] = 0
    return np.where(flies, near + rng.random(z.shape) * (far - near), z)


# The name of a fault: what becomes of true depth, how it is read, what is said.
FAULTS: dict[str, tuple[Callable[..., Any], str, str]] = {
    "exact": (lambda z, camera: z, "", "^$"),
    "mirrored": (lambda z, camera: z[:, ::-1], "", "^flipped: maps are mirrored, left for right$"),
    "upside_down": (lambda z, camera: z[::-1], "", "^flipped: maps are upside down$"),
    "turned": (lambda z, camera: z[::-1, ::-1], "", "^flipped: maps are turned by 180 degrees$"),
    "ray_as_z": (lambda z, camera: z * ray_lengths(camera), "",
                 r"^ray length: lengths of rays are read as depth z \(kind=ray\)$"),
    "z_as_ray": (lambda z, camera: z, ",kind=ray",
                 r"^ray length: depth z is read as lengths of rays \(kind=z\)$"),
    "disparity": (inverted(lambda z: 300 / z), "", "^disparity: depth is 300 / the true one: "),
    "shifted_disparity": (inverted(lambda z: 100 / z + 5), "",
                          r"^disparity: depth is 100 / the true one \+5: "),
    "inverse_offset": (inverted(lambda z: np.maximum(300 / z - 15, 0)), ",kind=inverse",
                       "^inverse offset: 1 / depth is 300.000 times the true one -15"),
    "power": (inverted(lambda z: 0.7 * z ** 1.2), "",
              "^power law: depth is 0.7 times the true one to the power of 1.200$"),
    "fattened": (lambda z, camera: fattened(z, 9), "",
                 "^fattened foreground: what is in front reaches 4 px too far$"),
    "median": (lambda z, camera: np.median(windows(z, 5), axis=(2, 3)), "",
               "^median: maps look like after a median of 5 x 5 px$"),
    "flying": (lambda z, camera: flying(z, 0.5), "",
               "^flying pixels: [0-9]+ % of the pixels at depth edges lie between"),
    "millimeters": (lambda z, camera: 1000 * z, "", "^scale: depth is 1000 times the true one$"),
    "two_faults": (lambda z, camera: z[:, ::-1] ** 0.8, "", "not explained: "),
}


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    folder = tmp_path_factory.mktemp("faults")
    images = raylift.Scene(DEMO / "model", every=4).references
    caster = raylift.RayCaster(raylift.Mesh.read(DEMO / "scene.obj"))
    geometry = {}
    for name in ["truth", *FAULTS]:
        plant, keys, _ = FAULTS.get(name, FAULTS["exact"])
        for image in images:
            depth = plant(caster.render(image.camera, image.cam_from_world)["depth"], image.camera)
            file = (folder / name / image.name).with_suffix(".npy")
            file.parent.mkdir(parents=True, exist_ok=True)
            np.save(file, np.asarray(depth, np.float32))
        geometry[name] = f"depth:{folder / name}{keys}"
    result = raylift.compare(DEMO / "model", geometry, truth="truth", every=4, max_side=160)
    return {source["name"]: [finding["text"] for finding in source["findings"]]
            for source in result["depth"]["sources"]}


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_named(findings: dict[str, list[str]], name: str) -> None:
    assert re.search(FAULTS[name][2], "; ".join(findings[name])), findings[name]
