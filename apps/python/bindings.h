// The parts of the module raylift._core; each adds its classes and functions.

#pragma once

#include <pybind11/pybind11.h>

namespace raylift::python {

void BindGeometry(pybind11::module_& module);
void BindEstimation(pybind11::module_& module);
void BindRendering(pybind11::module_& module);
void BindLifting(pybind11::module_& module);
void BindLocalization(pybind11::module_& module);
void BindIo(pybind11::module_& module);

}  // namespace raylift::python
