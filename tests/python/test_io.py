import copy
import pickle
import struct
import zlib
from pathlib import Path
from typing import Any, Callable

import numpy as np
import pytest

import raylift
from synthetic import CAMERA, pose
from test_rendering import DEMO


def small_model() -> raylift.ColmapModel:
    model = raylift.ColmapModel()
    model.add_camera(3, CAMERA)
    model.add_image(5, "b.jpg", 3, pose([0.1, 0, 0], [1, 2, 3]), [[1.5, 2.5], [3.0, 4.0]], [9, -1])
    model.add_image(6, "a.jpg", 3, np.eye(4), [[7, 8]], [9])
    model.add_point3d(9, [1, 2, 3], [[5, 0], [6, 0]], (10, 20, 30), 0.25)
    return model


@pytest.mark.parametrize("form", ["text", "binary"])
def test_models_round_trip(tmp_path: Path, form: str) -> None:
    model = small_model()
    model.write(tmp_path / form, form)
    assert (tmp_path / form / ("images.txt" if form == "text" else "images.bin")).exists()
    read = raylift.ColmapModel.read(tmp_path / form)
    assert read.cameras == {3: CAMERA} and read.image_ids == [5, 6]
    image = read.image(5)
    assert image["name"] == "b.jpg" and image["camera_id"] == 3
    assert image["points2d"].tolist() == [[1.5, 2.5], [3.0, 4.0]]
    assert image["point3d_ids"].tolist() == [9, -1]
    assert image["cam_from_world"].center == pytest.approx([1, 2, 3])
    points = read.points3d
    assert points["ids"].tolist() == [9] and points["positions"].tolist() == [[1, 2, 3]]
    assert points["colors"].tolist() == [[10, 20, 30]] and points["errors_px"].tolist() == [0.25]
    assert points["track_lengths"].tolist() == [2]
    assert read.track(9).tolist() == [[5, 0], [6, 0]]
    assert [image.name for image in read.posed_images] == ["a.jpg", "b.jpg"]
    assert "2 images" in repr(read) and read.warnings == []
    for wrong in (lambda: read.image(1), lambda: read.track(1), lambda: read.add_image(1, "c", 1, np.eye(4))):
        with pytest.raises(raylift.InputError, match="no (image|point|camera) 1"):
            wrong()
    with pytest.raises(raylift.OptionError, match="form"):
        read.write(tmp_path, "xml")
    with pytest.raises(raylift.InputError, match="nowhere"):
        raylift.ColmapModel.read(tmp_path / "nowhere")


@pytest.mark.parametrize("add, message", [
    (lambda m: m.add_image(7, "a.jpg", 3, np.eye(4)), "image 6 has the name a.jpg, too"),
    (lambda m: m.add_image(5, "c.jpg", 3, np.eye(4)), "image 5: the model has one already"),
    (lambda m: m.add_camera(3, CAMERA), "camera 3: the model has one already"),
    (lambda m: m.add_image(7, "c.jpg", 3, np.eye(4), [[np.nan, 1]]), "points2d, row 0: expected finite"),
    (lambda m: m.add_point3d(9, [0, 0, 1], []), "point 9: the model has one already"),
    (lambda m: m.add_point3d(1, [0, 0, np.nan], []), "point 1, position: expected finite"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [[8, 0]]), "point 1, track: the model has no image 8"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [[-1, 0]]), "has no image -1"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [[5, 2]]), "image 5 has 2 keypoints, and none of index 2"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [[5, 0]]), "keypoint 0 of image 5 observes point 9 already"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [], (300, 0, 0)), "color: expected integers from 0 to 255, found 300"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [], (0, -1, 0)), "color: expected integers from 0 to 255, found -1"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [], (1.0, 0.5, 0)), "color: expected integers from 0 to 255, found floats up to 1"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [], (1, 2)), r"color: expected 3 integers from 0 to 255, found \(2,\)"),
    (lambda m: m.add_point3d(1, [0, 0, 1], [], "red"), "color: expected 3 integers from 0 to 255, found str"),
])
def test_what_no_reader_takes_is_refused_when_added(tmp_path: Path, add: Callable[..., Any],
                                                    message: str) -> None:
    model = small_model()
    with pytest.raises(raylift.InputError, match=message):
        add(model)
    model.write(tmp_path)
    assert raylift.ColmapModel.read(tmp_path).points3d["ids"].tolist() == [9]


def test_keypoints_and_tracks_agree(tmp_path: Path) -> None:
    model = small_model()
    model.add_point3d(4, [0, 0, 1], [[5, 1]])
    assert model.image(5)["point3d_ids"].tolist() == [9, 4]
    model.add_image(7, "c.jpg", 3, np.eye(4), [[1, 1]], [77])
    with pytest.raises(raylift.InputError, match="image 7: keypoint 0 observes point 77"):
        model.write(tmp_path / "model")


def test_models_pickle_copy_and_compare() -> None:
    model = small_model()
    model.add_image(7, "c.jpg", 3, np.eye(4), [[1, 1]], [77])  # of a point that is not there yet
    for again in pickle.loads(pickle.dumps(model)), copy.copy(model), copy.deepcopy(model):
        assert again == model and again is not model and repr(again) == repr(model)
        assert again.cameras == model.cameras and again.image_ids == model.image_ids
        assert again.image(7)["point3d_ids"].tolist() == [77] and again.track(9).tolist() == [[5, 0], [6, 0]]
        for key, values in again.points3d.items():
            assert np.array_equal(values, model.points3d[key])  # type: ignore[arg-type, literal-required]
        again.add_camera(8, CAMERA)
        assert again != model and 8 not in model.cameras
    assert raylift.ColmapModel() == raylift.ColmapModel() != model != 5


