// The options of localization against a mesh without photographs of the scene.

#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <CLI/CLI.hpp>
#include <Eigen/Core>

#include "raylift/base/progress.h"
#include "raylift/localization/scene.h"
#include "raylift/views/rendered_references.h"

namespace raylift {

// "x", "-y", ... or "X,Y,Z". Throws OptionError.
Eigen::Vector3d ParseUp(std::string_view option, const std::string& text);

struct MeshOnlyFlags {
  int views = 48;
  std::string kind = "auto";
  std::string size;     // empty: as the queries'
  std::string fov_deg;  // empty: as the queries'
  std::string up = "z";
  double eye_height = 1.6;
  double clearance = 0.3;
  int rerender = 0;  // rounds

  // All of these throw OptionError.
  void Check() const;
  // Of queries with these cameras, to `out`.
  RenderedReferenceOptions Resolve(std::span<const Camera> queries,
                                   const std::filesystem::path& out) const;
};
void AddMeshOnlyOptions(CLI::App& app, MeshOnlyFlags& flags);

// Without --model there must be one mesh to render the references from, and nothing that only a
// model has: `needless` is the name of such an option, where `is_given`. Throws OptionError.
void RequireMeshOnly(std::span<const std::string> geometry, std::string_view needless,
                     bool is_given);

// What --rerender needs: a mesh, and the queries' photographs. Throws OptionError.
void CheckRerender(int rounds, std::span<const std::string> geometry, bool has_photographs);

// Renders the references of a scene, and says on stderr how far it is.
Scene RenderSceneWithProgress(const std::string& mesh_spec, const Thinning& thinning,
                              const RenderedReferenceOptions& options, Progress::Show show);

}  // namespace raylift
