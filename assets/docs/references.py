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
    names = re.findall(r"^  ([a-z]+)(?:, [a-z]+)*  +\S", overview, flags=re.MULTILINE)
    parts = ["# Commands", f"```text\n{overview.strip()}\n```"]
    for name in names:
        parts.append(f"## {name}\n\n```text\n{help_of(raylift, name).strip()}\n```")
    return "\n\n".join(parts) + "\n"


def signature(function):
    """As a reader needs it: without `self`, and names of modules that all share."""
    text = ast.unparse(function.args)
    text = re.sub(r"^self(, )?", "", text)
    text = without_modules(text).replace("SupportsInt | SupportsIndex", "int")
    text = text.replace("SupportsFloat | SupportsIndex", "float")
    result = without_modules(ast.unparse(function.returns)) if function.returns else ""
    return f"({text})" + (f" -> {result}" if result not in ("", "None") else "")


def without_modules(text):
    return re.sub(r"\b(raylift\._\w+|collections\.abc|typing_extensions|numpy\.typing|typing)\.", "", text)


def results_of(package):
    """The dicts that functions return, with those of their members that they have of others."""
    members, parts = {}, ["## What functions return as dicts"]
    for node in ast.parse((package / "_results.py").read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.ClassDef):
            continue
        members[node.name] = [line for base in node.bases for line in members.get(ast.unparse(base), [])]
        members[node.name] += [ast.unparse(line) for line in node.body if isinstance(line, ast.AnnAssign)]
        if not node.name.startswith("_"):
            text = "\n".join(members[node.name])
            parts += [f"### `{node.name}`", ast.get_docstring(node) or "", f"```text\n{text}\n```"]
    return parts


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
    return "\n\n".join([*parts, *results_of(package)]) + "\n"


def main():
    raylift, package, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    (out / "commands.md").write_text(commands_page(raylift), encoding="utf-8")
    (out / "python-reference.md").write_text(python_page(package), encoding="utf-8")


if __name__ == "__main__":
    main()
