#include "localization/calibration_images.h"

#include <algorithm>
#include <numeric>
#include <string>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/index_sets.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

auto KeyOf(const ReferenceMatch& m) {
  return std::tuple(m.reference_a, m.reference_b, m.a_px.x(), m.a_px.y(), m.b_px.x(), m.b_px.y());
}

// Returns the same whichever of the two was the query.
ReferenceMatch MatchOf(int a, const Eigen::Vector2d& a_px, int b, const Eigen::Vector2d& b_px) {
  if (a < b) return {a, b, a_px, b_px};
  return {b, a, b_px, a_px};
}

void SortAndDropRepeated(std::vector<ReferenceMatch>& matches) {
  std::sort(matches.begin(), matches.end(),
            [](const ReferenceMatch& a, const ReferenceMatch& b) { return KeyOf(a) < KeyOf(b); });
  const auto end = std::unique(
      matches.begin(), matches.end(),
      [](const ReferenceMatch& a, const ReferenceMatch& b) { return KeyOf(a) == KeyOf(b); });
  matches.erase(end, matches.end());
}

// A source whose queries are the references.
class ReferencesAsQueries final : public MatchSource {
 public:
  explicit ReferencesAsQueries(std::shared_ptr<const MatchSource> source)
      : source_(std::move(source)) {}
  QueryMatches Match(const Query& query) const override { return source_->MatchReference(query); }
  std::vector<std::string> Warnings() const override { return source_->Warnings(); }

 private:
  std::shared_ptr<const MatchSource> source_;
};

}  // namespace

CachedMatches::CachedMatches(std::shared_ptr<const MatchSource> source, size_t most_bytes)
    : source_(std::move(source)), most_bytes_(most_bytes) {}

QueryMatches CachedMatches::Match(const Query& query) const {
  return Cached(query, of_query_, &MatchSource::Match);
}

QueryMatches CachedMatches::Cached(const Query& query, ByName& known,
                                   QueryMatches (MatchSource::*match)(const Query&) const) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = known.find(query.name); found != known.end()) return found->second;
  }
  QueryMatches matches = ((*source_).*match)(query);
  const size_t bytes =
      matches.matches.size() * sizeof(Match2D2D) + matches.references.size() * sizeof(PosedImage);
  const std::lock_guard lock(mutex_);
  if (bytes_ + bytes <= most_bytes_ && known.emplace(query.name, matches).second) {
    bytes_ += bytes;
  }
  return matches;
}

QueryMatches CachedMatches::MatchPhotograph(const Query& query, const Image& photograph) const {
  return source_->MatchPhotograph(query, photograph);
}

QueryMatches CachedMatches::MatchFeatures(const Query& query, const Features& features) const {
  return source_->MatchFeatures(query, features);
}

QueryMatches CachedMatches::MatchReference(const Query& reference) const {
  return Cached(reference, of_reference_, &MatchSource::MatchReference);
}

CalibrationImages ImagesToCalibrateBy(const ReferenceSet& references,
                                      const std::shared_ptr<const MatchSource>& matches,
                                      std::span<const Query> queries) {
  std::unordered_set<std::string> names;
  for (const Query& query : queries) names.insert(query.name);
  const bool are_queries =
      !references.images.empty() &&
      std::all_of(references.images.begin(), references.images.end(),
                  [&](const PosedImage& reference) { return names.contains(reference.name); });
  if (are_queries) return {CalibratedBy::kReferences, QueriesOf(references), matches};
  if (!matches->MatchesReferences()) {
    return {CalibratedBy::kQueries, {queries.begin(), queries.end()}, matches};
  }
  return {CalibratedBy::kReferences, QueriesOf(references),
          std::make_shared<ReferencesAsQueries>(matches)};
}

bool TellsNoise(const CalibrationImages& images, const Scene& scene) {
  return images.by == CalibratedBy::kQueries || scene.rendered == nullptr;
}

