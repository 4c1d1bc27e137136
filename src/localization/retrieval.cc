#include "raylift/localization/retrieval.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

template <typename T>
std::vector<std::string> NamesOf(std::span<const T> images) {
  std::vector<std::string> names;
  names.reserve(images.size());
  for (const T& image : images) names.push_back(image.name);
  return names;
}

// "2 of 5 queries, e.g. a.jpg, ..."; none where there are none. All of them are an error.
std::vector<std::string> WarnOf(const std::vector<std::string>& names, size_t of,
                                std::string_view what) {
  if (names.empty()) return {};
  if (names.size() == of) {
    throw InputError(fmt::format("all {} queries, e.g. {}, {}", of, names.front(), what));
  }
  return {fmt::format("{} of {} queries, e.g. {}, {}: they have no references", names.size(), of,
                      names.front(), what)};
}

// References by cameras, of those queries whose pose is known.
Retrieval RetrieveByCameras(std::span<const Query> queries, std::span<const PosedImage> references,
                            const RetrievalOptions& options) {
  std::vector<PosedImage> posed;
  std::vector<size_t> index_of_posed;
  std::vector<std::string> unknown;
  for (size_t i = 0; i < queries.size(); ++i) {
    const auto pose = options.prior_poses.find(queries[i].name);
    if (pose == options.prior_poses.end()) {
      unknown.push_back(queries[i].name);
      continue;
    }
    posed.push_back({queries[i].name, queries[i].camera, pose->second});
    index_of_posed.push_back(i);
  }
  Retrieval retrieval;
  retrieval.warnings = WarnOf(unknown, queries.size(), "have no prior pose");
  RetrievedLists found;
  if (options.method == RetrievalMethod::kOverlap) {
    RAYLIFT_CHECK(options.mesh != nullptr);
    found = RetrieveByOverlap(posed, references, *options.mesh, options.top_k, options.threads);
  } else if (options.view_range) {
    found =
        RetrieveByFrustum(posed, references, *options.view_range, options.top_k, options.threads);
  } else {
    found = RetrieveByDistance(posed, references, options.max_angle_deg, options.top_k,
                               options.threads);
  }
  retrieval.lists.resize(queries.size());
  for (size_t i = 0; i < found.size(); ++i) {
    retrieval.lists[index_of_posed[i]] = std::move(found[i]);
  }
  return retrieval;
}

Retrieval RetrieveByPoints(std::span<const Query> queries, std::span<const PosedImage> references,
                           const RetrievalOptions& options) {
  Retrieval retrieval;
  std::vector<std::string> unknown;
  const auto names = NamesOf(references);
  for (const Query& query : queries) {
    if (!options.covisibility.Knows(query.name)) unknown.push_back(query.name);
  }
  retrieval.lists =
      options.covisibility.MostShared(NamesOf(queries), names, options.top_k, options.threads);
  retrieval.warnings = WarnOf(unknown, queries.size(), "observe no points of the model");
  return retrieval;
}

Retrieval RetrieveSorted(std::span<const Query> queries, std::span<const PosedImage> references,
                         const RetrievalOptions& options) {
  switch (options.method) {
    case RetrievalMethod::kGlobal:
      return {
          RetrieveByGlobalFeatures(NamesOf(queries), NamesOf(references), options.global_features,
                                   options.top_k, options.threads, options.show_progress),
          {}};
    case RetrievalMethod::kPose:
    case RetrievalMethod::kOverlap:
      return RetrieveByCameras(queries, references, options);
    case RetrievalMethod::kCovisibility:
      return RetrieveByPoints(queries, references, options);
    case RetrievalMethod::kVlad:
      break;
  }
  RAYLIFT_CHECK(options.method != RetrievalMethod::kVlad);
  return {};
}

}  // namespace

Retrieval RetrieveReferences(std::span<const Query> queries, std::span<const PosedImage> references,
                             const RetrievalOptions& options) {
  std::vector<int> order(references.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return references[static_cast<size_t>(a)].name < references[static_cast<size_t>(b)].name;
  });
  std::vector<PosedImage> sorted;
  sorted.reserve(order.size());
  for (const int index : order) sorted.push_back(references[static_cast<size_t>(index)]);
  Retrieval retrieval = RetrieveSorted(queries, sorted, options);
  for (auto& list : retrieval.lists) {
    for (RetrievedReference& reference : list) {
      reference.reference_index = order[static_cast<size_t>(reference.reference_index)];
    }
  }
  return retrieval;
}

}  // namespace raylift
