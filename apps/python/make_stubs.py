"""Writes raylift/_core.pyi from the compiled part, by pybind11-stubgen: make_stubs.py [OUT_FOLDER]

Needs pybind11-stubgen, and the module built with pybind11 3 or later, which tells more of types:
`pip install . pybind11-stubgen`. Without OUT_FOLDER, the stubs here are written anew.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

# What the generator leaves untyped or writes in numpy's old way.
REPAIRS = [
    (r"numpy\.ndarray\[(numpy\.\w+|bool)\]", r"numpy.typing.NDArray[\1]"),
    (r"NDArray\[(numpy\.)?bool\]", "NDArray[numpy.bool_]"),
    (r"\bdict(?=[:,)\s]| \|)(?!\[)", "dict[str, typing.Any]"),
    (r"(?<=-> )tuple(?=:)|(?<=: )tuple(?=\))", "tuple[typing.Any, ...]"),
    (r"(?<=-> )list(?=:)", "list[typing.Any]"),
    (r"\*\*kwargs\)", "**kwargs: typing.Any)"),
    (r"(__hash__: typing.ClassVar\[None\]) = None", r"\1  # type: ignore[assignment]"),
    (r"abc\.Iterator(?!\[)", "abc.Iterator[typing.Any]"),
    (r"(def __array__\(.*-> )typing\.Any", r"\1numpy.typing.NDArray[typing.Any]"),
    (r"\*args,", "*args: raylift._types.GeometryLike,"),
    (r"(?m)^import typing$", "import typing\nimport typing_extensions"),
]
# The options that functions take by keyword, as raylift/_types.py has them.
OPTIONS = {
    "DepthMaps.from_arrays": "DepthMapOptions",
    "Localizer.__init__": "LocalizerOptions",
    "RayCaster.render": "RenderOptions",
    "RayCaster.render_many": "RenderOptions",
    "estimate": "EstimateOptions",
    "estimate_all": "EstimateOptions",
    "filter_points": "FilterThresholds",
    "merge_candidates": "CandidateOptions",
    "refine_pose": "EstimateOptions",
    "write_depth": "DepthWriteOptions",
}
HEAD = "# Written by make_stubs.py; do not edit.\n"


def with_options(text: str) -> str:
    """The stubs with the options' types for what is left of keywords."""
    lines, owner = [], ""
    for line in text.splitlines():
        if found := re.match(r"(class|def) (\w+)", line):
            owner = found[2] + "." if found[1] == "class" else ""
        if found := re.match(r"\s*def (\w+)", line):
            options = OPTIONS.get(owner + found[1])
            if options is not None:
                line = line.replace("**kwargs: typing.Any",
                                    f"**kwargs: typing_extensions.Unpack[raylift._types.{options}]")
        lines.append(line.rstrip())
    return "\n".join(lines) + "\n"


def make_stubs() -> str:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "pybind11_stubgen", "raylift._core", "-o", folder, "--exit-code"],
                       check=True)
        text = (Path(folder) / "raylift/_core.pyi").read_text(encoding="utf-8")
    # Docstrings are prose: only code is repaired.
    parts = re.split(r'("""[\s\S]*?""")', text)
    for i in range(0, len(parts), 2):
        for pattern, replacement in REPAIRS:
            parts[i] = re.sub(pattern, replacement, parts[i])
    return HEAD + with_options("".join(parts))


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "raylift"
    (folder / "_core.pyi").write_text(make_stubs(), encoding="utf-8")
