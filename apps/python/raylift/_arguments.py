"""What is wrong with the arguments of a compiled function, in one line: pybind11 tells it in many, by
all signatures and the names of C++ types."""

from __future__ import annotations

import re
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from . import _core

_NUMBERS = {"int": "an integer", "typing.SupportsInt": "an integer", "typing.SupportsIndex": "an integer",
            "float": "a number", "typing.SupportsFloat": "a number"}
_KINDS = {"list": "a list", "List": "a list", "tuple": "a tuple", "Tuple": "a tuple", "str": "a str", "bool": "True or False", "dict": "a dict", "None": "None", "ArrayLike": "an array",
          "PathLike": "a path", "CameraLike": "a camera", "PoseLike": "a pose", "PosedImageLike": "a reference",
          "QueryLike": "a query", "ModelLike": "a COLMAP model", "GeometryLike": "geometry",
          "Extractor": "an extractor", "Matcher": "a matcher", "Progress": "a callable"}
_LISTS = ("list", "List", "collections.abc.Sequence", "Sequence")
_MAPPINGS = ("dict", "Dict", "collections.abc.Mapping")


class _Parameter(NamedTuple):
    name: str
    kind: str
    required: bool
    by_position: bool


def _split(text: str, separator: str) -> List[str]:
    """At the separators that are outside of brackets."""
    parts, depth, start = [], 0, 0
    for i, character in enumerate(text):
        depth += (character in "([") - (character in ")]")
        if depth == 0 and text.startswith(separator, i):
            parts.append(text[start:i])
            start = i + len(separator)
    return [part.strip() for part in [*parts, text[start:]] if part.strip()]


def _inside(kind: str) -> Tuple[str, List[str]]:
    """"List[int]" is ("List", ["int"])."""
    found = re.fullmatch(r"([\w.]+)\[(.*)\]", kind)
    if found is None:
        return kind, []
    name, inner = found[1], _split(found[2], ",")
    if name.endswith("Annotated"):
        owner, elements = _inside(inner[0])
        size = re.search(r"FixedSize\((\d+)\)", found[2])
        return owner, [f"{elements[0]}[{size[1]}]"] if size else elements
    return name.replace("typing.", ""), inner


def _sized(element: str) -> Tuple[str, Optional[int]]:
    """"int[3]", of a list of three, is ("int", 3)."""
    found = re.fullmatch(r"(.+)\[(\d+)\]", element)
    return (found[1], int(found[2])) if found else (element, None)


def _is_list(value: Any) -> bool:
    return hasattr(value, "__len__") and hasattr(value, "__getitem__") and not isinstance(value, (str, bytes, dict))


def _fits(kind: str, value: Any) -> bool:
    name, inner = _inside(kind)
    options = _split(kind, "|")
    if len(options) > 1:
        return any(_fits(option, value) for option in options)
    if name == "Optional":
        return value is None or _fits(inner[0], value)
    if name in _NUMBERS:
        integer = hasattr(value, "__index__")
        return integer if _NUMBERS[name] == "an integer" else integer or hasattr(value, "__float__")
    if name in _LISTS and inner:
        element, size = _sized(inner[0])
        return _is_list(value) and size in (None, len(value)) and all(_fits(element, one) for one in value)
    if name in ("tuple", "Tuple") and inner:
        return _is_list(value) and len(value) == len(inner) and all(map(_fits, inner, value))
    if name in _LISTS or name in ("tuple", "Tuple"):
        return _is_list(value)
    if name == "str":
        return isinstance(value, (str, bytes))
    if name == "None":
        return value is None
    if name in _MAPPINGS:
        return isinstance(value, Mapping)
    if name.startswith("raylift._core."):
        return isinstance(value, getattr(_core, name[len("raylift._core."):]))
    if name.endswith(".Progress"):
        return callable(value)
    return value is not None


