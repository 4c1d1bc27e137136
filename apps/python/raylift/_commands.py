"""The program's commands as functions: the same options, with underscores, and the same defaults."""

from __future__ import annotations

import csv
import html
import json
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union, cast

from . import _core

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import (
        ColorOptions,
        CompareOptions,
        DoctorOptions,
        EvaluateOptions,
        ExperimentOptions,
        ExportOptions,
        ImportDatasetOptions,
        LocalizeOptions,
        RenderDatasetOptions,
        RetrieveOptions,
    )
    from ._results import Comparison, Diagnosis, Evaluation, LocalizeSummary, RenderSummary
    from ._types import PathLike, PoseLike, Progress

Poses = Union["PathLike", Mapping[str, Union["PoseLike", _core.LocalizedQuery]]]


def _text(value: object) -> str:
    if isinstance(value, float):
        return repr(float(value))  # of numpy's, too
    return str(os.fspath(value) if isinstance(value, os.PathLike) else value)


def _option(name: str, value: object) -> Iterator[str]:
    option = "--" + name.replace("_", "-")
    if value is None or value is False:
        return
    if value is True:
        yield option
    elif isinstance(value, (list, tuple)):
        for one in value:
            yield f"{option}={_text(one)}"
    else:
        yield f"{option}={_text(value)}"


def run(command: str, *arguments: object, progress: Optional[Progress] = None, quiet: bool = True,
        **options: object) -> None:
    """Runs a command of the program: `raylift COMMAND ARGUMENTS --options`.

    Options are keywords with underscores: True sets a flag, lists repeat an option, None and False
    leave it out. progress is called with (done, total, what). quiet=False prints tables on stdout;
    warnings are told on stderr, as by the program.

    Raises OptionError and InputError where the program would end with such a message, and
    KeyboardInterrupt after Ctrl-C, with what is on disk in good order.
    """
    words = [*map(_text, (command, *arguments))]
    for name, value in dict(options, quiet=quiet).items():
        words.extend(_option(name, value))
    _core.run_command(words, progress=progress)


def _pose_file(poses: Poses, folder: str, name: str) -> PathLike:
    if not isinstance(poses, Mapping):
        return poses
    file = Path(folder) / name
    found: Dict[str, Any] = {name: getattr(pose, "cam_from_world", pose) for name, pose in poses.items()}
    _core.write_poses(file, {name: pose for name, pose in found.items() if pose is not None})
    return file


def _json(file: PathLike) -> Any:
    return json.loads(Path(file).read_text(encoding="utf-8"))


def evaluate(poses: Union[Poses, Sequence[Poses]], ground_truth: Optional[Poses] = None, *,
             thresholds: Union[str, Sequence[Tuple[float, float]], None] = None,
             json: Optional[PathLike] = None, **options: Unpack[EvaluateOptions]) -> Evaluation:
    """`raylift evaluate`: recalls and median errors of poses against the truth.

    poses, ground_truth: files, or dicts of poses (cam_from_world) or LocalizedQuery by name; of poses
    also a list of these, one row of the table each. ground_truth may be a COLMAP model. thresholds:
    pairs of position and degrees. json: file that keeps the table. options: names, groups,
    calibration, geometry (dense errors), report, ... as of `raylift evaluate --help`.

    Returns the table, as the option --json writes it.
    """
    several: Sequence[Any] = poses if isinstance(poses, (list, tuple)) else [poses]
    if isinstance(thresholds, (list, tuple)):
        thresholds = ":".join(",".join(map(_text, pair)) for pair in thresholds)
    with tempfile.TemporaryDirectory() as folder:
        files = [_pose_file(one, folder, f"poses_{i}.txt") for i, one in enumerate(several)]
        truth = None if ground_truth is None else _pose_file(ground_truth, folder, "ground_truth.txt")
        table = json or Path(folder) / "table.json"
        run("evaluate", poses=files, ground_truth=truth, thresholds=thresholds, json=table, **options)
        return cast("Evaluation", _json(table))


def compare(model: PathLike, geometry: Union[Mapping[str, str], Sequence[str]],
            out: Optional[PathLike] = None, **options: Unpack[CompareOptions]) -> Comparison:
    """`raylift compare`: which source of geometry is best, where, and what is wrong with the others.

    geometry: specifications ("depth:maps") by the names that tables call them by, or a list of them.
    out: folder for the tables; none are kept where it is not given. options: truth, max_side, queries,
    images, ground_truth, report, ... as of `raylift compare --help`.

    Returns {"depth": ..., "localization": ...}, the latter (else None) where queries and their ground
    truth are given.
    """
    named = list(geometry)
    if isinstance(geometry, Mapping):
        named = [f"{name}={spec}" for name, spec in geometry.items()]
    with tempfile.TemporaryDirectory() as folder:
        tables = Path(folder if out is None else out)
        run("compare", model=model, geometry=named, out=tables, **options)
        localization = tables / "localization.json"
        return {"depth": _json(tables / "comparison.json"),
                "localization": _json(localization) if localization.exists() else None}


