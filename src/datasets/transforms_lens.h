// The cameras of transforms.json, of which two tools have dialects: nerfstudio
// (nerfstudio/cameras/camera_utils.py: camera_model, distortion_params) and instant-ngp
// (src/nerf_loader.cu, read_lens: is_fisheye, x_fov).

#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/text/json_document.h"

#include "raylift/geometry/camera.h"
#include "raylift/scene/image.h"

namespace raylift {

// The camera of a frame: every number is the frame's own, else the one of the whole file. `photo`
// is asked where the file does not say the size. Throws InputError naming frame and member where it
// cannot be one of COLMAP's.
class TransformsLens {
 public:
  TransformsLens(const JsonPlace& frame, const JsonPlace& root) : frame_(frame), root_(root) {}

  bool SaysSize() const { return Has("w") && Has("h"); }
  Camera MakeCamera(const std::optional<PlaneSize>& photo) const;

 private:
  bool Has(std::string_view key) const { return frame_.Has(key) || root_.Has(key); }
  std::optional<double> Number(std::string_view key) const;
  double NumberOr(std::string_view key, double otherwise) const;
  std::optional<double> Focal(char axis, double side_px) const;
  std::string ModelName() const;
  // k1 k2 k3 k4 p1 p2, or what distortion_params holds.
  std::vector<double> Distortion() const;

  const JsonPlace& frame_;
  const JsonPlace& root_;
};

}  // namespace raylift
