"""Each block of Python in the README and its pages runs where `assets` is, and what page_inputs.py makes.

RAYLIFT_PAGES=readme leaves the pages out, which take long.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(os.environ["RAYLIFT_SOURCE"])
PAGES = [SOURCE / "README.md"]
OF_ALL = os.environ.get("RAYLIFT_PAGES") != "readme"
if OF_ALL:
    PAGES += sorted((SOURCE / "assets/docs/pages").glob("*.md"))


def blocks() -> dict[str, str]:
    """Each once, by the page and the number of the line where it begins."""
    found: dict[str, str] = {}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in re.finditer(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
            found.setdefault(match[1], f"{page.name}:{text[:match.start()].count(os.linesep) + 2}")
    return {name: script for script, name in found.items()}


BLOCKS = blocks()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("cv2")
    pytest.importorskip("h5py")
    from page_inputs import write_page_inputs
    made = tmp_path_factory.mktemp("pages")
    (made / "assets").symlink_to(SOURCE / "assets")
    write_page_inputs(made)
    return made


def test_the_pages_have_blocks() -> None:
    expected = {"README.md", "coming-from.md", "python.md", "recipes.md"} if OF_ALL else {"README.md"}
    assert {name.split(":")[0] for name in BLOCKS} == expected


@pytest.mark.parametrize("name", BLOCKS)
def test_block(name: str, folder: Path) -> None:
    script = BLOCKS[name]
    if "raylift.onnx" in script:
        pytest.importorskip("onnxruntime")
    run = subprocess.run([sys.executable, "-c", script], cwd=folder, text=True, capture_output=True)
    assert run.returncode == 0, run.stderr
    assert not re.search(r"\b(failed|None|0 localized)\b", run.stdout), run.stdout
