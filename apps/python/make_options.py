"""Writes raylift/_options.py from the program's own options: make_options.py [OUT_FOLDER]

Needs the module; `PYTHONPATH=build/release/python` is enough. Without OUT_FOLDER, the file here is
written anew.
"""

import inspect
import re
import sys
from pathlib import Path
from typing import Callable, Iterator

sys.path.pop(0)  # beside this file, the package is not built
from raylift import _commands, _core

HEAD = '''# Written by make_options.py; do not edit.
"""The options of the program's commands, which its functions take as keywords."""

from __future__ import annotations

from typing import Literal, Sequence, SupportsIndex, TypedDict

from ._types import Progress, SpecValue
'''
# What values of each kind may be; None leaves an option out.
TYPES = {"FLAG": "bool", "INT": "SupportsIndex", "UINT": "SupportsIndex", "FLOAT": "float",
         "TEXT": "SpecValue"}


def type_of(kind: str) -> str:
    """The type of what _core.kinds_of_options() says: "INT", "p3p|e5p1", "TEXT ..."."""
    kind, _, several = kind.partition(" ")
    one = TYPES.get(kind) or "Literal[" + ", ".join(f'"{name}"' for name in kind.split("|")) + "]"
    if several:
        one += f" | Sequence[{one}]"
    return one if one == "bool" else one + " | None"


def functions() -> Iterator[tuple[str, str, Callable[..., object]]]:
    """The functions of commands: their names and the commands', with which their descriptions begin."""
    for name, function in vars(_commands).items():
        command = re.match(r"`raylift (\w+)`", inspect.getdoc(function) or "")
        if command and function.__name__ == name:  # an alias has another one
            yield name, command[1], function


def make_options() -> str:
    kinds, text = _core.kinds_of_options(), HEAD
    for name, command, function in sorted(functions()):
        text += f"\n\nclass {name.title().replace('_', '')}Options(TypedDict, total=False):\n"
        text += f'    """Options of {name}(): `raylift {command} --help` explains them."""\n\n'
        text += "    progress: Progress | None\n"
        taken = inspect.signature(function).parameters
        for option, kind in kinds[command].items():
            keyword = option.replace("-", "_")
            if keyword not in taken and not keyword.startswith("help"):  # --help, --help-files
                text += f"    {keyword}: {type_of(kind)}\n"
    return text


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "raylift"
    (folder / "_options.py").write_text(make_options(), encoding="utf-8")
