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
    modules = r"raylift\._\w+|_core|_types|collections\.abc|typing_extensions|numpy\.typing|typing"
    return re.sub(rf"\b({modules})\.", "", text)


def in_lines(text, width=100):
    """A call, one argument a line where it is long."""
    if len(text) <= width:
        return text
    opening = text.index("(")
    parts, depth, quote = [""], 0, ""
    for i, letter in enumerate(text[opening + 1:], opening + 1):
        if letter in "'\"":
            quote = "" if letter == quote else quote or letter
        depth += 0 if quote else (letter in "([{") - (letter in ")]}")
        if depth < 0:
            return text[:opening + 1] + "\n" + "\n".join(f"    {part.strip()}," for part in parts) + "\n" + text[i:]
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return text


def body_of(file):
    return ast.parse(file.read_text(encoding="utf-8")).body


def fields_of(file, title):
    """The dicts of a file, with those of their members that they have of others."""
    members, parts = {}, [title]
    for node in body_of(file):
        if not isinstance(node, ast.ClassDef) or any("Protocol" in ast.unparse(base) for base in node.bases):
            continue
        members[node.name] = [line for base in node.bases for line in members.get(ast.unparse(base), [])]
        members[node.name] += [without_modules(ast.unparse(line)) for line in node.body
                               if isinstance(line, ast.AnnAssign)]
        if not node.name.startswith("_"):
            text = "\n".join(members[node.name])
            parts += [f"### `{node.name}`", ast.get_docstring(node) or "", f"```text\n{text}\n```"]
    return parts


def documented(name, function, level=0):
    lines = [f"{'#' * level} `{name}`"] if level else []
    lines.append(f"```text\n{in_lines(name + signature(function))}\n```")
    text = ast.get_docstring(function)
    if text:
        lines.append(text)
    return lines


def methods_of(node, bases):
    """Its own, and those that it has of a class that is not public."""
    own = [member for member in node.body if isinstance(member, ast.FunctionDef)]
    names = {member.name for member in own}
    for base in node.bases:
        if isinstance(base, ast.Name) and base.id in bases:
            own = [member for member in methods_of(bases[base.id], bases) if member.name not in names] + own
    return own


def class_parts(prefix, node, bases):
    name = prefix + node.name
    members = methods_of(node, bases)
    parts = [f"## `{name}`", ast.get_docstring(node) or ""]
    for member in members:
        if member.name == "__init__":
            parts += documented(name, member)
    for member in members:
        if any(isinstance(d, ast.Name) and d.id == "property" for d in member.decorator_list):
            kind = without_modules(ast.unparse(member.returns))
            text = " ".join((ast.get_docstring(member) or "").split())
            parts.append(f"`{member.name}`: `{kind}`" + (f". {text}" if text else ""))
        elif not ast.get_docstring(member):
            continue
        elif member.name == "__call__":
            parts += documented(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", node.name).lower(), member, 3)
        elif not member.name.startswith("_"):
            parts += documented(f"{name}.{member.name}", member, 3)
    return parts


def module_parts(prefix, body, names=None):
    """Of what is public, or of these names."""
    classes = {node.name: node for node in body if isinstance(node, ast.ClassDef)}
    nodes = [node for node in body if isinstance(node, (ast.ClassDef, ast.FunctionDef))
             and (not node.name.startswith("_") if names is None else node.name in names)]
    parts = []
    for node in sorted(nodes, key=lambda node: node.name.lower()):
        if isinstance(node, ast.FunctionDef):
            parts += documented(prefix + node.name, node, 2)
        else:
            parts += class_parts(prefix, node, {name: one for name, one in classes.items() if name.startswith("_")})
    return parts


def python_page(package):
    """What the package says to be public, wherever it is defined, and its modules."""
    top = body_of(package / "__init__.py")
    [names] = [ast.literal_eval(node.value) for node in top
               if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"]
    files = [package / ("_core.pyi" if node.module == "_core" else f"{node.module}.py")
             for node in top if isinstance(node, ast.ImportFrom) and node.module]
    modules = [alias.name for node in top if isinstance(node, ast.ImportFrom) and not node.module
               for alias in node.names]
    body = [node for file in dict.fromkeys(files) for node in body_of(file)]
    defined = {node.name for node in body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    other_names = {target.id for node in body if isinstance(node, ast.Assign) for target in node.targets
                   if isinstance(target, ast.Name)}
    missing = set(names) - defined - other_names - set(modules) - {"__version__"}
    if missing:
        sys.exit(f"the Python reference lacks {', '.join(sorted(missing))}")
    parts = ["# Python reference", "Made from the package; `help(raylift.NAME)` shows the same. Modules: "
             + ", ".join(f"[raylift.{name}](#raylift{name})" for name in modules) + "."]
    parts += module_parts("", body, set(names))
    for name in modules:
        file = package / f"{name}.py"
        tree = ast.parse(file.read_text(encoding="utf-8"))
        parts += [f"## raylift.{name}", ast.get_docstring(tree) or "", *module_parts(f"{name}.", tree.body)]
    parts += fields_of(package / "_results.py", "## What functions return as dicts")
    parts += fields_of(package / "_types.py", "## What functions take as options")
    return "\n\n".join(parts) + "\n"


def main():
    raylift, package, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    (out / "commands.md").write_text(commands_page(raylift), encoding="utf-8")
    (out / "python-reference.md").write_text(python_page(package), encoding="utf-8")


if __name__ == "__main__":
    main()
