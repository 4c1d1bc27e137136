#include "diagnosis/diagnosis_text.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

// Returns "; the fewest of a.jpg (3 %), ...".
std::string WorstImages(std::span<const ReferenceMatch> matches, const std::vector<bool>& agrees,
                        std::span<const PosedImage> references) {
  constexpr double kFewestOfImage = 10;
  constexpr size_t kWorst = 3;
  struct Counts {
    double agreeing = 0;
    double matches = 0;
  };
  std::map<int, Counts> of_image;
  for (size_t i = 0; i < matches.size(); ++i) {
    for (const int image : {matches[i].reference_a, matches[i].reference_b}) {
      of_image[image].agreeing += agrees[i] ? 1 : 0;
      of_image[image].matches += 1;
    }
  }
  std::vector<std::pair<double, int>> shares;
  for (const auto& [image, counts] : of_image) {
    if (counts.matches >= kFewestOfImage) {
      shares.emplace_back(counts.agreeing / counts.matches, image);
    }
  }
  std::sort(shares.begin(), shares.end());
  shares.resize(std::min(shares.size(), kWorst));
  std::vector<std::string> parts;
  for (const auto& [share, image] : shares) {
    parts.push_back(
        fmt::format("{} ({:.0f} %)", references[static_cast<size_t>(image)].name, 100 * share));
  }
  return parts.empty() ? "" : fmt::format("; the fewest of {}", fmt::join(parts, ", "));
}

// Says it as the end of a clause.
std::string DescribeSearch(std::optional<MeshSearch> search) {
  if (!search) return "";
  switch (*search) {
    case MeshSearch::kTooFewMatches:
      return "; the matches are too few to look for another place of the mesh";
    case MeshSearch::kTooTangled:
      return "; another place of the mesh was not looked for: its triangles overlap too much";
    case MeshSearch::kNoneFound:
      return "; no unit, axes, mirror or shift of the mesh was found that mends that";
    case MeshSearch::kRejected:
      return "; the best other place of the mesh that was found does not fit the matches either";
  }
  RAYLIFT_CHECK(false);
}

}  // namespace

std::string DescribeFewMatches(size_t num_matches, size_t num_pairs) {
  return fmt::format("{} matches between {} pairs of references", num_matches, num_pairs);
}

std::string DescribeFewAtRandom(const MatchAgreement& agreement) {
  return fmt::format(
      "of {} matches {} share an image with others, so that it cannot be told how many fit the "
      "poses by chance",
      agreement.agrees.size(), agreement.num_random);
}

std::string DescribeChance(const MatchAgreement& agreement) {
  return fmt::format("{:.0f} % of the matches would fit the poses by chance, too",
                     100 * agreement.chance);
}

std::string DescribeFewAgreeing(const MatchAgreement& agreement, size_t num_pairs) {
  return fmt::format("{} of {} matches agree with the poses, between {} pairs of references",
                     agreement.num_agreeing, agreement.agrees.size(), num_pairs);
}

std::string DescribeDisagreement(const MatchAgreement& agreement,
                                 std::span<const ReferenceMatch> matches,
                                 std::span<const PosedImage> references) {
  return fmt::format(
      "poses and matches do not agree: {:.0f} % of {} matches fit the poses, {:.0f} % would by "
      "chance{}",
      100.0 * static_cast<double>(agreement.num_agreeing) / static_cast<double>(matches.size()),
      matches.size(), 100 * agreement.chance, WorstImages(matches, agreement.agrees, references));
}

std::string DescribeOtherPoses(PoseConvention fitting, PoseConvention as_read) {
  return fmt::format("the matches fit poses that are {}, not {}, but depth fits neither",
                     TitleOf(fitting), TitleOf(as_read));
}

std::string Describe(const ClampFault& clamp) {
  return fmt::format(
      "{:.1f} % of the pixels hold exactly {:.6g}, the {} value, but what they show is {:.2g} "
      "times as deep (median of {} keypoints): {}",
      100 * clamp.extreme.share, clamp.extreme.value,
      clamp.extreme.largest ? "largest" : "smallest", clamp.depth_ratio, clamp.num_keypoints,
      clamp.is_cut_off ? "depth is cut off there" : "it marks what has none");
}

