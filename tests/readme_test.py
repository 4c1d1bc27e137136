"""Runs what the README and its pages tell their readers to run: readme_test.py SOURCE_FOLDER RAYLIFT WORK_FOLDER
readme|pages [PACKAGE_FOLDER].

Every command in a ```sh block of the README, or of it and all pages, is run, with `raylift` on the PATH, in a
folder that holds `assets` and what tests/python/page_inputs.py makes with the Python package in PACKAGE_FOLDER;
without it, blocks that name these files are left out. What a ```text block shows of the output, its parts
between dots, must be there. No other block holds commands or code but ```python, which
tests/python/test_pages.py runs, and ```cpp, which tests/install builds. The demo's script is run with the
program that is already built; the test script is only looked for, as this test is part of it.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

LANGUAGES = {"sh", "python", "cpp", "cmake", "text"}
# Below the folder that page_inputs.py makes.
MADE = re.compile(r"(?<![\w/])(outputs|survey|phone|scannetpp|lamar)/")


def blocks_of(language, text):
    """Each once, in the order in which they are read: pages repeat what the README shows."""
    return list(dict.fromkeys(re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)))


def shown_after(block, text):
    """The parts of the output that a page shows below a block of commands, in order."""
    following = re.search(rf"^```sh\n{re.escape(block)}```\n+```text\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    return [part.strip() for part in following[1].split("...") if part.strip()] if following else []


def check_form(name, text, source):
    """Every block is one whose language says that it is run, or shown as output."""
    for language in re.findall(r"^```(.*)\n(?:.*\n)*?```$", text, flags=re.MULTILINE):
        if language not in LANGUAGES:
            sys.exit(f"{name}: a block of {language or 'no language'}, which no test runs")
    if len(re.findall(r"^```text$", text, flags=re.MULTILINE)) != len(re.findall(r"^```\n+```text$", text, flags=re.MULTILINE)):
        sys.exit(f"{name}: output that stands below no commands")
    prose = re.sub(r"^```.*\n(?:.*\n)*?```$", "", text, flags=re.MULTILINE)
    for line in re.findall(r"^    (.*)$", prose, flags=re.MULTILINE):
        # What this test is part of, or what .ci/check-python does.
        if line != "pip install ." and not os.access(source / line.split()[0], os.X_OK):
            sys.exit(f"{name}: an indented block is run by no test: {line}")


def main():
    source, raylift, work = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
    is_of_pages = sys.argv[4] == "pages"
    package = sys.argv[5] if len(sys.argv) > 5 else None
    readme = (source / "README.md").read_text(encoding="utf-8")
    pages = readme
    check_form("README.md", readme, source)
    for page in sorted((source / "assets/docs/pages").glob("*.md")):
        text = page.read_text(encoding="utf-8")
        check_form(page.name, text, source)
        pages += "\n" + text
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    (work / "assets").symlink_to(source / "assets")
    environment = dict(os.environ, PATH=f"{raylift.parent}:{os.environ['PATH']}", RAYLIFT=str(raylift))

    for link in re.findall(r"\]\(([^)#:]+)\)", readme):
        if not (source / link).exists():
            sys.exit(f"README.md links to {link}, which is not there")
    # Its C++ programs are those that are built against the installed library.
    programs = blocks_of("cpp", pages)
    consumer = [file.read_text(encoding="utf-8")
                for file in sorted((source / "tests/install/consumer").glob("*.cc"))]
    if programs != consumer:
        sys.exit("the programs in the pages are not those of tests/install/consumer")
    blocks = blocks_of("sh", pages if is_of_pages else readme)
    if not blocks:
        sys.exit("the pages hold no commands")
    if is_of_pages and package:
        subprocess.run([sys.executable, source / "tests/python/page_inputs.py", work], check=True,
                       env=dict(environment, PYTHONPATH=package, PYTHONDONTWRITEBYTECODE="1", RAYLIFT_SOURCE=str(source)))
    # OpenVDB may be missing, or too old (Ubuntu 22.04).
    told = subprocess.run([raylift, "fuse", "--model", "none", "--geometry", "mesh:none", "--out", "none.ply"],
                          cwd=work, capture_output=True, text=True).stderr
    cannot_fuse = "needs OpenVDB" in told
    for block in blocks:
        if cannot_fuse and "raylift fuse" in block or not package and MADE.search(block):
            continue
        print(block, flush=True)
        start = time.monotonic()
        run = subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=work, env=environment, text=True,
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        print(run.stdout, f"# {time.monotonic() - start:.0f} s\n", flush=True)
        if run.returncode != 0:
            sys.exit(f"exit code {run.returncode}")
        rest = run.stdout
        for part in shown_after(block, pages):
            if part not in rest:
                sys.exit(f"the pages show output that is not there: {part}")
            rest = rest[rest.index(part) + len(part):]

    demo = subprocess.run([source / "assets/demo/run.sh", work / "demo"], env=environment, check=True,
                          capture_output=True, text=True).stdout
    print(demo)
    for method in ("P3P", "E5+1", "Adaptive", "Select"):
        if not re.search(rf"^{re.escape(method)} ", demo, flags=re.MULTILINE):
            sys.exit(f"the demo's table has no row of {method}")
    if not list((work / "demo" / "pictures").rglob("*.jpg")):
        sys.exit("the demo drew no picture")


if __name__ == "__main__":
    main()
