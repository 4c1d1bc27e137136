"""Runs what the README and its pages tell their readers to run: readme_test.py SOURCE_FOLDER RAYLIFT WORK_FOLDER
[PACKAGE_FOLDER].

Every command in a ```sh block is run in a folder that holds nothing but `assets`, with `raylift` on
the PATH. The demo's script is run with the program that is already built; the test script is only
looked for, as this test is part of it. With PACKAGE_FOLDER, that of the Python package, every ```python
block is run, too.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import time


def blocks_of(language, text):
    """Each once, in the order in which they are read: pages repeat what the README shows."""
    return list(dict.fromkeys(re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)))


def main():
    source, raylift, work = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
    readme = (source / "README.md").read_text(encoding="utf-8")
    pages = "\n".join([readme] + [page.read_text(encoding="utf-8")
                                  for page in sorted((source / "assets/docs/pages").glob("*.md"))])
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    (work / "assets").symlink_to(source / "assets")
    environment = dict(os.environ, PATH=f"{raylift.parent}:{os.environ['PATH']}", RAYLIFT=str(raylift))

    for link in re.findall(r"\]\(([^)#:]+)\)", readme):
        if not (source / link).exists():
            sys.exit(f"README.md links to {link}, which is not there")
    for script in re.findall(r"^    (\S+\.sh)$", readme, flags=re.MULTILINE):
        if not os.access(source / script, os.X_OK):
            sys.exit(f"README.md names {script}, which cannot be run")
    # Its C++ programs are those that are built against the installed library.
    programs = blocks_of("cpp", pages)
    consumer = [file.read_text(encoding="utf-8")
                for file in sorted((source / "tests/install/consumer").glob("*.cc"))]
    if programs != consumer:
        sys.exit("the programs in the pages are not those of tests/install/consumer")
    blocks = blocks_of("sh", pages)
    if not blocks:
        sys.exit("the pages hold no commands")
    # OpenVDB may be missing, or too old (Ubuntu 22.04).
    told = subprocess.run([raylift, "fuse", "--model", "none", "--geometry", "mesh:none", "--out", "none.ply"],
                          cwd=work, capture_output=True, text=True).stderr
    cannot_fuse = "needs OpenVDB" in told
    for block in blocks:
        if cannot_fuse and "raylift fuse" in block:
            continue
        print(block, flush=True)
        start = time.monotonic()
        subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=work, env=environment, check=True)
        print(f"# {time.monotonic() - start:.0f} s\n", flush=True)

    for script in blocks_of("python", pages):
        if len(sys.argv) > 4:
            print(script, flush=True)
            subprocess.run([sys.executable, "-c", script], cwd=work, check=True,
                           env=dict(environment, PYTHONPATH=sys.argv[4], PYTHONDONTWRITEBYTECODE="1"))

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
