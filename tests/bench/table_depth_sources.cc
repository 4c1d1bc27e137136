// The table of depth sources on a real scene: recall by source of geometry, estimator, consistency
// filter, depth alignment and thinned references, over several seeds, as Markdown; and what it says
// of the automatic filter and of alignment.
//
//   table_depth_sources DATA/rgbd_small [SEEDS] > table.md
//
// A cell reads "A/B/C (b-B) P, R": recalls in percent at (2 cm, 0.5 deg), (5 cm, 5 deg) and (10 cm,
// 1 deg), means over the runs; the lowest and highest B of a run; the medians over queries and runs
// in cm and degrees. Runs are the seeds times the ways to take every n-th reference.

#include <algorithm>
#include <array>
#include <charconv>
#include <compare>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "raylift/base/parallel.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/evaluation/recall.h"
#include "raylift/io/colmap_model.h"
#include "raylift/lifting/aligned_source.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

constexpr std::array<Threshold, 3> kThresholds = {{{0.02, 0.5}, {0.05, 5}, {0.10, 1}}};
constexpr std::array<int, 3> kThinning = {1, 2, 5};
constexpr std::array<AlignMode, 3> kAlignments = {AlignMode::kOff, AlignMode::kScale,
                                                  AlignMode::kGrid};
constexpr double kAlpha = 0.8;         // Select's
constexpr double kNotLocalized = 1e9;  // in medians of positions

enum class Estimator { kP3p, kSum, kMult, kSelect };
constexpr std::array<std::pair<Estimator, std::string_view>, 4> kEstimators = {
    {{Estimator::kP3p, "P3P"},
     {Estimator::kSum, "Adaptive sum_msac"},
     {Estimator::kMult, "Adaptive mult_msac"},
     {Estimator::kSelect, "Select"}}};

struct NamedFilter {
  std::string_view name;
  FilterOptions options;
};

FilterOptions Fixed(double px, int views, double ratio) {
  return {.mode = FilterMode::kFixed,
          .thresholds = {.reprojection_px = px, .min_views = views, .min_ratio = ratio}};
}

const std::array<NamedFilter, 6> kFilters = {{{"off", {}},
                                              {"4 px 3", Fixed(4, 3, 0)},
                                              {"4 px 3 + 0.8", Fixed(4, 3, 0.8)},
                                              {"2 px 3 + 0.8", Fixed(2, 3, 0.8)},
                                              {"2 px 18", Fixed(2, 18, 0)},
                                              {"auto", {.mode = FilterMode::kAuto}}}};

using Errors = std::vector<std::optional<PoseError>>;  // by run, then by query

struct Cell {
  std::array<double, kThresholds.size()> recalls_percent{};
  double lowest_percent = 100, highest_percent = 0;  // of a run, at the second threshold
  double median_position = 0, median_rotation_deg = 0;

  std::string Text() const {
    const std::string recalls = fmt::format("{:.0f}/{:.0f}/{:.0f}", recalls_percent[0],
                                            recalls_percent[1], recalls_percent[2]);
    if (median_position >= kNotLocalized) return recalls;
    return fmt::format("{} ({:.0f}-{:.0f}) {:.1f}, {:.2f}", recalls, lowest_percent,
                       highest_percent, 100 * median_position, median_rotation_deg);
  }
};

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Cell Summarize(const Errors& errors, size_t num_queries) {
  Cell cell;
  std::vector<double> positions, rotations_deg;
  const size_t num_runs = errors.size() / num_queries;
  for (size_t run = 0; run < num_runs; ++run) {
    double within = 0;
    for (size_t q = 0; q < num_queries; ++q) {
      const auto& error = errors[run * num_queries + q];
      positions.push_back(error ? error->position : kNotLocalized);
      rotations_deg.push_back(error ? error->rotation_deg : 180);
      for (size_t t = 0; t < kThresholds.size(); ++t) {
        if (!error || !kThresholds[t].Accepts(*error)) continue;
        cell.recalls_percent[t] += 100.0 / static_cast<double>(errors.size());
        within += t == 1 ? 100.0 / static_cast<double>(num_queries) : 0;
      }
    }
    cell.lowest_percent = std::min(cell.lowest_percent, within);
    cell.highest_percent = std::max(cell.highest_percent, within);
  }
  cell.median_position = Median(std::move(positions));
  cell.median_rotation_deg = Median(std::move(rotations_deg));
  return cell;
}

