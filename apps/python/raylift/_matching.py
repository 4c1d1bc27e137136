"""Extractors and matchers of one's own for Localizer, in whatever form people have them.

What other libraries have is known by its attributes (_adapters.py), tensors by `detach` or by numpy's own
protocols. Nothing but numpy is imported, and h5py where matches are kept.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
from typing import (
    TYPE_CHECKING,
    Any,
    Callable,
    Dict,
    Iterator,
    List,
    Mapping,
    NoReturn,
    Optional,
    Protocol,
    Sequence,
    Tuple,
)

import numpy as np
from numpy.typing import NDArray

from . import _adapters, _core

if TYPE_CHECKING:
    from ._types import Extractor, GlobalDescriptor, Matcher

_PIXELS = (("matched_kpts0", "matched_kpts1"), ("mkpts0", "mkpts1"), ("kpts0", "kpts1"),
           ("query2d", "reference2d"), ("keypoints0", "keypoints1"), ("inlier_kpts0", "inlier_kpts1"))
_SCORES = ("scores", "mconf", "conf", "confidence", "match_confidence", "matching_scores0", "certainty")
Array = NDArray[np.generic]
Image = NDArray[np.uint8]
Numbers = NDArray[np.float64]
_Pixels = Tuple[Numbers, Numbers, Optional[Numbers]]
# The features of so many photographs in files are kept.
_MOST_FEATURES = 1000


def _array(value: object) -> Array:
    """The array that a tensor or list holds, without the axis of a batch of one."""
    if isinstance(value, (list, tuple)) and len(value) == 1 and hasattr(value[0], "__array__"):
        return _array(value[0])
    array = _adapters.numbers(value)
    return array[0] if array.ndim == 3 and len(array) == 1 else array


def _numbers(value: object) -> Numbers:
    return _array(value).reshape(-1).astype(float)


def _fail(who: str, expected: str, found: object) -> NoReturn:
    what = f"an array of shape {found.shape}" if isinstance(found, np.ndarray) else f"a {type(found).__name__}"
    if isinstance(found, Mapping):
        what = "the keys " + ", ".join(sorted(map(str, found)))
    raise _core.InputError(f"{who}: expected {expected}, found {what}")


def _pixels(value: object, who: str) -> Numbers:
    """Rows of pixels, be they OpenCV's KeyPoint."""
    if isinstance(value, (list, tuple)) and len(value) and hasattr(value[0], "pt"):
        value = [keypoint.pt for keypoint in value]
    rows = _array(value)
    if rows.size == 0:
        return np.zeros((0, 2))
    if rows.ndim != 2 or rows.shape[1] < 2:
        _fail(who, "pixels (N, 2)", rows)
    return rows[:, :2].astype(float)


def _parts(features: object) -> Tuple[object, object]:
    if isinstance(features, Mapping) and "keypoints" in features:
        return features["keypoints"], features.get("descriptors")
    if not isinstance(features, (tuple, list)) or len(features) != 2:
        _fail("extractor", "a dict or pair of keypoints (N, 2) and descriptors (N, D)", features)
    return features[0], features[1]


def _keypoints(features: object) -> Numbers:
    return _pixels(_parts(features)[0], "extractor, keypoints")


def _keypoints_and_descriptors(features: object) -> Tuple[Numbers, Optional[Array]]:
    pixels, descriptors = _keypoints(features), _parts(features)[1]
    if descriptors is None:
        return pixels, None
    rows = _array(descriptors)
    if rows.ndim == 2 and rows.shape[0] != len(pixels) and rows.shape[1] == len(pixels):
        rows = rows.T  # as hloc's and SuperPoint's
    if rows.ndim != 2 or len(rows) != len(pixels):
        _fail("extractor", f"descriptors ({len(pixels)}, D)", rows)
    return pixels, rows


def _extract_by(extractor: Extractor) -> Callable[[Image], object]:
    """What takes a photograph."""
    known = _adapters.known_extractor(extractor)
    if known is not None:
        return known
    if not callable(extractor):
        _fail("extractor", "a callable, or OpenCV's Feature2D", extractor)
    return extractor


