// Every estimator of the paper on the same problems, as a Markdown table: P3P, E5+1, the 5 x 2
// variants of Adaptive, Select by alpha, Hybrid RANSAC and HLoc.
//
//   table_methods                  the synthetic regimes: solved (0.1 m, 1 deg) and position
//   table_methods MODEL FOLDER...  folders of pose problems, ten seeds; MODEL is a COLMAP model of
//                                  the queries' true poses
//
// Thresholds are 4 px (2D-3D) and 2 px (2D-2D).

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

#include "base/statistics.h"
#include "support/synthetic_problem.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/pose_problem_json.h"

namespace raylift {
namespace {

constexpr int kSeeds = 10;

struct Variant {
  std::string title;
  EstimatorOptions options;
};

std::vector<Variant> AllVariants() {
  EstimatorOptions standard;
  standard.reprojection_threshold_px = 4;
  standard.sampson_threshold_px = 2;
  std::vector<Variant> variants;
  for (const EnumName<Method>& method : kEnumNames<Method>) {
    EstimatorOptions options = standard;
    options.method = method.value;
    if (method.value == Method::kAdaptive) {
      using enum ScoreCombination;
      for (const auto score : {kSumInliers, kSumInlierRatios, kMultInliers, kSumMsac, kMultMsac}) {
        for (const auto local : {LocalOptimization::kHybrid, LocalOptimization::kSplit}) {
          options.score = score;
          options.local_optimization = local;
          variants.push_back(
              {fmt::format("Adaptive {} {}", ToString(score), ToString(local)), options});
        }
      }
    } else if (method.value == Method::kSelect) {
      for (const double alpha : {0.7, 0.8, 0.9, 1.0}) {
        options.alpha = alpha;
        variants.push_back({fmt::format("Select {:.1f}", alpha), options});
      }
    } else {
      variants.push_back({std::string(method.title), options});
    }
  }
  return variants;
}

struct Problem {
  PoseProblem problem;
  Rigid3 truth;
};

// What one variant reaches on some problems.
struct Outcome {
  std::vector<double> position, rotation_deg, ms;

  double RecallPercent(double position_limit, double limit_deg) const {
    size_t within = 0;
    for (size_t i = 0; i < position.size(); ++i) {
      within += position[i] <= position_limit && rotation_deg[i] <= limit_deg ? 1 : 0;
    }
    return 100.0 * static_cast<double>(within) / static_cast<double>(position.size());
  }
};

Outcome Run(const Variant& variant, const std::vector<Problem>& problems, int seeds) {
  const size_t count = problems.size() * static_cast<size_t>(seeds);
  Outcome outcome{std::vector<double>(count, 1e9), std::vector<double>(count, 180),
                  std::vector<double>(count)};
  ParallelFor(count, 0, [&](size_t i) {
    EstimatorOptions options = variant.options;
    options.seed = i / problems.size();
    const Problem& problem = problems[i % problems.size()];
    const auto start = std::chrono::steady_clock::now();
    const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(problem.problem);
    outcome.ms[i] =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    if (estimate.cam_from_world) {
      const PoseError error = ComparePoses(*estimate.cam_from_world, problem.truth);
      outcome.position[i] = error.position;
      outcome.rotation_deg[i] = error.rotation_deg;
    }
  });
  return outcome;
}

void PrintRegimes() {
  std::string header = "| |";
  std::string rule = "|---|";
  std::vector<std::vector<Problem>> regimes;
  for (const SyntheticRegime& regime : AllRegimes()) {
    header += fmt::format(" {} |", regime.name);
    rule += "---|";
    std::vector<Problem>& problems = regimes.emplace_back();
    for (const SyntheticProblem& made : MakeRegime(regime, regime.num_problems)) {
      problems.push_back({made.problem, made.query_from_world});
    }
  }
  fmt::print("Solved % (median position error, m)\n\n{}\n{}\n", header, rule);
  for (const Variant& variant : AllVariants()) {
    fmt::print("| {} |", variant.title);
    for (const std::vector<Problem>& problems : regimes) {
      const Outcome outcome = Run(variant, problems, 1);
      fmt::print(" {:.0f} ({:.4f}) |", outcome.RecallPercent(0.1, 1),
                 UpperMedianOr(outcome.position, 0));
    }
    fmt::print("\n");
  }
}

std::vector<Problem> ReadProblems(const std::string& folder, const PosesByName& truth) {
  std::vector<Problem> problems;
  for (const auto& path : ListPoseProblems(folder)) {
    PoseProblem problem = ReadPoseProblem(path).problem;
    const auto found = truth.find(problem.name);
    if (found == truth.end()) {
      throw InputError(path, "name", fmt::format("no true pose of \"{}\"", problem.name));
    }
    problems.push_back({std::move(problem), found->second});
  }
  return problems;
}

void PrintFolder(const std::string& folder, const PosesByName& truth) {
  const std::vector<Problem> problems = ReadProblems(folder, truth);
  fmt::print("\n{}: {} queries x {} seeds\n\n", folder, problems.size(), kSeeds);
  fmt::print("| | 2 cm, 0.5 deg | 5 cm, 5 deg | 10 cm, 1 deg | median cm | deg | ms |\n");
  fmt::print("|---|---|---|---|---|---|---|\n");
  for (const Variant& variant : AllVariants()) {
    const Outcome outcome = Run(variant, problems, kSeeds);
    fmt::print("| {} | {:.0f} | {:.0f} | {:.0f} | {:.2f} | {:.2f} | {:.2f} |\n", variant.title,
               outcome.RecallPercent(0.02, 0.5), outcome.RecallPercent(0.05, 5),
               outcome.RecallPercent(0.1, 1), 100 * UpperMedianOr(outcome.position, 0),
               UpperMedianOr(outcome.rotation_deg, 0), UpperMedianOr(outcome.ms, 0));
  }
}

int Main(const std::vector<std::string>& arguments) {
  if (arguments.empty()) {
    PrintRegimes();
    return 0;
  }
  PosesByName truth;
  for (const PosedImage& image : ReadColmapModel(arguments[0]).PosedImages()) {
    truth[image.name] = image.cam_from_world;
  }
  for (size_t i = 1; i < arguments.size(); ++i) {
    PrintFolder(arguments[i], truth);
  }
  return 0;
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  try {
    return raylift::Main({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    fmt::print(stderr, "table_methods: {}\n", error.what());
    return 1;
  }
}