std::string Describe(const WrapFault& wrap) {
  return fmt::format(
      "depth is wrapped: stored values start again at 0 where they reach {:.6g}. {:.0f} % of the "
      "keypoints lie beyond; with multiples of it the median is {:.2f} px. Write the maps in more "
      "bits or as floats",
      wrap.modulus, 100 * wrap.share, wrap.fit.median_px);
}

std::string Describe(const AffineFault& affine) {
  const std::string formula = fmt::format(
      "{} = {:.4g} * stored {} {:.4g}{} (median {:.2f} px)", affine.form.inverse ? "1 / z" : "z",
      affine.factor, affine.shift < 0 ? "-" : "+", std::abs(affine.shift),
      affine.form.common ? "" : " in the first map, and otherwise in others", affine.fit.median_px);
  if (affine.form.inverse) {
    return fmt::format("the maps hold disparity, not depth: {}. Write z instead", formula);
  }
  return fmt::format("the maps hold depth up to a factor and a shift: {}. Write z instead{}",
                     formula,
                     affine.form.common ? "" : ", or localize with affine alignment of depth");
}

std::string DescribeFewDepths(const ConventionFit& fit, std::span<const StoredExtreme> extremes,
                              std::optional<MeshSearch> search) {
  const std::string constant =
      extremes.empty() ? ""
                       : fmt::format(" ({:.0f} % of the pixels hold exactly {:.6g})",
                                     100 * extremes.back().share, extremes.back().value);
  return fmt::format("only {} of {} keypoints have a depth{}{}", fit.count, fit.asked, constant,
                     DescribeSearch(search));
}

std::string DescribeMisfit(const DoctorInput& input, const ConventionFit& fit,
                           double baseline_error_px, std::optional<MeshSearch> search) {
  if (!input.map_size_px && fit.coverage < kLeastCoverage) {
    return fmt::format("only {:.0f} % of the keypoints' rays meet the mesh{}", 100 * fit.coverage,
                       DescribeSearch(search));
  }
  return fmt::format(
      "lifted keypoints are {:.1f} px from their matches (median of the best reading{}; {:.1f} px "
      "with depths at random), while the matches are {:.1f} px from their epipolar lines{}",
      fit.median_px, input.map_size_px ? ", each map at its best scale" : "", fit.median_chance_px,
      baseline_error_px, DescribeSearch(search));
}

std::string DescribeManyPlaces(std::ptrdiff_t num_places) {
  return fmt::format(
      "the mesh is not where the references are, and {} placements of it fit about as well",
      num_places);
}

std::string DescribePlace(const PlacedMesh& best, const MeshPlacement& as_placed,
                          std::optional<double> as_read_px) {
  return fmt::format(
      "{}{} fits far better (median {:.2f} px of matches that it was not found by; {})",
      KeysOf(as_placed).empty() ? "" : "beside its placement as read, ", Describe(best.placement),
      best.fit.median_px,
      as_read_px ? fmt::format("as read {:.2f} px", *as_read_px) : "as read no ray meets it");
}

std::string Summary(const Diagnosis& diagnosis) {
  switch (diagnosis.verdict) {
    case InputVerdict::kTooFewMatches:
      return fmt::format("there are too few matches between references to tell: {}",
                         diagnosis.reason);
    case InputVerdict::kNothingFits:
      return fmt::format("nothing fits: {}", diagnosis.reason);
    case InputVerdict::kAsMeant: {
      const ConventionEvidence& as_read = diagnosis.EvidenceOf(diagnosis.as_read);
      const bool scales_differ = as_read.median_px > 2 * as_read.median_own_scale_px;
      return fmt::format("the input is read as the matches suggest: median {:.2f} px{}",
                         as_read.median_px,
                         scales_differ ? fmt::format(", {:.2f} px with each map at its own scale",
                                                     as_read.median_own_scale_px)
                                       : "");
    }
    case InputVerdict::kRepair:
      break;
  }
  const std::string repair = fmt::format("Repair: {}", ToString(diagnosis.repair));
  if (diagnosis.fault != InputFault::kNone) return fmt::format("{}. {}", diagnosis.reason, repair);
  const ConventionEvidence& as_read = diagnosis.EvidenceOf(diagnosis.as_read);
  const ConventionEvidence& best = diagnosis.EvidenceOf(diagnosis.best);
  return fmt::format(
      "another reading of the input explains the matches far better: {} (median {:.2f} px, as read "
      "{:.2f} px; {:.0f} standard errors). {}",
      diagnosis.reason, best.median_px, as_read.median_px, best.sigmas, repair);
}

