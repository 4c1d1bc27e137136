#include "apps/argument_files.h"

#include <array>
#include <map>
#include <string_view>

#include "io/text/toml_file.h"
#include "lifting/mesh_spec.h"
#include <fmt/format.h>

#include "raylift/geometry/geodesy.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

using std::filesystem::path;

class ConfigReader {
 public:
  explicit ConfigReader(const CLI::App& command) : command_(command) {}

  std::vector<std::string> Arguments(const path& file) {
    TomlTable top = ReadToml(file);
    for (const std::string& key : top.Keys()) {
      if (!top.IsTable(key) || !IsSibling(command_, key)) Take(top, key);
    }
    if (const std::string name = NameOf(command_); top.IsTable(name)) {
      TomlTable table = *top.Table(name);
      for (const std::string& key : table.Keys()) Take(table, key);
    }
    // Positional arguments come first, as an option of several values would take them for its own.
    std::vector<std::string> positionals, options;
    for (const auto& [name, values] : values_) {
      const OptionFacts option = *FindOption(command_, name);
      if (option.is_given) continue;
      for (const std::string& value : values) {
        if (option.is_positional) {
          positionals.push_back(value);
        } else {
          options.push_back(fmt::format("{}={}", name, value));
        }
      }
    }
    positionals.insert(positionals.end(), options.begin(), options.end());
    return positionals;
  }

 private:
  void Take(TomlTable& table, const std::string& key) {
    const std::string name = OptionName(table, key);  // first, for its message
    values_[name] = table.Values(key);
  }

  std::string OptionName(const TomlTable& table, const std::string& key) const {
    for (const std::string& name : {"--" + key, key}) {
      const auto option = FindOption(command_, name);
      if (option && option->is_configurable && option->name == name) return name;
    }
    table.FailAtLineOf(key,
                       fmt::format("\"{}\" is no option of raylift {}", key, NameOf(command_)));
  }

  const CLI::App& command_;
  std::map<std::string, std::vector<std::string>> values_;  // by the option's name
};

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

bool Wants(const CLI::App& command, const char* option) {
  return FindOption(command, option) && !IsGiven(command, option);
}

// Returns whether the scene's value can stand beside what the command was given.
bool Fits(const SceneFile& scene, const CLI::App& command, std::string_view option) {
  const std::string name = NameOf(command);
  // Without a model, references are rendered.
  if (option == "--images" && scene.references.empty()) return IsGiven(command, "--model");
  if (option == "--times") {
    if (name == "evaluate") return IsGiven(command, "--trajectory-json");
    if (name == "perturb") return IsGiven(command, "--walk");
    return IsGiven(command, "--continuous") || IsGiven(command, "--odometry");
  }
  const bool of_queries = option == "--queries" || option == "--query-images" ||
                          option == "--ground-truth" || option == "--priors";
  if (of_queries && IsGiven(command, "--leave-one-out")) return false;
  if (name == "render" && option == "--model") return !IsGiven(command, "--cameras");
  const bool localizes = name == "localize" || name == "prepare" || name == "calibrate";
  if (localizes && option == "--ground-truth") return IsGiven(command, "--report");
  // These options are for localizing with every source, which needs matches.
  const bool of_matches = option == "--queries" || option == "--ground-truth";
  return !(name == "compare" && of_matches) || IsGiven(command, "--features");
}

bool CanUse(const CLI::App& command, const SceneGeometry& geometry) {
  const std::string name = NameOf(command);
  if (name == "render") return IsMeshSpec(geometry.spec);
  if (name == "doctor") return !geometry.spec.starts_with("sfm");
  return name != "evaluate";  // there it asks for another figure of merit
}

std::vector<std::string> GeometryArguments(const SceneFile& scene, const CLI::App& command) {
  std::vector<std::string> arguments;
  for (const SceneGeometry& geometry : scene.geometries) {
    if (!CanUse(command, geometry)) continue;
    if (NameOf(command) == "compare") {
      arguments.push_back(fmt::format("--geometry={}={}", geometry.name, geometry.spec));
    } else {
      return {fmt::format("--geometry={}", geometry.spec)};
    }
  }
  return arguments;
}

}  // namespace

std::vector<std::string> ConfigArguments(const path& file, const CLI::App& command) {
  return ConfigReader(command).Arguments(file);
}

void AddSceneOption(CLI::App& command) {
  OptionGroup(command, "Scene file")
      .AddText("--scene",
               "Scene file (raylift import makes them): says what the options do\n"
               "not; --geometry also takes the names of its geometries",
               [](const std::string&) {});
}

std::vector<std::string> SceneArguments(const SceneFile& scene, const CLI::App& command) {
  std::vector<std::string> arguments;
  for (const PathOption& known : kPathOptions) {
    const path& value = scene.*known.member;
    if (!value.empty() && Wants(command, known.option) && Fits(scene, command, known.option)) {
      arguments.push_back(fmt::format("{}={}", known.option, value.string()));
    }
  }
  for (const auto& [option, value] :
       {std::pair("--thresholds", &scene.thresholds), std::pair("--crs", &scene.crs)}) {
    if (!value->empty() && Wants(command, option)) {
      arguments.push_back(fmt::format("{}={}", option, *value));
    }
  }
  if (Wants(command, "--geometry")) {
    const auto geometries = GeometryArguments(scene, command);
    arguments.insert(arguments.end(), geometries.begin(), geometries.end());
  }
  return arguments;
}

void TakeGeometries(const SceneFile& scene, const std::string& crs, CLI::App& command) {
  Translate(command, "--geometry",
            [geometries = scene.geometries, crs,
             is_named = NameOf(command) == "compare"](const std::string& text) -> std::string {
              SceneGeometry given{.name = {}, .spec = text};
              for (const SceneGeometry& geometry : geometries) {
                if (geometry.name == text) given = geometry;
              }
              const size_t equals = text.find('=');
              if (is_named && given.name.empty() && equals < text.find_first_of(":,")) {
                given = {.name = text.substr(0, equals), .spec = text.substr(equals + 1)};
              }
              if (!crs.empty()) {
                given.spec = InWorld({GeometrySpecOf(given.spec)}, WorldFrame::Parse(crs)).front();
              }
              return is_named && !given.name.empty() ? given.name + "=" + given.spec : given.spec;
            });
}

}  // namespace raylift
