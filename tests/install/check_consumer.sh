#!/usr/bin/env bash
# Builds the project in consumer/ with an installed Raylift and compares what its programs print.
# Usage: check_consumer.sh WORK_FOLDER DEMO_FOLDER [CMAKE_ARGUMENT]...
set -euo pipefail
source=$(cd "$(dirname "$0")/consumer" && pwd)
work=$1
demo=$2
shift 2

cmake -S "$source" -B "$work" -G Ninja -DCMAKE_BUILD_TYPE=Release "$@"
cmake --build "$work"
{
  "$work/estimate_matches"
  "$work/lift_keypoints"
  "$work/localize_photograph" "$demo"
} > "$work/printed.txt"
diff "$source/expected.txt" "$work/printed.txt"
# Where a library brings libunwind, exceptions are raised by GCC's unwinder all the same.
unwinder=$(readelf --dynamic "$work/localize_photograph" | sed -n 's/.*\[lib\(gcc_s\|unwind\)\.so.*/\1/p' | sed -n 1p)
if [ "$unwinder" = unwind ]; then
  echo "The consumer's exceptions are raised by libunwind." >&2
  exit 1
fi
