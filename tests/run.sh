#!/usr/bin/env bash
# Installs what is missing, builds Raylift with its tests and runs them.
# Usage: tests/run.sh [PRESET]   (default: test; `asan` for the sanitizers)
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-test}

.ci/install-packages test
cmake --preset "$preset" > /dev/null
cmake --build --preset "$preset"
ctest --preset "$preset" --parallel "$(nproc)"
