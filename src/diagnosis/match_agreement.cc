#include "diagnosis/match_agreement.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "base/statistics.h"
#include "lifting/reference_matches.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// Returns the distance of a match from the projection of a line's direction. Far points of nearly
// parallel rays may seem to lie behind the cameras, and are judged by that. nullopt where the
// direction has no pixel.
std::optional<double> DistanceFromInfinity(const SightLine& line, const Camera& camera,
                                           const Eigen::Vector2d& match_px) {
  const auto projected = camera.ImgFromCam(line.direction);
  if (!projected) return std::nullopt;
  return (*projected - match_px).norm();
}

// Returns the distance of a match from the epipolar line; nullopt where it is behind a camera.
std::optional<double> EpipolarDistance(const PosedImage& a, const Eigen::Vector2d& a_px,
                                       const PosedImage& b, const Eigen::Vector2d& b_px) {
  const auto line = LineInOther(a, a_px, b);
  if (!line) return std::nullopt;
  const auto at_infinity = DistanceFromInfinity(*line, b.camera, b_px);
  const auto depth = TriangulateDepth(*line, b.camera, b_px);
  if (!depth) return at_infinity;
  const double distance = (depth->projected_px - b_px).norm();
  return at_infinity ? std::min(*at_infinity, distance) : distance;
}

// Returns for each match another keypoint of image b: that of another match of the same two images,
// or, where these are few, of another match of that image; nullopt where there is no other.
std::vector<std::optional<Eigen::Vector2d>> KeypointsAtRandom(
    std::span<const ReferenceMatch> matches) {
  constexpr size_t kFewOfPair = 5;
  struct Keypoint {
    size_t match;
    Eigen::Vector2d px;
  };
  std::map<std::pair<int, int>, std::vector<size_t>> of_pair;
  std::map<int, std::vector<Keypoint>> of_image;
  for (size_t i = 0; i < matches.size(); ++i) {
    const ReferenceMatch& match = matches[i];
    of_pair[{match.reference_a, match.reference_b}].push_back(i);
    of_image[match.reference_a].push_back({i, match.a_px});
    of_image[match.reference_b].push_back({i, match.b_px});
  }
  std::vector<std::optional<Eigen::Vector2d>> dealt(matches.size());
  for (const auto& [pair, indices] : of_pair) {
    for (size_t k = 0; k < indices.size(); ++k) {
      if (indices.size() < kFewOfPair) continue;
      dealt[indices[k]] = matches[indices[(k + indices.size() / 2) % indices.size()]].b_px;
    }
  }
  for (const auto& [image, keypoints] : of_image) {
    for (size_t k = 0; k < keypoints.size(); ++k) {
      const size_t i = keypoints[k].match;
      const Keypoint& other = keypoints[(k + keypoints.size() / 2) % keypoints.size()];
      if (dealt[i] || matches[i].reference_b != image || other.px == matches[i].b_px) {
        continue;
      }
      dealt[i] = other.px;
    }
  }
  return dealt;
}

}  // namespace

double EpipolarThresholdPx(const Camera& camera) {
  constexpr double kLeastPx = 3;
  constexpr double kOfDiagonal = 0.004;
  return std::max(kLeastPx, kOfDiagonal * std::hypot(camera.width_px(), camera.height_px()));
}

PosedImage ReadAs(const PosedImage& reference, PoseConvention as_read, PoseConvention poses) {
  PosedImage image = reference;
  image.cam_from_world = CamFromWorld(StoredPose(reference.cam_from_world, as_read), poses);
  return image;
}

double MatchAgreement::Skill() const {
  if (agrees.empty() || chance >= 1) return 0;
  const double share = static_cast<double>(num_agreeing) / static_cast<double>(agrees.size());
  return (share - chance) / (1 - chance);
}

double MatchAgreement::Purity() const {
  if (num_agreeing == 0) return 0;
  return Skill() * static_cast<double>(agrees.size()) / static_cast<double>(num_agreeing);
}

MatchAgreement Agreement(std::span<const PosedImage> references,
                         std::span<const ReferenceMatch> matches, PoseConvention as_read,
                         PoseConvention poses, int threads) {
  std::vector<PosedImage> posed;
  for (const PosedImage& reference : references) posed.push_back(ReadAs(reference, as_read, poses));
  const auto random_b_px = KeypointsAtRandom(matches);
  std::vector<std::optional<double>> distance(matches.size());
  std::vector<std::optional<double>> at_random(matches.size());
  ParallelFor(matches.size(), threads, [&](size_t i) {
    const ReferenceMatch& match = matches[i];
    const PosedImage& a = posed[static_cast<size_t>(match.reference_a)];
    const PosedImage& b = posed[static_cast<size_t>(match.reference_b)];
    distance[i] = EpipolarDistance(a, match.a_px, b, match.b_px);
    if (random_b_px[i]) at_random[i] = EpipolarDistance(a, match.a_px, b, *random_b_px[i]);
  });
  MatchAgreement agreement{.poses = poses};
  agreement.agrees.resize(matches.size());
  std::vector<double> agreeing_px;
  size_t random_agreeing = 0;
  for (size_t i = 0; i < matches.size(); ++i) {
    const double threshold_px =
        EpipolarThresholdPx(references[static_cast<size_t>(matches[i].reference_b)].camera);
    agreement.agrees[i] = distance[i] && *distance[i] <= threshold_px;
    if (agreement.agrees[i]) agreeing_px.push_back(*distance[i]);
    if (!random_b_px[i]) continue;
    ++agreement.num_random;
    if (at_random[i] && *at_random[i] <= threshold_px) ++random_agreeing;
  }
  agreement.num_agreeing = agreeing_px.size();
  agreement.median_px = UpperMedianOr(std::move(agreeing_px), 0);
  if (agreement.num_random > 0) {
    agreement.chance =
        static_cast<double>(random_agreeing) / static_cast<double>(agreement.num_random);
  }
  return agreement;
}

}  // namespace raylift
