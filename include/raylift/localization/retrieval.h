// Retrieval: which references probably show what a query shows, before any matching.
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

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/localization/covisibility.h"
#include "raylift/localization/front_end.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/features.h"
#include "raylift/scene/photographs.h"

namespace raylift {

enum class RetrievalMethod { kVlad, kGlobal, kPose, kOverlap, kCovisibility };
template <>
inline constexpr auto kEnumNames<RetrievalMethod> = std::to_array<EnumName<RetrievalMethod>>({
    {RetrievalMethod::kVlad, "vlad", "", "RootSIFT features are alike"},
    {RetrievalMethod::kGlobal, "global", "", "global descriptors of the images are alike"},
    {RetrievalMethod::kPose, "pose", "", "cameras look at the same part of space"},
    {RetrievalMethod::kOverlap, "overlap", "", "cameras see the same part of the mesh (by rays)"},
    {RetrievalMethod::kCovisibility, "covisibility", "",
     "images observe the same points of the model"},
});

struct GlobalFeatureFiles {
  std::filesystem::path references;
  std::filesystem::path queries;  // empty: in the same file
};

// Distances from the camera, scene units.
struct ViewRange {
  double near;
  double far;
};

struct RetrievalOptions {
  RetrievalMethod method = RetrievalMethod::kGlobal;
  int top_k = 10;
  // kGlobal.
  GlobalFeatureFiles global_features = {};
  // kPose, kOverlap: of the queries, cam_from_world; a query without one has no references.
  std::map<std::string, Rigid3> prior_poses = {};
  // kPose: without a range, the nearest references whose optical axes differ by at most this.
  double max_angle_deg = 30;
  // kPose: with one, those that see most of what the query sees at these distances.
  std::optional<ViewRange> view_range = std::nullopt;
  // kOverlap.
  std::shared_ptr<const RayCaster> mesh = nullptr;
  // kCovisibility.
  Covisibility covisibility = {};
  int threads = 0;
  bool show_progress = false;  // on stderr
};

struct Retrieval {
  RetrievedLists lists;  // of each query, indices into the references
  std::vector<std::string> warnings;
};

// By any method but VLAD, which needs images. InputError where a file does not hold what it must.
Retrieval RetrieveReferences(std::span<const Query> queries, std::span<const PosedImage> references,
                             const RetrievalOptions& options);

// By VLAD as the built-in front end does, with its cache of features.
RetrievedLists RetrieveByVlad(std::span<const Query> queries,
                              std::span<const PosedImage> references,
                              const FrontEndOptions& options);

// The parts of RetrieveReferences. The lower index is first among equals.

// Dot products; references whose product is negative are left out, as hloc does. The files are read
// in blocks: with descriptors of 4096 numbers, 128 MB hold what is in work, however many images
// there are.
RetrievedLists RetrieveByGlobalFeatures(std::span<const std::string> queries,
                                        std::span<const std::string> references,
                                        const GlobalFeatureFiles& files, int top_k, int threads,
                                        bool show_progress);

// The nearest cameras, the score being minus the distance of the centers.
RetrievedLists RetrieveByDistance(std::span<const PosedImage> queries,
                                  std::span<const PosedImage> references, double max_angle_deg,
                                  int top_k, int threads);

// The score is the share of points, spread over the query's view within the range, that fall into
// the reference's image, no farther than the range.
RetrievedLists RetrieveByFrustum(std::span<const PosedImage> queries,
                                 std::span<const PosedImage> references, const ViewRange& range,
                                 int top_k, int threads);

// The score is the share of a grid of rays through the query's image whose surface points the
// reference sees: in its image, from the same side and with nothing in between.
RetrievedLists RetrieveByOverlap(std::span<const PosedImage> queries,
                                 std::span<const PosedImage> references, const RayCaster& mesh,
                                 int top_k, int threads);

}  // namespace raylift
