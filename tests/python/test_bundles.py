"""Depth as networks write it: bundles in each layout from rendered truth, read exactly."""

import itertools
from pathlib import Path
from typing import Any, Callable

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from scenes import HlocScene
from synthetic import pose, some
from test_rendering import DEMO

SIZES = [(640, 480), (480, 640), (1000, 667), (667, 1000), (1280, 720), (500, 500)]


@pytest.fixture(scope="module")
def caster() -> raylift.RayCaster:
    return raylift.RayCaster(raylift.Mesh.read(DEMO / "scene.obj"))


def references(size: tuple[int, ...] = (640, 480), count: int = 3) -> list[raylift.PosedImage]:
    """The demo's first views, taken with a camera of this size."""
    width, height = size
    focal = 0.7 * max(size)
    camera = raylift.Camera("PINHOLE", width, height,
                            [focal, 1.01 * focal, 0.49 * width, 0.52 * height])
    return [raylift.PosedImage(image.name, camera, image.cam_from_world)
            for image in raylift.ColmapModel.read(DEMO / "model").posed_images[:count]]


def render(caster: raylift.RayCaster, image: raylift.PosedImage, resized: tuple[int, ...],
           shift: tuple[int, ...], size: tuple[int, ...]) -> NDArray[np.float32]:
    """Depth of the image resized to `resized` px and cut to `size` px at `shift` (below 0: padded)."""
    (width, height), (columns, lines) = resized, size
    fx, fy, cx, cy = image.camera.params
    sx, sy = width / image.camera.width, height / image.camera.height
    camera = raylift.Camera("PINHOLE", columns, lines, [sx * fx, sy * fy, sx * cx - shift[0], sy * cy - shift[1]])
    depth = caster.render(camera, image.cam_from_world)["depth"].copy()
    x, y = np.meshgrid(np.arange(columns) + shift[0], np.arange(lines) + shift[1])
    depth[(x < 0) | (y < 0) | (x >= width) | (y >= height)] = 7  # what a network makes of padding
    return depth


def expect_exact(caster: raylift.RayCaster, images: list[raylift.PosedImage],
                 resized: tuple[int, ...], file: Path, **keys: Path | str) -> raylift.DepthMaps:
    """Every map is the depth of the whole image at its resized size, where the network saw it."""
    maps = raylift.DepthMaps(file, images, **keys)
    for image in images:
        read = some(maps.load(image))
        assert read.shape == resized[::-1]
        truth = render(caster, image, resized, (0, 0), resized)
        seen = np.asarray(read > 0)
        assert seen.mean() > 0.4
        # The same rays, but for rounding; a few pass an edge on its other side.
        assert np.mean(~np.isclose(read, truth, rtol=1e-5)[seen]) < 1e-3
    return maps


# What the tools do to a photograph before the network sees it: the size to which it is resized,
# where the map begins in it, and the map's size.

Fit = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]


