# What the project's targets share, and how its libraries are made.

# Warnings, sanitizers, and the promise that the same source gives the same bytes (no contraction of
# a*b+c, which differs between machines). All code is position independent, so that a static library
# can become a part of a shared one, and one precompiled header serves libraries and programs.
add_library(raylift_options INTERFACE)
target_compile_features(raylift_options INTERFACE cxx_std_20)
target_compile_options(raylift_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual -Wcast-qual
  -Wformat=2 -Wimplicit-fallthrough -ffp-contract=off -fPIC
  $<$<BOOL:${RAYLIFT_WERROR}>:-Werror>)
# At -O3, GCC 12 takes the copy in "text" + std::string() for one of nearly all memory, and says so in
# one of four ways (GCC bug 105651, mended in 13). The other builds keep these warnings.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 12
    AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(raylift_options INTERFACE
    "$<$<CONFIG:Release>:-Wno-restrict;-Wno-stringop-overflow;-Wno-stringop-overread;-Wno-array-bounds>")
endif()
# GCC takes a file that is compiled with others for a header, which may have no types of its own.
if(CMAKE_UNITY_BUILD AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(raylift_options INTERFACE -Wno-subobject-linkage)
endif()
# TBB asks this of those who link it, and the precompiled header must know it of all.
target_compile_definitions(raylift_options INTERFACE $<$<CONFIG:Debug>:TBB_USE_DEBUG>)
if(RAYLIFT_SANITIZE)
  # Of undefined behavior the project's own code is asked alone: asking the tests' own lines as well
  # takes as long as compiling them.
  string(REPLACE "," "$<COMMA>" sanitize_all ${RAYLIFT_SANITIZE})
  string(REPLACE "$<COMMA>undefined" "" sanitize_tests ${sanitize_all})
  if(RAYLIFT_NOT_SANITIZED)
    set(not_sanitized -fno-sanitize=${RAYLIFT_NOT_SANITIZED})
  endif()
  set(is_test $<BOOL:$<TARGET_PROPERTY:RAYLIFT_IS_TEST>>)
  target_compile_options(raylift_options INTERFACE
    $<IF:${is_test},-fsanitize=${sanitize_tests},-fsanitize=${sanitize_all}>
    ${not_sanitized} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(raylift_options INTERFACE -fsanitize=${RAYLIFT_SANITIZE})
  # GCC loses what it knows of an empty std::optional at the sanitizers' calls.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    target_compile_options(raylift_options INTERFACE -Wno-maybe-uninitialized)
  endif()
endif()
# Private headers are included as "module/header.h", by their own module and by those above it.
target_include_directories(raylift_options INTERFACE ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR})
set(CMAKE_CXX_EXTENSIONS OFF)

# Static libraries hide all their symbols, so that what is linked with them does not pass them on.
# Shared ones show the namespace raylift and nothing that they took from elsewhere (Eigen's and the
# standard library's templates), by exports.map: marks in the headers would stand in each of
# them, and fail silently where an inner header declares a public class first.
if(NOT BUILD_SHARED_LIBS)
  set(CMAKE_CXX_VISIBILITY_PRESET hidden)
  set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
endif()

# raylift_add_kernels(<layer> <source> [FLAG...]): compiles a file once per instruction set (SimdLevel
# in base/instruction_sets.h), with vectors of RAYLIFT_KERNEL_BYTES and a namespace RAYLIFT_KERNEL_LEVEL.
# It takes no precompiled header: nothing that is compiled with these flags may reach the rest of the
# program.
set(RAYLIFT_X86_KERNELS 0)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set(RAYLIFT_X86_KERNELS 1)
endif()
target_compile_definitions(raylift_options INTERFACE RAYLIFT_X86_KERNELS=${RAYLIFT_X86_KERNELS})
function(raylift_add_kernels_of layer source level bytes)
  set(target raylift_${layer}_kernels_${level})
  add_library(${target} OBJECT ${source})
  target_compile_features(${target} PRIVATE cxx_std_20)
  target_link_libraries(${target} PRIVATE raylift_options)
  target_compile_definitions(${target} PRIVATE RAYLIFT_KERNEL_BYTES=${bytes} RAYLIFT_KERNEL_LEVEL=${level})
  target_compile_options(${target} PRIVATE -Wno-psabi -O3 ${ARGN})
  target_sources(raylift_${layer} PRIVATE $<TARGET_OBJECTS:${target}>)
endfunction()
function(raylift_add_kernels layer source)
  raylift_add_kernels_of(${layer} ${source} sse2 16 ${ARGN})
  if(RAYLIFT_X86_KERNELS)
    raylift_add_kernels_of(${layer} ${source} avx2 32 -mavx2 ${ARGN})
    raylift_add_kernels_of(${layer} ${source} avx512 64
      -mavx512f -mavx512dq -mavx512vl -mavx512bw -mprefer-vector-width=512 ${ARGN})
  endif()
endfunction()

# raylift_add_library(<layer> SOURCES ... PUBLIC ... PRIVATE ...) makes the target raylift_<layer>
# and its alias raylift::<layer>, which find_package(raylift COMPONENTS <layer>) gives, too.
function(raylift_add_library layer)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  set(target raylift_${layer})
  add_library(${target} ${ARG_SOURCES})
  add_library(raylift::${layer} ALIAS ${target})
  set_target_properties(${target} PROPERTIES
    EXPORT_NAME ${layer}
    DEFINE_SYMBOL ""  # else each would have a macro that the precompiled header lacks
    VERSION ${PROJECT_VERSION}
    SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_include_directories(${target} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  if(BUILD_SHARED_LIBS)
    set(exports ${PROJECT_SOURCE_DIR}/src/cmake/exports.map)
    target_link_options(${target} PRIVATE LINKER:--version-script=${exports})
    set_target_properties(${target} PROPERTIES LINK_DEPENDS ${exports}
      INSTALL_RPATH $ORIGIN)
    # Nobody replaces the library's own functions at run time, so they may be inlined.
    target_compile_options(${target} PRIVATE -fno-semantic-interposition)
  endif()
  # Who links the library needs neither our options nor headers that its own do not include.
  list(TRANSFORM ARG_PRIVATE REPLACE "^(nanoflann|nlohmann_json)::.*" "$<BUILD_INTERFACE:\\0>")
  target_link_libraries(${target} PUBLIC ${ARG_PUBLIC}
    PRIVATE ${ARG_PRIVATE} $<BUILD_INTERFACE:raylift_options>)
  raylift_precompile(${target} raylift_core
    <algorithm> <cmath> <filesystem> <functional> <map> <memory> <optional> <span> <string>
    <string_view> <vector> <Eigen/Core> <Eigen/Geometry> <fmt/format.h>)

  # What the installed package has to find (install.cmake). Other packages that a shared library links
  # privately are its own matter.
  set(components ${ARG_PUBLIC} ${ARG_PRIVATE})
  list(FILTER components INCLUDE REGEX "^raylift::")
  list(TRANSFORM components REPLACE "^raylift::" "")
  set(packages ${ARG_PUBLIC})
  if(NOT BUILD_SHARED_LIBS)
    list(APPEND packages ${ARG_PRIVATE})
  endif()
  list(FILTER packages EXCLUDE REGEX "^raylift::|BUILD_INTERFACE")
  list(TRANSFORM packages REPLACE "^raylift_package::" "")
  list(TRANSFORM packages REPLACE "^opencv_.*" "OpenCV")
  list(TRANSFORM packages REPLACE "^SQLite::.*" "SQLite3")
  list(TRANSFORM packages REPLACE "::.*" "")
  list(REMOVE_ITEM packages "" ${CMAKE_DL_LIBS})  # a part of the C library, and no package
  list(REMOVE_DUPLICATES packages)
  set_property(TARGET ${target} PROPERTY RAYLIFT_COMPONENTS "${components}")
  set_property(TARGET ${target} PROPERTY RAYLIFT_PACKAGES "${packages}")
  set_property(GLOBAL APPEND PROPERTY RAYLIFT_LIBRARIES ${layer})
endfunction()

# raylift_embed(<source> <file>...) makes the source of its template <source>.in, where the name of
# each text file in capitals, without folder and extension, stands for what it holds.
function(raylift_embed source)
  foreach(file ${ARGN})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${file})
    get_filename_component(name ${file} NAME_WE)
    string(TOUPPER ${name} name)
    file(READ ${file} ${name})
  endforeach()
  configure_file(${source}.in ${CMAKE_CURRENT_BINARY_DIR}/${source} @ONLY)
endfunction()

# raylift_precompile(<target> <owner> <header>...): <owner>, which is made first, precompiles the
# headers, and the others use its file. They must be compiled with its options (those of the file win)
# and with all of its definitions.
function(raylift_precompile target owner)
  if(RAYLIFT_PRECOMPILED_HEADERS AND "${target}" STREQUAL "${owner}")
    target_precompile_headers(${target} PRIVATE ${ARGN})
  elseif(RAYLIFT_PRECOMPILED_HEADERS)
    target_precompile_headers(${target} REUSE_FROM ${owner})
  endif()
endfunction()
