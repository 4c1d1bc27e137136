// Point clouds.

#include "fuzz/fuzz_targets.h"

#include "raylift/base/error.h"
#include "raylift/surfaces/point_cloud.h"

namespace raylift {
namespace {

template <size_t N>
void ReadAs(const char (&name)[N], std::string_view bytes) {
  const PointCloud cloud = ReadPointCloud(PutFile(name, bytes));
  const size_t count = cloud.points_in_world.size();
  RAYLIFT_CHECK(count > 0);
  RAYLIFT_CHECK(cloud.normals.empty() || cloud.normals.size() == count);
  RAYLIFT_CHECK(cloud.colors_rgb.empty() || cloud.colors_rgb.size() == count);
  for (const Eigen::Vector3d& point : cloud.points_in_world) RAYLIFT_CHECK(point.allFinite());
}

template <typename T>
void Put(size_t at, T value, std::string& bytes) {
  bytes.replace(at, sizeof(T), reinterpret_cast<const char*>(&value), sizeof(T));
}

// Two points: version 1.2 with colors, or 1.4.
std::string LasSeed(bool is_14) {
  const size_t header = is_14 ? 375 : 227, record = is_14 ? 36 : 26;
  std::string bytes(header + 2 * record, '\0');
  bytes.replace(0, 4, "LASF");
  Put(24, uint8_t{1}, bytes);
  Put(25, uint8_t(is_14 ? 4 : 2), bytes);
  Put(96, static_cast<uint32_t>(header), bytes);
  Put(104, uint8_t(is_14 ? 7 : 2), bytes);
  Put(105, static_cast<uint16_t>(record), bytes);
  Put(107, uint32_t(is_14 ? 0 : 2), bytes);
  if (is_14) Put(247, uint64_t{2}, bytes);
  for (size_t axis = 0; axis < 3; ++axis) Put(131 + 8 * axis, 0.001, bytes);
  Put(header + record, int32_t{1000}, bytes);
  return bytes;
}

std::vector<std::string> PcdSeeds() {
  std::string binary =
      "# .PCD v.7\nVERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
      "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary\n";
  binary += std::string(32, '\x3f');
  return {binary,
          "FIELDS x y z normal_x normal_y normal_z rgb\nSIZE 8 4 4 4 4 4 4\nTYPE F F F F F F F\n"
          "WIDTH 1\nHEIGHT 2\nDATA ascii\n0 0 1 0 0 1 4.2e-38\n1 1 nan 0 0 1 1\n"};
}

}  // namespace

std::vector<FuzzTarget> CloudFuzzTargets() {
  return {
      {"cloud_ply", [](std::string_view bytes) { ReadAs("cloud.ply", bytes); },
       [] {
         return std::vector<std::string>{
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
             "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
             "end_header\n0 0 0 0 0 1\n1 2 3 0 1 0\n"};
       },
       "element vertex face property list uchar int float double nx red green blue "
       "binary_little_endian binary_big_endian nan 1e308 18446744073709551615"},
      {"cloud_las", [](std::string_view bytes) { ReadAs("cloud.las", bytes); },
       [] {
         return std::vector<std::string>{LasSeed(false), LasSeed(true)};
       },
       "LASF"},
      {"cloud_pcd", [](std::string_view bytes) { ReadAs("cloud.pcd", bytes); }, PcdSeeds,
       "VERSION FIELDS SIZE TYPE COUNT WIDTH HEIGHT VIEWPOINT POINTS DATA ascii binary "
       "binary_compressed rgb rgba normal_x nan 1e308 -1e308 65536 2147483648 "
       "18446744073709551615"},
      {"cloud_text", [](std::string_view bytes) { ReadAs("cloud.xyz", bytes); },
       [] {
         return std::vector<std::string>{"//X Y Z R G B Nx Ny Nz\n0 0 0 1 2 3 0 0 1\n",
                                         "0;0;0;255;0;0\n1;2;3;1;2;3\n", "2\n0 0 0\n1 1 1\n"};
       },
       "// X Y Z R G B Nx Ny Nz nan inf 1e308 , ; # 256"},
  };
}

}  // namespace raylift
