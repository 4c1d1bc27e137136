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
    (r"(def __eq__\(self, other: )typing\.Any", r"\1object"),
    (r"(def __array__\(.*-> )typing\.Any", r"\1numpy.typing.NDArray[numpy.float64]"),
    # A query is no tuple, but unpacks like one: no type of __iter__ says so.
    (r"class Query:", "class Query(tuple[str, Camera]):"),
    (r"( +)def __getitem__\(self, index: .*:\n +\.\.\.",
     r"\1def __new__(cls, *args: object, **kwargs: object) -> Query:\n\1    ..."),
    (r" +def (__iter__|__len__)\(self\) -> (collections\.abc\.Iterator|int):\n +\.\.\.\n", ""),
    # A pose has __array__, but is told from arrays first.
    (r"(def __mul__\(self, other: Rigid3\) -> Rigid3:)", r"\1  # pyright: ignore[reportOverlappingOverload]"),
    (r"\*args,", "*args: raylift._types.GeometryLike,"),
    (r"(?m)^import raylift\._types$", "import raylift._results\nimport raylift._types"),
    (r"(?m)^import typing$", "import typing\nimport typing_extensions"),
]
# What the bindings leave open: arguments, options and results ("return") by names of raylift/_types.py
# and raylift/_results.py, or of the module itself.
TYPES = {
    "ColmapModel.image": {"return": "_results.ModelImage"},
    "ColmapModel.points3d": {"return": "_results.ModelPoints"},
    "DepthMaps.__init__": {"kwargs": "_types.SpecValue"},
    "DepthMaps.from_arrays": {
        "maps": "collections.abc.Mapping[str, numpy.typing.ArrayLike]", "kwargs": "Unpack[_types.DepthMapOptions]"},
    "DepthMaps.load": {"return": "numpy.typing.NDArray[numpy.float32] | None"},
    "Geometry.lift": {"return": "_results.LiftedPixels"},
    "Lifter.lift": {"return": "_results.LiftedBySources"},
    "LocalizedQuery.counts": {"return": "_results.StageCounts"},
    "Localizer.__init__": {
        "reference_features": "collections.abc.Mapping[str, _types.FeaturesLike]",
        "kwargs": "Unpack[_types.LocalizerOptions]"},
    "Localizer.leave_one_out": {"return": "dict[str, LocalizedQuery]"},
    "Localizer.localize": {"query": "_types.PhotographLike"},
    "Localizer.localize_all": {"return": "dict[str, LocalizedQuery]"},
    "Mesh.read": {"files": "_types.PathLike"},
    "PoseEstimate.alternatives": {"return": "list[_results.AlternativePose]"},
    "PoseEstimate.noise": {"return": "_results.Noise | None"},
    "RayCaster.cast": {"return": "_results.RayHits"},
    "RayCaster.render": {"return": "_results.Pictures", "kwargs": "Unpack[_types.RenderOptions]"},
    "RayCaster.render_many": {
        "cameras": "_types.CameraLike | collections.abc.Sequence[_types.CameraLike]",
        "return": "list[_results.Pictures]", "kwargs": "Unpack[_types.RenderOptions]"},
    "RayCaster.score_views": {"return": "_results.ViewScores"},
    "Rigid3.__array__": {"dtype": "numpy.typing.DTypeLike | None", "copy": "bool | None"},
    "SfmPoints.__init__": {"kwargs": "_types.SpecValue"},
    "estimate": {"kwargs": "Unpack[_types.EstimateOptions]"},
    "estimate_all": {"kwargs": "Unpack[_types.EstimateOptions]"},
    "extract_features": {"return": "_results.FoundFeatures"},
    "filter_points": {
        "return": "tuple[PoseProblem, numpy.typing.NDArray[numpy.bool_], _results.FilterCounts]",
        "kwargs": "Unpack[_types.FilterThresholds]"},
    "merge_candidates": {"kwargs": "Unpack[_types.CandidateOptions]"},
    "read_poses": {"return": "dict[str, Rigid3]"},
    "refine_pose": {"kwargs": "Unpack[_types.EstimateOptions]"},
    "write_poses": {"poses": "collections.abc.Mapping[str, _types.PoseLike]"},
    "write_depth": {"return": "_results.WrittenDepth", "kwargs": "Unpack[_types.DepthWriteOptions]"},
}
HEAD = "# Written by make_stubs.py; do not edit.\n"


def with_types(text: str) -> str:
    """The stubs with what TYPES says in place of what is left open."""
    lines, owner = [], ""
    for line in text.splitlines():
        if found := re.match(r"(class|def) (\w+)", line):
            owner = found[2] + "." if found[1] == "class" else ""
        if found := re.match(r"\s*def (\w+)", line):
            for name, kind in TYPES.get(owner + found[1], {}).items():
                kind = re.sub(r"\b_(?=types|results)", "raylift._", kind).replace("Unpack", "typing_extensions.Unpack")
                pattern = r"-> .*:$" if name == "return" else rf"\b{name}: (typing\.Any|dict\[str, typing\.Any\])"
                line = re.sub(pattern, f"-> {kind}:" if name == "return" else f"{name}: {kind}", line)
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
    return HEAD + with_types("".join(parts))


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "raylift"
    (folder / "_core.pyi").write_text(make_stubs(), encoding="utf-8")
