// A comparison as one HTML page that people can look at: no network, opens from the file system.
// The page is a fixed script and style with the numbers as JSON and small pictures inside.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "raylift/comparison/depth_comparison.h"
#include "raylift/comparison/localization_comparison.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct ReportOptions {
  std::string title = "Raylift";
  std::filesystem::path images;        // photographs of the references; empty: none are shown
  std::filesystem::path query_images;  // of the queries; empty: none
};

// Collects the pictures of a comparison while it runs.
class ReportPictures {
 public:
  // The sources determine which images are shown, and the range of depth of the colors.
  ReportPictures(std::span<const ComparedSource> sources, std::span<const PosedImage> images,
                 std::optional<size_t> truth, const ReportOptions& options);
  ~ReportPictures();

  // Serves as DepthComparisonOptions::on_views. Thread safe.
  void Take(size_t image, const PosedImage& view, std::span<const SourceView> views);

 private:
  friend std::string FormatReport(const DepthComparison&, const LocalizationComparison*,
                                  const ReportPictures&, std::span<const PosedImage>,
                                  std::span<const PosedImage>, const ReportOptions&);
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Returns the page. `localization` may be null; `true_queries` (may be empty) are drawn in the 3D
// view.
std::string FormatReport(const DepthComparison& comparison,
                         const LocalizationComparison* localization, const ReportPictures& pictures,
                         std::span<const PosedImage> references,
                         std::span<const PosedImage> true_queries, const ReportOptions& options);

// One result on the page of `raylift evaluate`, which shows recalls, the errors of each query, and
// the poses in 3D.
struct EvaluatedResult {
  ResultSummary summary;
  Comparison comparison;
  PosesByName poses;  // under the ground truth's names
};
std::string FormatEvaluationReport(std::span<const Threshold> thresholds,
                                   std::span<const EvaluatedResult> results,
                                   const PosesByName& ground_truth, std::string_view title);

}  // namespace raylift
