// raylift color: colors the vertices of a bare mesh from photographs with poses.

#include <memory>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "base/progress.h"
#include "lifting/mesh_spec.h"
#include "surfaces/resampled_mesh.h"
#include "views/mesh_scene.h"
#include "views/vertex_coloring.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/localization/scene.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Vertices that are farther apart than this in the photographs, in pixels, lose detail that
// matching needs.
constexpr double kCoarsePx = 3;
constexpr double kMostTriangles = 5e8;

struct ColorFlags {
  std::string mesh;
  ReferenceFlags references;
  path images, out;
  double max_edge = 0;
  bool keep_exposures = false;
  RunFlags run;
};

void Check(const ColorFlags& flags) {
  flags.references.Check();
  flags.run.Check();
  if (!(flags.max_edge >= 0)) {
    throw OptionError("--max-edge", fmt::format("{}", flags.max_edge), "must not be negative");
  }
  if (flags.out.extension() != ".ply") {
    throw OptionError("--out", flags.out.string(), "expected a name that ends in .ply");
  }
}

// Returns about how many triangles there are once edges are halved down to `max_edge`.
double TrianglesAfterSplit(const TriangleMesh& mesh, double max_edge) {
  double count = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f& corner = mesh.vertices[a];
    const double area = 0.5 * (mesh.vertices[b] - corner).cross(mesh.vertices[c] - corner).norm();
    count += 1 + 4 * area / (max_edge * max_edge);
  }
  return count;
}

TriangleMesh FineMesh(const TriangleMesh& mesh, double max_edge) {
  if (max_edge == 0) return mesh;
  const double count = TrianglesAfterSplit(mesh, max_edge);
  if (count > kMostTriangles) {
    throw OptionError("--max-edge", fmt::format("{}", max_edge),
                      fmt::format("would split the mesh into some {:.0e} triangles", count));
  }
  return SplitLongEdges(mesh, max_edge);
}

void Color(const ColorFlags& flags) {
  RequireWritable(flags.out);
  const LoadedReferences loaded = flags.references.Load();
  PrintWarnings(loaded.warnings);
  const std::string spec = IsMeshSpec(flags.mesh) ? flags.mesh : "mesh:" + flags.mesh;
  const MeshScene scene = LoadMeshScene({spec}, {.threads = flags.run.threads});
  PrintWarnings(scene.warnings);
  TriangleMesh mesh = FineMesh(scene.caster->mesh(), flags.max_edge);
  const std::vector<PosedImage>& photographs = loaded.references.images;
  VertexColoring coloring;
  {
    Progress progress("photographs", photographs.size(), flags.run.Show());
    coloring = ColorVertices(mesh, *scene.caster, photographs, flags.images,
                             {.level_exposures = !flags.keep_exposures,
                              .threads = flags.run.threads,
                              .on_photograph = [&progress] { progress.Advance(); }});
  }
  if (coloring.num_seen == 0) {
    throw InputError(flags.references.model,
                     fmt::format("none of its {} photographs sees a vertex of {}: are the mesh and "
                                 "the poses of one world?",
                                 photographs.size(), flags.mesh));
  }
  mesh.vertex_colors_rgb = std::move(coloring.colors_rgb);
  WritePly(flags.out, mesh);
  if (coloring.median_spacing_px > kCoarsePx) {
    PrintWarning(fmt::format(
        "the mesh's vertices are {:.0f} px apart in the photographs, whose details are lost "
        "between them; --max-edge {:.2g} splits its triangles to about their resolution",
        coloring.median_spacing_px, coloring.median_pixel_width));
  }
  if (flags.run.quiet) return;
  fmt::print(
      "{:.1f} % of {} vertices colored by {} photographs, {:.1f} px apart there; the others "
      "as their neighbors: {}\n",
      100.0 * static_cast<double>(coloring.num_seen) / static_cast<double>(mesh.vertices.size()),
      mesh.vertices.size(), photographs.size(), coloring.median_spacing_px, flags.out.string());
}

}  // namespace

Command AddColorCommand(CLI::App& program) {
  auto flags = std::make_shared<ColorFlags>();
  CLI::App& command =
      AddCommand(program, "color", "Vertex colors for a bare mesh, from photographs with poses");
  AddAlias(command, "colour");
  const OptionGroup options(command);
  options.Add("MESH", flags->mesh, "The mesh: a file, or mesh:PATH[,key=value...]").Required();
  AddReferenceOptions(command, flags->references);
  AddModelPosesOption(command, flags->references);
  const OptionGroup references(command, "References");
  references.Add("--images", flags->images, "Folder of the photographs").Required();
  const OptionGroup mesh(command, "Mesh");
  mesh.Add("--max-edge", flags->max_edge,
           "Split longer edges, as only vertices have colors (units of\n"
           "the mesh; 0: none)");
  mesh.Flag("--keep-exposures", flags->keep_exposures, "Do not level the photographs' exposures");
  const OptionGroup output(command, "Output");
  output.Add("--out", flags->out, "The colored mesh (PLY)").Required();
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      "Each vertex takes what the photographs agree on that see it best. Where there are no\n"
      "colors, a mesh alone is hardly localized against: its rendered views look like none of\n"
      "the photographs.\n"
      "Example:\n"
      "  raylift color scan.ply --model sfm --images photos --out colored.ply\n"
      "  raylift localize --geometry mesh:colored.ply --queries queries.txt \\\n"
      "      --query-images new --out result");
  return {&command, [flags] {
            Check(*flags);
            UntilSignal([&] { Color(*flags); }, &BeginsAnew);
          }};
}

}  // namespace raylift
