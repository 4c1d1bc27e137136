#include "apps/mesh_only_options.h"

#include <algorithm>
#include <optional>

#include "apps/command_line.h"
#include "apps/options.h"
#include "lifting/mesh_spec.h"
#include "views/task_list.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

double ParseFov(std::string_view option, const std::string& text) {
  const double fov_deg = ParsePositive(option, text);
  if (!(fov_deg < 180)) throw OptionError(option, text, "must be below 180");
  return fov_deg;
}

}  // namespace

void MeshOnlyFlags::Check() const {
  RequireAtLeast("--views", views, 1);
  RequirePositive("--view-eye-height", eye_height);
  if (!(clearance >= 0)) {
    throw OptionError("--view-clearance", FormatDouble(clearance), "must not be negative");
  }
}

RenderedReferenceOptions MeshOnlyFlags::Resolve(std::span<const Camera> queries,
                                                const std::filesystem::path& out) const {
  RenderedReferenceOptions options;
  options.out = out;
  options.kind = kind;
  options.views.camera = CameraLikeQueries(queries, size, fov_deg);
  options.views.count = views;
  options.estimate_up = !up_in_world;
  if (up_in_world) options.views.up_in_world = *up_in_world;
  options.views.clearance = clearance;
  options.inside.eye_height = eye_height;
  return options;
}

void AddMeshOnlyOptions(CLI::App& command, MeshOnlyFlags& flags) {
  const OptionGroup group(command, "Without --model: references rendered from the mesh");
  group.Add("--views", flags.views, "How many; they are kept in OUT/references");
  group.Add("--view-kind", flags.kind,
            "Where from: {}. inside: at eye height above\n"
            "the ground; around: from outside, looking at the middle; cover: from\n"
            "wherever there is room in front of surfaces; auto: inside where there\n"
            "is a ground, else cover");
  group.AddParsed("--view-size", flags.size, &ParseSize,
                  "WIDTHxHEIGHT (default: as sharp as the queries)");
  group.AddParsed("--view-fov-deg", flags.fov_deg, &ParseFov,
                  "Horizontal angle of view (default: the queries', 60 to 100)");
  AddUpOption(group, "--view-up", flags.up_in_world);
  group.Add("--view-eye-height", flags.eye_height, "inside: above the ground");
  group.Add("--view-clearance", flags.clearance,
            "Distance to the nearest surface (but for inside, at most 5 % of the\n"
            "mesh's size)");
  const OptionGroup estimator(command, "Estimator");
  estimator.Add("--rerender", flags.rerender,
                "Rounds of rendering the mesh (or splats) from the estimated pose, matching\n"
                "the query with that by features and by patches and estimating again; a pose is\n"
                "kept where the 2D-3D matches support it better. For what looks like the\n"
                "photographs");
}

void RequireMeshOnly(std::span<const std::string> geometry, std::string_view needless,
                     bool is_given) {
  if (geometry.empty()) {
    throw OptionError(
        "--model is required (or --geometry mesh:PATH or dsm:FILE, to render the references from "
        "it); COLMAP "
        "makes one of photographs: `colmap automatic_reconstructor --workspace_path sfm "
        "--image_path PHOTOS "
        "--dense 0`, then --model sfm/sparse/0");
  }
  if (geometry.size() != 1 || !IsMeshSpec(geometry.front())) {
    throw OptionError("--geometry", fmt::format("{}", fmt::join(geometry, " ")),
                      "without --model the references are rendered from a mesh: expected one "
                      "mesh:PATH or dsm:FILE");
  }
  if (is_given) throw OptionError(fmt::format("{} needs --model", needless));
}

void CheckRerender(int rounds, std::span<const std::string> geometry, bool has_photographs) {
  const std::string value = std::to_string(rounds);
  if (rounds < 0) throw OptionError("--rerender", value, "must not be negative");
  if (rounds == 0) return;
  if (std::none_of(geometry.begin(), geometry.end(), [](const std::string& spec) {
        return IsMeshSpec(spec) || spec.starts_with("splat:");
      })) {
    throw OptionError("--rerender", value, "needs --geometry mesh:PATH, dsm:FILE or splat:FILE");
  }
  if (!has_photographs) throw OptionError("--rerender", value, "needs --query-images");
}

Scene RenderSceneWithProgress(const std::string& mesh_spec, const Subsampling& subsampling,
                              const RenderedReferenceOptions& options, Progress::Show show) {
  std::optional<Progress> progress;
  const RenderHooks hooks{
      .on_start = [&](size_t images, size_t) { progress.emplace("views", images, show); },
      .on_image = [&](const RenderedImage&) { progress->Advance(); }};
  return OpenMeshScene(mesh_spec, subsampling, options, hooks);
}

}  // namespace raylift