def doctor(model: PathLike, geometry: str, *, json: Optional[PathLike] = None,
           **options: Unpack[DoctorOptions]) -> Diagnosis:
    """`raylift doctor`: whether depth, mesh and poses are read as they were meant.

    json: file that keeps the diagnosis. options: images, or features, matches and pairs, queries, ...
    as of `raylift doctor --help`.

    Returns the diagnosis as the option --json writes it: verdict, fault, summary, repair, readings.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = json or Path(folder) / "diagnosis.json"
        run("doctor", model=model, geometry=geometry, json=file, **options)
        return cast("Diagnosis", _json(file))


def render_dataset(geometry: Union[str, Sequence[str]], out: PathLike, *,
                   products: Union[str, Sequence[str], None] = None,
                   **options: Unpack[RenderDatasetOptions]) -> RenderSummary:
    """`raylift render`: depth maps and other pictures of a mesh for every image of a data set.

    geometry: "mesh:PATH" or a list. products: "depth,normals" or a list. options: model or cameras,
    format, scale, resume, shard, threads, ... as of `raylift render --help`.

    Returns the summary that it writes.
    """
    if isinstance(products, (list, tuple)):
        products = ",".join(products)
    run("render", geometry=geometry, out=out, products=products, **options)
    return cast("RenderSummary", _json(Path(out) / "summary.json"))


def color(mesh: PathLike, out: PathLike, **options: Unpack[ColorOptions]) -> _core.Mesh:
    """`raylift color`: vertex colors for a bare mesh, from photographs with poses.

    mesh: a file, or "mesh:PATH[,key=value...]". out: the colored mesh (PLY). options: model, images,
    max_edge, keep_exposures, ... as of `raylift color --help`.

    Returns the colored mesh.
    """
    run("color", mesh, out=out, **options)
    return _core.Mesh.read(out)


colour = color  # its name in earlier versions


def import_dataset(dataset: str, folder: PathLike, out: PathLike,
                   **options: Unpack[ImportDatasetOptions]) -> List[Path]:
    """`raylift import`: scene files from one of the field's data sets ("7scenes", "cambridge", ...).

    Returns the scene files.
    """
    run("import", dataset, folder, out=out, **options)
    return sorted(Path(out).rglob("scene.toml"))


def experiment(file: PathLike, out: PathLike, *, set: Optional[Mapping[str, str]] = None,
               **options: Unpack[ExperimentOptions]) -> List[Dict[str, str]]:
    """`raylift experiment`: many ways to localize, from one file; tables, figures and a page in `out`.

    set: values of ${NAME} in the file. options: datasets, own_features, threads, ...

    Returns the rows of results.csv.
    """
    values = [f"{name}={value}" for name, value in (set or {}).items()]
    run("experiment", file, out=out, set=values, **options)
    if options.get("dry_run"):
        return []
    with open(Path(out) / "results.csv", newline="", encoding="utf-8") as results:
        return list(csv.DictReader(results))


def localize(out: PathLike, **options: Unpack[LocalizeOptions]) -> LocalizeSummary:
    """`raylift localize`: poses of query photographs in a known scene, to files.

    options: model (or scene), geometry, queries (or leave_one_out=True), images, ... as of
    `raylift localize --help`. Where out holds a former run, resume=True goes on with it, overwrite=True
    begins anew.

    Returns the summary that it writes beside poses.txt and queries.jsonl.
    """
    run("localize", out=out, **options)
    return cast("LocalizeSummary", _json(Path(out) / "summary.json"))


def export(form: str, poses: Poses, out: PathLike, **options: Unpack[ExportOptions]) -> Path:
    """`raylift export`: poses for other tools, form: "colmap", "glb", "hloc", "kapture", "kitti" or "tum".

    poses: folder of a run of localize, a pose file, or a dict of poses or LocalizedQuery by name. out:
    file, or folder for colmap and kapture. options: model, queries, geometry, names, times, ... as of
    `raylift export --help`.

    Returns out.
    """
    with tempfile.TemporaryDirectory() as folder:
        run("export", form, _pose_file(poses, folder, "poses.txt"), out=out, **options)
    return Path(out)


def retrieve(out: PathLike, **options: Unpack[RetrieveOptions]) -> Dict[str, List[str]]:
    """`raylift pairs`: which references look like each query, best first, written as hloc's pairs list.

    options: model, queries (or none: for each reference), images, retrieval ("vlad", "global", "pose",
    "overlap", "covisibility"), top_k, ... as of `raylift pairs --help`.

    Returns the list, the references' names by the query's.
    """
    run("pairs", out=out, **options)
    found: Dict[str, List[str]] = {}
    for line in Path(out).read_text(encoding="utf-8").splitlines():
        query, reference = line.split(", ") if ", " in line else line.split()  # of names with blanks
        found.setdefault(query, []).append(reference)
    return found


class Report:
    """A page that the option report=DIR made; a notebook shows it where it is a cell's value.

    path: DIR, or its index.html, which holds all that it shows.
    """

    def __init__(self, path: PathLike) -> None:
        if not isinstance(path, (str, os.PathLike)):
            raise _core.InputTypeError(f"path: expected a path (str or os.PathLike), found {type(path).__name__}")
        given = Path(path)
        self.path = given / "index.html" if given.is_dir() else given
        if not self.path.is_file():
            raise _core.InputError(f"{self.path}: there is no such page")

    def __repr__(self) -> str:
        return f"<raylift.Report {self.path}>"

    def _repr_html_(self) -> str:
        # In ASCII, as pages that it is pasted into may be read in any encoding.
        page = html.escape(self.path.read_text(encoding="utf-8")).encode("ascii", "xmlcharrefreplace").decode()
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 85vh; border: 0"></iframe>'


def main() -> int:
    """The program itself, as the command `raylift` of an installed package."""
    import signal
    import sys

    # As any program: Ctrl-C ends it, or lets it finish what it has in hand.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _core.run_program(sys.argv[1:])
