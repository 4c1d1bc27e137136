#include "raylift/localization/covisibility.h"

#include <unordered_map>

#include "raylift/base/disjoint_sets.h"

namespace raylift {

Covisibility::Covisibility(const ColmapModel& model) {
  if (model.points3d.empty()) {
    return;
  }
  for (const auto& [id, image] : model.images) {
    std::vector<uint64_t>& points = points_of_image_[image.name];
    for (const ColmapImage::Point2D& point : image.points2d) {
      if (point.point3d_id) {
        points.push_back(*point.point3d_id);
      }
    }
  }
}

std::vector<int> Covisibility::Clusters(const std::vector<PosedImage>& references) const {
  if (points_of_image_.empty()) {
    return {};
  }
  DisjointSets sets(references.size());
  std::unordered_map<uint64_t, size_t> first_observer;
  for (size_t i = 0; i < references.size(); ++i) {
    const auto points = points_of_image_.find(references[i].name);
    if (points == points_of_image_.end()) {
      continue;
    }
    for (const uint64_t point : points->second) {
      sets.Join(first_observer.try_emplace(point, i).first->second, i);
    }
  }
  return sets.Numbers();
}

}  // namespace raylift
