#include "raylift/io/scene_file.h"

#include <algorithm>
#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "io/map/packed_map.h"
#include "io/text/line_tokens.h"
#include "io/text/toml_file.h"
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kFormat = "raylift-scene/1";

struct PathKey {
  std::string_view key;
  path SceneFile::*member;
};
constexpr std::array<PathKey, 8> kPathKeys = {{{"references", &SceneFile::references},
                                               {"images", &SceneFile::images},
                                               {"queries", &SceneFile::queries},
                                               {"query_images", &SceneFile::query_images},
                                               {"ground_truth", &SceneFile::ground_truth},
                                               {"times", &SceneFile::times},
                                               {"groups", &SceneFile::groups},
                                               {"priors", &SceneFile::priors}}};

path FolderOf(const path& file) { return file.has_parent_path() ? file.parent_path() : path("."); }

class SceneReader {
 public:
  explicit SceneReader(const path& file) : file_(file), top_(ReadToml(file)) {}

  SceneFile Read() {
    CheckFormat();
    scene_.name = top_.Text("name").value_or("");
    scene_.thresholds = top_.Text("thresholds").value_or("");
    scene_.crs = top_.Text("crs").value_or("");
    for (const PathKey& known : kPathKeys) {
      if (const auto text = top_.Text(known.key)) scene_.*known.member = Resolve(*text);
    }
    for (TomlTable& table : top_.Tables("geometry")) TakeGeometry(table);
    if (auto provenance = top_.Table("provenance")) {
      for (const std::string& key : provenance->Keys()) {
        scene_.provenance.emplace_back(key, provenance->RequiredText(key));
      }
    }
    RequireAllRead(top_, "a scene file");
    return std::move(scene_);
  }

 private:
  void CheckFormat() {
    const auto format = top_.Text("format");
    if (!format)
      throw InputError(file_, fmt::format("expected format = \"{}\", found none", kFormat));
    if (*format != kFormat) {
      top_.Fail("format", fmt::format("expected \"{}\", found \"{}\"", kFormat, *format));
    }
  }

  void TakeGeometry(TomlTable& table) {
    SceneGeometry geometry;
    geometry.name = table.Text("name").value_or("");
    geometry.spec = MapSpecPaths(table.Text("spec").value_or(""),
                                 [this](const path& given) { return Resolve(given); });
    RequireAllRead(table, "a geometry");
    if (geometry.name.empty() || geometry.spec.empty()) {
      table.FailHere("expected a name and a spec");
    }
    for (const SceneGeometry& other : scene_.geometries) {
      if (other.name == geometry.name) {
        table.FailHere(fmt::format("the name \"{}\" stands twice", geometry.name));
      }
    }
    scene_.geometries.push_back(std::move(geometry));
  }

  static void RequireAllRead(const TomlTable& table, std::string_view of_what) {
    for (const std::string& key : table.UnreadKeys()) {
      table.FailAtLineOf(key, fmt::format("\"{}\" is no key of {}", key, of_what));
    }
  }

  // Absolute paths stay as they are.
  path Resolve(const path& given) const {
    return given.empty() ? given : (FolderOf(file_) / given).lexically_normal();
  }

  const path& file_;
  TomlTable top_;
  SceneFile scene_;
};

// Returns a path relative to a folder, whatever links lead to either.
path RelativeTo(const path& folder, const path& target) {
  std::error_code error;
  const path canonical = std::filesystem::weakly_canonical(target, error);
  if (error) return target;  // no file can have the name
  return canonical.lexically_relative(std::filesystem::weakly_canonical(folder));
}

// Reads lines of a name and one more token.
template <typename Value, typename Parse>
std::map<std::string, Value> ReadByName(const path& file, std::string_view field, Parse parse) {
  std::map<std::string, Value> values;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const std::string name(tokens.Name());
    if (!values.emplace(name, parse(lines, tokens.Name(field))).second) {
      tokens.Fail(fmt::format("name: \"{}\" stands twice", name));
    }
    tokens.ExpectEnd();
  }
  return values;
}

}  // namespace

