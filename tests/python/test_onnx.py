"""raylift.onnx by small graphs whose answers are known exactly, made here as protobuf's bytes."""

import sys
from pathlib import Path
from typing import Any, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from raylift import _results
from scenes import DEMO, MESH, truth
from synthetic import some
from test_results import faults

FLOAT, UINT8, INT64 = 1, 2, 7
Value = tuple[str, int, Sequence[int | str]]
Constants = Sequence[tuple[str, NDArray[Any]]]


def field(number: int, value: int | str | bytes) -> bytes:
    """A field of a protobuf message: an integer, or bytes and text with their length."""
    def varint(n: int) -> bytes:
        out = b""
        while n > 127:
            out, n = out + bytes([n & 127 | 128]), n >> 7
        return out + bytes([n])

    if isinstance(value, int):
        return varint(number << 3) + varint(value % 2**64)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def ints(*numbers: int) -> NDArray[np.int64]:
    return np.array(numbers, np.int64)


def tensor(name: str, array: NDArray[Any]) -> bytes:
    kind = {np.dtype(np.float32): FLOAT, np.dtype(np.int64): INT64}[array.dtype]
    return b"".join(field(1, n) for n in array.shape) + field(2, kind) + field(8, name) + field(9, array.tobytes())


def value(name: str, kind: int, shape: Sequence[int | str]) -> bytes:
    dims = b"".join(field(1, field(1, n) if isinstance(n, int) else field(2, n)) for n in shape)
    return field(1, name) + field(2, field(1, field(1, kind) + field(2, dims)))


def node(kind: str, inputs: Sequence[str], output: str | list[str],
         **attributes: int | list[int]) -> bytes:
    outputs = [output] if isinstance(output, str) else output
    text = b"".join(field(1, name) for name in inputs) + b"".join(field(2, name) for name in outputs) + field(4, kind)
    for name, number in attributes.items():
        if isinstance(number, list):
            text += field(5, field(1, name) + b"".join(field(8, n) for n in number) + field(20, 7))
        else:
            text += field(5, field(1, name) + field(3, number) + field(20, 2))
    return text


def write_graph(file: Path, inputs: Sequence[Value], nodes: Sequence[bytes], outputs: Sequence[Value],
                constants: Constants = ()) -> Path:
    graph = b"".join(field(1, one) for one in nodes) + field(2, "g")
    graph += b"".join(field(5, tensor(*one)) for one in constants)
    graph += b"".join(field(11, value(*one)) for one in inputs) + b"".join(field(12, value(*one)) for one in outputs)
    file.write_bytes(field(1, 8) + field(8, field(2, 13)) + field(7, graph))
    return file


def bright(image: str, suffix: str = "") -> list[bytes]:
    """Nodes that find pixels brighter than a half: `keypoints` (x, y) and `rows` (0, 0, y, x)."""
    return [node("Greater", [image, "least"], "is_bright" + suffix), node("NonZero", ["is_bright" + suffix], "found" + suffix),
            node("Transpose", ["found" + suffix], "indices" + suffix, perm=[1, 0]),
            node("Cast", ["indices" + suffix], "rows" + suffix, to=FLOAT),
            node("Gather", ["rows" + suffix, "xy"], "keypoints" + suffix, axis=1)]


CONSTANTS: Constants = [("least", np.array([0.5], np.float32)), ("xy", ints(3, 2))]
SPOTS = np.array([[4, 8], [20, 12], [40, 24]])


def photograph(spots: NDArray[Any] = SPOTS, size: int = 4) -> NDArray[np.uint8]:
    image = np.zeros((48, 64, 3), np.uint8)
    for x, y in spots:
        image[y:y + size, x:x + size] = 255
    return image


def extractor_file(folder: Path, height: int | str = "h", width: int | str = "w",
                   channels: int = 1) -> Path:
    return write_graph(folder / f"extractor_{height}.onnx", [("image", FLOAT, [1, channels, height, width])],
                       bright("image") + [node("Identity", ["rows"], "descriptors")],
                       [("keypoints", FLOAT, ["n", 2]), ("descriptors", FLOAT, ["n", 4])], CONSTANTS)