def _say(kind: str) -> str:
    """What is expected, in words."""
    name, inner = _inside(kind)
    options = _split(kind, "|")
    if name == "Optional":
        options = [*inner, "None"]
    if len(options) > 1:
        return " or ".join(dict.fromkeys(_say(option) for option in options))
    if name in _LISTS and inner:
        element, size = _sized(inner[0])
        return f"a list{'' if size is None else f' of {size}'}, each {_say(element)}"
    if name in ("tuple", "Tuple"):
        return f"({', '.join(map(_say, inner))})"
    if name.startswith("raylift._core."):
        return f"a raylift.{name[len('raylift._core.'):]}"
    return _NUMBERS.get(name) or _KINDS.get(name.split(".")[-1]) or "another type"


def _show(value: Any) -> str:
    """What came, in few words."""
    if isinstance(value, (type(None), bool, int, float, str, bytes)):
        text = repr(value)
        return text if len(text) < 60 else text[:57] + "..."
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        return f"an array of shape {shape}"
    kind = type(value).__name__
    return ("an " if kind[0] in "aeiouAEIOU" else "a ") + kind


def _faults(name: str, kind: str, value: Any) -> Iterator[str]:
    """The innermost of a list that is no other list."""
    if _fits(kind, value):
        return
    element = next((_sized(inner[0])[0] for option in [kind, *_split(kind, "|"), *_inside(kind)[1]]
                    for owner, inner in [_inside(option)] if owner in _LISTS and inner), None)
    if element is not None and isinstance(value, (list, tuple)):
        for i, one in enumerate(value):
            yield from _faults(f"{name}[{i}]", element, one)
    yield f"{name}: expected {_say(kind)}, found {_show(value)}"


def _parameters(signature: str) -> List[_Parameter]:
    parameters, by_position = [], True
    for part in _split(signature[signature.index("(") + 1:signature.rindex(")")], ","):
        if part == "*" or part.startswith("*args"):
            by_position = False
        elif not part.startswith("*") and part != "/":
            name, _, kind = part.partition(":")
            kind, has_default, _ = kind.partition(" = ")
            parameters.append(_Parameter(name.strip(), kind.strip(), not has_default, by_position))
    return parameters


def _fault(signature: str, arguments: Sequence[Any], keywords: Mapping[str, Any]) -> Optional[str]:
    """What keeps the arguments from a signature."""
    parameters = _parameters(signature)
    if parameters and parameters[0].name == "self":
        parameters, arguments = parameters[1:], arguments[1:]
    positional = [one for one in parameters if one.by_position]
    names = [one.name for one in parameters]
    if len(arguments) > len(positional) and "*args" not in signature:
        return f"expected at most {len(positional)} arguments without a name, found {len(arguments)}"
    given: Dict[str, Any] = dict(zip(names, arguments))
    for name, value in keywords.items():
        if name in given:
            return f"{name}: expected once, found twice"
        if name not in names and "**" not in signature:
            return f"{name}: there is no such argument; there are {', '.join(names)}"
        given[name] = value
    for one in parameters:
        if one.required and one.name not in given:
            return f"{one.name}: expected {_say(one.kind)}, found nothing"
        if one.name in given:
            for fault in _faults(one.name, one.kind, given[one.name]):
                return fault
    # Of the right types: what is left is integers that are too large.
    for one in parameters:
        value = given.get(one.name)
        if _say(one.kind).startswith("an integer") and isinstance(value, int) and not 0 <= value < 2**31:
            return f"{one.name}: expected an integer of its range, found {value}"
    return None


def explain(message: str, arguments: Sequence[object], keywords: Mapping[str, object]) -> str:
    """pybind11's message of arguments that fit none of a function's signatures, in one line."""
    if "incompatible constructor" in message:
        arguments = arguments[1:]  # the first is what is being made
    signatures = re.findall(r"^    \d+\. (.*)$", message.split("\n\nInvoked with")[0], flags=re.MULTILINE)
    faults = [_fault(signature, arguments, keywords) for signature in signatures]
    # With several signatures, the one that most arguments belong to.
    told = [fault for fault in faults if fault is not None]
    told.sort(key=lambda fault: "at most" in fault or "no such" in fault or "found nothing" in fault)
    return told[0] if told else f"{message.split('(')[0]}: arguments of other types or values are expected"
