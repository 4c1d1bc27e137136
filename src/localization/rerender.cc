#include "localization/rerender.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/constants.h"
#include "base/lap_clock.h"
#include "base/statistics.h"
#include "features/cv_image.h"
#include <Eigen/LU>
#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/features/local_features.h"
#include "raylift/io/image_file.h"
#include "raylift/lifting/lifter.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

FrameOptions ColorAndMask(const ColorOptions& look) {
  FrameOptions options;
  options.color = true;
  options.mask = true;
  options.color_options = look;
  return options;
}

Camera AtMost(const Camera& camera, int max_side_px) {
  const int side_px = std::max(camera.width_px(), camera.height_px());
  if (side_px <= max_side_px) return camera;
  const double scale = static_cast<double>(max_side_px) / side_px;
  const auto scaled = [scale](int length_px) {
    return std::max(1, static_cast<int>(std::lround(scale * length_px)));
  };
  return camera.Scaled(scaled(camera.width_px()), scaled(camera.height_px()));
}

// Returns the camera as far as the estimator knows it.
Camera CameraOf(const Query& query, const PoseEstimate& estimate) {
  return estimate.refined_camera.value_or(query.camera);
}

// Returns the median depth of the inliers along the optical axis.
double MedianDepth(const QueryResult& result) {
  std::vector<double> depths;
  const auto& matches = result.problem.matches_2d3d;
  for (size_t i = 0; i < matches.size(); ++i) {
    const PoseEstimate& estimate = result.localized.estimate;
    if (i < estimate.inliers_2d3d.size() && estimate.inliers_2d3d[i]) {
      depths.push_back((*estimate.cam_from_world * matches[i].point_in_world).z());
    }
  }
  return UpperMedianOr(std::move(depths), 0);
}

// Returns the pose itself, then those around it, all looking at the point at `depth` on its axis.
std::vector<Rigid3> PosesAround(const Rigid3& cam_from_world, double depth, double around_deg) {
  std::vector<Rigid3> poses = {cam_from_world};
  if (!(around_deg > 0) || !(depth > 0)) return poses;
  const Rigid3 middle_from_cam{Eigen::Quaterniond::Identity(), {0, 0, -depth}};
  for (const auto& [axis, sign] : {std::pair{0, 1}, {0, -1}, {1, 1}, {1, -1}}) {
    const Eigen::AngleAxisd turn(sign * around_deg * kRadPerDeg, Eigen::Vector3d::Unit(axis));
    const Rigid3 turned{Eigen::Quaterniond(turn), Eigen::Vector3d::Zero()};
    poses.push_back(middle_from_cam.Inverse() * (turned * (middle_from_cam * cam_from_world)));
  }
  return poses;
}

// Leaves a pose as sure as it was found: patches are looked for where it has them.
void LimitConfidence(const PoseEstimate& found, PoseEstimate& sharper) {
  if (sharper.confidence <= found.confidence) return;
  sharper.confidence = found.confidence;
  sharper.verdict = found.verdict;
  sharper.alternatives = found.alternatives;
}

void RequireSize(const Image& photograph, const Camera& camera, const std::string& name) {
  if (photograph.width_px == camera.width_px() && photograph.height_px == camera.height_px()) {
    return;
  }
  throw InputError(std::filesystem::path(name),
                   fmt::format("the image is {} x {}, its camera {} x {}", photograph.width_px,
                               photograph.height_px, camera.width_px(), camera.height_px()));
}

struct Candidate {
  PoseProblem problem;
  PoseEstimate estimate;
};

std::optional<Candidate> EstimateOf(PoseProblem problem, const PoseEstimator& estimator,
                                    double min_confidence) {
  PoseEstimate estimate = estimator.Estimate(problem);
  if (!ReasonNotLocalized(estimate, min_confidence).empty()) return std::nullopt;
  return Candidate{std::move(problem), std::move(estimate)};
}

// Runs the rounds of one query.
class Rounds {
 public:
  // `photograph` is gray.
  Rounds(const Query& query, Image photograph, const GeometrySource& source,
         const FrameRenderer& renderer, const RerenderOptions& options)
      : query_(query),
        source_(source),
        renderer_(renderer),
        options_(options),
        photograph_(std::move(photograph)),
        query_features_(Extract(photograph_)) {}

