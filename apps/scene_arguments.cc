#include "scene_arguments.h"

#include <array>
#include <filesystem>
#include <string_view>

#include <fmt/format.h>

namespace raylift {
namespace {

using std::filesystem::path;

struct PathOption {
  const char* option;
  path SceneFile::*member;
};
constexpr std::array<PathOption, 8> kPathOptions = {{{"--model", &SceneFile::references},
                                                     {"--images", &SceneFile::images},
                                                     {"--queries", &SceneFile::queries},
                                                     {"--query-images", &SceneFile::query_images},
                                                     {"--ground-truth", &SceneFile::ground_truth},
                                                     {"--times", &SceneFile::times},
                                                     {"--groups", &SceneFile::groups},
                                                     {"--priors", &SceneFile::priors}}};

bool IsGiven(const CLI::App& command, const char* option) {
  const CLI::Option* found = command.get_option_no_throw(option);
  return found != nullptr && found->count() > 0;
}

bool Wants(const CLI::App& command, const char* option) {
  return command.get_option_no_throw(option) != nullptr && !IsGiven(command, option);
}

// Whether the scene's value can stand beside what the command was given.
bool Fits(const SceneFile& scene, const CLI::App& command, std::string_view option) {
  const std::string& name = command.get_name();
  // Without a model, references are rendered.
  if (option == "--images" && scene.references.empty()) return IsGiven(command, "--model");
  if (option == "--times") return IsGiven(command, "--continuous");
  const bool of_queries = option == "--queries" || option == "--query-images" ||
                          option == "--ground-truth" || option == "--priors";
  if (of_queries && IsGiven(command, "--leave-one-out")) return false;
  if (name == "render" && option == "--model") return !IsGiven(command, "--cameras");
  // They are for the localization with every source, which needs matches.
  const bool of_matches = option == "--queries" || option == "--ground-truth";
  return !(name == "compare" && of_matches) || IsGiven(command, "--features");
}

bool CanUse(const CLI::App& command, const SceneGeometry& geometry) {
  const std::string& name = command.get_name();
  if (name == "render") return geometry.spec.starts_with("mesh:");
  if (name == "doctor") return !geometry.spec.starts_with("sfm");
  return name != "evaluate";  // there it asks for another figure of merit
}

std::vector<std::string> GeometryArguments(const SceneFile& scene, const CLI::App& command) {
  std::vector<std::string> arguments;
  for (const SceneGeometry& geometry : scene.geometries) {
    if (!CanUse(command, geometry)) continue;
    if (command.get_name() == "compare") {
      arguments.push_back(fmt::format("--geometry={}={}", geometry.name, geometry.spec));
    } else {
      return {fmt::format("--geometry={}", geometry.spec)};
    }
  }
  return arguments;
}

}  // namespace

void AddSceneOption(CLI::App& app) {
  app.add_option("--scene",
                 "Scene file (raylift import makes them): says what the options do\n"
                 "not; --geometry also takes the names of its geometries")
      ->type_name("TEXT")
      ->group("Scene file");
}

std::vector<std::string> SceneArguments(const SceneFile& scene, const CLI::App& command) {
  std::vector<std::string> arguments;
  for (const PathOption& known : kPathOptions) {
    const path& value = scene.*known.member;
    if (!value.empty() && Wants(command, known.option) && Fits(scene, command, known.option)) {
      arguments.push_back(fmt::format("{}={}", known.option, value.string()));
    }
  }
  if (!scene.thresholds.empty() && Wants(command, "--thresholds")) {
    arguments.push_back("--thresholds=" + scene.thresholds);
  }
  if (Wants(command, "--geometry")) {
    const auto geometries = GeometryArguments(scene, command);
    arguments.insert(arguments.end(), geometries.begin(), geometries.end());
  }
  return arguments;
}

void TakeGeometryNames(const SceneFile& scene, CLI::App& command) {
  CLI::Option* option = command.get_option_no_throw("--geometry");
  if (option == nullptr) return;
  const bool named = command.get_name() == "compare";
  option->transform(CLI::Validator(
      [geometries = scene.geometries, named](std::string& text) -> std::string {
        for (const SceneGeometry& geometry : geometries) {
          if (geometry.name != text) continue;
          text = named ? fmt::format("{}={}", geometry.name, geometry.spec) : geometry.spec;
          break;
        }
        return {};
      },
      ""));
}

}  // namespace raylift
