#include "datasets/pseudo_ground_truth.h"

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/line_tokens.h"
#include "raylift/io/unit_quaternion.h"

namespace raylift {

using std::filesystem::path;

PseudoGroundTruth::PseudoGroundTruth(const path& pgt, const path& scene) {
  const path folder = std::filesystem::canonical(scene);
  const std::string room = folder.filename().string();
  const std::string place = folder.parent_path().filename().string();
  for (const std::string& name : {room, place + "_" + room}) {
    file_ = pgt / (name + "_train.txt");
    if (!std::filesystem::exists(file_)) continue;
    Read(file_);
    Read(pgt / (name + "_test.txt"));
    return;
  }
  throw InputError(
      pgt, fmt::format("expected {0}_train.txt and {0}_test.txt, or {1}_{0}_...", room, place));
}

void PseudoGroundTruth::Read(const path& file) {
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const std::string name(tokens.Token("name"));
    const auto rotation = UnitQuaternion(tokens.Quaternion("quaternion"));
    if (!rotation) tokens.Fail("quaternion: expected one of length 1");
    const Eigen::Vector3d translation = tokens.Vector<3>("translation");
    const double focal_px = tokens.Double("focal length");
    if (!(focal_px > 0)) tokens.Fail("focal length: expected a positive number");
    tokens.ExpectEnd();
    if (!rows_.emplace(name, Row{{*rotation, translation}, focal_px}).second) {
      tokens.Fail(fmt::format("{} stands twice", name));
    }
  }
}

std::optional<PosedImage> PseudoGroundTruth::Find(const std::string& name,
                                                  const PlaneSize& published,
                                                  const Camera& fitted) const {
  const auto row = rows_.find(name);
  if (row == rows_.end()) return std::nullopt;
  const std::vector<double> params = {row->second.focal_px, 0.5 * published.width_px,
                                      0.5 * published.height_px};
  const Camera camera(CameraModel::kSimplePinhole, published.width_px, published.height_px, params);
  return PosedImage{name, camera.Scaled(fitted.width_px(), fitted.height_px()),
                    row->second.cam_from_world};
}

}  // namespace raylift