def extractor_of(extractor: Extractor) -> Callable[[Image], Dict[str, Array]]:
    """What the module calls for the features of a photograph, one call at a time."""
    extract, lock = _extract_by(extractor), threading.RLock()

    def features(image: Image) -> Dict[str, Array]:
        with lock, _adapters.without_gradients():
            keypoints, descriptors = _keypoints_and_descriptors(extract(image))
        if descriptors is None and len(keypoints):
            _fail("extractor", "descriptors beside the keypoints, or a matcher", None)
        return {"keypoints": keypoints, "descriptors": np.zeros((0, 1)) if descriptors is None else descriptors}

    return features


def descriptor_of(retrieval: GlobalDescriptor) -> Callable[[Image], NDArray[np.float32]]:
    """What the module calls for the global descriptor of a photograph, one call at a time: of unit length."""
    if not callable(retrieval):
        _fail("retrieval", "a callable", retrieval)
    lock, size = threading.RLock(), 0

    def describe(image: Image) -> NDArray[np.float32]:
        nonlocal size
        with lock, _adapters.without_gradients():
            vector = np.asarray(_array(retrieval(image)), np.float32).reshape(-1)
            norm = float(np.linalg.norm(vector))
            if not 0 < norm < np.inf:
                raise _core.InputError(f"retrieval: expected a vector (D,) of finite length above 0, found {norm:g} "
                                       f"of {len(vector)} numbers")
            size = size or len(vector)
        if len(vector) != size:
            raise _core.InputError(f"retrieval: expected vectors of one size, {size} numbers, found {len(vector)}")
        return vector / norm

    return describe


def _mutual(matcher: Any, first: Array, second: Array) -> NDArray[np.int64]:
    """Indices (K, 2) of what OpenCV's DescriptorMatcher matches both ways."""
    back = {match.queryIdx: match.trainIdx for match in matcher.match(second, first)}
    pairs = [(m.queryIdx, m.trainIdx) for m in matcher.match(first, second) if back.get(m.trainIdx) == m.queryIdx]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def _match_by(matcher: Matcher, of_features: bool, first_pixel: float) -> Callable[[Any, List[Any]], Sequence[Any]]:
    """What takes a query and a list of references, each a photograph or its features."""
    def by_descriptors(first: object, second: object) -> NDArray[np.int64]:
        both = [_keypoints_and_descriptors(features)[1] for features in (first, second)]
        found = [rows for rows in both if rows is not None and len(rows)]
        return _mutual(matcher, *found) if len(found) == 2 else np.zeros((0, 2), dtype=int)

    batch: Optional[Callable[[Any, List[Any]], Sequence[Any]]] = getattr(matcher, "match_batch", None)
    if batch is not None:
        return batch
    pair: Any = _adapters.known_matcher(matcher, of_features, first_pixel) or matcher
    if not callable(pair) and of_features and hasattr(matcher, "match"):
        pair = by_descriptors
    if not callable(pair):
        _fail("matcher", "a callable, an object with match_batch, or, with an extractor, OpenCV's DescriptorMatcher",
              matcher)
    return lambda query, references: [pair(query, reference) for reference in references]


def _of_indices(matches: Array, scores: Optional[Numbers], keypoints: Sequence[Numbers]) -> _Pixels:
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


def _of_names(result: Mapping[str, object], keypoints: Optional[Sequence[Numbers]]) -> _Pixels:
    scores = next((_numbers(result[key]) for key in _SCORES if result.get(key) is not None), None)
    named = next(([_pixels(result[name], "matcher") for name in pair] for pair in _PIXELS
                  if pair[0] in result and pair[1] in result), None)
    keypoints = named or keypoints
    matches = None if result.get("matches") is None else _array(result["matches"])
    if matches is None and result.get("matches0") is not None:
        matches = _array(result["matches0"]).reshape(-1)
    if matches is not None and keypoints is not None:
        return _of_indices(matches, scores, keypoints)
    if named is None:
        _fail("matcher", "keypoints0 and keypoints1 with matches, or mkpts0 and mkpts1", result)
    return named[0], named[1], scores