  // Returns what a round makes of the pose so far; nullopt where it finds none of this confidence.
  std::optional<Candidate> Run(int round, const PoseProblem& base, const QueryResult& so_far,
                               const PoseEstimator& estimator, double min_confidence) const {
    const PoseEstimate& before = so_far.localized.estimate;
    const auto poses =
        PosesAround(*before.cam_from_world, MedianDepth(so_far), options_.around_deg);
    auto found = EstimateOf(AddPictures(base, CameraOf(query_, before), poses, round), estimator,
                            min_confidence);
    if (!found) return std::nullopt;
    const bool is_better =
        Support(found->problem, found->estimate) > Support(found->problem, before);
    const PoseEstimate rough = is_better ? found->estimate : before;
    auto sharper = EstimateOf(
        AddPatches(found->problem, CameraOf(query_, rough), *rough.cam_from_world, round),
        estimator, min_confidence);
    // Patches that support their own pose less leave the features' one.
    if (!sharper ||
        Support(sharper->problem, sharper->estimate) < Support(sharper->problem, rough)) {
      return found;
    }
    LimitConfidence(rough, sharper->estimate);
    const auto is_sure = [](const Candidate& candidate) {
      return candidate.estimate.verdict == PoseVerdict::kLocalized;
    };
    return is_sure(*found) && !is_sure(*sharper) ? found : sharper;
  }

  double Support(const PoseProblem& problem, const PoseEstimate& estimate) const {
    return KeypointSupport(CameraOf(query_, estimate), *estimate.cam_from_world,
                           problem.matches_2d3d, options_.reprojection_threshold_px);
  }

 private:
  // Returns `base` with pictures through `query_camera` from these poses as further references,
  // with their matches and points.
  PoseProblem AddPictures(const PoseProblem& base, const Camera& query_camera,
                          const std::vector<Rigid3>& poses, int round) const {
    const Camera camera = AtMost(query_camera, options_.max_image_side_px);
    const PixelRays rays(camera, 1);
    PoseProblem pictures;
    for (size_t i = 0; i < poses.size(); ++i) {
      AddPicture(rays, {fmt::format("rerender/{}/{}", round, i), camera, poses[i]}, pictures);
    }
    KeepNear(poses.front(), query_camera, pictures);
    return Join(base, std::move(pictures));
  }

  // Returns `base` with a picture from this pose as a further reference, whose patches are found in
  // the photograph.
  PoseProblem AddPatches(const PoseProblem& base, const Camera& query_camera,
                         const Rigid3& cam_from_world, int round) const {
    const Camera camera = AtMost(query_camera, options_.max_image_side_px);
    Frame frame;
    renderer_.Render(PixelRays(camera, 1), cam_from_world, 1, frame);
    PoseProblem picture;
    picture.references = {{fmt::format("rerender/{}/patches", round), camera, cam_from_world}};
    for (const PatchMatch& match : AlignPatches(photograph_, ToGray(frame.color), frame.mask)) {
      picture.matches_2d2d.push_back(
          {.reference = 0, .query_px = match.photograph_px, .reference_px = match.rendering_px});
    }
    KeepNear(cam_from_world, query_camera, picture);
    return Join(base, std::move(picture));
  }

  Features Extract(const Image& gray) const {
    return ExtractRootSift(gray, {.max_features = options_.max_features});
  }

  void AddPicture(const PixelRays& rays, PosedImage view, PoseProblem& pictures) const {
    Frame frame;
    renderer_.Render(rays, view.cam_from_world, 1, frame);
    const Features features = Extract(ToGray(frame.color));
    const std::vector<int> keypoints = CanonicalKeypoints(features.keypoints_px);
    const int reference = static_cast<int>(pictures.references.size());
    for (const FeatureMatch& match :
         MatchMutualNearest(query_features_, features, {.max_ratio = options_.max_ratio})) {
      const auto picture_index = static_cast<size_t>(match.reference_index);
      pictures.matches_2d2d.push_back(
          {.reference = reference,
           .query_px = query_features_.keypoints_px[static_cast<size_t>(match.query_index)],
           .reference_px = features.keypoints_px[picture_index],
           .reference_keypoint = keypoints[picture_index]});
    }
    pictures.references.push_back(std::move(view));
  }

  // Lifts the matches and keeps those whose point is seen near the keypoint from the pose so far.
  void KeepNear(const Rigid3& cam_from_world, const Camera& query_camera,
                PoseProblem& pictures) const {
    const double radius_px =
        options_.search_radius * std::max(query_camera.width_px(), query_camera.height_px());
    const LiftResult lifted = LiftMatches(source_, pictures.references, pictures.matches_2d2d);
    const std::vector<Match2D2D> all = std::move(pictures.matches_2d2d);
    pictures.matches_2d2d.clear();
    for (Match2D3D match : Matches2D3D(lifted)) {
      const auto pixel = query_camera.ImgFromCam(cam_from_world * match.point_in_world);
      if (!pixel || (*pixel - match.query_px).norm() > radius_px) continue;
      const size_t from = *std::exchange(match.match_2d2d, std::nullopt);
      if (options_.use_pairs) {
        match.match_2d2d = pictures.matches_2d2d.size();
        pictures.matches_2d2d.push_back(all[from]);
      }
      pictures.matches_2d3d.push_back(match);
    }
  }

