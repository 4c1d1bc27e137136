#!/usr/bin/env bash
# Installs what is missing, builds Raylift and runs it on the demo scene: query photographs of a
# courtyard are localized against its mesh from nothing but the images and the reference poses.
# Usage: assets/demo/run.sh [OUTPUT_FOLDER]   (default: build/demo)
# With RAYLIFT=/path/to/raylift that program is run and nothing is installed or built.
set -euo pipefail
cd "$(dirname "$0")/../.."
out=${1:-build/demo}
demo=assets/demo

if [ -z "${RAYLIFT:-}" ]; then
  .ci/install-packages build
  cmake --preset release > /dev/null
  cmake --build --preset release
fi
raylift=${RAYLIFT:-build/release/bin/raylift}

"$raylift" localize --model "$demo/model" --images "$demo/images" \
  --geometry "mesh:$demo/scene.obj" --queries "$demo/queries.txt" \
  --out "$out" --write-problems "$out/problems" --pictures 10 --overwrite

# The same matches through every method of the paper.
for method in p3p e5p1 adaptive select; do
  "$raylift" estimate "$out/problems" --method "$method" --poses "$out/$method.txt" --quiet
done
echo
"$raylift" evaluate --ground-truth "$demo/ground_truth" --thresholds 0.05,0.5:0.1,1:0.25,2 \
  --poses "$out"/{p3p,e5p1,adaptive,select}.txt --names P3P E5+1 Adaptive Select
echo
echo "Each query beside the mesh as seen from its pose: $out/pictures"
