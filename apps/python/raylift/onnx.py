"""Extractors, matchers and global descriptors that are ONNX files, for Localizer; run by onnxruntime
(`pip install raylift[onnx]`).

    extractor = raylift.onnx.Extractor("superpoint.onnx", longer_side=1024)
    matcher = raylift.onnx.Matcher("lightglue.onnx", centered_keypoints=True)
    localizer = raylift.Localizer(scene, extractor=extractor, matcher=matcher,
                                  retrieval=raylift.onnx.GlobalDescriptor("netvlad.onnx"))

Tensors are known by their names ("image", "keypoints0", "descriptors", "scores", "matches0", ...) or
given: roles={"keypoints": "output_3"}. A photograph becomes (1, C, H, W), gray where C is 1, else RGB, as
float from 0 to 1, or uint8 where the graph takes that.

It is resized to the size that the graph's input has, or so that its longer side has `longer_side`
pixels, by a triangle filter that averages what becomes smaller, and edge to edge: its corners stay
corners. `first_pixel` says where the graph puts the center of its first pixel: (0, 0) as OpenCV and
most networks do, or 0.5. What it finds at x on a picture of the width w is
(x - first_pixel + 0.5) * W / w - 0.5 of the photograph's W: of all results the first pixel's center is
(0, 0), as Localizer takes them by default. doctor() tests it.
"""

from __future__ import annotations

import os
import re
from typing import (
    TYPE_CHECKING,
    Collection,
    Dict,
    List,
    Mapping,
    NamedTuple,
    NoReturn,
    Optional,
    Sequence,
    Tuple,
    Union,
    cast,
)

import numpy as np

from . import _core, _matching

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Unpack

    from ._results import FirstPixel, GraphFeatures, GraphMatches
    from ._types import Extractor as ExtractorLike
    from ._types import Matcher as MatcherLike
    from ._types import ModelOptions, PathLike

    Image = NDArray[np.uint8]
    Tensor = NDArray[np.generic]
    Numbers = NDArray[np.float64]
    Pixels = Union[NDArray[np.float32], NDArray[np.float64]]
    Features = Mapping[str, ArrayLike]

Roles = Optional[Mapping[str, str]]

# What tensors of each role are called, as far as exporters agree; the first that is there counts.
_NAMES = {
    "image": ("image", "images", "input", "pixel_values"),
    "keypoints": ("keypoints", "kpts"),
    "descriptors": ("descriptors", "desc", "descs"),
    "scores": ("scores", "mscores", "confidence", "conf", "mconf", "match_confidence", "matching_scores"),
    "matches": ("matches", "matches0"),
    "descriptor": ("descriptor", "global_descriptor", "embedding", "output"),
}
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(double)": np.float64,
          "tensor(uint8)": np.uint8, "tensor(int64)": np.int64, "tensor(int32)": np.int32}


class _Picture(NamedTuple):
    tensor: Pixels
    scale: Numbers  # (2,) of the photograph's pixels to the tensor's


def _taps(count: int, of: int) -> Tuple[NDArray[np.int64], Numbers]:
    """The pixels (count, K) of `of` that each of `count` is made of, and their weights."""
    step = of / count
    width = max(1.0, step)
    centers = (np.arange(count) + 0.5) * step - 0.5
    pixels = np.floor(centers - width)[:, None] + np.arange(1, int(2 * width) + 3)
    weights = np.clip(1 - np.abs(pixels - centers[:, None]) / width, 0, None)
    weights[(pixels < 0) | (pixels >= of)] = 0
    return np.clip(pixels, 0, of - 1).astype(int), weights / weights.sum(axis=1, keepdims=True)


def _resized(image: Pixels, width: int, height: int) -> Pixels:
    for axis, count in ((0, height), (1, width)):
        if image.shape[axis] == count:
            continue
        pixels, weights = _taps(count, image.shape[axis])
        shape = (count, 1, 1) if axis == 0 else (1, count, 1)
        image = np.asarray(sum(image.take(pixels[:, k], axis=axis) * weights[:, k].reshape(shape)
                               for k in range(pixels.shape[1])))
    return image


