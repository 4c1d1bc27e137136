#include <string>
#include <vector>

#include "program.h"
#include <opencv2/core/utility.hpp>

int main(int argc, char** argv) {
  // Images are worked on side by side, on --threads; OpenCV's own threads would come on top.
  cv::setNumThreads(1);
  return raylift::RunProgram(std::vector<std::string>(argv + 1, argv + argc));
}
