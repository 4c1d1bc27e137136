"""Extractors and matchers of other libraries, known by their attributes, as functions for Localizer.

Each becomes a function of photographs (H, W, 3), uint8, RGB, or of what an extractor returned of them. Where
it is known where they put the center of the first pixel, that becomes `first_pixel`. Nothing but numpy is
imported, and PIL for those who take its pictures; tensors are made by the torch that a model has brought.
"""

from __future__ import annotations

import contextlib
import sys
from typing import Any, Callable, ContextManager, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from . import _core

Array = NDArray[Any]
Match = Callable[[Any, Any], Any]
Prediction = Mapping[str, Any]

# Pixels between those of the first photograph that are matched by MASt3R's descriptors or DUSt3R's
# points, as fast_reciprocal_NNs (mast3r/fast_nn.py) has it, and steps after which such a search ends.
_STEP_PX = 8
_MOST_STEPS = 10
# Pixels that are compared with all others at once.
_BLOCK = 64


def without_gradients() -> ContextManager[object]:
    torch = sys.modules.get("torch")
    return contextlib.nullcontext() if torch is None else torch.no_grad()


def numbers(value: Any) -> Array:
    """The array that a tensor or a list holds."""
    detach = getattr(value, "detach", None)
    return np.asarray(value if detach is None else detach().cpu())


def _tensor(array: Array, model: Any) -> Any:
    """float32, where the model is."""
    tensor = sys.modules["torch"].from_numpy(np.array(array, np.float32))
    weights = next(iter(model.parameters()), None) if hasattr(model, "parameters") else None
    return tensor if weights is None else tensor.to(weights.device)


def _planes(image: Array) -> Array:
    """(3, H, W), from 0 to 1."""
    return image.transpose(2, 0, 1) / np.float32(255)


def _asks_for(model: Any, *keys: str) -> bool:
    asked = getattr(model, "required_data_keys", None)
    return isinstance(asked, (list, tuple)) and set(keys) <= set(asked)


def known_extractor(extractor: Any) -> Optional[Callable[[Array], object]]:
    """The extractor as a function, where it is one of these."""
    if hasattr(extractor, "detectAndCompute"):  # OpenCV's Feature2D
        return lambda image: extractor.detectAndCompute(image, None)
    if hasattr(extractor, "extract") and _asks_for(extractor, "image"):
        # SuperPoint, DISK, ALIKED and SIFT of LightGlue (lightglue/utils.py, Extractor.extract): resizes
        # by itself, and its keypoints are the photograph's, the first pixel's center being (0, 0).
        return lambda image: extractor.extract(_tensor(_planes(image), extractor))
    return None


def _of_features(matcher: Any) -> Match:
    """LightGlue (lightglue/lightglue.py; kornia's is the same): takes tensors with an axis for the batch, and
    image_size (width, height); returns indices."""

    def tensors(features: Any) -> Any:
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

    def match(first: Array, second: Array) -> Tuple[Array, Array, Array]:
        from PIL import Image  # type: ignore[import-not-found, import-untyped, unused-ignore]

        warp, certainty = matcher.match(Image.fromarray(first), Image.fromarray(second))
        rows, certainty = matcher.sample(warp, certainty)
        pixels = matcher.to_pixel_coordinates(rows, *first.shape[:2], *second.shape[:2])
        shift = first_pixel - 0.5
        return numbers(pixels[0]) + shift, numbers(pixels[1]) + shift, numbers(certainty)

    return match


def known_matcher(matcher: Any, of_features: bool, first_pixel: float) -> Optional[Match]:
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


def _nearest(rows: Array, among: Array) -> Array:
    """For each row the index of the nearest of the others."""
    half_squares = 0.5 * np.einsum("ij,ij->i", among, among)
    return np.concatenate([np.argmax(block @ among.T - half_squares, axis=1)
                           for block in np.split(rows, range(_BLOCK, len(rows), _BLOCK))])


def _reciprocal(first: Array, second: Array) -> Tuple[Array, Array]:
    """Indices of what is nearest to each other, from every _STEP_PX-th pixel of the first: fast reciprocal
    matching of MASt3R (arXiv 2406.09756, Sec. 3.3)."""
    height, width = first.shape[:2]
    rows = np.arange(_STEP_PX // 2, height, _STEP_PX)[:, None] * width
    at = (rows + np.arange(_STEP_PX // 2, width, _STEP_PX)).reshape(-1)
    firsts, seconds = (np.ascontiguousarray(one.reshape(-1, one.shape[2]), np.float32) for one in (first, second))
    found: List[Array] = [np.zeros((0, 2), int)]
    for _ in range(_MOST_STEPS):
        if not len(at):
            break
        there = _nearest(firsts[at], seconds)
        back = _nearest(seconds[there], firsts)
        found.append(np.stack([at, there], axis=1)[back == at])
        at = np.unique(back[back != at])
    pairs = np.unique(np.concatenate(found), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _of_photograph(index: Array, shape: Sequence[int], image: Array) -> Array:
    """The photograph's pixels of those of a map that load_images() made (dust3r/utils/image.py): it resizes
    edge to edge until the map is covered, and cuts off both ends of the longer side."""
    rows, columns = np.divmod(index, shape[1])
    pixels = np.stack([columns, rows], axis=1).astype(float)
    size, map_size = np.array(image.shape[1::-1]), np.array([shape[1], shape[0]])
    resized = np.rint(size * (map_size / size).max())
    return np.asarray((pixels + resized // 2 - map_size / 2 + 0.5) * size / resized - 0.5)


def predictions_in(result: Any) -> Optional[Tuple[Prediction, Prediction]]:
    """What MASt3R or DUSt3R predicts of two photographs: of inference(), or of the model itself."""
    pair = (result.get("pred1"), result.get("pred2")) if isinstance(result, Mapping) else result
    if not isinstance(pair, (tuple, list)) or len(pair) != 2:
        return None
    first, second = pair
    if isinstance(first, Mapping) and isinstance(second, Mapping) and {"desc", "pts3d"} & set(first):
        return first, second
    return None


def match_predictions(predictions: Tuple[Prediction, Prediction], photographs: Sequence[Array],
                      first_pixel: float) -> Dict[str, Array]:
    """Matches by descriptors (MASt3R), else by points in one frame (DUSt3R)."""
    maps = [_map(predictions[0], "desc", "pts3d"), _map(predictions[1], "desc", "pts3d_in_other_view")]
    if maps[0] is None or maps[1] is None:
        raise _core.InputError("matcher: expected desc of both predictions, or pts3d and pts3d_in_other_view")
    indices = _reciprocal(maps[0], maps[1])
    pixels = [_of_photograph(i, one.shape, image) for i, one, image in zip(indices, (maps[0], maps[1]), photographs)]
    result = {"mkpts0": pixels[0] + first_pixel, "mkpts1": pixels[1] + first_pixel}
    confidences = [_map(prediction, "desc_conf", "conf") for prediction in predictions]
    if confidences[0] is not None and confidences[1] is not None:
        result["mconf"] = np.minimum(confidences[0].reshape(-1)[indices[0]], confidences[1].reshape(-1)[indices[1]])
    return result