@pytest.mark.parametrize("name", ["a.exr", "a.npy", "a.npz", "a.tiff", "a.pfm", "a.bin", "a.png"])
def test_depth_round_trips(tmp_path: Path, name: str) -> None:
    depth = np.random.default_rng(0).uniform(0.5, 9, (6, 8)).astype(np.float32)
    report = raylift.write_depth(tmp_path / name, depth, exr_compression="zip")
    assert report["bytes"] == (tmp_path / name).stat().st_size and report["dropped"] == 0
    read = raylift.read_depth(tmp_path / name)
    if name == "a.png":  # in counts of 0.001
        assert read == pytest.approx(1000 * depth, abs=0.51)
        assert report["max_rounding"] <= 0.00051
    else:
        assert (read == depth).all()
    strided = np.zeros((6, 16), np.float64)
    strided[:, ::2] = depth
    raylift.write_depth(tmp_path / name, strided[:, ::2], exr_compression="zip")
    assert (raylift.read_depth(tmp_path / name) == read).all()


def test_depth_files_of_others(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(6, dtype=np.uint16).reshape(2, 3))
    assert raylift.read_depth(tmp_path / "a.npy").tolist() == [[0, 1, 2], [3, 4, 5]]
    np.arange(6, dtype=np.float32).tofile(tmp_path / "a.depth")
    assert raylift.read_depth(tmp_path / "a.depth", raw_size=(3, 2)).tolist() == [[0, 1, 2], [3, 4, 5]]
    np.savez(tmp_path / "a.npz", x=np.ones((2, 2)), y=np.zeros((2, 2)))
    assert raylift.read_depth(tmp_path / "a.npz", layer="x").tolist() == [[1, 1], [1, 1]]
    raylift.write_depth(tmp_path / "half.npy", np.full((2, 2), 1.5), sample="half")
    assert np.load(tmp_path / "half.npy").dtype == np.float16
    with pytest.raises(raylift.InputError, match="a.txt"):
        (tmp_path / "a.txt").write_text("no depth")
        raylift.read_depth(tmp_path / "a.txt")
    with pytest.raises(raylift.InputError, match=r"depth: expected an array of shape \(height, width\)"):
        raylift.write_depth(tmp_path / "b.npy", np.zeros(3))
    with pytest.raises(raylift.InputError):
        raylift.write_depth(tmp_path / "b.png", np.full((2, 2), 1e6))
    assert raylift.write_depth(tmp_path / "b.png", np.full((2, 2), 1e6), out_of_range="drop")["dropped"] == 4


def test_poses_and_queries_round_trip(tmp_path: Path) -> None:
    poses: dict[str, Any] = {"z.jpg": pose([0.1, 0.2, 0.3], [1, 2, 3]), "a b.jpg".replace(" ", "_"): np.eye(4)}
    raylift.write_poses(tmp_path / "poses.txt", poses)
    read = raylift.read_poses(str(tmp_path / "poses.txt"))
    assert list(read) == ["z.jpg", "a_b.jpg"]
    assert read["z.jpg"].matrix.tolist() == poses["z.jpg"].matrix.tolist()
    queries: list[tuple[str, Any]] = [("z.jpg", CAMERA), ("a.jpg", "PINHOLE 4 3 1 1 2 1.5")]
    raylift.write_queries(tmp_path / "queries.txt", queries)
    first, second = raylift.read_queries(tmp_path / "queries.txt")
    assert first == ("z.jpg", CAMERA) and second[1].model == "PINHOLE"
    (tmp_path / "poses.txt").write_text("a.jpg 1 0 0 0 1 2\n")
    with pytest.raises(raylift.InputError, match="poses.txt: line 1"):
        raylift.read_poses(tmp_path / "poses.txt")


def test_photographs(tmp_path: Path) -> None:
    image = raylift.read_image(DEMO / "images/query/query_05.jpg")
    assert image.shape == (640, 480, 3) and image.dtype == np.uint8
    with pytest.raises(raylift.InputError, match="missing.jpg"):
        raylift.read_image(tmp_path / "missing.jpg")


def tiled_tiff(side: int, tile: int) -> bytes:
    """A picture of side^2 gray pixels, all 7, in one tile of tile^2."""
    packer = zlib.compressobj(1)
    row = b"\7" * tile
    data = b"".join([packer.compress(row) for _ in range(tile)]) + packer.flush()
    tags = [(256, side), (257, side), (258, 8), (259, 8), (262, 1), (277, 1), (322, tile), (323, tile), (324, 8),
            (325, len(data))]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return struct.pack("<2sHI", b"II", 42, 8 + len(data)) + data + struct.pack("<H", len(tags)) + entries + b"\0" * 4


def test_tiles_far_larger_than_their_picture_are_refused(tmp_path: Path) -> None:
    (tmp_path / "usual.tif").write_bytes(tiled_tiff(10, 1024))
    assert (raylift.read_image(tmp_path / "usual.tif") == 7).all()
    (tmp_path / "large.tif").write_bytes(tiled_tiff(10, 16384))  # 256 MB
    with pytest.raises(raylift.InputError, match="large.tif"):
        raylift.read_image(tmp_path / "large.tif")
