#include "raylift/comparison/localization_comparison.h"

#include <algorithm>
#include <memory>
#include <tuple>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/localizer.h"

namespace raylift {
namespace {

// The estimates of one way to localize, query by query.
struct Variant {
  std::optional<size_t> geometry;  // index of lifted geometries; none: needs none
  FilterMode filter = FilterMode::kOff;
  size_t method = 0;
  std::string source, alignment;
  std::vector<PoseEstimate> estimates;
  std::vector<QueryDetail> details;
};

constexpr size_t kShownKeypoints = 120;

bool NeedsGeometry(Method method) { return method != Method::kE5p1; }

// A source with one way of correcting its depth.
struct Geometry {
  std::string source, alignment;
  const GeometrySource* lifted = nullptr;
};

class Runner {
 public:
  Runner(std::span<const ComparedSource> sources, std::span<const Query> queries,
         const MatchSource& matches, std::span<const PosedImage> references,
         std::span<const ReferenceMatch> reference_matches, const PosesByName& ground_truth,
         const LocalizationGrid& grid)
      : queries_(queries), matches_(matches), grid_(grid) {
    for (const Query& query : queries) {
      const auto pose = ground_truth.find(query.name);
      if (pose != ground_truth.end()) truth_.insert(*pose);
    }
    if (truth_.empty()) throw InputError("the ground truth holds none of the queries");
    for (const ComparedSource& source : sources) {
      for (const AlignMode mode : grid.alignments) {
        AddGeometry(source, mode, references, reference_matches);
      }
    }
    for (const EstimatorOptions& options : grid.methods) {
      estimators_.push_back(MakePoseEstimator(options));
    }
    ListVariants();
  }

  LocalizationComparison Run(const std::function<void()>& on_progress) {
    for (Variant& variant : variants_) {
      variant.estimates.resize(queries_.size());
      variant.details.resize(queries_.size());
    }
    ParallelFor(queries_.size(), grid_.threads, [&](size_t i) {
      EstimateAll(i);
      if (on_progress) on_progress();
    });
    LocalizationComparison result;
    result.thresholds = grid_.thresholds;
    for (const Variant& variant : variants_) result.rows.push_back(MakeRow(variant));
    AddOracles(result.rows);
    Rate(result.rows);
    return result;
  }

 private:
  void AddGeometry(const ComparedSource& source, AlignMode mode,
                   std::span<const PosedImage> references,
                   std::span<const ReferenceMatch> reference_matches) {
    Geometry geometry{source.name, std::string(ToString(mode)), source.source};
    if (mode != AlignMode::kOff) {
      const DepthAlignment alignment =
          AlignDepth(*source.source, references, reference_matches, {.mode = mode}, grid_.threads);
      // The source outlives this run.
      const std::shared_ptr<const GeometrySource> borrowed(source.source,
                                                           [](const GeometrySource*) {});
      aligned_.push_back(std::make_unique<AlignedSource>(borrowed, alignment.Corrections()));
      geometry.lifted = aligned_.back().get();
    }
    geometries_.push_back(std::move(geometry));
  }

  void ListVariants() {
    for (size_t m = 0; m < grid_.methods.size(); ++m) {
      if (!NeedsGeometry(grid_.methods[m].method)) {
        variants_.push_back({std::nullopt, FilterMode::kOff, m, "", "", {}, {}});
      }
    }
    for (size_t g = 0; g < geometries_.size(); ++g) {
      for (const FilterMode filter : grid_.filters) {
        for (size_t m = 0; m < grid_.methods.size(); ++m) {
          if (!NeedsGeometry(grid_.methods[m].method)) continue;
          variants_.push_back(
              {g, filter, m, geometries_[g].source, geometries_[g].alignment, {}, {}});
        }
      }
    }
  }

  // Without filter and alignment: the rows whose keypoints are worth keeping.
  static bool IsPlain(const Variant& variant) {
    return variant.filter == FilterMode::kOff &&
           (variant.alignment.empty() || variant.alignment == ToString(AlignMode::kOff));
  }

