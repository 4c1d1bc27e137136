"""Extractors and matchers of one's own."""
import functools
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from scenes import DEMO, MESH, truth
from synthetic import some

cv2 = pytest.importorskip("cv2")
NAME = "query/query_02.jpg"
FILE = DEMO / "images" / NAME


def open_scene(every: int = 4) -> raylift.Scene:
    return raylift.Scene(DEMO / "model", [MESH], images=DEMO / "images", every=every)


def camera() -> raylift.Camera:
    return {query.name: query.camera for query in raylift.read_queries(DEMO / "queries.txt")}[NAME]


def error_of(query: raylift.LocalizedQuery) -> float:
    assert query, query
    return float(np.linalg.norm(some(query.cam_from_world).center - truth()[NAME].cam_from_world.center))


def expect_right(query: raylift.LocalizedQuery) -> None:
    assert error_of(query) < 0.1 and query.verdict == "localized"


@functools.lru_cache(maxsize=None)
def sift(pixels: bytes, shape: tuple[int, ...]) -> Any:
    return cv2.SIFT_create(1000).detectAndCompute(np.frombuffer(pixels, np.uint8).reshape(shape), None)


def sift_pixels(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float64]:
    """A matcher of photographs: rows (N, 4), where the first pixel's center is (0, 0)."""
    (k0, d0), (k1, d1) = (sift(image.tobytes(), image.shape) for image in (first, second))
    found = cv2.BFMatcher(crossCheck=True).match(d0, d1)
    return np.array([k0[m.queryIdx].pt + k1[m.trainIdx].pt for m in found]).reshape(-1, 4)


@pytest.mark.parametrize("extractor, matcher, every", [
    (cv2.SIFT_create(1000), None, 4),
    (cv2.SIFT_create(1000), cv2.BFMatcher(), 4),
    (cv2.ORB_create(3000), cv2.BFMatcher(cv2.NORM_HAMMING), 3),
    (None, sift_pixels, 4),
])
def test_opencv_localizes_the_demo(
        extractor: Any, matcher: Any,
        every: int) -> None:
    localizer = raylift.Localizer(open_scene(every), extractor=extractor, matcher=matcher, max_features=500)
    of_file = localizer.localize(FILE, camera(), name=NAME)
    expect_right(of_file)
    of_list = localizer.localize_all([(NAME, camera())], threads=2)[NAME]
    assert some(of_list.cam_from_world).matrix.tolist() == some(of_file.cam_from_world).matrix.tolist()


def test_pixels_are_told_by_first_pixel() -> None:
    def found(first_pixel: float) -> raylift.PoseProblem:
        localizer = raylift.Localizer(open_scene(12), matcher=lambda a, b: [[3, 4, 5, 6]] * 3, max_features=500,
                                      first_pixel=first_pixel)
        return localizer.localize(FILE, camera()).problem
    assert np.array_equal(np.unique(found(0).query2d, axis=0), [[3.5, 4.5]])
    assert np.array_equal(np.unique(found(0.5).reference2d, axis=0), [[5, 6]])
    # Equal pixels are one keypoint.
    assert len(set(found(0).query_keypoints)) == 1

    def corner(image: NDArray[np.uint8]) -> dict[str, list[list[float]] | list[list[int]]]:
        return {"keypoints": [[10, 20]], "descriptors": [[1.0, 0, 0]]}
    problem = raylift.Localizer(open_scene(12), extractor=corner).localize(FILE, camera()).problem
    assert np.unique(problem.query2d, axis=0).tolist() == [[10.5, 20.5]]


FIRST, SECOND = np.array([[1.0, 2], [30, 40], [50, 60]]), np.array([[7.0, 8], [9, 10]])
ROWS = [[30, 40, 7, 8], [50, 60, 9, 10]]


class Tensor:
    """What is known of torch's tensors."""

    def __init__(self, array: NDArray[np.float64] | list[Any]) -> None:
        self.array = np.asarray(array)

    def detach(self) -> "Tensor":
        return self

    cpu = detach

    def __array__(self, *args: object, **kwargs: Any) -> NDArray[Any]:
        return self.array


class Match:
    def __init__(self, query: int, train: int) -> None:
        self.queryIdx, self.trainIdx = query, train