SceneFile ReadSceneFile(const path& file) {
  if (!IsPackedMap(file)) return SceneReader(file).Read();
  if (file.string().find(',') != std::string::npos) {
    throw InputError(file, "the path of a packed map must hold no comma");
  }
  const MapHeader header = PackedMap(file).header();
  SceneFile scene;
  scene.name = file.stem().string();
  scene.references = file;
  scene.crs = header.crs;
  scene.geometries = {{"map", fmt::format("depth:{}{}", file.string(), header.depth_keys)}};
  return scene;
}

void WriteSceneFile(const path& file, const SceneFile& scene) {
  const auto relative = [folder = FolderOf(file)](const path& target) {
    return RelativeTo(folder, target);
  };
  std::string text = fmt::format("format = {}\n", TomlString(std::string(kFormat)));
  const auto add = [&text](std::string_view key, const std::string& value) {
    if (!value.empty()) text += fmt::format("{} = {}\n", key, TomlString(value));
  };
  add("name", scene.name);
  for (const PathKey& known : kPathKeys) {
    const path& target = scene.*known.member;
    if (!target.empty()) add(known.key, relative(target).string());
  }
  add("thresholds", scene.thresholds);
  add("crs", scene.crs);
  for (const SceneGeometry& geometry : scene.geometries) {
    text += "\n[[geometry]]\n";
    add("name", geometry.name);
    add("spec", MapSpecPaths(geometry.spec, relative));
  }
  if (!scene.provenance.empty()) text += "\n[provenance]\n";
  for (const auto& [key, value] : scene.provenance) {
    text += fmt::format("{} = {}\n", TomlString(key), TomlString(value));
  }
  WriteFile(file, text);
}

std::map<std::string, double> ReadTimes(const path& file) {
  return ReadByName<double>(file, "seconds", [](const LineReader& lines, std::string_view token) {
    return lines.Double(token, "seconds");
  });
}

void WriteTimes(const path& file, const std::map<std::string, double>& times) {
  std::string text;
  for (const auto& [name, seconds] : times) {
    text += fmt::format("{} {}\n", NameText(file, name), FormatDouble(seconds));
  }
  WriteFile(file, text);
}

std::map<std::string, std::string> ReadGroups(const path& file) {
  return ReadByName<std::string>(
      file, "group", [](const LineReader&, std::string_view token) { return std::string(token); });
}

void WriteGroups(const path& file, const std::map<std::string, std::string>& groups) {
  std::string text;
  for (const auto& [name, group] : groups) {
    text += fmt::format("{} {}\n", NameText(file, name), NameText(file, group));
  }
  WriteFile(file, text);
}

std::string MapSpecPaths(const std::string& spec, const std::function<path(const path&)>& move) {
  const std::vector<std::string_view> parts = SplitBy(spec, ',');
  const size_t colon = parts.front().find(':');
  if (colon == std::string_view::npos || colon + 1 == parts.front().size()) return spec;
  const auto moved = [&move](std::string_view file) {
    return file.empty() ? std::string() : move(file).string();
  };
  std::vector<std::string> files;
  for (const std::string_view file : SplitBy(parts.front().substr(colon + 1), '+')) {
    files.push_back(moved(file));
  }
  std::string all = fmt::format("{}{}", parts.front().substr(0, colon + 1), fmt::join(files, "+"));
  for (const std::string_view part : std::span(parts).subspan(1)) {
    const size_t equals = std::min(part.find('='), part.size());
    const std::string_view key = part.substr(0, equals);
    const bool is_file =
        key == "ortho" || key == "names" || (key == "transform" && part.substr(equals) != "=none");
    all += is_file
               ? fmt::format(",{}={}", key, moved(part.substr(std::min(equals + 1, part.size()))))
               : fmt::format(",{}", part);
  }
  return all;
}

}  // namespace raylift
