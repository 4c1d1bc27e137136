// Learns the standard deviation of ln(depth) that each confidence beside depth maps stands for,
// from matches between references whose poses are known.
//
// A match of a map's keypoint in another image shows the error of its depth: the keypoint projects
// e pixels along the epipolar line from its match, and a unit of ln(depth) moves the projection by
// g. With the noise s of keypoints, that is known across the lines, and the share w of wrong
// matches,
//
//   p(e | c) = (1 - w) N(e; 0, s^2 + g^2 sigma(c)^2) + w / extent
//
// where sigma(c) is the monotone function of the confidence c, falling or rising, of the greatest
// likelihood. It is used where it predicts the matches of references that it was not learned from
// better than one sigma of all depths does, by more than two standard errors over eight maps or
// more.

#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/geometry_source.h"

namespace raylift {

struct ConfidenceWorth {
  struct Knot {
    double confidence;  // as stored
    double sigma;       // of ln(depth)
  };
  std::vector<Knot> knots = {};  // by confidence; empty: confidences tell nothing and are not used
  double common_sigma = 0;       // of all depths alike; 0: too few matches tell
  size_t num_matches = 0;
  // The log likelihood of held-out references beyond that of the common sigma, and its standard
  // error.
  double gain = 0;
  double gain_sigma = 0;

  bool tells() const { return !knots.empty(); }
  // Returns the sigma of a confidence; its logarithm is linear between knots and constant beyond
  // them. For a confidence that is not a number it is the largest. To be called only where there
  // are knots.
  double SigmaAt(double confidence) const;
};

// Learns the sigmas of the confidences of `maps` for the source that lifts by these maps as they
// are read. `alignment` is the correction of these references' depth, or empty. What a correction
// leaves wrong in one half of a map's places is measured by a correction from the other half's
// matches. The result does not depend on the number of threads.
ConfidenceWorth LearnConfidence(const GeometrySource& source, const DepthFolder& maps,
                                const DepthAlignment& alignment,
                                std::span<const PosedImage> references,
                                std::span<const ReferenceMatch> matches, int threads);

// Gives the points of a source the standard deviations of ln(depth) that the confidences of its
// maps stand for.
class WeighedSource final : public GeometrySource {
 public:
  WeighedSource(std::shared_ptr<const GeometrySource> source,
                std::shared_ptr<const DepthFolder> maps, ConfidenceWorth worth);

  std::string Description() const override { return source_->Description(); }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::shared_ptr<const GeometrySource> source_;
  std::shared_ptr<const DepthFolder> maps_;
  ConfidenceWorth worth_;
};

}  // namespace raylift
