// The options of localization against a mesh without photographs of the scene.

#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "apps/command_line.h"
#include "base/progress.h"
#include <Eigen/Core>

#include "raylift/localization/scene.h"
#include "raylift/views/rendered_references.h"

namespace raylift {

struct MeshOnlyFlags {
  int views = 48;
  ViewKind kind = ViewKind::kAuto;
  std::optional<PlaneSize> size;                              // none: as the queries'
  std::optional<double> fov_deg;                              // none: as the queries'
  std::optional<Eigen::Vector3d> up_in_world = std::nullopt;  // none: estimated
  double eye_height = 1.6;
  double clearance = 0.3;
  int rerender = 0;  // rounds

  // Throws OptionError.
  void Check() const;
  // Returns the options for queries with these cameras; pictures go to `out`.
  RenderedReferenceOptions Resolve(std::span<const Camera> queries,
                                   const std::filesystem::path& out) const;
};
void AddMeshOnlyOptions(CLI::App& command, MeshOnlyFlags& flags);

// Without --model there must be one mesh to render the references from, and nothing that only a
// model has: `needless` is the name of such an option, where `is_given`. Throws OptionError.
void RequireMeshOnly(std::span<const std::string> geometry, std::string_view needless,
                     bool is_given);

// Throws OptionError unless there is what --rerender needs: a mesh, and the queries' photographs.
void CheckRerender(int rounds, std::span<const std::string> geometry, bool has_photographs);

// Renders the references of a scene, and says on stderr how far it is.
Scene RenderSceneWithProgress(const std::string& mesh_spec, const Subsampling& subsampling,
                              const RenderedReferenceOptions& options, Progress::Show show);

}  // namespace raylift
