"""Extractors and matchers of one's own."""
import functools
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
