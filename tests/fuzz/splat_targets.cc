// Gaussian splats.

#include "fuzz/fuzz_targets.h"
#include "renderers/splat_blend.h"
#include "support/splat_files.h"

#include "raylift/base/error.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {
namespace {

// What was read must be fit for rays.
void Read(std::string_view bytes) {
  const auto splats = std::make_shared<const Splats>(ReadSplats(PutFile("splats.ply", bytes)));
  RAYLIFT_CHECK(!splats->means.empty());
  const std::vector<Eigen::Vector3f> colors = SplatColors(*splats, {0, 0, 0}, 1);
  RAYLIFT_CHECK(colors.empty() || colors.size() == splats->means.size());
  const RayCaster caster(splats, SplatDepth::kMedian);
  const Ray ray{{0, 0, 0}, splats->means[0].cast<double>()};
  SplatLook look;
  caster.LookAtSplats({&ray, 1}, colors, {&look, 1});
  RAYLIFT_CHECK(look.transmittance >= 0 && look.transmittance <= 1);
}

std::vector<std::string> Seeds() {
  TestSplat near{.mean = {0, 0, 2}};
  near.harmonics.resize(4);
  TestSplat far = near;
  far.mean.z() = 3;
  std::string packed = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n";
  for (const char* name :
       {"min_x", "min_y", "min_z", "max_x", "max_y", "max_z", "min_scale_x", "min_scale_y",
        "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z"}) {
    packed += std::string("property float ") + name + "\n";
  }
  packed +=
      "element vertex 1\nproperty uint packed_position\nproperty uint packed_rotation\n"
      "property uint packed_scale\nproperty uint packed_color\nelement sh 1\n";
  for (int i = 0; i < 9; ++i) packed += "property uchar f_rest_" + std::to_string(i) + "\n";
  packed += "end_header\n" + std::string(12 * 4 + 4 * 4 + 9, '\x3f');
  return {SplatPly({{near, far}}, SplatLayout::kEllipsoids),
          SplatPly({{near, far}}, SplatLayout::kDiscs), packed};
}

}  // namespace

std::vector<FuzzTarget> SplatFuzzTargets() {
  return {{"splat_ply", Read, Seeds,
           "element vertex chunk sh property list uchar uint float double opacity scale_0 rot_0 "
           "f_dc_0 f_rest_0 red packed_position min_x max_scale_x min_r binary_little_endian "
           "binary_big_endian 18446744073709551615"}};
}

}  // namespace raylift
