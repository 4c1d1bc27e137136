"""Writes the pages that are made from the program and the Python package:
references.py RAYLIFT PACKAGE_FOLDER OUT_FOLDER
"""

import ast
import re
import subprocess
import sys
from pathlib import Path


def help_of(raylift, *command):
    return subprocess.run([raylift, *command, "--help"], check=True, capture_output=True, text=True).stdout


def commands_page(raylift):
    overview = help_of(raylift)
    names = re.findall(r"^  ([a-z-]+)  +\S", overview, flags=re.MULTILINE)
    parts = ["# Commands", f"```text\n{overview.strip()}\n```"]
    for name in names:
        parts.append(f"## {name}\n\n```text\n{help_of(raylift, name).strip()}\n```")
    return "\n\n".join(parts) + "\n"


def signature(function):
    """As a reader needs it: without `self`, and names of modules that all share."""
    text = ast.unparse(function.args)
    text = re.sub(r"^self(, )?", "", text)
    for module in ("raylift._types.", "collections.abc.", "typing_extensions.", "numpy.typing.", "typing."):
        text = text.replace(module, "")
    text = text.replace("SupportsInt | SupportsIndex", "int").replace("SupportsFloat | SupportsIndex", "float")
    result = ast.unparse(function.returns).replace("typing.", "").replace("numpy.typing.", "") if function.returns else ""
    return f"({text})" + (f" -> {result}" if result not in ("", "None") else "")


def documented(name, function, level):
    lines = [f"{'#' * level} `{name}`", f"```text\n{name}{signature(function)}\n```"]
    text = ast.get_docstring(function)
    if text:
        lines.append(text)
    return lines


def python_page(package):
    stubs = ast.parse((package / "_core.pyi").read_text(encoding="utf-8"))
    own = ast.parse((package / "_estimation.py").read_text(encoding="utf-8"))
    parts = ["# Python reference", "Made from the stubs; `help(raylift.NAME)` shows the same."]
    nodes = sorted((node for node in [*stubs.body, *own.body] if isinstance(node, (ast.ClassDef, ast.FunctionDef))
                    and not node.name.startswith("_")), key=lambda node: node.name.lower())
    for node in nodes:
        if isinstance(node, ast.FunctionDef):
            parts += documented(node.name, node, 2)
            continue
        parts += [f"## `{node.name}`", ast.get_docstring(node) or ""]
        for member in node.body:
            if not isinstance(member, ast.FunctionDef) or not ast.get_docstring(member):
                continue
            if any(isinstance(d, ast.Name) and d.id == "property" for d in member.decorator_list):
                parts.append(f"`{member.name}`: " + " ".join((ast.get_docstring(member) or "").split()))
            elif member.name == "__init__" or not member.name.startswith("_"):
                parts += documented(node.name if member.name == "__init__" else f"{node.name}.{member.name}", member, 3)
    return "\n\n".join(parts) + "\n"


def main():
    raylift, package, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    (out / "commands.md").write_text(commands_page(raylift), encoding="utf-8")
    (out / "python-reference.md").write_text(python_page(package), encoding="utf-8")


if __name__ == "__main__":
    main()