struct Scene {
  fs::path data;
  std::vector<Query> queries;
  std::vector<Rigid3> truth;  // of each query
  size_t num_seeds;
};

Scene LoadScene(const fs::path& data, size_t num_seeds) {
  Scene scene{data, ReadQueryList(data / "queries_with_intrinsics.txt"), {}, num_seeds};
  std::map<std::string, Rigid3> truth;
  for (const PosedImage& image : ReadColmapModel(data / "model_query_gt").PosedImages()) {
    truth.emplace(image.name, image.cam_from_world);
  }
  for (const Query& query : scene.queries) scene.truth.push_back(truth.at(query.name));
  return scene;
}

PoseEstimate Estimate(const PoseProblem& problem, Method method, ScoreCombination score,
                      size_t seed) {
  EstimatorOptions options;
  options.method = method;
  options.score = score;
  options.seed = seed;
  return MakePoseEstimator(options)->Estimate(problem);
}

std::optional<PoseError> ErrorOf(const PoseEstimate& estimate, const Rigid3& truth) {
  if (!estimate.cam_from_world || !estimate.position_observable) return std::nullopt;
  return ComparePoses(*estimate.cam_from_world, truth);
}

// Every n-th reference, from `first` on.
ReferenceSet Thinned(ReferenceSet references, size_t every, size_t first) {
  std::vector<PosedImage> images;
  for (size_t i = 0; i < references.images.size(); ++i) {
    if (i % every == first) {
      images.push_back(references.images[i]);
    } else {
      references.thinned_out.push_back(references.images[i].name);
    }
  }
  references.images = std::move(images);
  return references;
}

std::optional<MultiViewNoise> NoiseOf(std::span<const PoseProblem> problems) {
  std::vector<MultiViewNoise> noise;
  for (const PoseProblem& problem : problems) {
    const auto trust =
        EstimateTrust(problem.references, problem.matches_2d2d, problem.matches_2d3d);
    if (trust) noise.push_back(trust->noise);
  }
  return PooledNoise(noise);
}

// One thinning of the references.
class ThinnedScene {
 public:
  ThinnedScene(const Scene& scene, int every, int first) : scene_(scene) {
    references_ = Thinned(LoadReferences(scene.data / "model_ref", 1).references,
                          static_cast<size_t>(every), static_cast<size_t>(first));
    const auto source = OpenHlocMatches(
        {scene.data / "features.h5", scene.data / "matches.h5", scene.data / "pairs.txt"},
        references_, 10);
    for (const Query& query : scene.queries) {
      QueryMatches matches = source->Match(query);
      problems_.push_back({.name = query.name,
                           .query_camera = query.camera,
                           .references = std::move(matches.references),
                           .reference_clusters = {},
                           .matches_2d2d = std::move(matches.matches),
                           .matches_2d3d = {}});
    }
    reference_matches_ = CollectReferenceMatches(scene.queries, *source, references_, 0);
    // Needs no geometry: once for all.
    e5p1_.resize(problems_.size() * scene.num_seeds);
    ParallelFor(e5p1_.size(), 0, [&](size_t i) {
      e5p1_[i] = Estimate(problems_[i % problems_.size()], Method::kE5p1, {}, i / problems_.size());
    });
  }

  size_t num_queries() const { return problems_.size(); }
  const ReferenceSet& references() const { return references_; }
  const std::vector<ReferenceMatch>& reference_matches() const { return reference_matches_; }

  Errors E5p1() const {
    Errors errors;
    for (size_t i = 0; i < e5p1_.size(); ++i) {
      errors.push_back(ErrorOf(e5p1_[i], scene_.truth[i % problems_.size()]));
    }
    return errors;
  }

  // The queries' problems, lifted.
  std::vector<PoseProblem> Lift(const GeometrySource& source) const {
    std::vector<PoseProblem> problems = problems_;
    ParallelFor(problems.size(), 0, [&](size_t q) {
      problems[q].matches_2d3d =
          Matches2D3D(LiftMatches(source, problems[q].references, problems[q].matches_2d2d));
    });
    return problems;
  }

  Errors Run(std::vector<PoseProblem> problems, FilterOptions filter, Estimator estimator) const {
    if (estimator == Estimator::kP3p) filter.few_points = FewPoints::kKeepBest;
    filter.scene_noise = NoiseOf(problems);
    ParallelFor(problems.size(), 0, [&](size_t q) { FilterProblem(filter, problems[q]); });
    Errors errors(e5p1_.size());
    ParallelFor(errors.size(), 0, [&](size_t i) {
      const size_t q = i % problems.size();
      errors[i] = ErrorOf(EstimateBy(estimator, problems[q], i), scene_.truth[q]);
    });
    return errors;
  }

