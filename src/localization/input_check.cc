#include "raylift/localization/input_check.h"

#include <algorithm>
#include <numeric>
#include <unordered_map>

#include <fmt/format.h>

#include "raylift/lifting/depth_doctor.h"

namespace raylift {
namespace {

constexpr size_t kQueries = 30;
constexpr size_t kMatches = 1500;

}  // namespace

InputCheck::InputCheck(std::span<const Query> queries)
    : wanted_(queries.size(), false), matches_(queries.size()) {
  std::vector<size_t> sorted(queries.size());
  std::iota(sorted.begin(), sorted.end(), size_t{0});
  std::sort(sorted.begin(), sorted.end(),
            [&](size_t a, size_t b) { return queries[a].name < queries[b].name; });
  const size_t count = std::min(kQueries, sorted.size());
  for (size_t i = 0; i < count; ++i) {
    by_name_.push_back(sorted[i * sorted.size() / count]);
    wanted_[by_name_.back()] = true;
  }
}

void InputCheck::Add(size_t query, std::span<const PosedImage> references,
                     std::span<const Match2D2D> matches) {
  MatchesOfQuery& kept = matches_[query];
  for (const PosedImage& reference : references) kept.references.push_back(reference.name);
  kept.matches = TransitiveMatches(matches);
}

std::optional<std::string> InputCheck::Warn(const NamedGeometry& geometry,
                                            const ReferenceSet& references, PoseConvention poses,
                                            int threads) const {
  if (geometry.kind == GeometryKind::kSfm) return std::nullopt;
  std::unordered_map<std::string, int> index_of_name;
  for (size_t i = 0; i < references.images.size(); ++i) {
    index_of_name.emplace(references.images[i].name, static_cast<int>(i));
  }
  std::vector<ReferenceMatch> all;
  for (const size_t query : by_name_) {
    const MatchesOfQuery& kept = matches_[query];
    for (ReferenceMatch match : kept.matches) {
      match.reference_a = index_of_name.at(kept.references[static_cast<size_t>(match.reference_a)]);
      match.reference_b = index_of_name.at(kept.references[static_cast<size_t>(match.reference_b)]);
      all.push_back(match);
    }
  }
  const Diagnosis diagnosis = Diagnose(MakeDoctorInput(geometry, references.images, all, poses),
                                       {.max_matches = kMatches, .threads = threads});
  if (!diagnosis.suspicious()) return std::nullopt;
  return fmt::format("{}: {}", geometry.source->Description(), Summary(diagnosis));
}

}  // namespace raylift
