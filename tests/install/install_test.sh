#!/usr/bin/env bash
# Installs a finished build and uses it from other projects, as a package and as a subproject.
# Usage: install_test.sh BUILD_FOLDER WORK_FOLDER COMPILER
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
source=$(cd "$here/../.." && pwd)
build=$(realpath "$1")
work=$(realpath --canonicalize-missing "$2")
compiler=$3
rm -rf "$work"

cmake --install "$build" --prefix "$work/prefix" > /dev/null
"$work/prefix/bin/raylift" --version
cmp "$source/assets/cluster/array.sbatch" "$work/prefix/share/raylift/cluster/array.sbatch"
as_consumer=(-DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_CXX_COMPILER="$compiler")
"$here/check_consumer.sh" "$work/consumer" "$source/assets/demo" "${as_consumer[@]}"

# With Eigen 5, which is compatible with itself alone.
mkdir "$work/eigen5"
eigen=$(sed -n 's/^Eigen3_DIR:PATH=//p' "$work/consumer/CMakeCache.txt")
echo "include($eigen/Eigen3Config.cmake)" > "$work/eigen5/Eigen3Config.cmake"
cat > "$work/eigen5/Eigen3ConfigVersion.cmake" << 'EOF'
set(PACKAGE_VERSION 5.0.1)
if(NOT PACKAGE_FIND_VERSION OR PACKAGE_FIND_VERSION_MAJOR EQUAL 5)
  set(PACKAGE_VERSION_COMPATIBLE TRUE)
endif()
EOF
cmake -S "$here/consumer" -B "$work/with_eigen5" -G Ninja "${as_consumer[@]}" -DEigen3_DIR="$work/eigen5" > /dev/null

# Without CMake.
if command -v pkg-config > /dev/null; then
  export PKG_CONFIG_PATH=$(dirname "$(find "$work/prefix" -name raylift-estimation.pc)")
  linked=()
  if [ -n "$(find "$work/prefix" -name libraylift_estimation.a)" ]; then linked=(--static); fi
  # shellcheck disable=SC2046
  "$compiler" -std=c++20 "$here/consumer/estimate_matches.cc" -o "$work/by_pkg_config" \
    $(pkg-config "${linked[@]}" --cflags --libs raylift-estimation)
  LD_LIBRARY_PATH=$(pkg-config --variable=libdir raylift-estimation) "$work/by_pkg_config" > "$work/by_pkg_config.txt"
  diff <("$work/consumer/estimate_matches") "$work/by_pkg_config.txt"
fi

# Without the packages that the other libraries link, there is estimation; static libraries of the
# others are then missing (shared ones bring their own).
without=()
for package in Ceres OpenCV OpenEXR assimp embree; do
  without+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON")
done
cmake -S "$here/consumer" -B "$work/estimation" -G Ninja "${as_consumer[@]}" "${without[@]}"
rules=$work/estimation/build.ninja
if ! grep -q 'estimate_matches\.cc\.o' "$rules"; then
  echo "Estimation should need none of ${without[*]}" >&2
  exit 1
fi
if [ -n "$(find "$work/prefix" -name 'libraylift_lifting.a')" ] && grep -q 'lift_keypoints\.cc\.o' "$rules"; then
  echo "A static raylift::lifting was found without what it links." >&2
  exit 1
fi

# A misspelt component is told from those that there are.
mkdir "$work/misspelt"
cat > "$work/misspelt/CMakeLists.txt" << EOF
cmake_minimum_required(VERSION 3.22)
project(misspelt LANGUAGES CXX)
find_package(raylift REQUIRED COMPONENTS estimatoin)
EOF
if cmake -S "$work/misspelt" -B "$work/misspelt/build" -G Ninja "${as_consumer[@]}" > "$work/misspelt/log" 2>&1 ||
   ! tr -s '\n ' ' ' < "$work/misspelt/log" | grep -q 'no raylift::estimatoin; there are .*estimation'; then
  cat "$work/misspelt/log" >&2
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
env -u CMAKE_BUILD_TYPE -u CMAKE_CXX_COMPILER_LAUNCHER cmake -S "$work/parent" -B "$work/parent/build" -G Ninja -DCMAKE_CXX_COMPILER="$compiler" > /dev/null
if grep -E '^build .*(_test\.dir|apps)/.*\.cc\.o' "$work/parent/build/build.ninja"; then
  echo "The subproject builds programs." >&2
  exit 1
fi

# A subproject that estimates alone needs nothing of what the other libraries link.
mkdir "$work/estimator"
cat > "$work/estimator/CMakeLists.txt" << EOF
cmake_minimum_required(VERSION 3.22)
project(estimator LANGUAGES CXX)
set(RAYLIFT_COMPONENTS estimation)
add_subdirectory("$source" raylift)
add_executable(estimator "$here/consumer/estimate_matches.cc")
target_link_libraries(estimator raylift::estimation)
EOF
for package in HDF5 JPEG PNG SQLite3 TIFF WebP libzip nlohmann_json; do
  without+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON")
done
cmake -S "$work/estimator" -B "$work/estimator/build" -G Ninja -DCMAKE_CXX_COMPILER="$compiler" "${without[@]}" > /dev/null
if grep -E '^build .*/(io|renderers|lifting|apps)/.*\.cc\.o' "$work/estimator/build/build.ninja"; then
  echo "The subproject builds more than estimation." >&2
  exit 1
fi
