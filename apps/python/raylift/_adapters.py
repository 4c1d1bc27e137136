"""Extractors and matchers of other libraries, known by their attributes, as functions for Localizer.

Each becomes a function of photographs (H, W, 3), uint8, RGB, or of what an extractor returned of them. Where
it is known where they put the center of the first pixel, that becomes `first_pixel`. Nothing but numpy is
imported, and PIL for those who take its pictures; tensors are made by the torch that a model has brought.
"""

from __future__ import annotations

import contextlib
import sys
from typing import Any, Callable, ContextManager, Dict, List, Mapping, Optional, Protocol, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from . import _core

Array = NDArray[np.generic]
Image = NDArray[np.uint8]
Indices = NDArray[np.int64]
Prediction = Mapping[str, object]


class Match(Protocol):
    """Takes two photographs, or what an extractor returned of them."""

    def __call__(self, first: object, second: object, /) -> object: ...



# Pixels between those of the first photograph that are matched by MASt3R's descriptors or DUSt3R's
# points, as fast_reciprocal_NNs (mast3r/fast_nn.py) has it, and steps after which such a search ends.
_STEP_PX = 8
_MOST_STEPS = 10
# Pixels that are compared with all others at once.
_BLOCK = 64


def without_gradients() -> ContextManager[object]:
    torch = sys.modules.get("torch")
    return contextlib.nullcontext() if torch is None else torch.no_grad()


def numbers(value: object) -> Array:
    """The array that a tensor or a list holds."""
    detach = getattr(value, "detach", None)
    return np.asarray(value if detach is None else detach().cpu())


def _tensor(array: Array, model: Any) -> object:
    """float32, where the model is."""
    tensor = sys.modules["torch"].from_numpy(np.array(array, np.float32))
    weights = next(iter(model.parameters()), None) if hasattr(model, "parameters") else None
    return tensor if weights is None else tensor.to(weights.device)


def _planes(image: object) -> NDArray[np.float32]:
    """(3, H, W), from 0 to 1."""
    return np.asarray(image, np.float32).transpose(2, 0, 1) / np.float32(255)


def _asks_for(model: object, *keys: str) -> bool:
    asked = getattr(model, "required_data_keys", None)
    return isinstance(asked, (list, tuple)) and set(keys) <= set(asked)


def known_extractor(extractor: object) -> Optional[Callable[[Image], object]]:
    """The extractor as a function, where it is one of these."""
    detect = getattr(extractor, "detectAndCompute", None)
    if detect is not None:  # OpenCV's Feature2D
        return lambda image: detect(image, None)
    extract = getattr(extractor, "extract", None)
    if extract is not None and _asks_for(extractor, "image"):
        # SuperPoint, DISK, ALIKED and SIFT of LightGlue (lightglue/utils.py, Extractor.extract): resizes
        # by itself, and its keypoints are the photograph's, the first pixel's center being (0, 0).
        return lambda image: extract(_tensor(_planes(image), extractor))
    return None


def _of_features(matcher: Any) -> Match:
    """LightGlue (lightglue/lightglue.py; kornia's is the same): takes tensors with an axis for the batch, and
    image_size (width, height); returns indices."""

    def tensors(features: object) -> Dict[str, object]:
        if not isinstance(features, Mapping):
            raise _core.InputError("matcher: expected an extractor beside it that returns a dict of keypoints and "
                                   f"descriptors, found a {type(features).__name__}")
        return {name: _tensor(value[None], matcher) if isinstance(value, np.ndarray) else value
                for name, value in features.items()}

    return lambda first, second: matcher({"image0": tensors(first), "image1": tensors(second)})


def _of_planes(matcher: Any) -> Match:
    """vismatch, once image-matching-models (vismatch/base_matcher.py): takes (3, H, W) from 0 to 1, and returns
    pixels, among them matched_kpts0 and matched_kpts1. Where their first pixel is depends on its model."""
    return lambda first, second: matcher(*(_tensor(_planes(image), matcher) for image in (first, second)))


def _of_pictures(matcher: Any, first_pixel: float) -> Match:
    """RoMa, Tiny RoMa (romatch/models/matcher.py, tiny.py) and DKM: match() gives a warp (H, W, 4) from -1 to 1,
    edge to edge, and sample() some of its rows. The first pixel's center is (0.5, 0.5) of what
    to_pixel_coordinates() returns."""

    def match(first: object, second: object) -> object:
        from PIL import Image as Picture  # type: ignore[import-not-found, import-untyped, unused-ignore]

        images = [np.asarray(image) for image in (first, second)]
        warp, certainty = matcher.match(*(Picture.fromarray(image) for image in images))
        rows, certainty = matcher.sample(warp, certainty)
        pixels = matcher.to_pixel_coordinates(rows, *images[0].shape[:2], *images[1].shape[:2])
        found = [numbers(one).astype(float) + (first_pixel - 0.5) for one in (pixels[0], pixels[1])]
        return found[0], found[1], numbers(certainty)

    return match


