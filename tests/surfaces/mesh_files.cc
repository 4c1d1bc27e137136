#include "mesh_files.h"

#include <algorithm>
#include <limits>

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {

Image TestPicture() {
  Image picture{4, 2, 3, {}};
  for (int i = 0; i < 4 * 2 * 3; ++i) picture.data.push_back(static_cast<uint8_t>(10 * i));
  return picture;
}

std::string TestPicturePng() {
  const Image rgb = TestPicture();
  cv::Mat bgr(rgb.height_px, rgb.width_px, CV_8UC3);
  for (int y = 0; y < rgb.height_px; ++y) {
    for (int x = 0; x < rgb.width_px; ++x) {
      const uint8_t* p = rgb.Pixel(x, y);
      bgr.at<cv::Vec3b>(y, x) = {p[2], p[1], p[0]};
    }
  }
  std::vector<uint8_t> png;
  cv::imencode(".png", bgr, png);
  return {png.begin(), png.end()};
}

std::vector<Eigen::Vector3d> Corners(const TriangleMesh& mesh) {
  std::vector<Eigen::Vector3d> corners;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t index : triangle) corners.push_back(mesh.VertexInWorld(index));
  }
  return corners;
}

double MaxCornerDistance(const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& expected) {
  const auto corners = Corners(mesh);
  if (corners.size() != expected.size()) return std::numeric_limits<double>::infinity();
  double largest = 0;
  for (size_t i = 0; i < corners.size(); ++i) {
    largest = std::max(largest, (corners[i] - expected[i]).norm());
  }
  return largest;
}

double SurfaceArea(const TriangleMesh& mesh) {
  double area = 0;
  const auto corners = Corners(mesh);
  for (size_t i = 0; i < corners.size(); i += 3) {
    area += 0.5 * (corners[i + 1] - corners[i]).cross(corners[i + 2] - corners[i]).norm();
  }
  return area;
}

int ReadTruncated(const std::filesystem::path& path, const std::string& contents, size_t step) {
  int meshes = 0;
  for (size_t size = 0; size < contents.size(); size += step) {
    WriteFile(path, contents.substr(0, size));
    try {
      EXPECT_FALSE(ReadMesh(path).triangles.empty());
      ++meshes;
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find(path.filename().string()), std::string::npos) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
  }
  return meshes;
}

std::string GlbOf(std::string json, const std::string& bin) {
  while (json.size() % 4 != 0) json += ' ';
  std::string glb = "glTF";
  AppendBytes(glb, uint32_t{2});
  AppendBytes(glb, static_cast<uint32_t>(12 + 8 + json.size() + 8 + bin.size()));
  AppendBytes(glb, static_cast<uint32_t>(json.size()));
  glb += "JSON" + json;
  AppendBytes(glb, static_cast<uint32_t>(bin.size()));
  return glb + std::string("BIN\0", 4) + bin;
}

}  // namespace raylift
