"""What an installed wheel says of the libraries that it brings is what is there and is linked."""

import hashlib
import importlib.metadata
import json
import re
from pathlib import Path
from typing import Any

import pytest

import raylift


def wheel_file(name: str) -> list[Path]:
    """Of the package that is imported; skips where it is no wheel that brings libraries."""
    try:
        installed = importlib.metadata.distribution("raylift")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("raylift is not installed from a wheel")
    files = {str(file): Path(str(file.locate())) for file in installed.files or []}
    is_it = files.get("raylift/__init__.py", Path()).resolve() == Path(raylift.__file__).resolve()
    found = [path for file, path in files.items() if re.fullmatch(name, file)]
    if not is_it or not found:
        pytest.skip("the package is none of a wheel that brings its libraries")
    return found


def bundled() -> dict[str, Any]:
    """The components that are files, by their names."""
    [sbom] = wheel_file(r".*\.dist-info/sboms/raylift\.cdx\.json")
    components = json.loads(sbom.read_text())["components"]
    assert all(one["licenses"] and (one.get("version") or "do nothing" in one["name"]) for one in components)
    return {one["properties"][0]["value"]: one for one in components if "properties" in one}


def test_the_libraries_are_those_that_are_named() -> None:
    components = bundled()
    there = {f"raylift.libs/{path.name}": path for path in wheel_file(r"raylift\.libs/.*")}
    assert components.keys() == there.keys()
    for name, path in there.items():
        assert components[name]["hashes"][0]["content"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_what_is_linked_is_named() -> None:
    components = bundled()
    mapped = {Path(line.split()[-1]) for line in Path("/proc/self/maps").read_text().splitlines() if ".so" in line}
    linked = {f"raylift.libs/{path.name}" for path in mapped if path.parent.name == "raylift.libs"}
    assert len(linked) > 10 and linked <= components.keys()


def test_each_library_has_its_license() -> None:
    texts = {path.name: path.read_text() for path in wheel_file(r".*\.dist-info/licenses/.*")}
    assert "BSD 3-Clause" in texts["LICENSE"]
    for name, one in bundled().items():
        is_ours = one["name"].endswith("(functions in its place that do nothing)")
        assert is_ours or len(texts[one["name"]]) > 200
        # GPL.
        assert is_ours or not re.search("cholmod|spqr|jbig", name)
