# A port of the tree that it stands in: `vcpkg install raylift --overlay-ports=.ci/packages/vcpkg`.
get_filename_component(SOURCE_PATH "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

# Static libraries that are found without CMake files of their own must need nothing else: OpenVDB does.
vcpkg_check_features(OUT_FEATURE_OPTIONS FEATURE_OPTIONS FEATURES tools RAYLIFT_BUILD_PROGRAM)
vcpkg_cmake_configure(
  SOURCE_PATH "${SOURCE_PATH}"
  OPTIONS ${FEATURE_OPTIONS} -DRAYLIFT_BUILD_TESTS=OFF -DRAYLIFT_BUILD_PYTHON=OFF -DRAYLIFT_OPENVDB=OFF
)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/raylift)
if("tools" IN_LIST FEATURES)
  vcpkg_copy_tools(TOOL_NAMES raylift AUTO_CLEAN)
endif()
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/debug/include" "${CURRENT_PACKAGES_DIR}/debug/share")
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE")