def _found(result: object, keypoints: Optional[Sequence[Numbers]]) -> _Pixels:
    """The pixels and scores of what a matcher returned; `keypoints` are those of the features it was given."""
    if isinstance(result, Mapping):
        return _of_names(result, keypoints)
    if isinstance(result, (tuple, list)) and len(result):
        if keypoints is not None and hasattr(result[0], "queryIdx"):
            return _of_indices(np.array([(match.queryIdx, match.trainIdx) for match in result]), None, keypoints)
        if len(result) in (2, 3) and _array(result[0]).ndim == 2:
            scores = _numbers(result[2]) if len(result) == 3 else None
            return _pixels(result[0], "matcher"), _pixels(result[1], "matcher"), scores
    rows: Array = np.zeros((0, 4)) if result is None else _array(result)
    if rows.size == 0:
        rows = np.zeros((0, 4))
    if rows.ndim == 2 and rows.shape[1] in (4, 5):
        numbers = rows.astype(float)
        return numbers[:, :2], numbers[:, 2:4], numbers[:, 4] if rows.shape[1] == 5 else None
    if keypoints is not None and rows.ndim == 2 and rows.shape[1] == 2:
        return _of_indices(rows, None, keypoints)
    expected = "rows (N, 4) of both photographs' pixels"
    if keypoints is not None:
        expected += " or (K, 2) of their keypoints' indices"
    _fail("matcher", expected, rows if rows.ndim else result)


def _checked(result: object, keypoints: Optional[Sequence[Numbers]] = None) -> _Pixels:
    """The pixels of what a matcher returned; `keypoints` are those of the features it was given."""
    first_px, second_px, scores = _found(result, keypoints)
    if len(first_px) != len(second_px) or (scores is not None and len(scores) != len(first_px)):
        num_scores = len(first_px) if scores is None else len(scores)
        raise _core.InputError(f"matcher: expected as many pixels of both photographs and scores, found "
                               f"{len(first_px)}, {len(second_px)} and {num_scores}")
    return first_px, second_px, scores


def _match_photographs(match: Callable[[Any, List[Any]], Sequence[Any]], query: Image,
                       references: List[Image], first_pixel: float) -> List[_Pixels]:
    found = []
    for reference, result in zip(references, _as_many(match(query, references), references)):
        predictions = _adapters.predictions_in(result)
        if predictions is not None:
            result = _adapters.match_predictions(predictions, (query, reference), first_pixel)
        found.append(_checked(result))
    return found


def _as_many(results: Sequence[Any], references: Sequence[Any]) -> Sequence[Any]:
    if len(results) != len(references):
        raise _core.InputError(f"matcher: expected the matches with {len(references)} references, found {len(results)}")
    return results


def pixels_of(matcher: Matcher, first: Image, second: Image) -> _Pixels:
    """What a matcher of photographs finds, the first pixel's center being (0, 0) where that is known."""
    with _adapters.without_gradients():
        return _match_photographs(_match_by(matcher, False, 0), first, [second], 0)[0]


def _state(file: str) -> Tuple[int, int]:
    """What changes with a file: its size and time."""
    try:
        state = os.stat(file)
    except OSError as error:
        raise _core.InputError(f"{file}: {error.strerror}") from None
    return state.st_size, state.st_mtime_ns


