#!/usr/bin/env bash
# Fuzzes the readers by libFuzzer, each target for so many minutes, as many at a time as there are
# processors. Usage: tests/fuzz/run.sh MINUTES [TARGET...]   (default: all targets)
#
# What is learnt stays in build/fuzz/corpus, so that the next run goes on from it. A finding is
# written to build/fuzz/found/TARGET-*: mend the reader and move the file to
# tests/fuzz/findings/TARGET, where a test replays it from then on.
#
# A finding is whatever is neither success nor an InputError or OptionError: a sanitizer's report,
# another exception, 20 s for an input, 512 MB at once or 2 GB in all for one of at most 64 KB. Leaks
# are left to the replay under the sanitizers: HDF5 and assimp have many on broken files.
set -euo pipefail
cd "$(dirname "$0")/../.."
minutes=${1:?Usage: tests/fuzz/run.sh MINUTES [TARGET...]}
shift
program=${FUZZ_READERS:-build/fuzz/bin/fuzz_readers}
if [ -z "${FUZZ_READERS:-}" ]; then
  .ci/install-packages fuzz
  cmake --preset fuzz > /dev/null
  cmake --build --preset fuzz
fi
seconds=$(awk -v minutes="$minutes" 'BEGIN { printf "%d", 60 * minutes }')
mkdir -p build/fuzz/corpus build/fuzz/found build/fuzz/seeds build/fuzz/logs

fuzz() {
  local target=$1 seeds=build/fuzz/seeds/$1 corpora
  corpora=("build/fuzz/corpus/$target" "$seeds")
  local dictionary=()
  "$program" "--target=$target" "--prepare=$seeds"
  mkdir -p "${corpora[@]}"
  if [ -s "$seeds.dict" ]; then dictionary=("-dict=$seeds.dict"); fi
  if [ -d "tests/fuzz/findings/$target" ]; then
    corpora+=("tests/fuzz/findings/$target")
  fi
  "$program" "--target=$target" "${corpora[@]}" "${dictionary[@]}" -max_total_time="$seconds" \
    -artifact_prefix="build/fuzz/found/$target-" -timeout=20 -rss_limit_mb=2048 \
    -malloc_limit_mb=512 -detect_leaks=0 -max_len=65536 -close_fd_mask=3 -print_final_stats=1 \
    > "build/fuzz/logs/$target" 2>&1 && verdict=good || verdict=FINDING
  awk -v target="$target" -v verdict="$verdict" '
    /number_of_executed_units/ { runs = $2 }
    /average_exec_per_sec/ { speed = $2 }
    END { printf "%-20s %10d inputs %8d/s  %s\n", target, runs, speed, verdict }' \
    "build/fuzz/logs/$target"
  [ "$verdict" = good ]
}
export -f fuzz
export program seconds

if [ $# -gt 0 ]; then printf '%s\n' "$@"; else "$program" --list; fi |
  xargs -P "$(nproc)" -I{} bash -c 'fuzz {}'
