"""Extractors and matchers of one's own for Localizer, in whatever form people have them.

Nothing but numpy is imported: objects of other libraries are known by their attributes, tensors by
`detach` or by numpy's own protocols.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, NoReturn, Optional, Sequence, Tuple

import numpy as np

from . import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ._types import Extractor, Matcher

    Image = NDArray[np.uint8]
    Numbers = NDArray[np.float64]
    _Tensor = NDArray[Any]  # of a user's own
    _Pixels = Tuple[Numbers, Numbers, Optional[Numbers]]

_PIXELS = (("matched_kpts0", "matched_kpts1"), ("mkpts0", "mkpts1"), ("kpts0", "kpts1"),
           ("query2d", "reference2d"), ("keypoints0", "keypoints1"))
_SCORES = ("scores", "mconf", "conf", "confidence", "match_confidence", "matching_scores0", "certainty")
# The features of so many photographs in files are kept.
_MOST_FEATURES = 1000


def _array(value: Any) -> _Tensor:
    """The array that a tensor or list holds, without the axis of a batch of one."""
    if isinstance(value, (list, tuple)) and len(value) == 1 and hasattr(value[0], "__array__"):
        return _array(value[0])
    detach = getattr(value, "detach", None)
    if detach is not None:
        value = detach().cpu()
    array = np.asarray(value)
    return array[0] if array.ndim == 3 and len(array) == 1 else array


def _fail(who: str, expected: str, found: Any) -> NoReturn:
    what = f"an array of shape {found.shape}" if isinstance(found, np.ndarray) else f"a {type(found).__name__}"
    if isinstance(found, Mapping):
        what = "the keys " + ", ".join(sorted(map(str, found)))
    raise _core.InputError(f"{who}: expected {expected}, found {what}")


def _pixels(value: Any, who: str) -> Numbers:
    """Rows of pixels, be they OpenCV's KeyPoint."""
    if isinstance(value, (list, tuple)) and len(value) and hasattr(value[0], "pt"):
        value = [keypoint.pt for keypoint in value]
    rows = _array(value)
    if rows.size == 0:
        return np.zeros((0, 2))
    if rows.ndim != 2 or rows.shape[1] < 2:
        _fail(who, "pixels (N, 2)", rows)
    return rows[:, :2].astype(float)


def _keypoints_and_descriptors(features: Any) -> Tuple[Numbers, Optional[_Tensor]]:
    expected = "a dict or pair of keypoints (N, 2) and descriptors (N, D)"
    if isinstance(features, Mapping) and "keypoints" in features:
        keypoints, descriptors = features["keypoints"], features.get("descriptors")
    elif isinstance(features, (tuple, list)) and len(features) == 2:
        keypoints, descriptors = features
    else:
        _fail("extractor", expected, features)
    pixels = _pixels(keypoints, "extractor, keypoints")
    if descriptors is None:
        return pixels, None
    rows = _array(descriptors)
    if rows.ndim == 2 and rows.shape[0] != len(pixels) and rows.shape[1] == len(pixels):
        rows = rows.T  # as hloc's and SuperPoint's
    if rows.ndim != 2 or len(rows) != len(pixels):
        _fail("extractor", f"descriptors ({len(pixels)}, D)", rows)
    return pixels, rows


def _extract_by(extractor: Extractor) -> Callable[[Image], Any]:
    """OpenCV's Feature2D, or any callable that takes a photograph."""
    if callable(extractor):
        return extractor
    if hasattr(extractor, "detectAndCompute"):
        return lambda image: extractor.detectAndCompute(image, None)
    _fail("extractor", "a callable, or OpenCV's Feature2D", extractor)


def extractor_of(extractor: Extractor) -> Callable[[Image], Dict[str, NDArray[np.generic]]]:
    """What the module calls for the features of a photograph, one call at a time."""
    extract, lock = _extract_by(extractor), threading.RLock()

    def features(image: Image) -> Dict[str, NDArray[np.generic]]:
        with lock:
            keypoints, descriptors = _keypoints_and_descriptors(extract(image))
        if descriptors is None and len(keypoints):
            _fail("extractor", "descriptors beside the keypoints, or a matcher", None)
        return {"keypoints": keypoints, "descriptors": np.zeros((0, 1)) if descriptors is None else descriptors}

    return features


def _mutual(matcher: Any, first: _Tensor, second: _Tensor) -> NDArray[np.int64]:
    """Indices (K, 2) of what OpenCV's DescriptorMatcher matches both ways."""
    back = {match.queryIdx: match.trainIdx for match in matcher.match(second, first)}
    pairs = [(m.queryIdx, m.trainIdx) for m in matcher.match(first, second) if back.get(m.trainIdx) == m.queryIdx]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def _match_by(matcher: Matcher, of_features: bool) -> Callable[[Any, Any], Any]:
    def by_descriptors(first: Any, second: Any) -> NDArray[np.int64]:
        both = [_keypoints_and_descriptors(features)[1] for features in (first, second)]
        found = [rows for rows in both if rows is not None and len(rows)]
        return _mutual(matcher, *found) if len(found) == 2 else np.zeros((0, 2), dtype=int)

    if callable(matcher):
        return matcher
    if of_features and hasattr(matcher, "match"):
        return by_descriptors
    _fail("matcher", "a callable, or, with an extractor, OpenCV's DescriptorMatcher", matcher)