def _at_least(name: str, value: object, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise _core.InputTypeError(f"{name}: expected an int, found {type(value).__name__}")
    if value < least:
        raise _core.OptionError(f"{name} = {value}: must be at least {least}")
    if value >= 2**31:
        raise _core.OptionError(f"{name} = {value}: must be below 2^31")
    return int(value)


def _said(error: Exception) -> str:
    """onnxruntime's message in one line, without the place in its sources that some versions name."""
    return re.sub(r"/\S+\.(cc|h):\d+ [^(]*\(.*?\) ", " ", " ".join(str(error).split()))


class _Graph:
    """A file with its tensors by their roles."""

    def __init__(self, file: PathLike, roles: Roles, providers: Optional[Sequence[str]], threads: int) -> None:
        try:
            import onnxruntime  # type: ignore[import-not-found, import-untyped, unused-ignore]
        except ImportError:
            raise ImportError("raylift.onnx needs onnxruntime: pip install raylift[onnx]") from None
        self.file = os.fspath(file)
        if not os.path.exists(self.file):
            raise _core.InputError(f"{self.file!s}: no such file")
        settings = onnxruntime.SessionOptions()
        settings.intra_op_num_threads = _at_least("threads", threads, 0)
        settings.log_severity_level = 3
        try:
            self.session = onnxruntime.InferenceSession(
                self.file, settings, providers=list(providers or ["CPUExecutionProvider"]))
        except Exception as error:
            raise _core.InputError(f"{self.file!s}: {_said(error)}") from None
        self.inputs = {one.name: one for one in self.session.get_inputs()}
        self.outputs = {one.name: one for one in self.session.get_outputs()}
        self.roles = dict(roles or {})
        for role, name in self.roles.items():
            if name not in self.inputs and name not in self.outputs:
                self.fail(f"roles, {role}: there is no tensor {name}; there are {self.names()}")

    def names(self) -> str:
        return ", ".join([*self.inputs, *self.outputs])

    def fail(self, message: str) -> NoReturn:
        raise _core.InputError(f"{self.file!s}: {message}")

    def find(self, role: str, among: Collection[str], suffix: str = "") -> Optional[str]:
        """The tensor of a role, such as "keypoints" with the suffix "0"."""
        given = self.roles.get(role + suffix)
        if given in among:
            return given
        names = [name + suffix for name in _NAMES[role]]
        return next((name for name in names if name in among), None)

    def need(self, role: str, among: Collection[str], suffix: str = "") -> str:
        found = self.find(role, among, suffix)
        if found is None:
            self.fail(f"expected a tensor of {role + suffix} ({', '.join(n + suffix for n in _NAMES[role])}), "
                      f"found {self.names()}; roles={{...}} names it")
        return found

    def run(self, feeds: Mapping[str, Tensor]) -> Dict[str, Tensor]:
        typed = {name: np.ascontiguousarray(value, _TYPES.get(self.inputs[name].type)) for name, value in feeds.items()}
        missing = [name for name in self.inputs if name not in typed]
        if missing:
            self.fail(f"expected inputs that are known, found {', '.join(missing)} as well")
        try:
            return dict(zip(self.outputs, self.session.run(None, typed)))
        except Exception as error:
            self.fail(_said(error))

    def picture(self, name: str, image: Image, longer_side: Optional[int]) -> _Picture:
        image = np.asarray(image)
        if image.dtype != np.uint8 or image.ndim not in (2, 3):
            raise _core.InputError(f"image: expected a uint8 array of shape (height, width) or (height, width, 3), "
                                   f"found {image.dtype} of shape {image.shape}")
        shape = self.inputs[name].shape
        if len(shape) != 4:
            self.fail(f"{name}: expected a tensor (1, C, H, W), found {shape}")
        gray = shape[1] == 1
        pixels = np.atleast_3d(image).astype(np.float32)
        if gray and pixels.shape[2] == 3:
            pixels = pixels @ np.array([[0.299], [0.587], [0.114]], np.float32)
        elif not gray and pixels.shape[2] == 1:
            pixels = np.repeat(pixels, 3, axis=2)
        height, width = pixels.shape[:2]
        factor = 1.0 if longer_side is None else longer_side / max(height, width)
        new_height, new_width = (size if isinstance(size, int) else max(1, round(factor * old))
                                 for size, old in zip(shape[2:], (height, width)))
        tensor = _resized(pixels, new_width, new_height).transpose(2, 0, 1)[None]
        is_bytes = self.inputs[name].type == "tensor(uint8)"
        return _Picture(np.rint(tensor) if is_bytes else tensor / 255,
                        np.array([new_width / width, new_height / height]))


def _rows(values: Tensor, columns: Optional[int] = None) -> Tensor:
    """Without the axis of the batch."""
    values = np.asarray(values)
    if values.ndim == 3 and len(values) == 1:
        values = values[0]
    if columns is not None and (values.ndim != 2 or values.shape[1] != columns):
        raise _core.InputError(f"expected a tensor (N, {columns}), found {values.shape}")
    return values


def _list(values: Tensor) -> NDArray[np.float32]:
    return np.asarray(values, np.float32).reshape(-1)


class _Model:
    def __init__(self, file: PathLike, *, roles: Roles = None, longer_side: Optional[int] = None,
                 first_pixel: float = 0, providers: Optional[Sequence[str]] = None, threads: int = 0) -> None:
        """roles: names of tensors by their roles, where they are not called so. longer_side: pixels to
        which photographs are resized where the graph leaves it open; None: as they are. first_pixel:
        where the graph puts the center of the first pixel, from 0 to 1. providers: onnxruntime's, by
        default the CPU's. threads: 0 is all."""
        self._graph = _Graph(file, roles, providers, threads)
        self._longer_side = None if longer_side is None else _at_least("longer_side", longer_side, 1)
        if isinstance(first_pixel, bool) or not isinstance(first_pixel, (int, float, np.number)):
            raise _core.InputTypeError(f"first_pixel: expected a float, found {type(first_pixel).__name__}")
        if not 0 <= first_pixel <= 1:
            raise _core.OptionError(f"first_pixel = {first_pixel}: must lie between 0 and 1")
        self._first_pixel = float(first_pixel)

    def __repr__(self) -> str:
        return f"<raylift.onnx.{type(self).__name__} {os.fspath(self._graph.file)!s}>"

    def _picture(self, image: Image, suffix: str = "") -> Tuple[str, _Picture]:
        graph = self._graph
        name = graph.find("image", graph.inputs, suffix)
        if name is None and not suffix and len(graph.inputs) == 1:
            name = next(iter(graph.inputs))
        if name is None:
            name = graph.need("image", graph.inputs, suffix)
        return name, graph.picture(name, image, self._longer_side)

    def _scale(self, image: Image) -> Numbers:
        return self._picture(image, "" if isinstance(self, Extractor) else "0")[1].scale

    def _of_photograph(self, pixels: Tensor, scale: Numbers) -> Numbers:
        return (_rows(pixels, 2).astype(float) - self._first_pixel + 0.5) / scale - 0.5


class Extractor(_Model):
    """A graph from a photograph to keypoints (N, 2) and descriptors (N, D) or (D, N), perhaps scores."""

    def __call__(self, image: Image) -> GraphFeatures:
        """The features of a photograph (H, W) or (H, W, 3), uint8, RGB: a dict with keypoints,
        descriptors, image_size (width, height) and, where there are any, scores."""
        graph = self._graph
        name, picture = self._picture(image)
        found = graph.run({name: picture.tensor})
        keypoints = self._of_photograph(found[graph.need("keypoints", found)], picture.scale)
        name = graph.need("descriptors", found)
        descriptors = _rows(found[name])
        # Of as many keypoints as dimensions, the axis of a fixed size is that of the dimensions.
        declared = graph.outputs[name].shape[-2:]
        is_fixed = [isinstance(size, int) for size in declared]
        if len(descriptors) != len(keypoints) or is_fixed == [True, False]:
            descriptors = descriptors.T
        height, width = np.asarray(image).shape[:2]
        features: GraphFeatures = {
            "keypoints": keypoints, "image_size": np.array([width, height], np.int64),
            "descriptors": (np.asarray(descriptors, np.uint8) if descriptors.dtype == np.uint8
                            else np.asarray(descriptors, np.float32))}
        scores = graph.find("scores", found)
        if scores is not None:
            features["scores"] = _list(found[scores])
        return features


class Matcher(_Model):
    """A graph from two photographs (image0, image1) to the pixels that match (keypoints0, keypoints1), or
    from the features of both (keypoints0, descriptors0, ...) to indices: matches0 (N,), the second
    keypoint of each first one or -1, or matches (K, 2)."""

    def __init__(self, file: PathLike, *, centered_keypoints: bool = False, **options: Unpack[ModelOptions]) -> None:
        """centered_keypoints: the graph takes keypoints as LightGlue does, from the photograph's middle
        and by half of its longer side; their features need image_size, as Extractor gives it. options:
        as of Extractor."""
        super().__init__(file, **options)
        self._centered = centered_keypoints

    def __call__(self, first: Union[Image, Features], second: Union[Image, Features]) -> GraphMatches:
        """From photographs: pixels and scores of both, as a dict. From features: indices and scores."""
        graph = self._graph
        if graph.find("keypoints", graph.inputs, "0") is None:
            return self._match_photographs(cast("Image", first), cast("Image", second))
        feeds = {}
        for suffix, features in (("0", first), ("1", second)):
            if not isinstance(features, Mapping):
                graph.fail(f"expected features of both photographs, a dict, found {type(features).__name__}")
            for role in ("keypoints", "descriptors", "scores"):
                name = graph.find(role, graph.inputs, suffix)
                if name is None:
                    continue
                if role not in features:
                    graph.fail(f"{name}: expected features with {role}, found {', '.join(features)}")
                values = self._given(features) if role == "keypoints" else np.asarray(features[role])
                feeds[name] = values[None] if len(graph.inputs[name].shape) == values.ndim + 1 else values
        return self._named(graph.run(feeds), None)

    def _given(self, features: Features) -> Numbers:
        """Keypoints as the graph takes them."""
        pixels = np.asarray(features["keypoints"], float)
        if not self._centered:
            return pixels + self._first_pixel
        if "image_size" not in features:
            self._graph.fail("centered_keypoints needs features with image_size")
        size = np.asarray(features["image_size"], float)
        return (pixels + 0.5 - size / 2) / (float(size.max()) / 2)

    def _match_photographs(self, first: Image, second: Image) -> GraphMatches:
        pictures = [self._picture(image, suffix) for image, suffix in ((first, "0"), (second, "1"))]
        found = self._graph.run({name: picture.tensor for name, picture in pictures})
        return self._named(found, [picture.scale for _, picture in pictures])

    def _named(self, found: Mapping[str, Tensor], scales: Optional[List[Numbers]]) -> GraphMatches:
        """By the names that Localizer knows."""
        graph = self._graph
        result: Dict[str, Tensor] = {}
        if scales is not None:
            for suffix, scale in zip("01", scales):
                pixels = found[graph.need("keypoints", found, suffix)]
                result[f"keypoints{suffix}"] = self._of_photograph(pixels, scale)
        scores = graph.find("scores", found) or graph.find("scores", found, "0")
        if scores is not None:
            result["scores"] = _list(found[scores])
        matches = graph.find("matches", found)
        if matches is not None:
            rows = np.asarray(found[matches])
            # Of a batch of one: (1, N), (1, K, 2), or rows that begin with its index.
            is_list = matches.endswith("0")
            rows = rows[0] if rows.ndim == 3 or (rows.ndim == 2 and is_list and len(rows) == 1) else rows
            rows = rows[:, 1:] if rows.ndim == 2 and rows.shape[1] == 3 else rows
            result["matches"] = rows.astype(np.int64)
        elif scales is None:
            graph.need("matches", found)
        else:
            result = {"mkpts0": result.pop("keypoints0"), "mkpts1": result.pop("keypoints1"), **result}
        return cast("GraphMatches", result)


class GlobalDescriptor(_Model):
    """A graph from a photograph to one vector, by which photographs of one place are found."""

    def __call__(self, image: Image) -> NDArray[np.float32]:
        """The vector of a photograph (D,), float32, of unit length."""
        graph = self._graph
        name, picture = self._picture(image)
        found = graph.run({name: picture.tensor})
        output = graph.find("descriptor", found) or (next(iter(found)) if len(found) == 1 else None)
        vector = np.asarray(found[output or graph.need("descriptor", found)], np.float32).reshape(-1)
        return vector / max(float(np.linalg.norm(vector)), 1e-12)

    def retrieve(self, queries: Mapping[str, PathLike], references: Mapping[str, PathLike],
                 top_k: int = 10) -> Dict[str, List[str]]:
        """For the name of each query's photograph the names of the references most like it, best first."""
        names = list(references)
        if not names:
            return {name: [] for name in queries}
        vectors = np.array([self(_core.read_image(references[name])) for name in names])
        found = {}
        for name, file in queries.items():
            order = np.argsort(-(vectors @ self(_core.read_image(file))), kind="stable")
            found[name] = [names[i] for i in order if names[i] != name][:top_k]
        return found


# A keypoint of a mirrored photograph is looked for so far from where it is mirrored to, and across so far.
_FAR_PX = 8.0
_ACROSS_PX = 1.0
# Sides of the photograph become multiples of it, so that grids of networks are mirrored to themselves.
_GRID_PX = 32
_FEWEST = 20


def _center(shifts: Numbers, what: str) -> Tuple[float, float]:
    """Where most of them lie, and its standard deviation."""
    counts, edges = np.histogram(shifts, np.arange(-_FAR_PX - 0.125, _FAR_PX + 0.25, 0.25))
    most = np.convolve(counts, np.ones(3), "same").argmax()
    near = shifts[np.abs(shifts - (edges[most] + 0.125)) <= 0.5]
    if len(near) < _FEWEST:
        raise _core.InputError(f"{what}: expected {_FEWEST} that are found again, found {len(near)}")
    center = float(np.median(near))
    # Of a median 1.25 times as much as of a mean.
    return center, 1.25 * 1.4826 * float(np.median(np.abs(near - center))) / np.sqrt(len(near))


def _first_pixel_of_extractor(extractor: ExtractorLike, image: Image, axis: int) -> Tuple[float, float]:
    """By the photograph and its mirror image: x of the one and x' of the other are W - 1 + 2 first_pixel."""
    extract = _matching.extractor_of(extractor)
    first, second = (np.asarray(extract(one)["keypoints"], float)
                     for one in (image, np.ascontiguousarray(np.flip(image, 1 - axis))))
    second = second[np.argsort(second[:, 1 - axis], kind="stable")]
    shifts = [np.zeros(0)]
    for keypoint in first:
        begin, end = np.searchsorted(second[:, 1 - axis], keypoint[1 - axis] + np.array([-_ACROSS_PX, _ACROSS_PX]))
        shifts.append(keypoint[axis] + second[begin:end, axis] - (image.shape[1 - axis] - 1))
    near = np.concatenate(shifts)
    center, sigma = _center(near[np.abs(near) <= _FAR_PX], "extractor, keypoints of a mirrored photograph")
    return center / 2, sigma / 2


def _first_pixel_of_matcher(matcher: MatcherLike, image: Image, axis: int) -> Tuple[float, float]:
    """By the photograph and the middle of it with each pixel twice, which has the same size: x of the one, and
    x' of the other, of the same place, are such that x' = 2 (x - W / 4) + 1/2 - first_pixel."""
    top, left = image.shape[0] // 4, image.shape[1] // 4
    middle = np.repeat(np.repeat(image[top:3 * top, left:3 * left], 2, axis=0), 2, axis=1)
    first, second, _ = _matching.pixels_of(matcher, image, middle)
    shifts = 2 * (first[:, axis] - (left, top)[axis]) - second[:, axis] + 0.5
    return _center(shifts[np.abs(shifts) <= _FAR_PX], "matcher, matches with the enlarged middle of the photograph")


def doctor(photograph: Image, *, extractor: Optional[ExtractorLike] = None, matcher: Optional[MatcherLike] = None,
           first_pixel: float = 0) -> FirstPixel:
    """Tests where an extractor, or a matcher of photographs, puts the center of the first pixel: by a
    photograph (H, W, 3), uint8, and the same mirrored, or its middle enlarged, whose pixels are known exactly.

    Any that Localizer takes. first_pixel: as it is stated to Localizer, so of no model of this module, which
    know it. Returns what was measured, its standard deviation, and in words whether it is what was stated."""
    own = matcher if extractor is None else extractor
    if (extractor is None) == (matcher is None):
        raise _core.InputError("doctor: expected an extractor or a matcher, found "
                               f"{'neither' if own is None else 'both'}")
    image = np.asarray(photograph)
    image = image[:image.shape[0] // _GRID_PX * _GRID_PX, :image.shape[1] // _GRID_PX * _GRID_PX]
    measured = np.array([_first_pixel_of_matcher(cast("MatcherLike", matcher), image, axis) if extractor is None else
                         _first_pixel_of_extractor(extractor, image, axis) for axis in (0, 1)])
    stated = first_pixel
    if isinstance(own, _Model):
        # Its results are as Localizer takes them where what was stated is right.
        stated, measured = own._first_pixel, measured * own._scale(image)[:, None]
        measured[:, 0] += stated
    x, y = measured[:, 0].tolist()
    sigma = float(measured[:, 1].max())
    fits = next((of for of in (stated, 0.0, 0.5) if np.abs(measured[:, 0] - of).max() < max(0.125, 3 * sigma)), None)
    text = f"the first pixel's center is ({x:.2f}, {y:.2f}), +- {sigma:.3f}"
    if fits == stated:
        text += f", as stated: {stated:g}"
    elif fits is not None:
        text += f", not {stated:g} as stated: say first_pixel={fits:g}"
    else:
        text += f", neither {stated:g} as stated nor 0 or 0.5: "
        text += (f"first_pixel={(x + y) / 2:.2f} fits better" if 0 <= x <= 1 and abs(x - y) < max(0.05, 3 * sigma) else
                 "are pixels brought to the photograph's size edge to edge?")
    return {"x": x, "y": y, "sigma": sigma, "stated": float(stated), "fits": fits, "text": text}
