#include "query_page.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/index_sets.h"
#include "report_pictures.h"

#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Json = nlohmann::ordered_json;

// More would hide the picture.
constexpr size_t kMaxMarks = 250;
constexpr size_t kMaxLines = 120;

// Inverse depth of a plane is linear in the image: what its second difference is against its value
// tells an edge or a crease from a slanted surface.
constexpr double kLeastCrease = 0.01;

double Rounded(double value) { return std::round(value * 10) / 10; }

bool IsInlier(const std::vector<bool>& inliers, size_t i) {
  return i < inliers.size() && inliers[i];
}

Json Mark(const Vector2d& pixel, bool is_inlier, const std::optional<Vector2d>& target) {
  Json mark = {Rounded(pixel.x()), Rounded(pixel.y()), is_inlier ? 1 : 0};
  if (target) {
    mark.push_back(Rounded(target->x() - pixel.x()));
    mark.push_back(Rounded(target->y() - pixel.y()));
  }
  return mark;
}

// The nearest of where a reference's keypoint may be seen, by its distance.
std::optional<Vector2d> NearestOnEpipolarLine(const PoseProblem& problem, const Match2D2D& match,
                                              const Rigid3& cam_from_world) {
  const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
  const auto ray = reference.camera.RayInCam(match.reference_px);
  if (!ray) return std::nullopt;
  const Rigid3 query_from_reference = cam_from_world * reference.cam_from_world.Inverse();
  const double baseline = std::max(query_from_reference.translation.norm(), 1e-9);
  std::optional<Vector2d> nearest;
  Vector2d before = Vector2d::Zero();
  bool has_before = false;
  double least = std::numeric_limits<double>::infinity();
  for (double distance = 0.1 * baseline; distance < 1e4 * baseline; distance *= 1.1) {
    const auto pixel = problem.query_camera.ImgFromCam(query_from_reference * (distance * *ray));
    if (pixel && has_before) {
      // On the chord between this point of the line and the one before.
      const Vector2d along = *pixel - before;
      const double share = std::clamp(
          (match.query_px - before).dot(along) / std::max(along.squaredNorm(), 1e-12), 0.0, 1.0);
      const Vector2d point = before + share * along;
      if ((point - match.query_px).norm() < least) {
        least = (point - match.query_px).norm();
        nearest = point;
      }
    }
    has_before = pixel.has_value();
    if (pixel) before = *pixel;
  }
  return nearest;
}

// Transparent but for edges and creases.
Image EdgesOf(const DepthMap& map) {
  Image edges{map.width_px, map.height_px, 4, {}};
  edges.data.resize(static_cast<size_t>(4) * map.width_px * map.height_px);
  const auto inverse = [&map](int x, int y) {
    const float depth = map.At(x, y);
    return depth > 0 ? 1 / static_cast<double>(depth) : 0;
  };
  for (int y = 1; y + 1 < map.height_px; ++y) {
    for (int x = 1; x + 1 < map.width_px; ++x) {
      const double here = inverse(x, y);
      const double bend = std::max(std::abs(inverse(x - 1, y) - 2 * here + inverse(x + 1, y)),
                                   std::abs(inverse(x, y - 1) - 2 * here + inverse(x, y + 1)));
      if (!(bend > kLeastCrease * here) || here == 0) continue;
      uint8_t* pixel = &edges.data[4 * (static_cast<size_t>(y) * map.width_px + x)];
      pixel[0] = 255;
      pixel[1] = 64;
      pixel[2] = 160;
      pixel[3] = 255;
    }
  }
  return edges;
}

}  // namespace