def test_without_onnxruntime_the_error_says_what_to_install(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ImportError, match=r"pip install raylift\[onnx\]"):
        raylift.onnx.Extractor(tmp_path / "a.onnx")


@pytest.fixture(autouse=True)
def runtime(request: pytest.FixtureRequest) -> None:
    if "without_onnxruntime" not in request.node.name:
        pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: pip install raylift[onnx]")


def test_pixels_are_the_photographs(tmp_path: Path) -> None:
    found = raylift.onnx.Extractor(extractor_file(tmp_path))(photograph(size=1))
    assert list(faults(found, _results.GraphFeatures)) == []
    assert sorted(map(tuple, found["keypoints"])) == sorted(map(tuple, SPOTS))
    assert (found["descriptors"][:, [3, 2]] == found["keypoints"]).all() and found["image_size"].tolist() == [64, 48]


@pytest.mark.parametrize("options, graph_size, factor", [(dict(longer_side=32), ("h", "w"), (2, 2)),
                                                         (dict(), (24, 64), (1, 2)), (dict(), (12, 16), (4, 4))])
def test_photographs_are_resized_edge_to_edge(tmp_path: Path, options: Any, graph_size: Any,
                                              factor: Any) -> None:
    found = raylift.onnx.Extractor(extractor_file(tmp_path, *graph_size), **options)(photograph())
    # The spots (x, y) to (x + 4, y + 4) are of whole pixels of the smaller picture, whose centers are these.
    expected = [(x + (i + 0.5) * factor[0] - 0.5, y + (j + 0.5) * factor[1] - 0.5)
                for x, y in SPOTS for j in range(4 // factor[1]) for i in range(4 // factor[0])]
    assert sorted(map(tuple, found["keypoints"])) == sorted(expected)
    shifted = raylift.onnx.Extractor(extractor_file(tmp_path, *graph_size), first_pixel=0.5, **options)(photograph())
    assert shifted["keypoints"] == pytest.approx(found["keypoints"] - 0.5 * np.array(factor))


def test_resizing_keeps_straight_lines_and_means() -> None:
    ramp = np.repeat(np.arange(64, dtype=np.float64)[None, :, None], 48, axis=0)
    for width in 32, 20, 128:
        middle = raylift.onnx._resized(ramp, width, 48)[0, 4:-4, 0]
        assert middle == pytest.approx((np.arange(width) + 0.5)[4:-4] * 64 / width - 0.5, abs=0.05)


def test_a_matcher_of_features(tmp_path: Path) -> None:
    values: list[Value] = [(f"{name}{i}", FLOAT, [1, f"n{i}", columns])
                           for i in "01" for name, columns in (("kpts", 2), ("desc", 4))]
    file = write_graph(tmp_path / "matcher.onnx", values,
                       [node("Transpose", ["desc1"], "other", perm=[0, 2, 1]), node("MatMul", ["desc0", "other"], "alike"),
                        node("ArgMax", ["alike"], "matches0", axis=2, keepdims=0),
                        node("ReduceMax", ["alike"], "mscores0", axes=[2], keepdims=0),
                        node("Identity", ["kpts0"], "seen0"), node("Identity", ["kpts1"], "seen1")],
                       [("matches0", INT64, [1, "n"]), ("mscores0", FLOAT, [1, "n"]), ("seen0", FLOAT, [1, "n", 2]),
                        ("seen1", FLOAT, [1, "m", 2])])
    unit = np.eye(4, dtype=np.float32)
    size = np.array([64, 48])
    first = {"keypoints": SPOTS[[0, 1, 2]], "descriptors": unit[[2, 0, 1]], "image_size": size}
    second = {"keypoints": SPOTS[[0, 1, 2]] + 1, "descriptors": unit[:3], "image_size": size}
    found = raylift.onnx.Matcher(file)(first, second)
    assert found["matches"].dtype == np.int64 and found["scores"].dtype == np.float32
    assert found["matches"].reshape(-1).tolist() == [2, 0, 1] and found["scores"].tolist() == [1, 1, 1]
    centered = raylift.onnx.Matcher(file, centered_keypoints=True)
    assert centered._given(first) == pytest.approx((SPOTS + 0.5 - [32, 24]) / 32)
    with pytest.raises(raylift.InputError, match="expected features of both photographs, a dict, found ndarray"):
        centered(first, photograph())
    with pytest.raises(raylift.InputError, match="needs features with image_size"):
        centered({"keypoints": SPOTS, "descriptors": unit[:3]}, second)


def test_a_matcher_of_photographs_localizes(tmp_path: Path) -> None:
    file = write_graph(tmp_path / "matcher.onnx", [(f"image{i}", FLOAT, [1, 1, "h", "w"]) for i in "01"],
                       bright("image0", "0") + bright("image1", "1"),
                       [(f"keypoints{i}", FLOAT, ["n", 2]) for i in "01"], CONSTANTS)
    found = raylift.onnx.Matcher(file, longer_side=64)(photograph(size=1), photograph(SPOTS + [3, 5], size=1))
    assert (found["mkpts1"] - found["mkpts0"] == [3, 5]).all() and len(found["mkpts0"]) == 3
    from raylift._matching import matcher_of
    pixels = [tmp_path / f"{i}.png" for i in "01"]
    for image, name in zip((photograph(size=1), photograph(SPOTS + [3, 5], size=1)), pixels):
        write_png(name, image)
    [(query, reference, scores)] = matcher_of(raylift.onnx.Matcher(file))(("0", str(pixels[0])), [("1", str(pixels[1]))])
    assert (reference - query == [3, 5]).all() and scores is None


SCENE = np.random.default_rng(0).choice(np.arange(20, 236), (2, 300))


def blobs(height: int = 256, width: int = 256) -> NDArray[np.uint8]:
    """Bright pixels in the dark: 300 of (256, 256)."""
    image = np.zeros((height, width, 3), np.uint8)
    image[SCENE[1], SCENE[0]] = 255
    return image


def bright_pixels(first_pixel: float) -> Any:
    def extract(image: NDArray[np.uint8]) -> dict[str, Any]:
        y, x = np.nonzero(image[:, :, 0] > 127)
        return {"keypoints": np.stack([x, y], axis=1) + first_pixel, "descriptors": np.ones((len(x), 4))}
    return extract


@pytest.mark.parametrize("stated", [0, 0.5])
@pytest.mark.parametrize("is_at", [0, 0.5])
def test_doctor_tells_the_first_pixel_without_onnxruntime(is_at: float, stated: float) -> None:
    found = raylift.onnx.doctor(blobs(), extractor=bright_pixels(is_at), first_pixel=stated)
    assert (found["x"], found["y"], found["sigma"]) == (is_at, is_at, 0) and found["fits"] == is_at
    says = f"as stated: {stated:g}" if is_at == stated else f"not {stated:g} as stated: say first_pixel={is_at:g}"
    assert found["text"].startswith(f"the first pixel's center is ({is_at:.2f}, {is_at:.2f})") and says in found["text"]

    def match(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Places in the middle of the first picture, with noise, and in the second."""
        assert (second[0, :2] == first[64, 64]).all() and second.shape == first.shape
        rng = np.random.default_rng(1)
        places = rng.uniform(64, 192, (2000, 2))
        rows = np.hstack([places, 2 * (places - 64)]) - 0.5 + is_at
        return rows + rng.normal(0, 0.1, rows.shape)
    of_matches = raylift.onnx.doctor(blobs(), matcher=match, first_pixel=stated)
    assert of_matches["fits"] == is_at and says in of_matches["text"]
    # 2 x - x' has the noise of 0.1 sqrt(5), of which a median of 2000 has 1.25 / sqrt(2000).
    assert of_matches["sigma"] == pytest.approx(1.25 * 0.1 * 5**0.5 / 2000**0.5, rel=0.2)
    assert abs(of_matches["x"] - is_at) < 4 * of_matches["sigma"]


def test_doctor_says_what_fits_nothing_without_onnxruntime() -> None:
    found = raylift.onnx.doctor(blobs(), extractor=bright_pixels(-1.25))
    assert found["fits"] is None and found["x"] == -1.25
    assert found["text"].endswith("neither 0 as stated nor 0 or 0.5: are pixels brought to the photograph's size edge to edge?")
    with pytest.raises(raylift.InputError, match="expected 20 that are found again, found 0"):
        raylift.onnx.doctor(np.zeros((64, 64, 3), np.uint8), extractor=bright_pixels(0))
    with pytest.raises(raylift.InputError, match="expected an extractor or a matcher, found neither"):
        raylift.onnx.doctor(blobs())


@pytest.mark.parametrize("stated", [0, 0.5])
@pytest.mark.parametrize("is_at", [0, 0.5])
@pytest.mark.parametrize("size", ["h", 64])  # as the photograph, or a quarter of it
def test_doctor_tells_the_first_pixel_of_a_graph(tmp_path: Path, size: int | str, is_at: float, stated: float) -> None:
    # A spot of 4 x 4 pixels is one of the smaller picture.
    image = np.repeat(np.repeat(blobs()[::4, ::4], 4, axis=0), 4, axis=1) if size == 64 else blobs()
    nodes = [*bright("image"), node("Add", ["keypoints", "shift"], "kpts"), node("Identity", ["rows"], "descriptors")]
    file = write_graph(tmp_path / "of.onnx", [("image", FLOAT, [1, 1, size, "w" if size == "h" else size])], nodes,
                       [("kpts", FLOAT, ["n", 2]), ("descriptors", FLOAT, ["n", 4])],
                       [*CONSTANTS, ("shift", np.array([is_at], np.float32))])
    found = raylift.onnx.doctor(image, extractor=raylift.onnx.Extractor(file, first_pixel=stated))
    assert found["fits"] == is_at and found["stated"] == stated
    assert (found["x"], found["y"]) == pytest.approx((is_at, is_at))


def test_doctor_of_a_photograph_without_onnxruntime() -> None:
    cv2 = pytest.importorskip("cv2")
    image = raylift.read_image(next((DEMO / "images").rglob("*.jpg")))
    if hasattr(cv2, "AKAZE_create"):  # until OpenCV 4
        assert raylift.onnx.doctor(image, extractor=cv2.AKAZE_create())["fits"] == 0
    # OpenCV doubles a photograph from its first pixel's center on, and halves what is found there.
    of_sift = raylift.onnx.doctor(image, extractor=cv2.SIFT_create(2000))
    assert (of_sift["x"], of_sift["y"]) == pytest.approx((0.25, 0.25), abs=0.01) and of_sift["sigma"] < 0.01
    assert of_sift["fits"] is None and "first_pixel=0.25 fits better" in of_sift["text"]


def write_png(file: Path, image: NDArray[np.uint8]) -> None:
    import struct
    import zlib

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = image.shape[:2]
    rows = b"".join(b"\0" + row.tobytes() for row in image)
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
                     chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def test_global_descriptors_retrieve(tmp_path: Path) -> None:
    file = write_graph(tmp_path / "global.onnx", [("pixels", UINT8, [1, 3, "h", "w"])],
                       [node("Cast", ["pixels"], "floats", to=FLOAT),
                        node("ReduceMean", ["floats"], "mean", axes=[2, 3], keepdims=0)], [("mean", FLOAT, [1, 3])])
    describe = raylift.onnx.GlobalDescriptor(file)
    files = {}
    for name, color in dict(red=(200, 10, 0), pink=(200, 90, 90), blue=(0, 20, 200)).items():
        files[name] = tmp_path / f"{name}.png"
        write_png(files[name], np.full((8, 10, 3), color, np.uint8))
    assert describe(np.full((8, 10, 3), (30, 40, 0), np.uint8)) == pytest.approx([0.6, 0.8, 0])
    scene = raylift.Scene.of([raylift.PosedImage(f"{name}.png", "PINHOLE 10 8 9 9 5 4", (np.eye(3), np.zeros(3)))
                              for name in ("red", "blue")], images=tmp_path)
    localizer = raylift.Localizer(scene, retrieval=describe)
    references = localizer.localize(files["pink"], "PINHOLE 10 8 9 9 5 4").problem.references
    assert [image.name for image in references] == ["red.png", "blue.png"]
    assert describe.retrieve(files, files, top_k=2) == {"red": ["pink", "blue"], "pink": ["red", "blue"],
                                                        "blue": ["pink", "red"]}


def test_wrong_files_and_roles_are_input_errors(tmp_path: Path) -> None:
    file = extractor_file(tmp_path)
    (tmp_path / "bad.onnx").write_bytes(b"no graph")
    older = ("[ONNXRuntimeError] : 1 : FAIL : Load model from a.onnx failed:/onnxruntime_src/graph/model.cc:166 "
             "onnxruntime::Model::Model(onnx::ModelProto&&, const onnxruntime::PathString&) It has no graph.")
    assert raylift.onnx._said(RuntimeError(older)) == ("[ONNXRuntimeError] : 1 : FAIL : Load model from a.onnx failed: "
                                                       "It has no graph.")
    with pytest.raises(raylift.InputError, match="nowhere.onnx: no such file"):
        raylift.onnx.Extractor(tmp_path / "nowhere.onnx")
    with pytest.raises(raylift.InputError, match="bad.onnx: "):
        raylift.onnx.Extractor(tmp_path / "bad.onnx")
    with pytest.raises(raylift.InputError, match="roles, keypoints: there is no tensor kp; there are image, keypoints"):
        raylift.onnx.Extractor(file, roles={"keypoints": "kp"})
    with pytest.raises(raylift.OptionError, match="first_pixel = 2: must lie between 0 and 1"):
        raylift.onnx.Extractor(file, first_pixel=2)
    wrong: dict[str, Any]
    for wrong, message in (({"threads": None}, "threads: expected an int, found NoneType"),
                           ({"threads": 2**70}, r"threads = 1180591620717411303424: must be below 2\^31"),
                           ({"longer_side": "32"}, "longer_side: expected an int, found str"),
                           ({"first_pixel": "0"}, "first_pixel: expected a float, found str")):
        with pytest.raises((raylift.InputError, raylift.OptionError), match=message):
            raylift.onnx.Extractor(file, **wrong)
    with pytest.raises(raylift.InputError, match="expected a tensor of image0"):
        raylift.onnx.Matcher(file)(photograph(), photograph())
    with pytest.raises(raylift.InputError, match="image: expected a uint8 array"):
        raylift.onnx.Extractor(file)(np.zeros((4, 4)))  # type: ignore[arg-type]


def upright_sift(file: Path, height: int, width: int, count: int = 1500) -> Path:
    """Corners (Harris) and upright histograms of gradients around them, as SIFT's, at one scale."""
    y, x = np.mgrid[-6:7, -6:7].astype(np.float32)

    def gaussian(sigma: float) -> Any:
        weights = np.exp(-(x**2 + y**2) / (2 * sigma**2))
        return weights / weights.sum()

    narrow = gaussian(1.0)
    slopes = np.stack([-x * narrow, -y * narrow])[:, None]  # d/dx, d/dy of the blurred picture
    angles = np.arange(8) * np.pi / 4
    directions = np.stack([np.cos(angles), np.sin(angles)], 1).astype(np.float32)[:, :, None, None]
    inside = np.zeros((1, 1, height, width), np.float32)
    inside[..., 16:-16, 16:-16] = 1
    cells = np.array([-9, -3, 3, 9])
    offsets = (cells[:, None] * width + cells).reshape(-1)
    constants = [("slopes", slopes), ("directions", directions),
                 ("blur", gaussian(2.0)[None, None]), ("pool", np.repeat(gaussian(3.0)[None, None], 8, axis=0)),
                 ("inside", inside), ("count", ints(count)), ("plane", ints(8, -1)), ("flat", ints(-1)),
                 ("offsets", offsets[None]), ("row", ints(-1, 1)), ("width", ints(width)),
                 ("columns", ints(count, 128)), ("few", np.array([0.04], np.float32)),
                 ("tiny", np.array([1e-9], np.float32)),
                 ("x", ints(0)), ("y", ints(1))]
    same = [6, 6, 6, 6]
    nodes = [
        node("Conv", ["image", "slopes"], "gradient", pads=same), node("Split", ["gradient"], ["gx", "gy"], axis=1),
        node("Mul", ["gx", "gx"], "gxx"), node("Mul", ["gx", "gy"], "gxy"), node("Mul", ["gy", "gy"], "gyy"),
        *(node("Conv", ["g" + of, "blur"], "s" + of, pads=same) for of in ("xx", "xy", "yy")),
        node("Mul", ["sxx", "syy"], "product"), node("Mul", ["sxy", "sxy"], "mixed"), node("Sub", ["product", "mixed"], "det"),
        node("Add", ["sxx", "syy"], "trace"), node("Mul", ["trace", "trace"], "trace2"), node("Mul", ["trace2", "few"], "edge"),
        node("Sub", ["det", "edge"], "corner"),
        node("MaxPool", ["corner"], "largest", kernel_shape=[7, 7], strides=[1, 1], pads=[3, 3, 3, 3]),
        node("GreaterOrEqual", ["corner", "largest"], "is_peak"), node("Cast", ["is_peak"], "peak", to=FLOAT),
        node("Mul", ["corner", "peak"], "peaks"), node("Mul", ["peaks", "inside"], "kept"), node("Reshape", ["kept", "flat"], "list"),
        node("TopK", ["list", "count"], ["scores", "places"]),
        node("Div", ["places", "width"], "rows"), node("Mul", ["rows", "width"], "starts"), node("Sub", ["places", "starts"], "columns_of"),
        node("Cast", ["columns_of"], "u", to=FLOAT), node("Cast", ["rows"], "v", to=FLOAT),
        node("Unsqueeze", ["u", "y"], "u1"), node("Unsqueeze", ["v", "y"], "v1"), node("Concat", ["u1", "v1"], "keypoints", axis=1),
        node("Conv", ["gradient", "directions"], "along"), node("Relu", ["along"], "strength"),
        node("Conv", ["strength", "pool"], "pooled", pads=same, group=8), node("Reshape", ["pooled", "plane"], "histograms"),
        node("Unsqueeze", ["places", "y"], "centers"), node("Add", ["centers", "offsets"], "cells"),
        node("Gather", ["histograms", "cells"], "by_direction", axis=1), node("Transpose", ["by_direction"], "by_point", perm=[1, 2, 0]),
        node("Reshape", ["by_point", "columns"], "numbers"), node("ReduceSum", ["numbers", "y"], "sum", keepdims=1),
        node("Add", ["sum", "tiny"], "total"), node("Div", ["numbers", "total"], "shares"), node("Sqrt", ["shares"], "descriptors")]
    return write_graph(file, [("image", FLOAT, [1, 1, height, width])], nodes,
                       [("keypoints", FLOAT, [count, 2]), ("descriptors", FLOAT, [count, 128]), ("scores", FLOAT, [count])],
                       constants)


def test_a_made_extractor_localizes_the_demo(tmp_path: Path) -> None:
    scene = raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images")
    extractor = raylift.onnx.Extractor(upright_sift(tmp_path / "made.onnx", 480, 640))
    localizer = raylift.Localizer(scene, extractor=extractor, extractor_name="upright-sift")
    near = 0
    for name, camera in raylift.read_queries(DEMO / "queries.txt"):
        found = localizer.localize(DEMO / "images" / name, camera, name=name)
        pose = truth()[name].cam_from_world
        near += bool(found) and bool(np.linalg.norm(some(found.cam_from_world).center - pose.center) < 0.1)
    assert near >= 9
