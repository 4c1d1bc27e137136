# What `cmake --install` and `cpack -G DEB` do. Two parts can be had alone (--component): raylift, the
# program, and libraylift-dev, the libraries and headers for other programs.
include(CMakePackageConfigHelpers)

set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/raylift)
set(docs_dir ${CMAKE_INSTALL_DATAROOTDIR}/doc)

if(RAYLIFT_BUILD_PROGRAM)
  install(TARGETS raylift RUNTIME COMPONENT raylift)
  # The program that was built writes its manual.
  install(CODE "
    execute_process(COMMAND \"$<TARGET_FILE:raylift>\" --man-pages man1
      WORKING_DIRECTORY \"${PROJECT_BINARY_DIR}\" COMMAND_ERROR_IS_FATAL ANY)" COMPONENT raylift)
  install(DIRECTORY ${PROJECT_BINARY_DIR}/man1 DESTINATION ${CMAKE_INSTALL_MANDIR}
    COMPONENT raylift)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/assets/cluster ${PROJECT_SOURCE_DIR}/assets/serve
    DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/raylift COMPONENT raylift USE_SOURCE_PERMISSIONS)
endif()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/raylift
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT libraylift-dev FILES_MATCHING PATTERN *.h)
foreach(part raylift libraylift-dev)
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${docs_dir}/${part} COMPONENT ${part}
    RENAME copyright)
  install(FILES ${PROJECT_SOURCE_DIR}/CITATION.cff DESTINATION ${docs_dir}/${part} COMPONENT ${part})
endforeach()

# Each library has its own file of targets, so that find_package can give one without what others need.
set(RAYLIFT_COMPONENT_NEEDS "")
get_property(layers GLOBAL PROPERTY RAYLIFT_LIBRARIES)
foreach(layer IN LISTS layers)
  install(TARGETS raylift_${layer} EXPORT raylift-${layer}
    LIBRARY COMPONENT raylift NAMELINK_COMPONENT libraylift-dev
    ARCHIVE COMPONENT libraylift-dev)
  install(EXPORT raylift-${layer} FILE raylift-${layer}-targets.cmake NAMESPACE raylift::
    DESTINATION ${config_dir} COMPONENT libraylift-dev)
  get_target_property(components_of_${layer} raylift_${layer} RAYLIFT_COMPONENTS)
  get_target_property(packages raylift_${layer} RAYLIFT_PACKAGES)
  string(APPEND RAYLIFT_COMPONENT_NEEDS
    "set(_raylift_${layer}_components ${components_of_${layer}})\n"
    "set(_raylift_${layer}_packages ${packages})\n")
endforeach()

# Each after those that it links.
set(RAYLIFT_COMPONENTS "")
while(layers)
  foreach(layer IN LISTS layers)
    set(below ${components_of_${layer}})
    list(REMOVE_ITEM below "" ${RAYLIFT_COMPONENTS})
    if(NOT below)
      list(APPEND RAYLIFT_COMPONENTS ${layer})
      list(REMOVE_ITEM layers ${layer})
    endif()
  endforeach()
endwhile()

configure_package_config_file(src/cmake/raylift-config.cmake.in ${PROJECT_BINARY_DIR}/raylift-config.cmake
  INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/raylift-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES
  ${PROJECT_BINARY_DIR}/raylift-config.cmake ${PROJECT_BINARY_DIR}/raylift-config-version.cmake
  ${PROJECT_SOURCE_DIR}/src/cmake/raylift-packages.cmake
  DESTINATION ${config_dir} COMPONENT libraylift-dev)

# For builds without CMake: what estimates alone, whose needs have such files themselves.
file(RELATIVE_PATH PC_PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" PC_PREFIX "${PC_PREFIX}")
configure_file(src/cmake/raylift-estimation.pc.in ${PROJECT_BINARY_DIR}/raylift-estimation.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/raylift-estimation.pc
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT libraylift-dev)

# The Debian packages.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "Raylift developers <maintainers@raylift.invalid>")
set(CPACK_COMPONENTS_ALL raylift libraylift-dev)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_RAYLIFT_PACKAGE_NAME raylift)
set(CPACK_DEBIAN_RAYLIFT_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RAYLIFT_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_RAYLIFT_DESCRIPTION "${PROJECT_DESCRIPTION}")
set(CPACK_DEBIAN_LIBRAYLIFT-DEV_PACKAGE_NAME libraylift-dev)
set(CPACK_DEBIAN_LIBRAYLIFT-DEV_PACKAGE_SECTION libdevel)
# What core and estimation need must be there. The rest is much, and only who links more than those
# needs it: apt installs it unless told not to.
set(CPACK_DEBIAN_LIBRAYLIFT-DEV_PACKAGE_DEPENDS "libeigen3-dev, libfmt-dev, libtbb-dev")
set(CPACK_DEBIAN_LIBRAYLIFT-DEV_PACKAGE_RECOMMENDS "libassimp-dev, libboost-dev, libceres-dev, libdraco-dev, libembree-dev, libhdf5-dev, libjpeg-dev, libmeshoptimizer-dev, libopencv-dev, libopenexr-dev, libopenvdb-dev, libpng-dev, libproj-dev, libpugixml-dev, libsqlite3-dev, libssl-dev, libtiff-dev, libwebp-dev, libzip-dev, zlib1g-dev")
if(BUILD_SHARED_LIBS)
  string(APPEND CPACK_DEBIAN_LIBRAYLIFT-DEV_PACKAGE_DEPENDS ", raylift (= ${PROJECT_VERSION})")
endif()
set(CPACK_DEBIAN_LIBRAYLIFT-DEV_DESCRIPTION
  "Libraries and headers of Raylift\n ${PROJECT_DESCRIPTION}.")
include(CPack)