def da3(width: int, height: int) -> Fit:
    """Depth-Anything-3's input_processor.py, "upper_bound_resize"."""
    scale = 504 / max(width, height)
    sides = [max(1, int(round(side * scale))) for side in (width, height)]
    near = [min((side // 14 * 14, side // 14 * 14 + 14), key=lambda m: (abs(m - side), -m)) for side in sides]
    return tuple(near), (0, 0), tuple(near)


def dust3r(width: int, height: int) -> Fit:
    """dust3r/utils/image.py, load_images(size=512)."""
    w, h = (int(round(side * 512 / max(width, height))) for side in (width, height))
    cx, cy = w // 2, h // 2
    half_w, half_h = 2 * cx // 16 * 8, 2 * cy // 16 * 8
    if w == h:
        half_h = 3 * half_w // 4
    return (w, h), (cx - half_w, cy - half_h), (2 * half_w, 2 * half_h)


def vggt_crop(width: int, height: int) -> Fit:
    """vggt/utils/load_fn.py, mode "crop"."""
    h = round(height * (518 / width) / 14) * 14
    return (518, h), (0, max(0, h - 518) // 2), (518, min(h, 518))


def vggt_pad(width: int, height: int) -> Fit:
    """vggt/utils/load_fn.py, mode "pad"."""
    if width >= height:
        w, h = 518, round(height * (518 / width) / 14) * 14
    else:
        w, h = round(width * (518 / height) / 14) * 14, 518
    return (w, h), (-((518 - w) // 2), -((518 - h) // 2)), (518, 518)


def mapanything(width: int, height: int) -> Fit:
    """mapanything/utils/image.py, "fixed_mapping" of 518; cropping.py."""
    sizes = {1.000: (518, 518), 1.321: (518, 392), 1.542: (518, 336), 1.762: (518, 294), 2.056: (518, 252),
             3.083: (518, 168), 0.757: (392, 518), 0.649: (336, 518), 0.567: (294, 518), 0.486: (252, 518)}
    size = sizes[min(sizes, key=lambda aspect: abs(aspect - width / height))]
    scale = max(size[0] / width, size[1] / height) + 1e-8
    w, h = int(np.floor(width * scale)), int(np.floor(height * scale))
    return (w, h), tuple(int(np.round(0.5 * (a - b))) for a, b in zip((w, h), size)), size


def stack(caster: raylift.RayCaster, images: list[raylift.PosedImage],
          tool: Callable[..., Any]) -> tuple[NDArray[np.float32], tuple[int, ...]]:
    layout = tool(images[0].camera.width, images[0].camera.height)
    return np.stack([render(caster, image, *layout) for image in images]), layout[0]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("tool, fit", [(da3, "whole"), (dust3r, "crop"), (vggt_crop, "width"),
                                       (vggt_pad, "pad"), (mapanything, "crop_floor")])
def test_maps_of_resized_cut_and_padded_images_are_read_exactly(
        caster: raylift.RayCaster, tmp_path: Path, size: tuple[int, ...], tool: Callable[..., Any],
        fit: str) -> None:
    images = references(size)
    depth, resized = stack(caster, images, tool)
    np.savez(tmp_path / "results.npz", depth=depth)
    expect_exact(caster, images, resized, tmp_path / "results.npz", fit=fit)


def test_depth_anything_3(caster: raylift.RayCaster, tmp_path: Path) -> None:
    images = references()
    depth, resized = stack(caster, images, da3)
    conf = np.full(depth.shape, 2, np.float32)
    conf[:, :100] = 1
    arrays: dict[str, Any] = {
        "image": np.zeros(depth.shape + (3,), np.uint8), "depth": np.round(depth, 8), "conf": conf,
        "extrinsics": np.stack([rows(image.cam_from_world) for image in images]).astype(np.float32),
        "intrinsics": np.zeros((len(images), 3, 3), np.float32)}
    folder = tmp_path / "exports/mini_npz"
    folder.mkdir(parents=True)
    np.savez_compressed(folder / "results.npz", **arrays)
    for place in tmp_path, folder, folder / "results.npz":
        assert expect_exact(caster, images, resized, place, preset="da3").warnings == []
    trusted = raylift.DepthMaps(tmp_path, images, preset="da3", confidence_threshold=1.5)
    assert (some(trusted.load(images[1]))[:100] == 0).all() and (some(trusted.load(images[1]))[100:] > 0).mean() > 0.5
    npy = tmp_path / "npy/exports/mini_npy"
    npy.mkdir(parents=True)
    for name, array in arrays.items():
        np.save(npy / f"{name}.npy", array)
    maps = expect_exact(caster, images, resized, tmp_path / "npy", preset="da3")
    assert "3 maps of float32 504 x 378, z, x 1 +- " in maps.interpretation


def test_one_image_alone_is_a_bundle_too(caster: raylift.RayCaster, tmp_path: Path) -> None:
    images = references(count=1)
    depth, resized = stack(caster, images, da3)
    np.savez(tmp_path / "results.npz", depth=depth,
             extrinsics=np.array([rows(images[0].cam_from_world)], np.float32))
    assert expect_exact(caster, images, resized, tmp_path, preset="da3").warnings == []


def test_keys_of_bundles_are_refused_for_maps_in_files_of_their_own(tmp_path: Path) -> None:
    [image] = references(count=1)
    alone = raylift.PosedImage("a.jpg", image.camera, image.cam_from_world)
    np.save(tmp_path / "a.npy", np.ones((480, 640), np.float32))
    for keys in {"points": "world"}, {"poses": "extrinsics"}:
        with pytest.raises(raylift.InputError, match="keys of maps that are one file"):
            raylift.DepthMaps(tmp_path, [alone], **keys)


def test_the_order_of_maps_is_that_of_the_references_names_or_of_a_list(
        caster: raylift.RayCaster, tmp_path: Path) -> None:
    images = references()
    depth, resized = stack(caster, images, da3)
    np.save(tmp_path / "depth.npy", depth[..., None])
    expect_exact(caster, images[::-1], resized, tmp_path / "depth.npy")
    np.savez(tmp_path / "turned.npz", depth=depth[::-1, None])
    names = tmp_path / "names.txt"
    names.write_text("\n".join(image.name for image in images[::-1]))
    expect_exact(caster, images, resized, tmp_path / "turned.npz", names=names)
    names.write_text("\n".join([images[2].name, "other.jpg", images[0].name]))
    maps = raylift.DepthMaps(tmp_path / "turned.npz", images, names=names)
    assert maps.load(images[1]) is None and maps.load(images[0]) is not None
    assert "1 of 3 references have no depth map, e.g. ref/ref_02.jpg" in maps.warnings[0]


@pytest.mark.parametrize("arrays, keys, message", [
    ({"depth": (2, 4, 6)}, "", r"b.npz: depth: expected a map of each of the 3 references in the order of "
                               r"their names, .* found an array of shape \(2, 4, 6\); names=FILE lists whose"),
    ({"depth": (3, 4, 6, 2)}, "", r"depth: .* found an array of shape \(3, 4, 6, 2\)"),
    ({"depth": (3, 0, 6)}, "", r"b.npz: depth: expected .* \(3, 0, 6\)"),
    ({"conf": (3, 4, 6), "depths": (3, 4, 6)}, "", r'b.npz: expected an array "depth", found conf, depths'),
    ({"depth": (3, 4, 6)}, ",preset=da3,confidence_threshold=2", r'expected an array "conf", found depth'),
    ({"depth": (3, 4, 6), "conf": (2, 4, 6)}, ",confidence=conf", r"b.npz: conf: .* of shape \(2, 4, 6\)"),
    ({"depth": (3, 4, 6)}, ",names={names}", r"none of the 3 images that .*names.txt lists is a reference, not a$"),
    ({"depth": (4, 4, 6)}, ",names={names}", r"depth: expected a map of each of the 3 images that .*names.txt lists"),
    ({"depth": (3, 4, 6, 3)}, "", r"depth: .* of shape \(3, 4, 6, 3\); points=FRAME says"),
    ({"depth": (3, 4, 6)}, ",points=world", r"depth: expected points of each of the 3 references"),
    ({"depth": (3, 4, 6), "cams": (3, 4, 3)}, ",poses=cams", r"cams: expected a pose of each .* \(3, 4, 3\)"),
    ({"depth": (3, 4, 6), "cams": (3, 3, 4)}, ",poses=cams", r"cams: expected poses, found no rotation in that of"),
    ({"depth": (3, 4, 6)}, ",poses=cams", r'b.npz: expected an array "cams", found depth'),
    ({"a": (3, 4, 6), "b": (1,)}, ",preset=mast3r", r'b.npz: expected an array "depth", found a, b'),
    ({"depth": (3, 4, 6)}, ",names={twice}", r"twice.txt: line 2: a stands twice"),
])
def test_what_is_wrong_is_named_by_file_and_array(tmp_path: Path, arrays: dict[str, Any], keys: str,
                                                  message: str) -> None:
    (tmp_path / "names.txt").write_text("a\nb\nc\n")
    (tmp_path / "twice.txt").write_text("a\na\n")
    stored: dict[str, Any] = {name: np.ones(shape, np.float32) for name, shape in arrays.items()}
    np.savez(tmp_path / "b.npz", **stored)
    keys = keys.format(names=tmp_path / "names.txt", twice=tmp_path / "twice.txt")
    with pytest.raises(raylift.InputError, match=message) as error:
        raylift.Geometry(f"depth:{tmp_path / 'b.npz'}{keys}", references=references())
    assert "\n" not in str(error.value)


def rows(pose: raylift.Rigid3) -> NDArray[np.float64]:
    return np.hstack([pose.rotation, pose.tvec[:, None]])


def of_a_network(images: list[raylift.PosedImage], scale: float) -> list[raylift.Rigid3]:
    """Poses of the images in a frame of its own, `scale` times as large: camera from frame."""
    frame_from_world = pose([0.4, -1, 0.2], [5, 1, 2])
    poses = []
    for image in images:
        cam_from_frame = image.cam_from_world @ frame_from_world.inverse()
        poses.append(raylift.Rigid3(cam_from_frame.rotation, scale * cam_from_frame.tvec))
    return poses


def points_in(depth: NDArray[np.float32], image: raylift.PosedImage, size: tuple[int, ...],
              cam_from_target: raylift.Rigid3 | None = None) -> NDArray[np.float32]:
    """Points of a map of the whole image, in its camera's axes or another frame."""
    fx, fy, cx, cy = image.camera.scaled(*size).params
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    points = np.stack([(x - cx) / fx * depth, (y - cy) / fy * depth, depth], axis=-1)
    if cam_from_target is not None:
        points = cam_from_target.inverse().transform(points.reshape(-1, 3)).reshape(points.shape)
        points[depth == 0] = 0
    return points.astype(np.float32)


def test_vggt_has_poses_of_another_scale(caster: raylift.RayCaster, tmp_path: Path) -> None:
    images = references(count=8)
    depth, resized = stack(caster, images, vggt_crop)
    poses = np.stack([np.float32(rows(p)) for p in of_a_network(images, 0.37)])
    np.savez(tmp_path / "predictions.npz", depth=0.37 * depth[..., None], depth_conf=depth + 1,
             extrinsic=poses, images=np.zeros((8, 3, 4, 4), np.float32), pose_enc=np.zeros((8, 9)))
    maps = expect_exact(caster, images, resized, tmp_path, preset="vggt")
    assert "8 maps of float32 518 x 392, z, layer depth, x 2.703 +- " in maps.interpretation
    assert "by 8 of its 8 poses" in maps.interpretation and maps.warnings == []
    # Points in the world of the poses are the same depth.
    points = np.stack([points_in(0.37 * d, image, resized, p)
                       for d, image, p in zip(depth, images, of_a_network(images, 0.37))])
    np.savez(tmp_path / "predictions.npz", world_points=points, extrinsic=poses)
    expect_exact(caster, images, resized, tmp_path, preset="vggt", layer="world_points", points="world")


def test_mapanything_writes_world_from_camera(caster: raylift.RayCaster, tmp_path: Path) -> None:
    images = references(count=8)
    depth, resized = stack(caster, images, mapanything)
    poses = np.stack([np.vstack([rows(p.inverse()), [0, 0, 0, 1]]) for p in of_a_network(images, 2)])
    mask = np.ones(depth.shape, bool)
    mask[:, :, :99] = False
    np.savez(tmp_path / "predictions.npz", depth=2 * depth[..., None], extrinsic=poses, final_mask=mask,
             conf=depth)
    assert "x 0.5 +- " in expect_exact(caster, images, resized, tmp_path, preset="mapanything").interpretation
    masked = raylift.DepthMaps(tmp_path, images, preset="mapanything", confidence="final_mask",
                               confidence_threshold=0.5).load(images[0])
    assert (some(masked)[:, :90] == 0).all() and (some(masked)[:, 110:] > 0).mean() > 0.5
    # Read the other way round they agree with nothing, and what they are is told.
    maps = raylift.DepthMaps(tmp_path, images, preset="mapanything", poses_are="cam_from_world")
    assert "extrinsic: the poses do not agree with those of the references" in maps.warnings[0]
    assert "as camera to world they do (poses_are=world_from_cam)" in maps.warnings[0]
    assert some(maps.load(images[0])).max() == pytest.approx(2 * depth[0].max(), rel=1e-5)


def test_points_of_mast3r_and_in_cameras(caster: raylift.RayCaster, tmp_path: Path) -> None:
    images = references(count=5)
    depth, resized = stack(caster, images, dust3r)
    own = [points_in(d, image, resized) for d, image in zip(depth, images)]
    world = [points_in(d, image, resized, image.cam_from_world) for d, image in zip(depth, images)]
    np.savez(tmp_path / "b.npz", camera=own, opengl=own * np.array([1, -1, -1], np.float32), pts3d=world)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["group/pts3d"] = np.asarray(world, np.float32)
        file["depth"] = np.asarray(depth, np.float16)
    for file, layer, frame in (("b.npz", "camera", "camera"), ("b.npz", "opengl", "opengl_camera"),
                               ("b.npz", "pts3d", "world"), ("b.h5", "group/pts3d", "world")):
        expect_exact(caster, images, resized, tmp_path / file, preset="mast3r", layer=layer, points=frame)
    # A wrong frame shows in the points themselves.
    for layer, frame, right in (("camera", "world", "camera"), ("opengl", "camera", "opengl_camera"),
                                ("pts3d", "camera", "world")):
        with pytest.raises(raylift.InputError, match=f"b.npz: {layer}: .* found those of points={right}"):
            raylift.DepthMaps(tmp_path / "b.npz", images, preset="mast3r", layer=layer, points=frame)
    halves = raylift.DepthMaps(tmp_path / "b.h5", images, preset="mast3r").load(images[0])
    assert halves == pytest.approx(depth[0], rel=1e-3)


def test_another_order_of_the_list_shows_in_the_poses(tmp_path: Path) -> None:
    images = [raylift.PosedImage(f"frame{i}.jpg", image.camera, image.cam_from_world)
              for i, image in enumerate(references(count=12))]
    np.savez(tmp_path / "results.npz", depth=np.ones((12, 42, 56), np.float32),
             extrinsics=np.stack([rows(p) for p in of_a_network(images, 3)]))
    maps = raylift.DepthMaps(tmp_path, images, preset="da3")
    assert "in the order of the numbers in their names they do (names=FILE lists it)" in maps.warnings[0]
    (tmp_path / "names.txt").write_text("\n".join(image.name for image in images))
    maps = raylift.DepthMaps(tmp_path, images, preset="da3", names=tmp_path / "names.txt")
    assert maps.warnings == [] and "x 0.3333 +- " in maps.interpretation


def write_reference_matches(caster: raylift.RayCaster, images: list[raylift.PosedImage],
                            folder: Path, per_pair: int = 60) -> None:
    """Files NAME__NAME.npy of pixels of one reference and of where another sees the same points."""
    rng = np.random.default_rng(0)
    lifter = raylift.Lifter(caster)
    folder.mkdir()
    for a, b in itertools.combinations(images, 2):
        pixels = rng.uniform([0, 0], [a.camera.width, a.camera.height], (600, 2))
        points = lifter.lift(a, pixels)["points"]
        seen = b.camera.project(b.cam_from_world.transform(points))
        with np.errstate(invalid="ignore"):
            good = np.asarray(((seen > 0) & (seen < [b.camera.width, b.camera.height])).all(axis=1))
            back = lifter.lift(b, np.where(good[:, None], seen, 1))["points"]
            good &= np.linalg.norm(back - points, axis=1) < 0.01  # nothing is in between
        rows = np.hstack([pixels[good], seen[good]])[:per_pair] - 0.5
        if len(rows) > 10:
            np.save(folder / f"{'__'.join(x.name.replace('/', '-') for x in (a, b))}.npy", rows)


def test_the_doctor_names_wrong_readings_of_a_bundle(caster: raylift.RayCaster,
                                                     tmp_path: Path) -> None:
    images = sorted(raylift.ColmapModel.read(DEMO / "model").posed_images, key=lambda image: image.name)
    depth = np.stack([caster.render(image.camera.scaled(160, 120), image.cam_from_world)["depth"]
                      for image in images])
    ray = np.stack([caster.render(image.camera.scaled(160, 120), image.cam_from_world, ["distance"])["distance"]
                    for image in images])
    write_reference_matches(caster, images, tmp_path / "pairs")
    with np.errstate(divide="ignore"):
        stored: dict[str, Any] = {
            "right": depth, "ray": ray, "inverse": np.where(depth > 0, 1 / depth, 0),
            "flipped": depth[:, ::-1], "millimeters": 1000 * depth}
    expected = {"right": "", "ray": "kind=ray", "inverse": "kind=inverse", "flipped": "orientation=flipped_y",
                "millimeters": "scale=0.001"}
    np.savez(tmp_path / "b.npz", **stored)
    for layer, key in expected.items():
        diagnosis = raylift.doctor(DEMO / "model", f"depth:{tmp_path / 'b.npz'},layer={layer}",
                                   matches=tmp_path / "pairs")
        assert diagnosis["verdict"] == ("repair" if key else "as_meant"), (layer, diagnosis["summary"])
        assert key in str(diagnosis["repair"]), (layer, diagnosis["repair"])


def test_localize_takes_the_scale_of_the_poses(caster: raylift.RayCaster, tmp_path: Path,
                                               capfd: pytest.CaptureFixture[str]) -> None:
    hloc = HlocScene(tmp_path / "hloc")
    images = sorted(raylift.ColmapModel.read(DEMO / "model").posed_images, key=lambda image: image.name)
    depth = np.stack([caster.render(image.camera.scaled(504, 378), image.cam_from_world)["depth"]
                      for image in images])
    np.savez(tmp_path / "results.npz", depth=0.37 * depth,
             extrinsics=np.stack([rows(p) for p in of_a_network(images, 0.37)]))
    raylift.localize(tmp_path / "out", model=DEMO / "model", geometry=f"depth:{tmp_path},preset=da3",
                     queries=hloc.query_list, features=hloc.features, matches=hloc.matches_file,
                     pairs=hloc.pairs, quiet=False)
    said = capfd.readouterr()
    assert f"read depth:{tmp_path},preset=da3 as 24 maps of float32 504 x 378, z, layer depth, x 2.703 +- " in said.out
    assert "poses" not in said.err
    for name, found in raylift.read_poses(tmp_path / "out/poses.txt").items():
        hloc.expect_near(name, found)