Json QueryFacts(const LocalizedQuery& query) {
  const StageCounts& counts = query.counts;
  const PoseEstimate& estimate = query.estimate;
  Json json = {{"query", query.name},
               {"reason", query.reason},
               {"verdict", ToString(query.verdict())},
               {"confidence", query.confidence()},
               {"position", nullptr},
               {"rotation_deg", nullptr},
               {"retrieved", counts.retrieved},
               {"matched", counts.matched},
               {"hit", counts.hit},
               {"consistent", counts.filter.consistent},
               {"inliers_2d3d", counts.inliers_2d3d},
               {"inliers_2d2d", counts.inliers_2d2d},
               {"keypoints", estimate.num_keypoints},
               {"inlier_keypoints", estimate.inlier_keypoints}};
  if (query.localized()) {
    json["solver"] = ToString(estimate.solver);
    if (estimate.covariance) {
      json["position_sigma"] = estimate.position_sigma;
      json["rotation_sigma_deg"] = estimate.rotation_sigma_deg;
    }
  }
  return json;
}

Json PointMarks(const QueryResult& result) {
  const PoseProblem& problem = result.problem;
  const PoseEstimate& estimate = result.localized.estimate;
  Json marks = Json::array();
  for (const size_t i : EvenlySpaced(problem.matches_2d3d.size(), kMaxMarks)) {
    const Match2D3D& match = problem.matches_2d3d[i];
    std::optional<Vector2d> target;
    if (estimate.cam_from_world) {
      target = problem.query_camera.ImgFromCam(*estimate.cam_from_world * match.point_in_world);
    }
    marks.push_back(Mark(match.query_px, IsInlier(estimate.inliers_2d3d, i), target));
  }
  return marks;
}

Json PairMarks(const QueryResult& result) {
  const PoseProblem& problem = result.problem;
  const PoseEstimate& estimate = result.localized.estimate;
  Json marks = Json::array();
  for (const size_t i : EvenlySpaced(problem.matches_2d2d.size(), kMaxMarks)) {
    const Match2D2D& match = problem.matches_2d2d[i];
    std::optional<Vector2d> target;
    if (estimate.cam_from_world) {
      target = NearestOnEpipolarLine(problem, match, *estimate.cam_from_world);
    }
    marks.push_back(Mark(match.query_px, IsInlier(estimate.inliers_2d2d, i), target));
  }
  return marks;
}

std::optional<size_t> BestReference(const QueryResult& result) {
  const PoseProblem& problem = result.problem;
  // Inliers, and then matches.
  std::vector<std::pair<int, int>> counts(problem.references.size());
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    auto& [inliers, matches] = counts[static_cast<size_t>(problem.matches_2d2d[i].reference)];
    inliers += IsInlier(result.localized.estimate.inliers_2d2d, i) ? 1 : 0;
    ++matches;
  }
  const auto best = std::max_element(counts.begin(), counts.end());
  if (best == counts.end() || best->second == 0) return std::nullopt;
  return static_cast<size_t>(best - counts.begin());
}

Json MatchLines(const QueryResult& result, size_t reference) {
  const PoseProblem& problem = result.problem;
  std::vector<size_t> own;
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    if (static_cast<size_t>(problem.matches_2d2d[i].reference) == reference) own.push_back(i);
  }
  Json lines = Json::array();
  for (const size_t k : EvenlySpaced(own.size(), kMaxLines)) {
    const Match2D2D& match = problem.matches_2d2d[own[k]];
    lines.push_back({Rounded(match.query_px.x()), Rounded(match.query_px.y()),
                     Rounded(match.reference_px.x()), Rounded(match.reference_px.y()),
                     IsInlier(result.localized.estimate.inliers_2d2d, own[k]) ? 1 : 0});
  }
  return lines;
}

Json SeenFromPose(const QueryResult& result, const RayCaster& mesh) {
  const Camera& camera = result.problem.query_camera;
  const int width = std::min(kPagePictureWidthPx, camera.width_px());
  const int height = std::max(1, camera.height_px() * width / camera.width_px());
  const Camera small = camera.Scaled(width, height);
  const Rigid3& pose = *result.localized.estimate.cam_from_world;
  ColorOptions colors;
  colors.background_rgb = {222, 226, 232};
  if (!mesh.HasColors()) colors.shading = ColorOptions::Shading::kHeadlight;
  return {{"rendering", JpegDataUri(RenderColor(mesh, small, pose, colors, 1), width)},
          {"edges", PngDataUri(EdgesOf(RenderDepth(mesh, small, pose, 1)))}};
}

}  // namespace raylift