  FilterOptions FilterOf(const Variant& variant) const {
    const Method method = grid_.methods[variant.method].method;
    const bool needs_points = method == Method::kP3p || method == Method::kHloc;
    return {.mode = variant.filter,
            .thresholds = grid_.filter_thresholds,
            .few_points = needs_points ? FewPoints::kKeepBest : FewPoints::kDropAll};
  }

  void EstimateAll(size_t index) {
    const Query& query = queries_[index];
    QueryMatches matches = matches_.Match(query);
    PoseProblem problem;
    problem.name = query.name;
    problem.query_camera = query.camera;
    problem.references = std::move(matches.references);
    problem.matches_2d2d = std::move(matches.matches);
    std::vector<std::vector<Match2D3D>> lifted;
    for (const Geometry& geometry : geometries_) {
      lifted.push_back(
          Matches2D3D(LiftMatches(*geometry.lifted, problem.references, problem.matches_2d2d)));
    }
    for (Variant& variant : variants_) {
      problem.matches_2d3d =
          variant.geometry ? lifted[*variant.geometry] : std::vector<Match2D3D>();
      const size_t hit = problem.matches_2d3d.size();
      FilterProblem(FilterOf(variant), problem);
      PoseEstimate& estimate = variant.estimates[index];
      estimate = estimators_[variant.method]->Estimate(problem);
      if (const auto pose = truth_.find(query.name); pose != truth_.end()) {
        variant.details[index] =
            DescribeQuery(problem, hit, estimate, grid_.methods[variant.method], pose->second,
                          IsPlain(variant) ? kShownKeypoints : 0);
      }
    }
  }

  LocalizationRow MakeRow(const Variant& variant) const {
    LocalizationRow row;
    row.source = variant.source;
    row.alignment = variant.alignment;
    if (variant.geometry) row.filter = ToString(variant.filter);
    row.method = MethodTitle(grid_.methods[variant.method]);
    PosesByName poses;
    std::vector<double> points, matches;
    for (size_t i = 0; i < queries_.size(); ++i) {
      const PoseEstimate& estimate = variant.estimates[i];
      if (ReasonNotLocalized(estimate).empty()) {
        poses.emplace(queries_[i].name, *estimate.cam_from_world);
      }
      if (truth_.contains(queries_[i].name)) {
        row.details.emplace(queries_[i].name, variant.details[i]);
      }
      points.push_back(estimate.score_2d3d.num_inliers);
      matches.push_back(estimate.score_2d2d.num_inliers);
    }
    row.comparison = CompareWithGroundTruth(truth_, poses);
    row.median_inliers = {MedianOf(std::span(points)), MedianOf(std::span(matches))};
    return row;
  }

  // Of P3P and E5+1, where both were run.
  static void AddOracles(std::vector<LocalizationRow>& rows) {
    const auto e5p1 = std::find_if(rows.begin(), rows.end(), [](const LocalizationRow& row) {
      return row.method == ToString(Method::kE5p1);
    });
    if (e5p1 == rows.end()) return;
    const Comparison without_geometry = e5p1->comparison;
    std::vector<LocalizationRow> oracles;
    for (const LocalizationRow& row : rows) {
      if (row.method != ToString(Method::kP3p)) continue;
      LocalizationRow oracle = row;
      oracle.method = "oracle";
      oracle.is_oracle = true;
      oracle.details.clear();
      oracle.comparison = ChooseByOracle(row.comparison, without_geometry);
      oracles.push_back(std::move(oracle));
    }
    rows.insert(rows.end(), oracles.begin(), oracles.end());
  }

