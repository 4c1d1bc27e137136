"""Runs what the README tells its readers to run: readme_test.py SOURCE_FOLDER RAYLIFT WORK_FOLDER
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


def main():
    source, raylift, work = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
    readme = (source / "README.md").read_text(encoding="utf-8")
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    (work / "assets").symlink_to(source / "assets")
    environment = dict(os.environ, PATH=f"{raylift.parent}:{os.environ['PATH']}", RAYLIFT=str(raylift))

    for script in re.findall(r"^    (\S+\.sh)$", readme, flags=re.MULTILINE):
        if not os.access(source / script, os.X_OK):
            sys.exit(f"README.md names {script}, which cannot be run")
    blocks = re.findall(r"^```sh\n(.*?)^```", readme, flags=re.MULTILINE | re.DOTALL)
    if not blocks:
        sys.exit("README.md holds no commands")
    for block in blocks:
        print(block, flush=True)
        subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=work, env=environment, check=True)

    for script in re.findall(r"^```python\n(.*?)^```", readme, flags=re.MULTILINE | re.DOTALL):
        if len(sys.argv) > 4:
            print(script, flush=True)
            subprocess.run([sys.executable, "-c", script], cwd=work, check=True,
                           env=dict(environment, PYTHONPATH=sys.argv[4], PYTHONDONTWRITEBYTECODE="1"))

    # Its C++ programs are those that are built against the installed library.
    programs = re.findall(r"^```cpp\n(.*?)^```", readme, flags=re.MULTILINE | re.DOTALL)
    consumer = [file.read_text(encoding="utf-8")
                for file in sorted((source / "tests/install/consumer").glob("*.cc"))]
    if programs != consumer:
        sys.exit("the programs in README.md are not those of tests/install/consumer")

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
