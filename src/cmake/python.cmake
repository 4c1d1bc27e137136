# Whether the Python module is built, and what it needs.

if("${RAYLIFT_BUILD_PYTHON}" STREQUAL "AUTO" AND NOT (RAYLIFT_BUILD_TESTS AND NOT RAYLIFT_SANITIZE))
  # With sanitizers the module takes long to build and to test: it is built where it is asked for.
  set(RAYLIFT_BUILD_PYTHON OFF)
elseif(RAYLIFT_BUILD_PYTHON)
  # The system's interpreter, for which the distribution's packages are; a build of a wheel has its own.
  if(NOT SKBUILD AND NOT Python_EXECUTABLE AND EXISTS /usr/bin/python3)
    set(Python_EXECUTABLE /usr/bin/python3 CACHE FILEPATH "Python for the module")
  endif()
  find_package(Python 3.9 QUIET COMPONENTS Interpreter Development.Module)
  set(PYBIND11_FINDPYTHON ON)
  if(Python_FOUND)
    find_package(pybind11 2.9 QUIET CONFIG)
  endif()
  if(pybind11_FOUND)
    set(RAYLIFT_BUILD_PYTHON ON)
  elseif("${RAYLIFT_BUILD_PYTHON}" STREQUAL "AUTO")
    message(STATUS "The Python module is not built: pybind11 or Python's headers are missing.")
    set(RAYLIFT_BUILD_PYTHON OFF)
  else()
    message(FATAL_ERROR "RAYLIFT_BUILD_PYTHON needs pybind11 and Python's headers; on Debian and Ubuntu, "
      "`apt-get install pybind11-dev python3-dev`.")
  endif()
endif()
