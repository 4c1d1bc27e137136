#!/usr/bin/env bash
# Installs a finished build and uses it from other projects, as a package and as a subproject.
# Usage: install_test.sh BUILD_FOLDER WORK_FOLDER COMPILER
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
source=$(cd "$here/../.." && pwd)
build=$1
work=$2
compiler=$3
rm -rf "$work"

cmake --install "$build" --prefix "$work/prefix" > /dev/null
"$work/prefix/bin/raylift" --version
as_consumer=(-DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_CXX_COMPILER="$compiler")
"$here/check_consumer.sh" "$work/consumer" "$source/assets/demo" "${as_consumer[@]}"

# Estimation alone is there without the packages of the others, and those are then missing.
without=()
for package in Ceres OpenCV OpenEXR assimp embree; do
  without+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON")
done
cmake -S "$here/consumer" -B "$work/estimation" -G Ninja "${as_consumer[@]}" "${without[@]}"
programs=$(cmake --build "$work/estimation" --target help | grep -o '^[a-z]*_[a-z]*: phony' | sort)
if [ "$programs" != "estimate_matches: phony" ]; then
  echo "estimation alone should offer one program, not: $programs" >&2
  exit 1
fi

# As a subproject it adds its libraries and nothing else.
mkdir "$work/parent"
cat > "$work/parent/CMakeLists.txt" << EOF
cmake_minimum_required(VERSION 3.22)
project(parent LANGUAGES CXX)
enable_testing()
add_subdirectory("$source" raylift)
add_executable(parent "$here/consumer/estimate_matches.cc")
target_link_libraries(parent raylift::estimation raylift::localization)
if(CMAKE_BUILD_TYPE OR CMAKE_CXX_COMPILER_LAUNCHER)
  message(FATAL_ERROR "The subproject chose the parent's settings.")
endif()
EOF
cmake -S "$work/parent" -B "$work/parent/build" -G Ninja -DCMAKE_CXX_COMPILER="$compiler" > /dev/null
if cmake --build "$work/parent/build" --target help | grep -E '_test:|bin/raylift'; then
  echo "The subproject builds programs." >&2
  exit 1
fi
