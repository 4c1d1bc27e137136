"""What the tests of several files share."""

import os
import subprocess
from pathlib import Path

import pytest

from served import CRS, RAYLIFT, SCENE


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of `localize` on the demo, as if it stood in UTM's zone 32. Nothing writes to it but to its cache."""
    if made_before := os.environ.get("RAYLIFT_DEMO_RUN"):
        return Path(made_before)
    out = tmp_path_factory.mktemp("demo") / "run"
    subprocess.run([RAYLIFT, "localize", "--scene", SCENE, "--crs", CRS, "--out", out, "--quiet"], check=True)
    return out
