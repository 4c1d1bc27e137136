// Depth maps with known values, and scripts of other programs to write and read them.

#pragma once

#include <cstdlib>
#include <string>
#include <vector>

#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/depth_file.h"

namespace raylift {

inline constexpr int kRampWidth = 7;
inline constexpr int kRampHeight = 5;

// Every pixel has another value; all are integers that every sample type holds, 10 to 78.
inline float RampAt(int x, int y) { return static_cast<float>(10 + x + 13 * y); }
inline constexpr const char* kNumpyRamp =
    "ramp = 10 + np.arange(7)[None, :] + 13 * np.arange(5)[:, None]\n";

inline DepthMap MakeRamp() {
  DepthMap map{kRampWidth, kRampHeight, {}};
  for (int y = 0; y < kRampHeight; ++y) {
    for (int x = 0; x < kRampWidth; ++x) map.z.push_back(RampAt(x, y));
  }
  return map;
}

inline ::testing::AssertionResult IsRamp(const StoredDepth& depth) {
  if (depth.width_px != kRampWidth || depth.height_px != kRampHeight) {
    return ::testing::AssertionFailure() << depth.width_px << " x " << depth.height_px;
  }
  for (int y = 0; y < kRampHeight; ++y) {
    for (int x = 0; x < kRampWidth; ++x) {
      const float value =
          depth.values[static_cast<size_t>(y) * kRampWidth + static_cast<size_t>(x)];
      if (value != RampAt(x, y)) {
        return ::testing::AssertionFailure() << "(" << x << ", " << y << ") is " << value;
      }
    }
  }
  return ::testing::AssertionSuccess();
}

// Runs a script in `folder`, where np is numpy, cv2 is OpenCV (with OpenEXR) and ramp is the ramp.
inline std::string RunNumpy(const std::filesystem::path& folder, const std::string& script) {
  WriteFile(folder / "script.py",
            "import os, struct\nos.environ['OPENCV_IO_ENABLE_OPENEXR'] = '1'\n"
            "import numpy as np, cv2\nos.chdir('" +
                folder.string() + "')\n" + kNumpyRamp + script);
  return RunProgram("/usr/bin/python3 " + (folder / "script.py").string());
}

inline bool HasNumpyAndOpenCv() {
  return std::system("/usr/bin/python3 -c 'import numpy, cv2' > /dev/null 2>&1") == 0;
}

}  // namespace raylift