def _of_indices(matches: _Tensor, scores: Optional[_Tensor], keypoints: Sequence[Numbers]) -> _Pixels:
    """By rows (K, 2) of indices; or by (N,), the second keypoint of each first one or -1, with their scores."""
    pairs = matches.astype(int)
    if matches.ndim == 1:
        matched = pairs >= 0
        if scores is not None and len(scores) == len(pairs):
            scores = scores[matched]
        pairs = np.stack([np.flatnonzero(matched), pairs[matched]], axis=1)
    for column, name in enumerate(("query", "reference")):
        if len(pairs) and not 0 <= pairs[:, column].min() <= pairs[:, column].max() < len(keypoints[column]):
            raise _core.InputError(f"matcher: a match names a keypoint of the {name} that is not among its "
                                   f"{len(keypoints[column])}")
    return keypoints[0][pairs[:, 0]], keypoints[1][pairs[:, 1]], scores


def _of_names(result: Mapping[str, Any], keypoints: Optional[Sequence[Numbers]]) -> _Pixels:
    scores = next((_array(result[key]).reshape(-1) for key in _SCORES if result.get(key) is not None), None)
    named = next(([_pixels(result[name], "matcher") for name in pair] for pair in _PIXELS
                  if pair[0] in result and pair[1] in result), None)
    keypoints = named or keypoints
    matches = result.get("matches0", result.get("matches"))
    if matches is not None and keypoints is not None:
        return _of_indices(_array(matches), scores, keypoints)
    if named is None:
        _fail("matcher", "keypoints0 and keypoints1 with matches, or mkpts0 and mkpts1", result)
    return named[0], named[1], scores


def _found(result: Any, keypoints: Optional[Sequence[Numbers]]) -> _Pixels:
    """The pixels and scores of what a matcher returned; `keypoints` are those of the features it was given."""
    if isinstance(result, Mapping):
        return _of_names(result, keypoints)
    if isinstance(result, (tuple, list)) and len(result):
        if keypoints is not None and hasattr(result[0], "queryIdx"):
            return _of_indices(np.array([(match.queryIdx, match.trainIdx) for match in result]), None, keypoints)
        if len(result) in (2, 3) and _array(result[0]).ndim == 2:
            scores = _array(result[2]).reshape(-1) if len(result) == 3 else None
            return _pixels(result[0], "matcher"), _pixels(result[1], "matcher"), scores
    rows = np.zeros((0, 4)) if result is None else _array(result)
    if rows.size == 0:
        rows = np.zeros((0, 4))
    if rows.ndim == 2 and rows.shape[1] in (4, 5):
        return rows[:, :2].astype(float), rows[:, 2:4].astype(float), rows[:, 4] if rows.shape[1] == 5 else None
    if keypoints is not None and rows.ndim == 2 and rows.shape[1] == 2:
        return _of_indices(rows, None, keypoints)
    expected = "rows (N, 4) of both photographs' pixels"
    if keypoints is not None:
        expected += " or (K, 2) of their keypoints' indices"
    _fail("matcher", expected, rows if rows.ndim else result)


def matcher_of(matcher: Matcher, extractor: Optional[Extractor] = None) -> Callable[
        [str, Optional[Image], Sequence[str]], List[_Pixels]]:
    """What the module calls for the matches of a query with its references, one call at a time: with a
    query's pixels, or None and its file, and the names and files of the references."""
    match = _match_by(matcher, extractor is not None)
    extract = None if extractor is None else _extract_by(extractor)
    lock, kept = threading.RLock(), dict[str, Any]()

    def seen(file: str, image: Optional[Image]) -> Any:
        """What the matcher takes of a photograph: its pixels, or its features."""
        if image is not None:
            return image if extract is None else extract(image)
        if extract is None:
            return _core.read_image(file)
        if file not in kept:
            if len(kept) >= _MOST_FEATURES:
                del kept[next(iter(kept))]
            kept[file] = extract(_core.read_image(file))
        return kept[file]

    def pair(first: Any, second: Any) -> _Pixels:
        keypoints = None
        if extract is not None:
            keypoints = [_keypoints_and_descriptors(features)[0] for features in (first, second)]
        first_px, second_px, scores = _found(match(first, second), keypoints)
        if len(first_px) != len(second_px) or (scores is not None and len(scores) != len(first_px)):
            raise _core.InputError(f"matcher: expected as many pixels of both photographs and scores, found "
                                   f"{len(first_px)}, {len(second_px)} and {len(first_px) if scores is None else len(scores)}")
        return first_px, second_px, scores

    def matches(file: str, image: Optional[Image], references: Sequence[str]) -> List[_Pixels]:
        with lock:
            query = seen(file, image)
            return [pair(query, seen(reference, None)) for reference in references]

    return matches
