// Typical cameras of every model.

#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "raylift/geometry/camera.h"

namespace raylift {

struct TestCamera {
  std::string name;  // for the names of parameterized tests
  Camera camera;
};

inline void PrintTo(const TestCamera& test, std::ostream* out) { *out << test.name; }

// Distorted as real lenses are; the whole image lies in the valid domain.
std::vector<TestCamera> TypicalCameras();

}  // namespace raylift