@pytest.mark.parametrize("result", [
    ROWS,
    np.array(ROWS, np.float32),
    [row + [0.5] for row in ROWS],
    (FIRST[1:], SECOND),
    (Tensor(FIRST[1:]), Tensor(SECOND), [0.1, 0.2]),
    {"mkpts0": FIRST[1:], "mkpts1": SECOND, "mconf": [1, 1]},
    {"matched_kpts0": FIRST[1:], "matched_kpts1": SECOND, "num_inliers": 2},
    {"inlier_kpts0": FIRST[1:], "inlier_kpts1": SECOND},
    {"keypoints0": FIRST, "keypoints1": SECOND, "matches0": [-1, 0, 1], "matching_scores0": [0, 1, 1]},
    {"keypoints0": Tensor(FIRST[None]), "keypoints1": Tensor(SECOND[None]), "matches": [Tensor([[1, 0], [2, 1]])]},
])
def test_forms_of_matches(result: Any) -> None:
    localizer = raylift.Localizer(open_scene(12), matcher=lambda a, b: result, max_features=500)
    problem = localizer.localize(FILE, camera()).problem
    first = problem.reference_index == 0
    assert (np.hstack([problem.query2d, problem.reference2d])[first] - 0.5).tolist() == ROWS


@pytest.mark.parametrize("result", [
    [[1, 0], [2, 1]],
    {"matches0": [-1, 0, 1]},
    {"matches0": Tensor([[-1, 0, 1]]), "matching_scores0": Tensor([[0, 1, 1]])},
    {"matches": [Tensor([[1, 0], [2, 1]])], "scores": [Tensor([1, 1])]},
    [Match(1, 0), Match(2, 1)],
    ROWS,
])
def test_forms_of_matches_of_an_extractor(result: dict[str, Any] | list[Any]) -> None:
    asked = []

    def match(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any] | list[Any] | None:
        if len(first["keypoints"]) != len(FIRST):
            return None  # references, of which the scene's noise is learned
        asked.append((first, second))
        return result

    photograph = raylift.read_image(FILE)

    def extract(image: NDArray[np.uint8]) -> dict[str, NDArray[np.float64] | int]:
        return {"keypoints": FIRST if np.array_equal(image, photograph) else SECOND, "mine": 1}
    localizer = raylift.Localizer(open_scene(12), max_features=500, matcher=match, extractor=extract)
    problem = localizer.localize(FILE, camera()).problem
    first = problem.reference_index == 0
    assert (np.hstack([problem.query2d, problem.reference2d])[first] - 0.5).tolist() == ROWS
    assert asked[0][0]["mine"] == 1


