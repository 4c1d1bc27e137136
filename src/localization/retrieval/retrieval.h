// Retrieves the references that probably show what a query shows, before any matching.
//
//   vlad          images whose RootSIFT features are alike (made here)
//   global        global descriptors that a file of hloc's layout holds: their dot products
//   pose          cameras that look at the same part of space
//   overlap       cameras that see the same part of a mesh
//   covisibility  images that observe the same points of an SfM model
//
// Queries may be references, too, for pairs among these: none is its own reference. Equal scores
// are ranked by name. Nothing depends on the number of threads.

#pragma once

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "localization/retrieval/covisibility.h"

#include "raylift/base/enum_names.h"
#include "raylift/localization/match_source.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/features.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct Retrieval {
  RetrievedLists lists;  // of each query, indices into the references
  std::vector<std::string> warnings;
};

// Retrieves by any method but VLAD, which needs images. Throws InputError where a file does not
// hold what it must.
Retrieval RetrieveReferences(std::span<const Query> queries, std::span<const PosedImage> references,
                             const RetrievalOptions& options);

// Retrieves by VLAD as the built-in front end does, with its cache of features (front_end.cc).
RetrievedLists RetrieveByVlad(std::span<const Query> queries, const ReferenceSet& references,
                              const FrontEndOptions& options);

// The parts of RetrieveReferences. The lower index is first among equals.

// Retrieves by dot products; references whose product is negative are left out, as in hloc. The
// files are read in blocks: with descriptors of 4096 numbers, 128 MB hold what is in work, however
// many images there are.
RetrievedLists RetrieveByGlobalFeatures(std::span<const std::string> queries,
                                        std::span<const std::string> references,
                                        const GlobalFeatureFiles& files, int top_k, int threads,
                                        bool show_progress);

// Retrieves the nearest cameras, the score being minus the distance of the centers.
RetrievedLists RetrieveByDistance(std::span<const PosedImage> queries,
                                  std::span<const PosedImage> references, double max_angle_deg,
                                  int top_k, int threads);

// Retrieves by view frustum: the score is the share of points, spread over the query's view within
// the range, that fall into the reference's image, no farther than the range.
RetrievedLists RetrieveByFrustum(std::span<const PosedImage> queries,
                                 std::span<const PosedImage> references, const ViewRange& range,
                                 int top_k, int threads);

// Retrieves by overlap: the score is the share of a grid of rays through the query's image whose
// surface points the reference sees: in its image, from the same side and with nothing in between.
RetrievedLists RetrieveByOverlap(std::span<const PosedImage> queries,
                                 std::span<const PosedImage> references, const RayCaster& mesh,
                                 int top_k, int threads);

inline bool IsBetter(const RetrievedReference& a, const RetrievedReference& b) {
  return a.score != b.score ? a.score > b.score : a.reference_index < b.reference_index;
}

// Keeps the best k of a list, sorted.
inline void KeepBest(std::vector<RetrievedReference>* list, int k) {
  const auto count = std::min(static_cast<size_t>(std::max(0, k)), list->size());
  std::partial_sort(list->begin(), list->begin() + static_cast<std::ptrdiff_t>(count), list->end(),
                    IsBetter);
  list->resize(count);
}

// Drops the query itself from lists of k + 1; k at most are left.
inline void DropOwn(std::span<const std::string> queries, std::span<const std::string> references,
                    int k, RetrievedLists* lists) {
  for (size_t i = 0; i < lists->size(); ++i) {
    auto& list = (*lists)[i];
    std::erase_if(list, [&](const RetrievedReference& r) {
      return references[static_cast<size_t>(r.reference_index)] == queries[i];
    });
    list.resize(std::min(list.size(), static_cast<size_t>(std::max(0, k))));
  }
}

}  // namespace raylift
