#include "program_help.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <utility>

namespace raylift {
namespace {

constexpr std::string_view kDescription =
    R"(Raylift finds where photographs were taken in a known scene: a mesh, depth maps or an SfM model.

LOCALIZE PHOTOGRAPHS
  Against a mesh and reference photographs with poses (a COLMAP model):
    raylift localize --model sfm --images photos --geometry mesh:scene.ply \
        --queries queries.txt --query-images new --out result
  Against a mesh alone, which has a texture or vertex colors:
    raylift localize --geometry mesh:scene.ply --queries queries.txt --query-images new --out result
  How good are the poses?
    raylift evaluate --ground-truth truth --poses result/poses.txt --thresholds 0.05,5:0.25,2

COMPARE DEPTH
  Which of meshes, depth maps and networks is best, where, and what is wrong with the others?
    raylift compare --model sfm --geometry scan=mesh:scan.ply --geometry network=depth:maps \
        --truth scan --out comparison --report report
  Is the depth read as it was meant: unit, z or ray, axes, poses?
    raylift doctor --model sfm --images photos --geometry depth:maps

RENDER DEPTH
  Depth maps, normals, color of a mesh for all images of a data set:
    raylift render --model sfm --geometry mesh:scene.ply --out rendered --products depth,normals
  There are no cameras yet: choose some.
    raylift views --geometry mesh:scene.ply --out views

queries.txt holds a photograph per line: NAME MODEL WIDTH HEIGHT PARAMS..., as in COLMAP and hloc.
assets/demo/run.sh tries it on a small scene.
)";

constexpr std::string_view kLocalize = "Localize photographs";
constexpr std::string_view kCompare = "Compare depth";
constexpr std::string_view kRender = "Render depth";
constexpr std::string_view kJobs = "Long runs, in parts";
constexpr std::array<std::pair<std::string_view, std::string_view>, 17> kGroupOfCommand = {
    {{"localize", kLocalize},
     {"prepare", kLocalize},
     {"estimate", kLocalize},
     {"evaluate", kLocalize},
     {"export", kLocalize},
     {"pairs", kLocalize},
     {"import", kLocalize},
     {"experiment", kLocalize},
     {"compare", kCompare},
     {"doctor", kCompare},
     {"perturb", kCompare},
     {"render", kRender},
     {"views", kRender},
     {"color", kRender},
     {"status", kJobs},
     {"merge", kJobs},
     {"verify", kJobs}}};

}  // namespace

void AddProgramHelp(CLI::App& program) {
  program.description(std::string(kDescription));
  for (CLI::App* command : program.get_subcommands([](const CLI::App*) { return true; })) {
    const auto* known =
        std::find_if(kGroupOfCommand.begin(), kGroupOfCommand.end(),
                     [command](const auto& entry) { return entry.first == command->get_name(); });
    command->group(known == kGroupOfCommand.end() ? "More" : std::string(known->second));
  }
}

}  // namespace raylift