 private:
  PoseEstimate EstimateBy(Estimator estimator, const PoseProblem& problem, size_t index) const {
    const size_t seed = index / problems_.size();
    switch (estimator) {
      case Estimator::kP3p:
        return Estimate(problem, Method::kP3p, {}, seed);
      case Estimator::kSum:
        return Estimate(problem, Method::kAdaptive, ScoreCombination::kSumMsac, seed);
      case Estimator::kMult:
        return Estimate(problem, Method::kAdaptive, ScoreCombination::kMultMsac, seed);
      case Estimator::kSelect:
        break;
    }
    // As Method::kSelect does, without estimating E5+1 again (Eq. 6).
    PoseEstimate p3p = Estimate(problem, Method::kP3p, {}, seed);
    const PoseEstimate& e5p1 = e5p1_[index];
    const bool take_p3p =
        p3p.cam_from_world &&
        (!e5p1.cam_from_world || p3p.score_2d2d.num_inliers > kAlpha * e5p1.score_2d2d.num_inliers);
    return take_p3p ? p3p : e5p1;
  }

  const Scene& scene_;
  ReferenceSet references_;
  std::vector<PoseProblem> problems_;  // without 2D-3D matches
  std::vector<ReferenceMatch> reference_matches_;
  std::vector<PoseEstimate> e5p1_;  // by seed, then by query
};

std::unique_ptr<GeometrySource> Aligned(NamedGeometry geometry, const ThinnedScene& scene,
                                        AlignMode mode) {
  if (mode == AlignMode::kOff) return std::move(geometry.source);
  const DepthAlignment alignment = AlignDepth(*geometry.source, scene.references().images,
                                              scene.reference_matches(), {.mode = mode}, 0);
  return std::make_unique<AlignedSource>(std::move(geometry.source), alignment.Corrections());
}

struct CellKey {
  int every;
  std::string_view depth;
  AlignMode align;
  std::string_view filter;
  Estimator estimator;

  auto operator<=>(const CellKey&) const = default;
};
using Cells = std::map<CellKey, Cell>;

void Append(const Errors& more, Errors& errors) {
  errors.insert(errors.end(), more.begin(), more.end());
}

// `scenes` are the ways to thin the references: their errors are pooled.
void PrintRows(std::span<const ThinnedScene> scenes, std::string_view depth,
               const std::string& spec, Cells& cells) {
  const int every = static_cast<int>(scenes.size());
  for (const AlignMode align : kAlignments) {
    std::map<std::pair<std::string_view, Estimator>, Errors> errors;
    for (const ThinnedScene& scene : scenes) {
      const auto source = Aligned(
          MakeGeometrySource(spec, {.references = scene.references().images}), scene, align);
      const std::vector<PoseProblem> problems = scene.Lift(*source);
      for (const NamedFilter& filter : kFilters) {
        for (const auto& [estimator, title] : kEstimators) {
          Append(scene.Run(problems, filter.options, estimator), errors[{filter.name, estimator}]);
        }
      }
    }
    for (const NamedFilter& filter : kFilters) {
      fmt::print("| 1/{} | {} | {} | {} |", every, depth, ToString(align), filter.name);
      for (const auto& [estimator, title] : kEstimators) {
        const Cell cell =
            Summarize(errors.at({filter.name, estimator}), scenes.front().num_queries());
        cells[{every, depth, align, filter.name, estimator}] = cell;
        fmt::print(" {} |", cell.Text());
      }
      fmt::print("\n");
    }
    std::fflush(stdout);
  }
}