@pytest.mark.parametrize("options, message", [
    (dict(matcher=5), "matcher: expected a callable"),
    (dict(extractor="sift"), "extractor: expected a callable"),
    (dict(matcher=cv2.BFMatcher()), "with an extractor"),
    (dict(matcher=types.SimpleNamespace(match_batch=lambda query, references: [])),
     "expected the matches with .* references, found 0"),
    (dict(retrieval=5), "retrieval: expected a callable, found a int"),
    (dict(retrieval=lambda image: [0, 0]), "retrieval: expected a vector"),
    (dict(retrieval=lambda image: [1] * int(image.sum() % 97 + 1)), "retrieval: expected vectors of one size"),
    (dict(matcher=lambda a, b: 3), "matcher: expected rows"),
    (dict(matcher=lambda a, b: [[1, 2, 3]]), r"matcher: expected rows \(N, 4\).*\(1, 3\)"),
    (dict(matcher=lambda a, b: {"a": 1}), "matcher: expected .*found the keys a"),
    (dict(matcher=lambda a, b: (FIRST, SECOND)), "found 3, 2"),
    (dict(matcher=lambda a, b: {"matches0": [0]}), "matcher: expected"),
    (dict(matcher=lambda a, b: {"keypoints0": FIRST, "keypoints1": SECOND, "matches0": [2, 0, 1]}),
     "names a keypoint of the reference"),
    (dict(matcher=lambda a, b: np.full((9, 4), 5000.0)), "the matcher: 9 of 9 matches lie outside"),
    (dict(extractor=lambda image: 5), "extractor: expected a dict"),
    (dict(extractor=lambda image: (FIRST, SECOND)), r"descriptors \(3, D\)"),
    (dict(extractor=lambda image: {"keypoints": FIRST}), "extractor: expected descriptors"),
    (dict(extractor=cv2.ORB_create()), "uint8 ones, such as ORB's"),
])
def test_what_is_no_matcher(options: dict[str, Any], message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        raylift.Localizer(open_scene(12), max_features=500, **options).localize(FILE, camera())


def test_binary_descriptors_in_memory_are_refused() -> None:
    features = {"keypoints": FIRST, "descriptors": np.zeros((3, 32), np.uint8)}
    with pytest.raises(raylift.InputError, match="uint8"):
        raylift.Localizer(open_scene(12), max_features=500).localize(features, camera())


@pytest.mark.parametrize("what", ["extractor", "matcher"])
def test_errors_of_ones_own_are_ones_own(what: str) -> None:
    def fails(*photographs: NDArray[np.uint8]) -> None:
        raise RuntimeError("no GPU")
    own: dict[str, Any] = {what: fails}
    localizer = raylift.Localizer(open_scene(12), max_features=500, **own)
    with pytest.raises(RuntimeError, match="no GPU"):
        localizer.localize(FILE, camera())
    with pytest.raises(RuntimeError, match="no GPU"):
        localizer.localize_all([(NAME, camera())])


def test_features_of_ones_own_are_cached_by_name(tmp_path: Path) -> None:
    calls = []

    def extract(image: NDArray[np.uint8]) -> Any:
        calls.append(image.shape)
        return cv2.SIFT_create(1000).detectAndCompute(image, None)

    def localize(**options: Any) -> raylift.LocalizedQuery:
        calls.clear()
        return raylift.Localizer(open_scene(), extractor=extract, cache=tmp_path / "cache",
                                 **options).localize(FILE, camera())
    with pytest.raises(raylift.OptionError, match="extractor_name"):
        localize()
    first = localize(extractor_name="sift-1000")
    assert len(calls) == 1 + len(open_scene().references)
    again = localize(extractor_name="sift-1000")
    assert again.cam_from_world == first.cam_from_world is not None
    assert len(calls) == 1
    localize(extractor_name="other")
    assert len(calls) > 1


def test_files_and_own_matchers_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(raylift.OptionError, match="an extractor or matcher makes matches"):
        raylift.Localizer(open_scene(), matcher=sift_pixels, matches=tmp_path)


def test_a_matcher_of_batches_is_called_once_for_a_query() -> None:
    batches: list[int] = []

    class Batches:
        def match_batch(self, query: Any, references: list[Any]) -> list[Any]:
            batches.append(len(references))
            return [sift_pixels(query, reference) for reference in references]
    scene = open_scene()
    one_by_one = raylift.Localizer(scene, matcher=sift_pixels, max_features=500).localize(FILE, camera(), name=NAME)
    in_batches = raylift.Localizer(scene, matcher=Batches(), max_features=500).localize(FILE, camera(), name=NAME)
    assert in_batches.cam_from_world == one_by_one.cam_from_world is not None
    # One of the query, and one of each reference that the scene's noise is learned of.
    assert len(batches) == 1 + len(scene.references) and min(batches) > 1


def test_matches_of_ones_own_are_kept_as_hlocs(tmp_path: Path) -> None:
    calls: list[int] = []

    def match(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float64]:
        calls.append(1)
        return sift_pixels(first, second) + first_pixel

    def localize(**options: Any) -> raylift.LocalizedQuery:
        calls.clear()
        localizer = raylift.Localizer(open_scene(), matcher=match, cache=tmp_path / "cache", max_features=500,
                                      first_pixel=first_pixel, **options)
        return localizer.localize_all([(NAME, camera())])[NAME]
    first_pixel = 0.0
    first = localize(matcher_name="sift")
    made = len(calls)
    assert made > 10 and some(first.cam_from_world)
    again = localize(matcher_name="sift")
    assert calls == [] and again.cam_from_world == first.cam_from_world
    assert again.problem.query2d.tolist() == first.problem.query2d.tolist()
    localize(matcher_name="other")
    assert len(calls) == made
    localize()
    assert len(calls) == made
    # In the file they count from (0, 0), so those that are understood otherwise are made anew.
    first_pixel = 0.5
    assert localize(matcher_name="sift").problem.query2d == pytest.approx(first.problem.query2d, abs=1e-4)
    assert len(calls) == made
    with pytest.raises(raylift.OptionError, match="matcher_name = a/b: must be part of a file's name"):
        localize(matcher_name="a/b")

    # As hloc.match_dense writes them, names_to_pair() of hloc/utils/parsers.py.
    h5py = pytest.importorskip("h5py")
    reference = first.problem.references[0].name
    rows = sift_pixels(raylift.read_image(FILE), raylift.read_image(DEMO / "images" / reference))
    with h5py.File(tmp_path / "cache/matches-sift.h5") as file:
        pair = file["/".join(name.replace("/", "-") for name in (NAME, reference))]
        assert pair["keypoints0"][()] == pytest.approx(rows[:, :2], abs=1e-4)
        assert pair["keypoints1"][()] == pytest.approx(rows[:, 2:], abs=1e-4)
        assert (pair["scores"][()] == 1).all() and len(pair["scores"]) == len(rows)


def test_a_file_that_is_no_cache_is_named(tmp_path: Path) -> None:
    (tmp_path / "matches-sift.h5").write_bytes(b"cut off")
    localizer = raylift.Localizer(open_scene(12), matcher=sift_pixels, cache=tmp_path, matcher_name="sift",
                                  max_features=500)
    with pytest.raises(raylift.InputError, match="matches-sift.h5: expected matches in HDF5"):
        localizer.localize_all([(NAME, camera())])


def test_kept_matches_are_those_of_the_photographs_as_they_are(tmp_path: Path) -> None:
    calls: list[str] = []

    def match(*photographs: NDArray[np.uint8]) -> None:
        calls.append("")

    def localize() -> None:
        calls.clear()
        localizer = raylift.Localizer(open_scene(12), cache=tmp_path / "cache", matcher_name="none", max_features=500,
                                      matcher=match, query_images=tmp_path / "images")
        localizer.localize_all([(NAME, camera())])
    copy = tmp_path / "images" / NAME
    copy.parent.mkdir(parents=True)
    copy.write_bytes(FILE.read_bytes())
    localize()
    localize()
    assert calls == []
    copy.write_bytes(FILE.read_bytes() + b"\0")
    localize()
    assert len(calls) == len(open_scene(12).references)


def copies(folder: Path, *names: str) -> list[tuple[str, str]]:
    """Names and files of copies of a photograph."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(FILE.read_bytes())
    return [(name, str(folder / name)) for name in names]


def test_names_that_hloc_writes_alike_each_have_their_matches(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    from raylift._matching import matcher_of
    calls: list[int] = []

    def match(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> list[list[float]]:
        calls.append(1)
        return [[len(calls), 0, 0, 0.1]]
    query, *references = copies(tmp_path, "query.jpg", "cam/0.jpg", "cam-0.jpg", "b.jpg")
    matches = matcher_of(match, None, 0, str(tmp_path / "cache"), "mine")
    for expected in ([1, 2, 3], [4, 2, 3], [4, 5, 3]):
        found = matches(query, references)
        assert [first_px[0, 0] for first_px, _, _ in found] == expected
        assert all(second_px[0, 1] == np.float32(0.1) for _, second_px, _ in found)


def test_kept_matches_are_those_of_the_extractor(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    from raylift._matching import matcher_of
    calls: list[int] = []

    def match(first: object, second: object) -> list[list[int]]:
        calls.append(1)
        return [[0, 0]]
    query, reference = copies(tmp_path, "query.jpg", "a.jpg")
    for name, count in (("one", 1), ("one", 1), ("other", 2), ("other", 2)):
        matcher_of(match, lambda image: (FIRST, None), 0, str(tmp_path / "cache"), "mine", name)(query, [reference])
        assert len(calls) == count


def test_features_in_memory_are_those_of_the_photographs_as_they_are(tmp_path: Path) -> None:
    from raylift._matching import matcher_of
    calls: list[int] = []

    def extract(image: NDArray[np.uint8]) -> tuple[NDArray[np.float64], None]:
        calls.append(1)
        return FIRST, None
    matches = matcher_of(lambda first, second: [[0, 0]], extract)
    query, reference = copies(tmp_path, "query.jpg", "a.jpg")
    for count in (2, 2):
        matches(query, [reference])
        assert len(calls) == count
    Path(reference[1]).write_bytes(FILE.read_bytes() + b"\0")
    matches(query, [reference])
    assert len(calls) == 3
    with pytest.raises(raylift.InputError, match="none.jpg: No such file"):
        matches(query, [("none.jpg", str(tmp_path / "none.jpg"))])


def test_without_references_nothing_is_called() -> None:
    from raylift._matching import matcher_of

    def fails(*photographs: object) -> None:
        raise AssertionError(photographs)
    assert matcher_of(fails, fails)(("a", "none.jpg"), []) == []


def test_a_descriptor_of_another_size_is_the_only_one_refused() -> None:
    from raylift._matching import descriptor_of
    describe = descriptor_of(lambda image: image.reshape(-1))
    pixels = np.array([3, 4, 0], np.uint8)
    assert describe(pixels).tolist() == pytest.approx([0.6, 0.8, 0])
    with pytest.raises(raylift.InputError, match="one size, 3 numbers, found 2"):
        describe(pixels[:2])
    assert describe(pixels).tolist() == pytest.approx([0.6, 0.8, 0])


def test_global_descriptors_of_ones_own_retrieve() -> None:
    def brightness(image: NDArray[np.uint8]) -> list[float]:
        left, right = image[:, :320].mean(), image[:, 320:].mean()
        return [left, right]

    def similarity(name: str) -> float:
        vectors = [np.array(brightness(raylift.read_image(DEMO / "images" / n))) for n in (NAME, name)]
        return float(vectors[0] @ vectors[1] / np.linalg.norm(vectors[0]) / np.linalg.norm(vectors[1]))
    scene = open_scene()
    expected = sorted((r.name for r in scene.references), key=similarity, reverse=True)[:4]
    localizer = raylift.Localizer(scene, retrieval=brightness, top_k=4, max_features=500)
    of_file = localizer.localize(FILE, camera(), name=NAME)
    assert [r.name for r in of_file.problem.references] == expected
    of_list = localizer.localize_all([(NAME, camera())])[NAME]
    assert [r.name for r in of_list.problem.references] == expected
    features = raylift.extract_features(raylift.read_image(FILE), max_features=500)
    with pytest.raises(raylift.InputError, match="global descriptor takes photographs"):
        localizer.localize({**features, "keypoints": features["keypoints"]}, camera())


class Torch(types.SimpleNamespace):
    """What is used of torch: from_numpy() and no_grad()."""

    def __init__(self) -> None:
        super().__init__(grad=True)

    def from_numpy(self, array: NDArray[Any]) -> "Moved":
        assert array.dtype == np.float32 and not self.grad
        return Moved(array)

    def no_grad(self) -> Any:
        torch = self

        class NoGrad:
            def __enter__(self) -> None:
                torch.grad = False

            def __exit__(self, *error: object) -> None:
                torch.grad = True
        return NoGrad()


class Moved(Tensor):
    device = "cpu"

    def to(self, device: str) -> "Moved":
        moved = Moved(self.array)
        moved.device = device
        return moved


class Model:
    """What is known of torch's modules."""

    def parameters(self) -> Any:
        return iter([types.SimpleNamespace(device="gpu")])


def found_by(monkeypatch: pytest.MonkeyPatch, **options: Any) -> list[list[float]]:
    """The pixels that an imitation finds in the first reference, as Localizer takes them."""
    monkeypatch.setitem(sys.modules, "torch", Torch())
    localizer = raylift.Localizer(open_scene(12), max_features=500, **options)
    problem = localizer.localize(FILE, camera()).problem
    rows = np.hstack([problem.query2d, problem.reference2d])[problem.reference_index == 0]
    return [[float(value) for value in row] for row in rows]


COLMAP_ROWS = (np.array(ROWS) + 0.5).tolist()


class SuperPoint(Model):
    """lightglue.SuperPoint: extract() of a tensor (3, H, W) from 0 to 1; calls take a dict."""

    required_data_keys = ["image"]

    def __init__(self) -> None:
        self.photograph = raylift.read_image(FILE)

    def __call__(self, data: Any) -> Any:
        raise AssertionError("forward() takes {image: ...}, and does not resize")

    def extract(self, image: Moved) -> dict[str, Any]:
        assert image.device == "gpu" and image.array.shape == (3, *self.photograph.shape[:2])
        pixels = np.rint(image.array * 255).transpose(1, 2, 0)
        keypoints = FIRST if np.array_equal(pixels, self.photograph) else SECOND
        return {"keypoints": Moved(keypoints[None]), "descriptors": Moved(np.ones((1, len(keypoints), 256))),
                "keypoint_scores": Moved(np.ones((1, len(keypoints)))),
                "image_size": Moved(np.array([[640.0, 480.0]]))}


class LightGlue(Model):
    """lightglue.LightGlue: called with one dict; all that it returns has an axis for the batch."""

    required_data_keys = ["image0", "image1"]

    def __call__(self, data: dict[str, dict[str, Any]]) -> dict[str, Any]:
        counts = []
        for features in (data["image0"], data["image1"]):
            assert features["keypoints"].array.ndim == features["descriptors"].array.ndim == 3
            assert features["image_size"].array.shape == (1, 2)
            counts.append(features["keypoints"].array.shape[1])
        if counts[0] != len(FIRST):
            return {"matches0": Moved(np.full((1, counts[0]), -1)), "matching_scores0": Moved(np.zeros((1, counts[0]))),
                    "matches": Moved(np.zeros((1, 0, 2))), "scores": Moved(np.zeros((1, 0)))}
        return {"matches0": Moved(np.array([[-1, 0, 1]])), "matches1": Moved(np.array([[1, 2]])),
                "matching_scores0": Moved(np.array([[0, 0.9, 0.8]])), "stop": 9,
                "matches": [Moved(np.array([[1, 0], [2, 1]]))], "scores": [Moved(np.array([0.9, 0.8]))]}


def of_numpy(image: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    keypoints = FIRST if np.array_equal(image, raylift.read_image(FILE)) else SECOND
    return {"keypoints": keypoints, "descriptors": np.ones((len(keypoints), 256)), "image_size": np.array([640, 480])}


@pytest.mark.parametrize("extractor", [SuperPoint(), of_numpy])
def test_lightglue_is_a_matcher(extractor: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert found_by(monkeypatch, extractor=extractor, matcher=LightGlue()) == COLMAP_ROWS


def test_lightglue_needs_an_extractor(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(raylift.InputError, match="expected an extractor beside it that returns a dict"):
        found_by(monkeypatch, matcher=LightGlue())
    with pytest.raises(raylift.InputError, match="expected an extractor beside it that returns a dict"):
        found_by(monkeypatch, matcher=LightGlue(), extractor=cv2.SIFT_create(100))


class VisMatch(Model):
    """vismatch.BaseMatcher: called with (3, H, W) from 0 to 1; results are arrays."""

    def load_image(self, path: str) -> None: ...

    def rescale_coords(self, *sizes: int) -> None: ...

    def __call__(self, first: Moved, second: Moved) -> dict[str, Any]:
        for image in (first, second):
            assert image.device == "gpu" and image.array.shape == (3, 480, 640) and image.array.max() <= 1
        return {"num_inliers": 0, "H": None, "all_kpts0": FIRST, "all_kpts1": SECOND, "all_desc0": np.zeros((0, 2)),
                "matched_kpts0": FIRST[1:], "matched_kpts1": SECOND, "inlier_kpts0": np.zeros((0, 2)),
                "inlier_kpts1": np.zeros((0, 2))}


def test_matchers_of_vismatch(monkeypatch: pytest.MonkeyPatch) -> None:
    assert found_by(monkeypatch, matcher=VisMatch()) == COLMAP_ROWS


class Picture:
    """What is used of PIL's."""

    def __init__(self, array: NDArray[np.uint8]) -> None:
        self.size = array.shape[1::-1]


class RoMa(Model):
    """romatch's: a warp from -1 to 1, edge to edge; -1 + 1 / W is the center of the first of W pixels."""

    def match(self, first: Picture, second: Picture) -> tuple[Moved, Moved]:
        assert first.size == second.size == (640, 480)
        ends = np.array([640, 480, 640, 480])
        return Moved((2 * (np.array(ROWS) + 0.5) / ends - 1)[None, None]), Moved(np.ones((1, 1, 2)))

    def sample(self, warp: Moved, certainty: Moved) -> tuple[Moved, Moved]:
        return Moved(warp.array.reshape(-1, 4)), Moved(certainty.array.reshape(-1))

    def to_pixel_coordinates(self, rows: Moved, h0: int, w0: int, h1: int, w1: int) -> tuple[Moved, Moved]:
        both = [np.stack([w / 2 * (xy[:, 0] + 1), h / 2 * (xy[:, 1] + 1)], axis=-1)
                for xy, w, h in ((rows.array[:, :2], w0, h0), (rows.array[:, 2:], w1, h1))]
        return Moved(both[0]), Moved(both[1])


@pytest.mark.parametrize("first_pixel", [0, 0.5])
def test_roma_is_a_matcher_whose_first_pixel_is_known(first_pixel: float, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = types.SimpleNamespace(Image=types.SimpleNamespace(fromarray=Picture))
    monkeypatch.setitem(sys.modules, "PIL", picture)
    assert found_by(monkeypatch, matcher=RoMa(), first_pixel=first_pixel) == [pytest.approx(row) for row in COLMAP_ROWS]


def predicted(names: tuple[str, str], shape: tuple[int, int], shift: int) -> dict[str, dict[str, Tensor]]:
    """What MASt3R or DUSt3R predict where x of the second map is x - shift of the first."""
    values = np.random.default_rng(0).normal(size=(shape[0], shape[1] + shift, 3))
    values /= np.linalg.norm(values, axis=2, keepdims=True)
    confidence = np.arange(shape[0] * shape[1], dtype=float).reshape(1, *shape)
    return {"pred1": {"pts3d": Tensor([]), names[0]: Tensor(values[None, :, :shape[1]]),
                      "desc_conf": Tensor(confidence)},
            "pred2": {names[1]: Tensor(values[None, :, shift:]), "desc_conf": Tensor(confidence + 5)}}


@pytest.mark.parametrize("names", [("desc", "desc"), ("pts3d", "pts3d_in_other_view")])
@pytest.mark.parametrize("as_pair", [False, True])
def test_predictions_are_matched_at_the_photographs_pixels(
        names: tuple[str, str], as_pair: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    # load_images() makes 64 x 48 of 640 x 480.
    result: Any = predicted(names, (48, 64), 16)
    rows = found_by(monkeypatch, matcher=lambda a, b: (result["pred1"], result["pred2"]) if as_pair else result)
    # Each 8th pixel from the 4th on that the other map shows, too; the 12 whose place it does not show
    # lead to others.
    expected = [[(x + 0.5) * 10, (y + 0.5) * 10, (x - 16 + 0.5) * 10, (y + 0.5) * 10]
                for y in range(4, 48, 8) for x in range(20, 64, 8)]
    assert all(row in rows for row in expected) and len(rows) <= len(expected) + 12


@pytest.mark.parametrize("size, shape, resized, cut", [
    ((640, 480), (384, 512), (512, 384), (0, 0)),  # load_images() of size 512
    ((1024, 683), (336, 512), (512, 342), (0, 3)),
    ((1000, 1000), (384, 512), (512, 512), (0, 64)),
    ((2048, 1150), (288, 512), (512, 288), (0, 0)),
    ((1150, 2048), (512, 288), (288, 512), (0, 0)),
    ((640, 480), (224, 224), (299, 224), (37, 0)),  # of size 224
    ((1080, 1920), (224, 224), (224, 398), (0, 87)),
])
def test_pixels_of_resized_and_cut_photographs(
        size: tuple[int, int], shape: tuple[int, int], resized: tuple[int, int], cut: tuple[int, int]) -> None:
    from raylift import _adapters
    of_map = np.array([[0, 0], [shape[1] - 1, shape[0] - 1]])
    found = _adapters._of_photograph(np.array([0, shape[0] * shape[1] - 1]), shape,
                                     np.zeros((size[1], size[0], 3), np.uint8))
    expected = (of_map + cut + 0.5) * np.array(size) / np.array(resized) - 0.5
    assert found == pytest.approx(expected, abs=1e-9)  # rounding alone
