"""What the tests of several files share."""

import os
from pathlib import Path

import pytest

from served import localize_demo


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of localize_demo(). Nothing writes to it but to its cache."""
    if made_before := os.environ.get("RAYLIFT_DEMO_RUN"):
        return Path(made_before)
    out = tmp_path_factory.mktemp("demo") / "run"
    localize_demo(out)
    return out
