#!/usr/bin/env bash
# Builds these pages as a site: assets/docs/build.sh RAYLIFT [OUT]   (default: build/docs)
# Needs the packages mkdocs and doxygen. Makes pictures and a gallery of the demo, which takes two minutes.
# Open OUT/index.html; no server is needed.
set -euo pipefail
raylift=$(realpath "$1")
cd "$(dirname "$0")/../.."
out=$(realpath --canonicalize-missing "${2:-build/docs}")
work=$(mktemp --directory)
trap 'rm -rf "$work"' EXIT

cp -r assets/docs/mkdocs.yml assets/docs/pages "$work"
cp assets/localized_query.jpg "$work/pages"
python3 assets/docs/references.py "$raylift" apps/python/raylift "$work/pages"
mkdir "$work/demo"
demo=$PWD/assets/demo script=$PWD/assets/docs/pictures.py
(cd "$work/demo" && python3 "$script" "$raylift" "$demo" "$work/pages")
mkdocs build --quiet --strict --clean --config-file "$work/mkdocs.yml" --site-dir "$out"

(
  cat << END
PROJECT_NAME = Raylift
INPUT = include
RECURSIVE = YES
EXTRACT_ALL = YES
GENERATE_LATEX = NO
OUTPUT_DIRECTORY = $out
HTML_OUTPUT = cpp-reference
QUIET = YES
WARNINGS = NO
HAVE_DOT = NO
JAVADOC_AUTOBRIEF = YES
# Comments are plain ones; those before and behind a declaration document it.
INPUT_FILTER = "sed -E 's|^( *)// |\\1/// |; s|([;,]) +// |\\1 ///< |'"
STRIP_FROM_INC_PATH = include
FULL_PATH_NAMES = YES
STRIP_FROM_PATH = include
END
) | doxygen -
echo "$out/index.html"