namespace {

// Returns the factor of depth that a change of scale means.
double DepthFactor(const DataConvention& as_read, const DataConvention& other) {
  return other.kind == DepthKind::kInverse ? as_read.scale / other.scale
                                           : other.scale / as_read.scale;
}

}  // namespace

std::optional<MapOrientation> Combined(MapOrientation a, MapOrientation b) {
  using enum MapOrientation;
  if (a == kAsStored) return b;
  if (b == kAsStored) return a;
  if (a == b) return kAsStored;
  if (a == kTransposed || b == kTransposed) return std::nullopt;
  // Any two of the two flips and the half turn make the third.
  for (const MapOrientation third : {kFlippedX, kFlippedY}) {
    if (a != third && b != third) return third;
  }
  return kHalfTurn;
}

int NumDifferences(const DataConvention& a, const DataConvention& b) {
  return (a.kind != b.kind ? 1 : 0) + (a.orientation != b.orientation ? 1 : 0) +
         (a.first_sample_px != b.first_sample_px ? 1 : 0) + (a.scale != b.scale ? 1 : 0) +
         (a.poses != b.poses ? 1 : 0);
}

std::string DescribeDifference(const DataConvention& as_read, const DataConvention& other) {
  std::vector<std::string> parts;
  if (other.kind != as_read.kind) {
    parts.push_back(fmt::format("depth is {}, not {}", TitleOf(other.kind), TitleOf(as_read.kind)));
  }
  if (other.orientation != as_read.orientation) {
    const auto relative = Combined(as_read.orientation, other.orientation);
    parts.push_back(fmt::format("maps are {}", TitleOf(relative.value_or(other.orientation))));
  }
  if (other.first_sample_px != as_read.first_sample_px) {
    parts.push_back(fmt::format("maps are shifted by {:+} px",
                                other.first_sample_px - as_read.first_sample_px));
  }
  if (other.scale != as_read.scale) {
    parts.push_back(fmt::format("depth times {:.4g}", DepthFactor(as_read, other)));
  }
  if (other.poses != as_read.poses) {
    parts.push_back(fmt::format("poses are {}", TitleOf(other.poses)));
  }
  return parts.empty() ? "as read" : fmt::format("{}", fmt::join(parts, "; "));
}

RepairOptions FindRepair(const DataConvention& as_read, const DataConvention& other) {
  RepairOptions repair;
  std::vector<std::string>& keys = repair.geometry_keys;
  if (other.kind != as_read.kind) keys.push_back(fmt::format("kind={}", ToString(other.kind)));
  if (other.orientation != as_read.orientation) {
    keys.push_back(fmt::format("orientation={}", ToString(other.orientation)));
  }
  if (other.first_sample_px != as_read.first_sample_px) {
    keys.push_back(fmt::format("first_sample_px={}", other.first_sample_px));
  }
  if (other.scale != as_read.scale) keys.push_back(fmt::format("scale={:.4g}", other.scale));
  if (other.poses != as_read.poses) {
    repair.model_poses = other.poses;
  }
  return repair;
}

std::string ToString(const RepairOptions& repair) {
  std::string text;
  if (!repair.geometry_keys.empty()) {
    text = fmt::format("in the geometry: {}", fmt::join(repair.geometry_keys, ","));
  }
  if (!repair.replaced_keys.empty()) {
    const std::string replaced = fmt::format("{}", fmt::join(repair.replaced_keys, ","));
    text = text.empty() ? fmt::format("in the geometry: leave out {}", replaced)
                        : fmt::format("{} in place of {}", text, replaced);
  }
  if (repair.model_poses) {
    text +=
        fmt::format("{}model_poses = {}", text.empty() ? "" : "; ", ToString(*repair.model_poses));
  }
  return text;
}

}  // namespace raylift
