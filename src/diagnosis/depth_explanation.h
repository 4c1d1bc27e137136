// Explains why depth maps differ from the truth by one cause and its size, found by fitting. Each
// cause predicts what an estimated map e would be of the true map t,
//
//   shift, zoom, lens        e(p) = t(w(p)), w a motion of pixels
//   rotation, displacement,  e is what a camera sees that is turned, moved, or where the images of
//   time offset              a neighboring frame were taken
//   factor, offset, affine,  e = a t, t + b, a t + b; 1 / e = a / t + b; e = min(t, c) or max(t,
//                            c);
//   inverse offset, clamp    e in steps; e = t after a Gaussian
//   quantization, smoothing
//   flipped, ray length,     e is the mirrored t; t times the length of the ray of z = 1;
//   disparity, power law,    a / t + b; a t^p; another function of t; t after a median; the least
//   depth curve, median,     (or largest) t near p, everywhere or where t jumps
//   fattened foreground
//
// and its parameters are those with the least mean |r|, r = ln(e / predicted), over half of the
// blocks of pixels of all views together. The other half judges: a cause is named if it explains
// more than half of what is beyond noise, surely (by three standard errors over blocks), and every
// other cause surely explains less, by a tenth or more of what is left. Where two explain alike, as
// a rotation and a shift do where all is one plane, neither is named. Errors of which no one cause
// explains half are not explained.

#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/diagnosis/depth_faults.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The largest time offset that is tried, in frames.
inline constexpr int kMaxFrames = 3;

struct ExplainedView {
  Camera camera;              // of both maps' size
  DepthMap estimated, truth;  // z-depth
  double image_px = 1;        // of the image, that a pixel of the maps is wide
  // The cameras of the frames from kMaxFrames before to kMaxFrames after; the middle one is the
  // identity.
  std::array<std::optional<Rigid3>, 2 * kMaxFrames + 1> frames_from_cam;
  std::string name = {};  // of the image
  // Returns the true z-depth that a camera sees at a pixel which stands there in place of the
  // image's, 0 where there is none. It is empty where the truth is known by its map alone.
  std::function<double(const Rigid3& cam_from_map_camera, const Eigen::Vector2d& pixel)>
      truth_from = {};
};

// Returns a few of the images, evenly spread. Frames follow each other in the order of their names.
// `truth` must outlive them.
std::vector<ExplainedView> ViewsToExplain(const GeometrySource& source, const GeometrySource& truth,
                                          std::span<const PosedImage> images, int threads);

// Returns the best explanation. `noise_sigma` is the standard deviation of the noise of
// ln(estimated / true) from pixel to pixel. nullopt where there are too few pixels, and for
// panoramas. The result is the same for any `threads`.
std::optional<DepthExplanation> ExplainDepthErrors(std::span<const ExplainedView> views,
                                                   double noise_sigma, int threads);

// Puts a cause that was found before all else, in place of the traces that it leaves; says where
// there is none although errors are no less than what noise needs to be named.
void AddExplanation(const DepthExplanation& explanation, std::vector<Finding>& findings);

// Makes depth maps of a camera that is not quite the image's, as an uncalibrated depth camera gives
// them: to check that a comparison names the fault (depth_explanation.h has the same quantities).

struct DepthMisalignment {
  Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();  // by which the map lies off
  double zoom = 1;                                     // the map's focal length over the true one
  double lens = 0;                                     // k of c + (p - c) (1 + k (|p - c| / f)^2)
  Eigen::Vector3d rotation_deg = Eigen::Vector3d::Zero();  // of cam_from_map_camera, a vector

  // Throws OptionError for a value out of its range.
  void Validate() const;
  bool IsNone() const;
};

// Returns what the misaligned camera sees of a map that `camera` sees. The shift is in pixels of
// the camera's size, and the fields are applied to a pixel of the result in their order. Pixels
// that see what the map does not show are holes.
DepthMap MisalignDepth(const DepthMap& map, const Camera& camera,
                       const DepthMisalignment& misalignment);

}  // namespace raylift
