#include "datasets/nvm.h"

#include <fmt/format.h>

#include "raylift/base/text.h"
#include "raylift/io/line_tokens.h"

namespace raylift {
namespace {

NvmCamera ReadCamera(const LineReader& lines, std::string_view line) {
  LineTokens tokens(lines, line);
  NvmCamera camera;
  camera.name = tokens.Token("name");
  camera.focal_px = tokens.Double("focal length");
  if (!(camera.focal_px > 0)) tokens.Fail("focal length: expected a positive number");
  const Eigen::Vector4d q = tokens.Quaternion("quaternion");
  const Eigen::Vector3d center_in_world = tokens.Vector<3>("camera center");
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
  camera.cam_from_world = {rotation, -(rotation * center_in_world)};
  camera.radial_distortion = tokens.Double("radial distortion");
  return camera;
}

}  // namespace

std::vector<NvmCamera> ReadNvmCameras(const std::filesystem::path& file) {
  LineReader lines(file);
  const auto header = lines.NextContent();
  if (!header || !header->starts_with("NVM_V3")) lines.Fail("expected NVM_V3");
  const auto count_line = lines.NextContent();
  if (!count_line) lines.Fail("expected the number of cameras, found the end of the file");
  const uint64_t count = lines.Uint(Trim(*count_line), "number of cameras");
  std::vector<NvmCamera> cameras;
  while (cameras.size() < count) {
    const auto line = lines.NextContent();
    if (!line) {
      lines.Fail(fmt::format("expected {} cameras, found {}", count, cameras.size()));
    }
    cameras.push_back(ReadCamera(lines, *line));
  }
  return cameras;
}

}  // namespace raylift
