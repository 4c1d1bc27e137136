#include "raylift/localization/quick_doctor.h"

#include <unordered_map>

#include <fmt/format.h>

#include "raylift/lifting/input_doctor.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {
namespace {

constexpr size_t kQueries = 30;
constexpr size_t kMatches = 1500;

}  // namespace

QuickDoctor::QuickDoctor(std::span<const Query> queries)
    : wanted_(queries.size(), false),
      by_name_(SampleByName(queries, kQueries)),
      matches_(queries.size()) {
  for (const size_t query : by_name_) wanted_[query] = true;
}

void QuickDoctor::Add(size_t query, std::span<const PosedImage> references,
                      std::span<const Match2D2D> matches) {
  MatchesOfQuery& kept = matches_[query];
  for (const PosedImage& reference : references) kept.references.push_back(reference.name);
  kept.matches = TransitiveMatches(matches);
}

std::optional<std::string> QuickDoctor::Warn(const NamedGeometry& geometry,
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
      const auto a = index_of_name.find(kept.references[static_cast<size_t>(match.reference_a)]);
      const auto b = index_of_name.find(kept.references[static_cast<size_t>(match.reference_b)]);
      // Localized queries that have become references tell nothing of the input.
      if (a == index_of_name.end() || b == index_of_name.end()) continue;
      match.reference_a = a->second;
      match.reference_b = b->second;
      all.push_back(match);
    }
  }
  const Diagnosis diagnosis = Diagnose(
      MakeDoctorInput(geometry, references.images, all, poses),
      {.max_matches = kMatches, .half_pixels = false, .mesh_frames = false, .threads = threads});
  // That few points come from the geometry, or few matches fit, is for RunCheck to say.
  const bool named = diagnosis.fault != InputFault::kNone && diagnosis.fault != InputFault::kPoses;
  if (diagnosis.verdict != InputVerdict::kRepair && !named) return std::nullopt;
  return fmt::format("{}: {}", geometry.source->Description(), Summary(diagnosis));
}

}  // namespace raylift
