// Finds where a mesh belongs that is not where the references are. Matches between references
// triangulate points on the surface; rays through their keypoints must meet the mesh there once it
// is scaled, turned, mirrored or shifted rightly.
//
// Placements are those of the mesh as it is read. They are looked for among all signed
// permutations of the axes: with any scale about the origin, and with usual scales and any shift
// (by how many of the points then lie near the surface, on a grid). The best are refined by the
// planes that the rays meet.

#pragma once

#include <optional>
#include <vector>

#include "diagnosis/convention_residuals.h"
#include "lifting/mesh_placement.h"

#include "raylift/renderers/ray_caster.h"

namespace raylift {

// A placement, and its fit to matches from which it was not found.
struct PlacedMesh {
  MeshPlacement placement;   // of the mesh as it is read
  MeshPlacement from_files;  // of the mesh as its files have it, to the digits of its keys
  ConventionFit fit;
  std::vector<std::optional<double>> errors_px;  // of each keypoint
};

// The outcome of looking for placements.
enum class MeshSearch {
  kTooFewMatches,  // to look by and to judge by
  kTooTangled,     // rays cross too many triangles
  kNoneFound,
  kRejected,  // a placement was found but is not good
};

class MeshFrameSearch {
 public:
  // `mesh` must outlive it.
  MeshFrameSearch(const RayCaster& mesh, const DoctorInput& input, const ConventionResiduals& data,
                  const DataConvention& convention, int threads);

  // Returns kNoneFound where nothing stands against a search.
  MeshSearch Obstacle() const;
  // Returns the few best of clearly different placements, best first.
  std::vector<PlacedMesh> Find() const;
  // Rates a placement of the whole mesh, without limits of what is lifted from it.
  PlacedMesh Judge(const MeshPlacement& placement) const;

 private:
  // A keypoint's ray in the world; ray_t is z in its map.
  struct Sample {
    size_t keypoint;
    Eigen::Vector3d origin;
    Eigen::Vector3d direction;
    double z;        // triangulated
    double gain_px;  // see TriangulatedDepth
  };
  struct Candidate {
    MeshPlacement placement;
    double score = 0;
  };

  std::vector<std::optional<RayHit>> Cast(std::span<const Sample> samples,
                                          const MeshPlacement& placement) const;
  double Score(std::span<const Sample> samples, const MeshPlacement& placement,
               double tolerance) const;
  double PxScore(std::span<const Sample> samples, const MeshPlacement& placement) const;
  bool IsSame(const MeshPlacement& a, const MeshPlacement& b) const;
  double MedianPx(std::span<const Sample> samples, const MeshPlacement& placement) const;
  std::vector<Candidate> ScaledAboutOrigin() const;
  std::vector<Candidate> Shifted() const;
  std::vector<Candidate> BestDifferent(std::vector<Candidate> candidates, size_t count) const;
  enum class Freedom { kShift, kShiftAndScale, kSimilarity };
  void RefineFully(Candidate& candidate, std::span<const Sample> samples) const;
  MeshPlacement Refine(MeshPlacement placement, std::span<const Sample> samples, double tolerance,
                       Freedom freedom) const;
  std::optional<MeshPlacement> AlongAxes(const MeshPlacement& placement,
                                         std::span<const Sample> samples) const;
  MeshPlacement Simplify(MeshPlacement refined) const;
  PlacedMesh JudgeByKeys(const MeshPlacement& placement) const;

  const RayCaster& mesh_;
  const ConventionResiduals& data_;
  const DataConvention& convention_;
  MeshPlacement as_placed_;
  int threads_;
  std::vector<Sample> fitting_;  // in an order that makes the first ones a fair sample
  std::vector<Sample> held_out_;
  Eigen::Vector3d center_ = Eigen::Vector3d::Zero();  // of the triangulated points
};

}  // namespace raylift
