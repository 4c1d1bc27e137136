#include "localization/results/exports.h"

#include <cmath>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/index_sets.h"
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {

namespace {

// Adds images behind those that are there; equal cameras are one.
class Adder {
 public:
  explicit Adder(ColmapModel& model) : model_(model) {
    for (const auto& [id, camera] : model.cameras) camera_ids_.emplace(camera.ToString(), id);
  }

  void Add(const std::string& name, const Camera& camera, const Rigid3& cam_from_world) {
    const auto [known, is_new] = camera_ids_.emplace(camera.ToString(), NextId(model_.cameras));
    if (is_new) model_.cameras.emplace(known->second, camera);
    ColmapImage image;
    image.name = name;
    image.camera_id = known->second;
    image.SetCamFromWorld(cam_from_world);
    model_.images.emplace(NextId(model_.images), std::move(image));
  }

 private:
  template <typename T>
  static uint32_t NextId(const std::map<uint32_t, T>& records) {
    return records.empty() ? 1 : records.rbegin()->first + 1;
  }

  ColmapModel& model_;
  std::map<std::string, uint32_t> camera_ids_;
};

// Returns the references' own model without the images that are not in use; made anew where they
// have none.
ColmapModel ModelOf(const ReferenceSet& references) {
  ColmapModel model;
  if (DetectColmapForm(references.model)) {
    model = ReadColmapModel(references.model);
    model.rigs.clear();
    model.frames.clear();
    model.rig_order.clear();
    model.frame_order.clear();
    RemoveImages(model, references.thinned_out);
  }
  std::unordered_map<std::string, ColmapImage*> images;
  for (auto& [id, image] : model.images) images.emplace(image.name, &image);
  Adder adder(model);
  for (const PosedImage& reference : references.images) {
    const auto image = images.find(reference.name);
    if (image == images.end()) {
      adder.Add(reference.name, reference.camera, reference.cam_from_world);
    } else {
      image->second->SetCamFromWorld(reference.cam_from_world);
    }
  }
  return model;
}

}  // namespace

ColmapModel LocalizedModel(const ReferenceSet& references, std::span<const Query> queries,
                           std::span<const LocalizedQuery> localized) {
  std::unordered_map<std::string, const Camera*> cameras;
  for (const Query& query : queries) cameras.emplace(query.name, &query.camera);
  std::vector<std::string> names;
  for (const LocalizedQuery& query : localized) {
    if (query.localized()) names.push_back(query.name);
  }
  ColmapModel model = ModelOf(references);
  RemoveImages(model, names);
  Adder adder(model);
  for (const LocalizedQuery& query : localized) {
    if (!query.localized()) continue;
    const auto camera = cameras.find(query.name);
    RAYLIFT_CHECK(camera != cameras.end());
    adder.Add(query.name, query.estimate.refined_camera.value_or(*camera->second),
              *query.estimate.cam_from_world);
  }
  return model;
}

namespace {

// Fixed point pixels for OpenCV's anti-aliased drawing; its center of the first pixel is (0, 0).
constexpr int kShift = 4;
cv::Point FixedPoint(const Eigen::Vector2d& pixel) {
  return {static_cast<int>(std::lround((pixel.x() - 0.5) * (1 << kShift))),
          static_cast<int>(std::lround((pixel.y() - 0.5) * (1 << kShift)))};
}

void DrawMark(cv::Mat& canvas, const Eigen::Vector2d& pixel) {
  cv::circle(canvas, FixedPoint(pixel), 3 << kShift, cv::Scalar(20, 20, 20), 3, cv::LINE_AA,
             kShift);
  cv::circle(canvas, FixedPoint(pixel), 3 << kShift, cv::Scalar(255, 196, 40), 1, cv::LINE_AA,
             kShift);
}

// More marks would hide the picture.
constexpr size_t kMaxMarks = 150;

}  // namespace

Image DrawQueryPicture(const QueryResult& result, const Image& photograph, const RayCaster& mesh,
                       int threads) {
  const PoseProblem& problem = result.problem;
  const PoseEstimate& estimate = result.localized.estimate;
  RAYLIFT_CHECK(estimate.cam_from_world.has_value());
  const Camera& camera = problem.query_camera;
  ColorOptions colors = PictureColors(mesh);
  colors.samples_per_pixel_side = 2;
  Image rendered = RenderColor(mesh, camera, *estimate.cam_from_world, colors, threads);

  const int width = camera.width_px();
  const int height = camera.height_px();
  Image picture{2 * width, height, 3,
                std::vector<uint8_t>(static_cast<size_t>(2) * width * height * 3)};
  cv::Mat canvas(height, 2 * width, CV_8UC3, picture.data.data());
  cv::Mat left = canvas.colRange(0, width);
  cv::Mat right = canvas.colRange(width, 2 * width);
  Image photo = photograph;
  cv::Mat(photo.height_px, photo.width_px, CV_8UC3, photo.data.data()).copyTo(left);
  cv::Mat(height, width, CV_8UC3, rendered.data.data()).copyTo(right);
  std::vector<size_t> inliers;
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    if (estimate.inliers_2d3d[i]) {
      inliers.push_back(i);
    }
  }
  for (const size_t i : EvenlySpaced(inliers.size(), kMaxMarks)) {
    const Match2D3D& match = problem.matches_2d3d[inliers[i]];
    DrawMark(left, match.query_px);
    if (const auto pixel = camera.ImgFromCam(*estimate.cam_from_world * match.point_in_world)) {
      DrawMark(right, *pixel);
    }
  }
  return picture;
}

}  // namespace raylift