  // References of `more` follow those of `base`, in a cluster of their own. The features of the
  // base's matches may be others, with indices of their own: a keypoint of `more` is one of the
  // base where its pixel is the same, and gets an index that the base does not use where not.
  static PoseProblem Join(const PoseProblem& base, PoseProblem more) {
    PoseProblem joint = base;
    const int offset = static_cast<int>(base.references.size());
    if (!base.reference_clusters.empty()) {
      const int cluster =
          *std::max_element(base.reference_clusters.begin(), base.reference_clusters.end()) + 1;
      joint.reference_clusters.resize(base.references.size() + more.references.size(), cluster);
    }
    for (Match2D2D& match : more.matches_2d2d) {
      match.reference += offset;
      joint.matches_2d2d.push_back(match);
    }
    for (Match2D3D& match : more.matches_2d3d) {
      if (match.reference) *match.reference += offset;
      if (match.match_2d2d) *match.match_2d2d += base.matches_2d2d.size();
      joint.matches_2d3d.push_back(match);
    }
    for (PosedImage& reference : more.references) joint.references.push_back(std::move(reference));
    AssignKeypointsByPixel(joint);
    return joint;
  }

  const Query& query_;
  const GeometrySource& source_;
  const FrameRenderer& renderer_;
  const RerenderOptions& options_;
  Image photograph_;
  Features query_features_;
};

constexpr int kMaxPatches = 600;
// Shares of the longer side: half a patch's side, and how far from its place it is looked for.
constexpr double kHalfSide = 1.0 / 40;
constexpr double kSearchRadius = 0.02;
// This is the least correlation; its square is the share of the patch's variance that the
// photograph shows, one half here.
constexpr double kLeastCorrelation = 0.7071;

cv::Mat ToFloat(const Image& gray, cv::Size size) {
  cv::Mat values;
  AsMat(gray).convertTo(values, CV_32F);
  if (values.size() != size) cv::resize(values, values, size, 0, 0, cv::INTER_AREA);
  return values;
}

// Returns the corners whose patches lie within the rendering and the mask.
std::vector<cv::Point> Corners(const cv::Mat& rendering, const Image& mask, int half_px) {
  cv::Mat inside;
  const int side_px = 2 * half_px + 1;
  cv::erode(AsMat(mask), inside, cv::Mat::ones(side_px, side_px, CV_8U), {-1, -1}, 1,
            cv::BORDER_CONSTANT, cv::Scalar::all(0));
  // All corners are taken: a weak one is a corner, too, and the correlation judges it.
  constexpr double kLeastQuality = 1e-4;
  std::vector<cv::Point2f> found;
  cv::goodFeaturesToTrack(rendering, found, kMaxPatches, kLeastQuality, half_px / 2.0, inside,
                          half_px);
  std::vector<cv::Point> corners;
  for (const cv::Point2f& corner : found)
    corners.emplace_back(cvRound(corner.x), cvRound(corner.y));
  return corners;
}

// Returns where the quadratic through a maximum and its neighbors has its peak; nullopt where that
// is not beside the maximum. A patch along an edge has an oblique one: both axes count at once.
std::optional<Eigen::Vector2d> PeakBeside(const cv::Mat& correlation, cv::Point at) {
  const auto value = [&](int x, int y) -> double {
    return correlation.at<float>(at.y + y, at.x + x);
  };
  const Eigen::Vector2d gradient((value(1, 0) - value(-1, 0)) / 2,
                                 (value(0, 1) - value(0, -1)) / 2);
  const double xy = (value(1, 1) - value(1, -1) - value(-1, 1) + value(-1, -1)) / 4;
  Eigen::Matrix2d curvature;
  curvature << value(1, 0) - 2 * value(0, 0) + value(-1, 0), xy, xy,
      value(0, 1) - 2 * value(0, 0) + value(0, -1);
  if (!(curvature.determinant() > 0)) return std::nullopt;
  const Eigen::Vector2d offset = -curvature.inverse() * gradient;
  if (!(offset.cwiseAbs().maxCoeff() <= 1)) return std::nullopt;
  return offset;
}

// Returns the highest correlation's place, to a fraction of a pixel; nullopt where it is on the
// border or too low.
std::optional<Eigen::Vector2d> Peak(const cv::Mat& correlation) {
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(correlation, nullptr, &best, nullptr, &at);
  if (!(best >= kLeastCorrelation) || at.x == 0 || at.y == 0 || at.x == correlation.cols - 1 ||
      at.y == correlation.rows - 1) {
    return std::nullopt;
  }
  const auto offset = PeakBeside(correlation, at);
  if (!offset) return std::nullopt;
  return Eigen::Vector2d(at.x, at.y) + *offset;
}

}  // namespace

