// raylift import: writes a scene file for a data set of the field.

#include <cstdio>

#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct ImportFlags {
  std::string dataset;
  path folder, out;
  ImportOptions options;
  std::string camera;
  bool quiet = false;
};

void Check(const ImportFlags& flags) {
  RequireAtLeast("--query-every", flags.options.query_every, 2);
  for (const Dataset& dataset : AllDatasets()) {
    if (dataset.name == flags.dataset) return;
  }
  throw OptionError("DATASET", flags.dataset, "expected " + DatasetNames());
}

void Run(const ImportFlags& flags) {
  Check(flags);
  RequireWritable(flags.out / "scene.toml");
  ImportOptions options = flags.options;
  if (!flags.camera.empty()) options.camera = ParseCamera("--camera", flags.camera);
  for (const ImportedScene& scene : ImportDataset(flags.dataset, flags.folder, options)) {
    const path file = WriteImportedScene(flags.out, scene, flags.dataset);
    for (const std::string& warning : scene.warnings) {
      PrintWarning(fmt::format("{}: {}", scene.name, warning));
    }
    if (flags.quiet) continue;
    const std::string references =
        scene.reference_model.empty()
            ? fmt::format("{} references", scene.references.size())
            : fmt::format("references of {}", scene.reference_model.string());
    fmt::print("{}: {}, {} queries ({} with a true pose): {}\n", scene.name, references,
               scene.queries.size(), scene.ground_truth.size(), file.string());
    for (const std::string& note : scene.notes) fmt::print("  {}\n", note);
  }
}

std::string DatasetHelp() {
  std::string text = "One of:";
  for (const Dataset& dataset : AllDatasets()) {
    text += fmt::format("\n{} = {}: {}", dataset.name, dataset.title, dataset.layout);
  }
  return text;
}

}  // namespace

Command AddImportCommand(CLI::App& program) {
  auto flags = std::make_shared<ImportFlags>();
  CLI::App& command =
      AddCommand(program, "import", "A scene file from one of the field's data sets");
  const OptionGroup options(command);
  options.Add("DATASET", flags->dataset, DatasetHelp()).Required();
  options.Add("DIR", flags->folder, "The data set's folder, as described there").Required();
  options
      .Add("--out", flags->out,
           "Folder for scene.toml, references, queries.txt, ground_truth, times.txt\n"
           "and groups.txt; photographs and depth maps stay where they are")
      .Required();
  options.Add("--query-every", flags->options.query_every,
              "Every N-th frame is a query where the data set has none of its own\n"
              "(nerfstudio, tum, scannet, eth3d)");
  options.Add("--split", flags->options.split,
              "Of gangnam: whose photographs are the queries, validation|test");
  options.Add("--calibration", flags->options.calibration,
              "Of 7scenes, whose poses are the depth camera's: color moves them to the\n"
              "photographs (as kapture and ACE do), raw takes them as they are (hloc): {}");
  options.Add("--pgt", flags->options.pseudo_ground_truth,
              "Of 7scenes and 12scenes: folder of SCENE_train.txt and SCENE_test.txt with\n"
              "poses and focal lengths to take instead (Brachmann et al., ICCV 2021)");
  options.Add("--camera", flags->camera,
              "\"MODEL width height params...\" of all images, instead of the data\n"
              "set's intrinsics");
  const OptionGroup running(command, "Running");
  running.Flag("--quiet", flags->quiet, "Print nothing but warnings");
  AddConfigOption(command);
  SetFooter(command,
            "Example:\n"
            "  raylift import 7scenes 7scenes/chess --out scenes/chess\n"
            "  raylift localize --scene scenes/chess/scene.toml --out result\n"
            "  raylift evaluate --scene scenes/chess/scene.toml --poses result/poses.txt");
  return {&command, [flags] { UntilSignal([&] { Run(*flags); }, &BeginsAnew); }};
}

}  // namespace raylift