class _MatchCache:
    """Matches of photographs in files as hloc.match_dense keeps them, matches-NAME.h5: of each pair
    keypoints0, keypoints1 (the first pixel's center is (0, 0)) and scores, float32."""

    def __init__(self, folder: str, name: str, first_pixel: float, extractor_name: str) -> None:
        try:
            import h5py
        except ImportError:
            raise ImportError("matcher_name needs h5py, which keeps matches as hloc does: pip install h5py") from None
        if "/" in name:
            raise _core.OptionError(f"matcher_name = {name}: must be part of a file's name")
        os.makedirs(folder, exist_ok=True)
        self._open, self._first_pixel, self._extractor_name = h5py.File, first_pixel, extractor_name
        self._file = os.path.join(folder, f"matches-{name}.h5")

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        """The file, for this process alone."""
        with open(self._file + ".lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                file = self._open(self._file, "a")
            except OSError as error:
                raise _core.InputError(f"{self._file}: expected matches in HDF5 ({error}); without it they are "
                                       "made anew") from None
            with file:
                yield file

    def stamp(self, *photographs: Sequence[str]) -> str:
        """Changes with the photographs, each with name and file, with how their pixels are understood, and with
        what their features come from."""
        states = [" ".join(map(str, (name, *_state(file)))) for name, file in photographs]
        return " ".join([*states, f"first_pixel {self._first_pixel:g}", self._extractor_name]).rstrip()

    @staticmethod
    def _pair(*names: str) -> str:
        return "/".join(name.replace("/", "-") for name in names)

    def _pixels(self, pair: Any) -> _Pixels:
        first_px, second_px = (pair[key][()].astype(float) + self._first_pixel for key in ("keypoints0", "keypoints1"))
        return first_px, second_px, pair["scores"][()].astype(float)

    def read(self, query: str, references: Sequence[str], stamps: Sequence[str]) -> List[Optional[_Pixels]]:
        """By names; None where there are none of these stamps."""
        with self._opened() as file:
            pairs = [file.get(self._pair(query, name)) for name in references]
            return [None if pair is None or pair.attrs.get("photographs") != stamp else self._pixels(pair)
                    for pair, stamp in zip(pairs, stamps)]

    def write(self, query: str, references: Sequence[str], stamps: Sequence[str],
              matches: Sequence[_Pixels]) -> List[_Pixels]:
        """Returns them as read() does: of two names that hloc writes alike, the file keeps the last alone."""
        written = []
        with self._opened() as file:
            for name, stamp, (first_px, second_px, scores) in zip(references, stamps, matches):
                pair = self._pair(query, name)
                if pair in file:
                    del file[pair]
                group = file.create_group(pair)
                for key, pixels in (("keypoints0", first_px), ("keypoints1", second_px)):
                    group[key] = (pixels - self._first_pixel).astype(np.float32)
                group["scores"] = np.ones(len(first_px), np.float32) if scores is None else scores.astype(np.float32)
                group.attrs["photographs"] = stamp
                written.append(self._pixels(group))
        return written


class _MatchReferences(Protocol):
    def __call__(self, query: Sequence[str], references: Sequence[Sequence[str]],
                 image: Optional[Image] = None) -> List[_Pixels]: ...


def matcher_of(matcher: Matcher, extractor: Optional[Extractor] = None, first_pixel: float = 0, cache: str = "",
               matcher_name: str = "", extractor_name: str = "") -> _MatchReferences:
    """What the module calls for the matches of a query with its references, one call at a time: with name and
    file of the query and of each reference, and the query's pixels where they are in memory."""
    match = _match_by(matcher, extractor is not None, first_pixel)
    extract = None if extractor is None else _extract_by(extractor)
    lock, kept = threading.RLock(), dict[Tuple[str, int, int], object]()
    stored = _MatchCache(cache, matcher_name, first_pixel, extractor_name) if cache and matcher_name else None

    def seen(file: str, image: Optional[Image]) -> Any:
        """What the matcher takes of a photograph: its pixels, or its features."""
        if image is not None:
            return image if extract is None else extract(image)
        if extract is None:
            return _core.read_image(file)
        key = (file, *_state(file))
        if key not in kept:
            if len(kept) >= _MOST_FEATURES:
                del kept[next(iter(kept))]
            kept[key] = extract(_core.read_image(file))
        return kept[key]

    def matched(file: str, image: Optional[Image], references: Sequence[str]) -> List[_Pixels]:
        query, others = seen(file, image), [seen(reference, None) for reference in references]
        if extract is None:
            return _match_photographs(match, query, others, first_pixel)
        keypoints = _keypoints(query)
        return [_checked(result, (keypoints, _keypoints(other)))
                for other, result in zip(others, _as_many(match(query, others), others))]

    def matches(query: Sequence[str], references: Sequence[Sequence[str]],
                image: Optional[Image] = None) -> List[_Pixels]:
        if not references:
            return []
        with lock, _adapters.without_gradients():
            if stored is None or image is not None:
                return matched(query[1], image, [file for _, file in references])
            names = [name for name, _ in references]
            stamps = [stored.stamp(query, reference) for reference in references]
            found = stored.read(query[0], names, stamps)
            missing = [i for i, one in enumerate(found) if one is None]
            if not missing:
                return [one for one in found if one is not None]
            made = matched(query[1], None, [references[i][1] for i in missing])
            new = iter(stored.write(query[0], [names[i] for i in missing], [stamps[i] for i in missing], made))
            return [next(new) if one is None else one for one in found]

    return matches
