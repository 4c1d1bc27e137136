// The options of `raylift localize`.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/command_line.h"
#include "apps/job_options.h"
#include "apps/matching_options.h"
#include "apps/options.h"
#include "localization/continuous/join_gate.h"
#include <Eigen/Core>

#include "raylift/estimation/options.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"
#include "raylift/sequences/smoothing.h"
#include "raylift/views/rendered_references.h"

namespace raylift {

// The options of continuous localization: `localize --continuous`.
struct ContinuousFlags {
  bool enabled = false;
  std::optional<int> max_joined;
  bool trust_joined = false;
  bool join_any_difference = false;
  JoinGateOptions gate;

  // Throws OptionError.
  void Check() const;
  JoinGateOptions Gate() const;
  // Returns how many of the `top_k` references of a query may be joined queries.
  int MaxJoined(int top_k) const;
};

// The odometry of a walk: `localize --odometry`. The times are --times.
struct WalkFlags {
  std::filesystem::path odometry;
  OdometryScale scale = OdometryScale::kKnown;
  Rigid3 cam_from_body;  // body: what the odometry's poses are of
  bool online = false;
  bool no_rematch = false;

  bool enabled() const { return !odometry.empty(); }
};

// Localization against a mesh without photographs of the scene.
struct MeshOnlyFlags {
  int views = 48;
  ViewKind kind = ViewKind::kAuto;
  std::optional<PlaneSize> size;                              // nullopt: as the queries'
  std::optional<double> fov_deg;                              // nullopt: as the queries'
  std::optional<Eigen::Vector3d> up_in_world = std::nullopt;  // nullopt: estimated
  double eye_height = 1.6;
  double clearance = 0.3;
  int rerender = 0;  // rounds

  // Throws OptionError.
  void Check() const;
  // Returns the options for queries with these cameras; pictures go to `out`.
  RenderedReferenceOptions Resolve(std::span<const Camera> queries,
                                   const std::filesystem::path& out) const;
};

// Poses come from matches, or from aligning the edges of the mesh with those of the photographs.
enum class AlignBy { kMatches, kEdges };
template <>
inline constexpr auto kEnumNames<AlignBy> = std::to_array<EnumName<AlignBy>>({
    {AlignBy::kMatches, "matches"},
    {AlignBy::kEdges, "edges"},
});

struct LocalizeFlags {
  ReferenceFlags references;
  std::filesystem::path images, queries, query_images, priors, rigs, scene_calibration;
  AlignBy align = AlignBy::kMatches;
  std::optional<WorldFrame> world;
  GeometryFlags geometry;
  MatchingFlags matching;
  std::filesystem::path out, write_problems, write_model, report, ground_truth;
  int pictures = 0;
  double min_confidence = 0;
  bool no_doctor = false;
  bool leave_one_out = false;
  FilterOptions filter;
  EstimatorOptions estimator;
  ContinuousFlags continuous;
  WalkFlags walk;
  std::filesystem::path times;
  RunFlags run;
  JobFlags running;
  MeshOnlyFlags mesh_only;

  // Returns whether the references are rendered from the mesh.
  bool RendersReferences() const { return references.model.empty() && !AlignsEdges(); }
  bool AlignsEdges() const { return align == AlignBy::kEdges; }

  std::filesystem::path QueryImages() const { return QueryImagesOf(query_images, images, queries); }

  // Returns whether the priors are read from the photographs' metadata.
  bool PriorsOfPhotographs() const { return priors == "exif"; }

  LocalizerOptions Localizer() const {
    return {.estimator = estimator,
            .filter = filter,
            .geometry_mode = geometry.mode,
            .min_confidence = min_confidence,
            .candidates = geometry.candidates};
  }

  // Returns whether the queries are the references (--leave-one-out).
  RetrievalFlags::Queries QueriesAre() const {
    return leave_one_out ? RetrievalFlags::Queries::kReferences : RetrievalFlags::Queries::kOwn;
  }

  // Returns the order of --continuous: by the times file, or by name where there is none.
  std::vector<size_t> Order(std::span<const Query> queries, const ReferenceSet& set) const;

  // Throws OptionError for what the options alone can tell, before any work.
  void Check() const;
};

// Adds the options of localize.
void AddLocalizeOptions(
    CLI::App& command, LocalizeFlags& flags,
    const char* out_help =
        "Folder for poses.txt, queries.jsonl, summary.json, and manifest.jsonl\n"
        "with what is done");

}  // namespace raylift
