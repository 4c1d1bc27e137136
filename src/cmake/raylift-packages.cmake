# How each package that Raylift links is found: by the build and, installed, by find_package(raylift).

# A package without targets that serve is linked as raylift_package::<name>.
function(raylift_package name include_dir)
  if(NOT TARGET raylift_package::${name})
    add_library(raylift_package::${name} INTERFACE IMPORTED GLOBAL)
    set_target_properties(raylift_package::${name} PROPERTIES
      INTERFACE_INCLUDE_DIRECTORIES "${include_dir}" INTERFACE_LINK_LIBRARIES "${ARGN}")
  endif()
endfunction()

# raylift_find_library(<name> <header> <arguments of find_library>...) for a package without CMake
# files that serve.
macro(raylift_find_library name header)
  find_path(raylift_${name}_INCLUDE_DIR ${header} PATH_SUFFIXES hdf5/serial)
  find_library(raylift_${name}_LIBRARY ${ARGN})
  mark_as_advanced(raylift_${name}_INCLUDE_DIR raylift_${name}_LIBRARY)
  set(${name}_FOUND FALSE)
  if(raylift_${name}_INCLUDE_DIR AND raylift_${name}_LIBRARY)
    set(${name}_FOUND TRUE)
    raylift_package(${name} "${raylift_${name}_INCLUDE_DIR}" "${raylift_${name}_LIBRARY}")
  endif()
endmacro()

# raylift_find(<package>) sets <package>_FOUND.
macro(raylift_find package)
  if("${package}" STREQUAL "Eigen3")
    # No version: after 3.4 came 5, which refuses who asks for 3.
    find_package(Eigen3 QUIET NO_MODULE)
  elseif("${package}" STREQUAL "OpenCV")
    find_package(OpenCV QUIET COMPONENTS core imgproc features2d)
  elseif("${package}" STREQUAL "embree")
    find_package(embree 4 QUIET CONFIG)
    if(NOT embree_FOUND)
      find_package(embree 3.12 QUIET CONFIG)
    endif()
  elseif("${package}" STREQUAL "OpenEXR")
    find_package(OpenEXR QUIET CONFIG)
    if(TARGET OpenEXR::OpenEXR)
      raylift_package(OpenEXR "" OpenEXR::OpenEXR)
    elseif(OpenEXR_FOUND)  # 2.5, of Ubuntu 22.04
      raylift_package(OpenEXR "" OpenEXR::IlmImf)
    endif()
  elseif("${package}" STREQUAL "libzip")
    # Its own CMake files demand its command line tools, which are another package.
    raylift_find_library(libzip zip.h zip)
  elseif("${package}" STREQUAL "WebP")
    raylift_find_library(WebP webp/decode.h webp)
  elseif("${package}" STREQUAL "PROJ")
    find_package(PROJ QUIET CONFIG)
    if(TARGET PROJ::proj)
      raylift_package(PROJ "" PROJ::proj)
    else()  # Ubuntu 22.04 leaves its CMake files out
      raylift_find_library(PROJ proj.h proj)
    endif()
  elseif("${package}" STREQUAL "OpenVDB")
    # Its headers include Boost's, on which its package does not depend.
    raylift_find_library(OpenVDB openvdb/openvdb.h openvdb)
    find_path(raylift_Boost_INCLUDE_DIR boost/any.hpp)
    mark_as_advanced(raylift_Boost_INCLUDE_DIR)
    # Before version 9 (Ubuntu 22.04) they declare names of an older TBB.
    set(raylift_OpenVDB_VERSION 0)
    if(OpenVDB_FOUND)
      file(STRINGS ${raylift_OpenVDB_INCLUDE_DIR}/openvdb/version.h raylift_OpenVDB_VERSION
        REGEX "define OPENVDB_LIBRARY_MAJOR_VERSION_NUMBER")
      string(REGEX REPLACE "[^0-9]" "" raylift_OpenVDB_VERSION "${raylift_OpenVDB_VERSION}")
    endif()
    if(NOT raylift_Boost_INCLUDE_DIR OR raylift_OpenVDB_VERSION LESS 9)
      set(OpenVDB_FOUND FALSE)
    elseif(NOT raylift_Boost_INCLUDE_DIR STREQUAL raylift_OpenVDB_INCLUDE_DIR)
      set_property(TARGET raylift_package::OpenVDB APPEND PROPERTY
        INTERFACE_INCLUDE_DIRECTORIES "${raylift_Boost_INCLUDE_DIR}")
    endif()
  elseif("${package}" STREQUAL "Ceres")
    find_package(Ceres QUIET)
    # That of Ubuntu 22.04 brings libunwind by glog: exceptions must not be raised by that and caught by
    # GCC's.
    set(raylift_glog_libraries "")
    if(TARGET glog::glog)
      get_target_property(raylift_glog_libraries glog::glog INTERFACE_LINK_LIBRARIES)
    endif()
    if(raylift_glog_libraries MATCHES unwind)
      set_property(TARGET glog::glog APPEND PROPERTY
        INTERFACE_LINK_OPTIONS "LINKER:--push-state,--no-as-needed,-lgcc_s,--pop-state")
    endif()
  elseif("${package}" STREQUAL "HDF5")
    # FindHDF5 needs C enabled and adds all that HDF5 itself is linked with.
    raylift_find_library(HDF5 hdf5.h NAMES hdf5_serial hdf5 PATH_SUFFIXES hdf5/serial)
  else()
    find_package(${package} QUIET)
  endif()
endmacro()