def known_matcher(matcher: object, of_features: bool, first_pixel: float) -> Optional[Match]:
    """The matcher as a function, where it is one of these; of what an extractor returned, or of photographs."""
    if _asks_for(matcher, "image0", "image1"):
        return _of_features(matcher)
    if of_features:
        return None
    if all(hasattr(matcher, name) for name in ("match", "sample", "to_pixel_coordinates")):
        return _of_pictures(matcher, first_pixel)
    if all(hasattr(matcher, name) for name in ("load_image", "rescale_coords")):
        return _of_planes(matcher)
    return None


def _map(prediction: Prediction, *names: str) -> Optional[Array]:
    """(H, W, ...), of a batch of one."""
    found = next((numbers(prediction[name]) for name in names if name in prediction), None)
    is_batch = found is not None and (found.ndim == 4 or (found.ndim == 3 and names[0].endswith("conf")))
    return found[0] if found is not None and is_batch else found


def _nearest(rows: NDArray[np.float32], among: NDArray[np.float32]) -> Indices:
    """For each row the index of the nearest of the others."""
    half_squares = 0.5 * np.einsum("ij,ij->i", among, among)
    return np.concatenate([np.argmax(block @ among.T - half_squares, axis=1)
                           for block in np.split(rows, range(_BLOCK, len(rows), _BLOCK))])


def _reciprocal(first: Array, second: Array) -> Tuple[Indices, Indices]:
    """Indices of what is nearest to each other, from every _STEP_PX-th pixel of the first: fast reciprocal
    matching of MASt3R (arXiv 2406.09756, Sec. 3.3)."""
    height, width = first.shape[:2]
    rows = np.arange(_STEP_PX // 2, height, _STEP_PX)[:, None] * width
    at = (rows + np.arange(_STEP_PX // 2, width, _STEP_PX)).reshape(-1)
    firsts, seconds = (np.ascontiguousarray(one.reshape(-1, one.shape[2]), np.float32) for one in (first, second))
    found: List[Indices] = [np.zeros((0, 2), int)]
    for _ in range(_MOST_STEPS):
        if not len(at):
            break
        there = _nearest(firsts[at], seconds)
        back = _nearest(seconds[there], firsts)
        found.append(np.stack([at, there], axis=1)[back == at])
        at = np.unique(back[back != at])
    pairs = np.unique(np.concatenate(found), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _of_photograph(index: Indices, shape: Sequence[int], image: Image) -> NDArray[np.float64]:
    """The photograph's pixels of those of a map that load_images() made (dust3r/utils/image.py): it resizes
    edge to edge, for a square map to its size along the shorter side, else along the longer one, rounds both,
    and cuts off both ends of what is more."""
    rows, columns = np.divmod(index, shape[1])
    pixels = np.stack([columns, rows], axis=1).astype(float)
    size, map_size = np.array(image.shape[1::-1]), np.array([shape[1], shape[0]])
    longer_side = np.rint(shape[0] * (size.max() / size.min())) if shape[0] == shape[1] else map_size.max()
    resized = np.rint(size * longer_side / size.max())
    return np.asarray((pixels + resized // 2 - map_size / 2 + 0.5) * size / resized - 0.5, float)


def predictions_in(result: object) -> Optional[Tuple[Prediction, Prediction]]:
    """What MASt3R or DUSt3R predicts of two photographs: of inference(), or of the model itself."""
    pair = (result.get("pred1"), result.get("pred2")) if isinstance(result, Mapping) else result
    if not isinstance(pair, (tuple, list)) or len(pair) != 2:
        return None
    first, second = pair
    if isinstance(first, Mapping) and isinstance(second, Mapping) and {"desc", "pts3d"} & set(first):
        return first, second
    return None


def match_predictions(predictions: Tuple[Prediction, Prediction], photographs: Sequence[Image],
                      first_pixel: float) -> Dict[str, NDArray[np.float64]]:
    """Matches by descriptors (MASt3R), else by points in one frame (DUSt3R)."""
    maps = [_map(predictions[0], "desc", "pts3d"), _map(predictions[1], "desc", "pts3d_in_other_view")]
    if maps[0] is None or maps[1] is None:
        raise _core.InputError("matcher: expected desc of both predictions, or pts3d and pts3d_in_other_view")
    indices = _reciprocal(maps[0], maps[1])
    pixels = [_of_photograph(i, one.shape, image) for i, one, image in zip(indices, (maps[0], maps[1]), photographs)]
    result = {"mkpts0": pixels[0] + first_pixel, "mkpts1": pixels[1] + first_pixel}
    confidences = [_map(prediction, "desc_conf", "conf") for prediction in predictions]
    both = [one.reshape(-1)[i].astype(float) for one, i in zip(confidences, indices) if one is not None]
    if len(both) == 2:
        result["mconf"] = np.minimum(*both)
    return result
