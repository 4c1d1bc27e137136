// Writes the sentences of the doctor's findings: one clause each, for Diagnosis::reason. Summary()
// of doctor.h puts them together.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

#include "diagnosis/match_agreement.h"
#include "diagnosis/mesh_frame.h"
#include "diagnosis/stored_faults.h"

#include "raylift/diagnosis/doctor.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// A surface that a few rays happen to meet rightly (the ground of a mirrored mesh) proves little.
inline constexpr double kLeastCoverage = 0.25;

// These say why nothing can be said.
std::string DescribeFewMatches(size_t num_matches, size_t num_pairs);
std::string DescribeFewAtRandom(const MatchAgreement& agreement);
std::string DescribeChance(const MatchAgreement& agreement);
std::string DescribeFewAgreeing(const MatchAgreement& agreement, size_t num_pairs);
inline constexpr const char* kViewsTooClose =
    "the views are too close together for the matches to tell depth";

// These say why nothing fits: matches, poses.
std::string DescribeDisagreement(const MatchAgreement& agreement,
                                 std::span<const ReferenceMatch> matches,
                                 std::span<const PosedImage> references);
std::string DescribeOtherPoses(PoseConvention fitting, PoseConvention as_read);

// These describe faults of what depth maps store.
std::string Describe(const ClampFault& clamp);
std::string Describe(const WrapFault& wrap);
std::string Describe(const AffineFault& affine);

// Describe the best reading, and the search for another place of the mesh, where there is one.
std::string DescribeFewDepths(const ConventionFit& fit, std::span<const StoredExtreme> extremes,
                              std::optional<MeshSearch> search);
std::string DescribeMisfit(const DoctorInput& input, const ConventionFit& fit,
                           double baseline_error_px, std::optional<MeshSearch> search);

// These describe the place of a mesh.
inline constexpr const char* kLimitsDrop =
    "the mesh is where the references are, but the limits of what is lifted from it (near, far, "
    "max_incidence_deg, max_depth_jump, back_faces) drop most of what the keypoints see";
std::string DescribeManyPlaces(std::ptrdiff_t num_places);
// `as_read_px` is nullopt where no ray meets the mesh as read.
std::string DescribePlace(const PlacedMesh& best, const MeshPlacement& as_placed,
                          std::optional<double> as_read_px);

}  // namespace raylift
