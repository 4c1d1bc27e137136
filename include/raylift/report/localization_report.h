// Makes the page of `raylift localize`: every query with its verdict, the counts of its stages, and
// its photograph over the mesh as seen from the pose, with edges, matches and residuals; and the
// poses among the references and the mesh in 3D.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "raylift/evaluation/pose_errors.h"
#include "raylift/localization/localizer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"
#include "raylift/sequences/smooth_queries.h"

namespace raylift {

struct LocalizationReportOptions {
  size_t num_queries = 0;
  // Where these are empty, no photographs are shown.
  std::filesystem::path query_images = {}, reference_images = {};
  std::shared_ptr<const RayCaster> mesh = nullptr;  // null: no pictures of it
  // Where there are more queries, pictures and matches are in files of their own, which the page
  // loads as they are looked at.
  size_t max_in_page = 50;
  PosesByName ground_truth = {};      // where it is known: errors stand beside what is expected
  std::filesystem::path folder = {};  // of the page
};

// The results of walks, by the order of the queries.
struct ReportedWalk {
  const WalkedQueries& walked;
  std::span<const Query> queries;
};

class LocalizationReport {
 public:
  explicit LocalizationReport(LocalizationReportOptions options);
  ~LocalizationReport();

  // Writes a query's part of the page to a file in its folder, which needs no other part: queries
  // may be taken in any order, from any thread and by several processes. Throws OutputError where a
  // file cannot be written.
  void Take(size_t index, const QueryResult& result);

  // Makes the page of all parts. `warnings` are those of the run. Where there is a walk, poses and
  // verdicts are those of the walk, beside those of the single photographs. Throws InputError where
  // a part is missing.
  std::string Format(std::string_view title, std::span<const PosedImage> references,
                     std::span<const std::string> warnings,
                     const std::optional<ReportedWalk>& walk = std::nullopt) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
