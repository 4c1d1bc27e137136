// The page of `raylift localize`: every query with what its stages left, its inliers drawn on the
// photograph, and the poses among the references in 3D. It knows no ground truth.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "raylift/localization/localizer.h"
#include "raylift/scene/posed_image.h"

namespace raylift {

class LocalizationReport {
 public:
  // `query_images` may be empty: then no photographs are shown. Of more than `max_photos` queries,
  // evenly spread ones get theirs.
  LocalizationReport(size_t num_queries, std::filesystem::path query_images,
                     size_t max_photos = 100);
  ~LocalizationReport();

  // Once per query, in any order. Thread safe.
  void Take(size_t index, const QueryResult& result);

  std::string Format(std::string_view title, std::span<const PosedImage> references) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