Cells PrintTable(const Scene& scene) {
  fmt::print("| references | depth | align | filter |");
  for (const auto& [estimator, title] : kEstimators) fmt::print(" {} |", title);
  fmt::print("\n|---|---|---|---|---|---|---|---|\n");
  const std::string data = scene.data.string();
  Cells cells;
  std::string e5p1;
  for (const int every : kThinning) {
    std::vector<ThinnedScene> scenes;
    for (int first = 0; first < every; ++first) scenes.emplace_back(scene, every, first);
    PrintRows(scenes, "mesh", "mesh:" + data + "/mesh.ply", cells);
    PrintRows(scenes, "sensor", "depth:" + data + "/depth_sensor,unit=mm,invalid=65535", cells);
    PrintRows(scenes, "mono_sim", "depth:" + data + "/depth_mono_sim", cells);
    Errors errors;
    for (const ThinnedScene& thinned : scenes) Append(thinned.E5p1(), errors);
    e5p1 += fmt::format("E5+1, which needs no depth, 1/{}: {}\n\n", every,
                        Summarize(errors, scene.queries.size()).Text());
  }
  fmt::print("\n{}", e5p1);
  return cells;
}

// The smallest difference of recalls between the automatic filter and another.
std::string AutoMinus(const Cells& cells, CellKey key, std::span<const std::string_view> others) {
  std::string text;
  key.filter = "auto";
  const Cell automatic = cells.at(key);
  for (size_t t = 0; t < kThresholds.size(); ++t) {
    double best = 0;
    for (const std::string_view other : others) {
      key.filter = other;
      best = std::max(best, cells.at(key).recalls_percent[t]);
    }
    text += fmt::format("{}{:+.0f}", t == 0 ? "" : " / ", automatic.recalls_percent[t] - best);
  }
  return text;
}

void PrintFilterFindings(const Cells& cells) {
  constexpr std::array<std::string_view, 1> kOff = {"off"};
  constexpr std::array<std::string_view, 4> kFixed = {"4 px 3", "4 px 3 + 0.8", "2 px 3 + 0.8",
                                                      "2 px 18"};
  fmt::print(
      "The automatic filter, in points of recall, without alignment:\n\n"
      "| references | depth | estimator | auto - off | auto - best fixed |\n"
      "|---|---|---|---|---|\n");
  for (const auto& [key, cell] : cells) {
    if (key.align != AlignMode::kOff || key.filter != "auto") continue;
    const auto name = std::find_if(kEstimators.begin(), kEstimators.end(),
                                   [&](const auto& e) { return e.first == key.estimator; });
    fmt::print("| 1/{} | {} | {} | {} | {} |\n", key.every, key.depth, name->second,
               AutoMinus(cells, key, kOff), AutoMinus(cells, key, kFixed));
  }
}

void PrintAlignmentFindings(const Cells& cells) {
  fmt::print(
      "\nThe share of P3P's gap between mono_sim and mesh (recalls without filter; medians) that "
      "alignment closes:\n\n| references | align | recalls | cm | deg |\n|---|---|---|---|---|\n");
  for (const int every : kThinning) {
    const auto cell = [&](std::string_view depth, AlignMode align) {
      return cells.at({every, depth, align, "off", Estimator::kP3p});
    };
    const Cell mesh = cell("mesh", AlignMode::kOff);
    const Cell before = cell("mono_sim", AlignMode::kOff);
    for (const AlignMode align : {AlignMode::kScale, AlignMode::kGrid}) {
      const Cell after = cell("mono_sim", align);
      const auto closed = [](double from, double to, double goal) {
        return from == goal ? std::string("no gap")
                            : fmt::format("{:.0f} %", 100 * (to - from) / (goal - from));
      };
      fmt::print("| 1/{} | {} |", every, ToString(align));
      for (size_t t = 0; t < kThresholds.size(); ++t) {
        fmt::print(
            "{} {}", t == 0 ? "" : " /",
            closed(before.recalls_percent[t], after.recalls_percent[t], mesh.recalls_percent[t]));
      }
      fmt::print(
          " | {} | {} |\n",
          closed(before.median_position, after.median_position, mesh.median_position),
          closed(before.median_rotation_deg, after.median_rotation_deg, mesh.median_rotation_deg));
    }
  }
}

int Main(int argc, char** argv) {
  size_t num_seeds = 10;
  const std::string seeds = argc > 2 ? argv[2] : "10";
  const auto parsed = std::from_chars(seeds.data(), seeds.data() + seeds.size(), num_seeds);
  if (argc < 2 || parsed.ec != std::errc() || num_seeds < 1) {
    std::fprintf(stderr, "usage: table_depth_sources DATA/rgbd_small [SEEDS]\n");
    return 2;
  }
  const Cells cells = PrintTable(LoadScene(argv[1], num_seeds));
  PrintFilterFindings(cells);
  PrintAlignmentFindings(cells);
  return 0;
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) { return raylift::Main(argc, argv); }
