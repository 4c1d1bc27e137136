// The names of methods, scores and the like: the one table behind options, help and result tables.

#include <array>

#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

constexpr std::array kMethods = {
    MethodName{Method::kP3p, "p3p", "P3P", "LO-RANSAC on the 2D-3D matches"},
    MethodName{Method::kE5p1, "e5p1", "E5+1", "LO-RANSAC on the 2D-2D matches; needs no geometry"},
    MethodName{Method::kAdaptive, "adaptive", "Adaptive",
               "both samples in every iteration, scored on both match sets"},
    MethodName{Method::kSelect, "select", "Select",
               "P3P and E5+1 apart, then one of them by its 2D-2D inliers"},
    MethodName{Method::kHybridRansac, "hybrid_ransac", "Hybrid RANSAC",
               "solver drawn by probability, summed inliers (Camposeco et al. 2018)"},
    MethodName{Method::kHloc, "hloc", "HLoc",
               "P3P per covisibility cluster of the references, best by inliers"},
};

template <typename Enum>
struct Name {
  Enum value;
  std::string_view name;
};

constexpr std::array kScores = {
    Name<ScoreCombination>{ScoreCombination::kSumInliers, "sum_inl"},
    Name<ScoreCombination>{ScoreCombination::kSumInlierRatios, "sum_inl_rat"},
    Name<ScoreCombination>{ScoreCombination::kMultInliers, "mult_inl"},
    Name<ScoreCombination>{ScoreCombination::kSumMsac, "sum_msac"},
    Name<ScoreCombination>{ScoreCombination::kMultMsac, "mult_msac"},
};

constexpr std::array kLocalOptimizations = {
    Name<LocalOptimization>{LocalOptimization::kHybrid, "hybrid"},
    Name<LocalOptimization>{LocalOptimization::kSplit, "split"},
};

template <typename Table, typename Enum>
std::string_view NameOf(const Table& table, Enum value) {
  for (const auto& entry : table) {
    if (entry.value == value) return entry.name;
  }
  return {};
}

template <typename Enum, typename Table>
std::optional<Enum> ValueOf(const Table& table, std::string_view name) {
  for (const auto& entry : table) {
    if (entry.name == name) return entry.value;
  }
  return std::nullopt;
}

}  // namespace

std::span<const MethodName> AllMethods() { return kMethods; }

std::string_view ToString(Method method) {
  for (const MethodName& entry : kMethods) {
    if (entry.method == method) return entry.name;
  }
  return {};
}

std::string_view ToString(ScoreCombination score) { return NameOf(kScores, score); }

std::string_view ToString(LocalOptimization local_optimization) {
  return NameOf(kLocalOptimizations, local_optimization);
}

std::string_view ToString(Solver solver) { return solver == Solver::kP3p ? "p3p" : "e5p1"; }

std::string_view ToString(FailureReason reason) {
  switch (reason) {
    case FailureReason::kNone:
      return "ok";
    case FailureReason::kTooFewMatches:
      return "too few matches";
    case FailureReason::kNoReferencePair:
      return "no reference has five matches";
    case FailureReason::kNoConsistentSample:
      return "no pose that enough matches agree on";
  }
  return {};
}

std::optional<Method> MethodFromName(std::string_view name) {
  for (const MethodName& entry : kMethods) {
    if (entry.name == name) return entry.method;
  }
  return std::nullopt;
}

std::optional<ScoreCombination> ScoreCombinationFromName(std::string_view name) {
  return ValueOf<ScoreCombination>(kScores, name);
}

std::optional<LocalOptimization> LocalOptimizationFromName(std::string_view name) {
  return ValueOf<LocalOptimization>(kLocalOptimizations, name);
}

}  // namespace raylift