std::vector<size_t> OrderByName(std::span<const Query> queries) {
  std::vector<size_t> order(queries.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::sort(order.begin(), order.end(),
            [&](size_t a, size_t b) { return queries[a].name < queries[b].name; });
  return order;
}

std::vector<size_t> SampleByName(std::span<const Query> queries, size_t count) {
  const std::vector<size_t> sorted = OrderByName(queries);
  std::vector<size_t> sample;
  for (const size_t i : EvenlySpaced(sorted.size(), count)) sample.push_back(sorted[i]);
  return sample;
}

std::vector<ReferenceMatch> CollectReferenceMatches(std::span<const Query> images,
                                                    const MatchSource& match_source,
                                                    const ReferenceSet& references, int threads,
                                                    size_t enough) {
  std::unordered_map<std::string, int> index_of_name;
  for (size_t i = 0; i < references.images.size(); ++i) {
    index_of_name.emplace(references.images[i].name, static_cast<int>(i));
  }
  std::vector<size_t> count(references.images.size(), 0);
  std::vector<ReferenceMatch> collected;
  // Queries in batches: matched in parallel, taken in order.
  constexpr size_t kBatch = 64;
  for (size_t begin = 0; begin < images.size(); begin += kBatch) {
    const auto batch = images.subspan(begin, std::min(kBatch, images.size() - begin));
    std::vector<std::vector<ReferenceMatch>> found(batch.size());
    ParallelFor(batch.size(), threads, [&](size_t i) {
      const QueryMatches matches = match_source.Match(batch[i]);
      const auto index_of = [&](int reference) {
        return index_of_name.at(matches.references[static_cast<size_t>(reference)].name);
      };
      if (const auto query = index_of_name.find(batch[i].name); query != index_of_name.end()) {
        for (const Match2D2D& m : matches.matches) {
          const int reference = index_of(m.reference);
          if (reference == query->second) continue;
          found[i].push_back(MatchOf(query->second, m.query_px, reference, m.reference_px));
        }
        return;
      }
      found[i] = TransitiveMatches(matches.matches);
      for (ReferenceMatch& m : found[i]) {
        m.reference_a = index_of(m.reference_a);
        m.reference_b = index_of(m.reference_b);
      }
      std::erase_if(found[i],
                    [](const ReferenceMatch& m) { return m.reference_a == m.reference_b; });
    });
    for (const auto& of_query : found) {
      const std::vector<size_t> before = count;
      for (const ReferenceMatch& m : of_query) {
        const auto a = static_cast<size_t>(m.reference_a);
        const auto b = static_cast<size_t>(m.reference_b);
        if (before[a] >= enough && before[b] >= enough) continue;
        collected.push_back(m);
        ++count[a];
        ++count[b];
      }
    }
  }
  SortAndDropRepeated(collected);
  return collected;
}

std::vector<size_t> NoiseSample(std::span<const Query> images) {
  constexpr size_t kImages = 30;
  return SampleByName(images, kImages);
}

std::optional<MultiViewNoise> LearnGeometryNoise(const CalibrationImages& images,
                                                 const Scene& scene,
                                                 const LocalizerOptions& options, int threads) {
  if (options.filter.mode != FilterMode::kAuto ||
      options.candidates.mode == CandidateMode::kTriangulate || !TellsNoise(images, scene)) {
    return std::nullopt;
  }
  const auto geometry = scene.Geometry();
  std::vector<const GeometrySource*> sources;
  for (const auto& source : geometry) sources.push_back(source.get());
  const std::vector<size_t> sample = NoiseSample(images.images);
  std::vector<std::optional<MultiViewNoise>> found(sample.size());
  ParallelFor(sample.size(), threads, [&](size_t i) {
    const QueryMatches of_image = images.matches->Match(images.images[sample[i]]);
    const LiftResult lifted =
        LiftMatches(sources, options.geometry_mode, of_image.references, of_image.matches);
    const auto trust = EstimateTrust(of_image.references, of_image.matches, Matches2D3D(lifted));
    if (trust) found[i] = trust->noise;
  });
  std::vector<MultiViewNoise> noise;
  for (const auto& of_image : found) {
    if (of_image) noise.push_back(*of_image);
  }
  return PooledNoise(noise);
}

}  // namespace raylift