std::vector<PatchMatch> AlignPatches(const Image& photograph, const Image& rendering,
                                     const Image& mask) {
  const cv::Size size(rendering.width_px, rendering.height_px);
  const cv::Mat seen = ToFloat(photograph, size);
  const cv::Mat rendered = ToFloat(rendering, size);
  const Eigen::Array2d photograph_from_rendering(
      static_cast<double>(photograph.width_px) / size.width,
      static_cast<double>(photograph.height_px) / size.height);
  const double longer_px = std::max(seen.cols, seen.rows);
  const int half_px = std::max(3, static_cast<int>(std::lround(kHalfSide * longer_px)));
  const int reach_px = half_px + std::max(2, static_cast<int>(kSearchRadius * longer_px));
  const cv::Rect all({0, 0}, seen.size());
  std::vector<PatchMatch> matches;
  cv::Mat correlation;
  for (const cv::Point& corner : Corners(rendered, mask, half_px)) {
    const auto around = [&](int px) {
      return cv::Rect(corner.x - px, corner.y - px, 2 * px + 1, 2 * px + 1) & all;
    };
    const cv::Rect searched = around(reach_px);
    cv::matchTemplate(seen(searched), rendered(around(half_px)), correlation, cv::TM_CCOEFF_NORMED);
    const auto peak = Peak(correlation);
    if (!peak) continue;
    const Eigen::Array2d found =
        peak->array() + Eigen::Array2d(searched.x, searched.y) + half_px + 0.5;
    matches.push_back({{corner.x + 0.5, corner.y + 0.5}, photograph_from_rendering * found});
  }
  return matches;
}

double KeypointSupport(const Camera& camera, const Rigid3& cam_from_world,
                       std::span<const Match2D3D> matches, double threshold_px) {
  const KeypointNumbers keypoints = NumberQueryKeypoints({}, matches);
  std::vector<double> support_of_keypoint(keypoints.count, 0);
  for (size_t i = 0; i < matches.size(); ++i) {
    const Match2D3D& match = matches[i];
    const auto pixel = camera.ImgFromCam(cam_from_world * match.point_in_world);
    if (!pixel) continue;
    const double error2 = (*pixel - match.query_px).squaredNorm() / (threshold_px * threshold_px);
    if (!(error2 < 1)) continue;
    double& support = support_of_keypoint[keypoints.of_2d3d[i]];
    support = std::max(support, 1 - error2);
  }
  return std::accumulate(support_of_keypoint.begin(), support_of_keypoint.end(), 0.0);
}

Rerenderer::Rerenderer(const std::shared_ptr<const RayCaster>& mesh, const ColorOptions& look,
                       std::filesystem::path query_images, const RerenderOptions& options)
    : source_("the mesh, rendered again", mesh),
      renderer_(mesh, ColorAndMask(look)),
      query_images_(std::move(query_images)),
      options_(options) {}

void Rerenderer::Improve(const Query& query, const PoseEstimator& estimator, QueryResult& result,
                         double min_confidence) const {
  result.localized.rerender_rounds = 0;
  if (!result.localized.localized()) return;
  const auto path = query_images_ / query.name;
  const Image photograph = ReadImage(path, ImageChannels::kGray);
  RequireSize(photograph, query.camera, path.string());
  Improve(query, photograph, estimator, result, min_confidence);
}

void Rerenderer::Improve(const Query& query, const Image& photograph,
                         const PoseEstimator& estimator, QueryResult& result,
                         double min_confidence) const {
  result.localized.rerender_rounds = 0;
  if (!result.localized.localized()) return;
  RequireSize(photograph, query.camera, query.name);
  const LapClock clock;
  const Rounds rounds(query, ToGray(photograph), source_, renderer_, options_);
  const PoseProblem base = result.problem;
  LocalizedQuery& localized = result.localized;
  for (int round = 1; round <= options_.rounds; ++round) {
    auto found = rounds.Run(round, base, result, estimator, min_confidence);
    if (!found || !(rounds.Support(found->problem, found->estimate) >
                    rounds.Support(found->problem, localized.estimate))) {
      break;
    }
    result.problem = std::move(found->problem);
    localized.TakeEstimate(std::move(found->estimate));
    localized.counts.points = result.problem.matches_2d3d.size();
    localized.rerender_rounds = round;
  }
  localized.times.rerender_ms = 1e3 * clock.Seconds();
}

}  // namespace raylift
