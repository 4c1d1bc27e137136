#include "localization/retrieval/covisibility.h"

#include <algorithm>
#include <unordered_map>

#include "base/index_sets.h"
#include "localization/retrieval/retrieval.h"

#include "raylift/base/parallel.h"

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

bool Covisibility::Knows(const std::string& image) const {
  const auto points = points_of_image_.find(image);
  return points != points_of_image_.end() && !points->second.empty();
}

RetrievedLists Covisibility::MostShared(std::span<const std::string> queries,
                                        std::span<const std::string> references, int k,
                                        int threads) const {
  std::unordered_map<uint64_t, std::vector<int>> observers;
  for (size_t i = 0; i < references.size(); ++i) {
    const auto points = points_of_image_.find(references[i]);
    if (points == points_of_image_.end()) continue;
    for (const uint64_t point : points->second) {
      std::vector<int>& images = observers[point];
      // A track may hold an image twice.
      if (images.empty() || images.back() != static_cast<int>(i)) {
        images.push_back(static_cast<int>(i));
      }
    }
  }
  RetrievedLists lists(queries.size());
  ParallelFor(queries.size(), threads, [&](size_t query) {
    if (!Knows(queries[query])) return;
    std::vector<uint64_t> points = points_of_image_.at(queries[query]);
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
    std::map<int, int> shared;
    for (const uint64_t point : points) {
      const auto found = observers.find(point);
      if (found == observers.end()) continue;
      for (const int image : found->second) ++shared[image];
    }
    for (const auto& [image, count] : shared) {
      if (references[static_cast<size_t>(image)] == queries[query]) continue;
      lists[query].push_back({image, static_cast<double>(count)});
    }
    KeepBest(&lists[query], k);
  });
  return lists;
}

}  // namespace raylift