  void Rate(std::vector<LocalizationRow>& rows) const {
    const QueryBootstrap bootstrap(truth_.size(), grid_.seed);
    for (LocalizationRow& row : rows) {
      row.summary = Summarize(row.Name(), row.comparison, grid_.thresholds);
      row.median_position = bootstrap.MedianPosition(row.comparison);
    }
    for (size_t t = 0; t < grid_.thresholds.size(); ++t) {
      LocalizationRow* best = nullptr;
      for (LocalizationRow& row : rows) {
        row.recalls.push_back(bootstrap.RecallPercent(row.comparison, grid_.thresholds[t]));
        if (!row.is_oracle && (best == nullptr || IsBetter(row.summary, best->summary, t))) {
          best = &row;
        }
      }
      best->is_best = true;
      for (LocalizationRow& row : rows) {
        row.difference_to_best.push_back(bootstrap.RecallDifferencePercent(
            row.comparison, best->comparison, grid_.thresholds[t]));
      }
    }
  }

  // By recall, then by the median error.
  static bool IsBetter(const ResultSummary& a, const ResultSummary& b, size_t threshold) {
    return std::tuple(-a.recalls_percent[threshold], a.median_position) <
           std::tuple(-b.recalls_percent[threshold], b.median_position);
  }

  std::span<const Query> queries_;
  const MatchSource& matches_;
  const LocalizationGrid& grid_;
  PosesByName truth_;
  std::vector<Geometry> geometries_;
  std::vector<std::unique_ptr<AlignedSource>> aligned_;
  std::vector<std::unique_ptr<PoseEstimator>> estimators_;
  std::vector<Variant> variants_;
};

EstimatorOptions ParseMethod(std::string_view text, EstimatorOptions options) {
  const size_t colon = text.find(':');
  const std::string_view name = text.substr(0, colon);
  const auto method = MethodFromName(name);
  const auto fail = [&](std::string_view expected) {
    return OptionError("--methods", text, expected);
  };
  if (!method) throw fail("expected p3p|e5p1|adaptive[:SCORE]|select[:ALPHA]|hybrid_ransac|hloc");
  options.method = *method;
  if (colon == std::string_view::npos) return options;
  const std::string_view detail = text.substr(colon + 1);
  if (*method == Method::kAdaptive) {
    const auto score = ScoreCombinationFromName(detail);
    if (!score) throw fail("expected adaptive:sum_inl|sum_inl_rat|mult_inl|sum_msac|mult_msac");
    options.score = *score;
  } else if (*method == Method::kSelect) {
    const auto alpha = ParseDouble(detail);
    if (!alpha) throw fail("expected select:ALPHA");
    options.alpha = *alpha;
  } else {
    throw fail("only adaptive has a score and select an alpha");
  }
  options.Validate();
  return options;
}

}  // namespace

std::vector<EstimatorOptions> ParseMethods(std::string_view text, const EstimatorOptions& base) {
  std::vector<EstimatorOptions> methods;
  for (const std::string_view part : SplitBy(text, ',')) methods.push_back(ParseMethod(part, base));
  return methods;
}

std::string MethodTitle(const EstimatorOptions& options) {
  const std::string name(ToString(options.method));
  switch (options.method) {
    case Method::kAdaptive:
      return fmt::format("{}:{}", name, ToString(options.score));
    case Method::kSelect:
      return fmt::format("{}:{}", name, FormatDouble(options.alpha));
    case Method::kP3p:
    case Method::kE5p1:
    case Method::kHybridRansac:
    case Method::kHloc:
      return name;
  }
  return name;
}

std::string LocalizationRow::Name() const {
  std::string name = method;
  for (const std::string* part : {&source, &alignment, &filter}) {
    if (!part->empty()) name += ", " + *part;
  }
  return name;
}

LocalizationComparison CompareLocalization(
    std::span<const ComparedSource> sources, std::span<const Query> queries,
    const MatchSource& matches, std::span<const PosedImage> references,
    std::span<const ReferenceMatch> reference_matches, const PosesByName& ground_truth,
    const LocalizationGrid& grid, const std::function<void()>& on_progress) {
  return Runner(sources, queries, matches, references, reference_matches, ground_truth, grid)
      .Run(on_progress);
}

}  // namespace raylift
