#include "raylift/io/scene_file.h"

#include <algorithm>
#include <array>
#include <functional>
#include <set>
#include <sstream>
#include <string_view>

#include "io/text/line_tokens.h"
#include <fmt/format.h>
#include <toml++/toml.h>

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
constexpr std::array<PathKey, 7> kPathKeys = {{{"references", &SceneFile::references},
                                               {"images", &SceneFile::images},
                                               {"queries", &SceneFile::queries},
                                               {"query_images", &SceneFile::query_images},
                                               {"ground_truth", &SceneFile::ground_truth},
                                               {"times", &SceneFile::times},
                                               {"groups", &SceneFile::groups}}};

// "kind:a.ply+b.ply,key=value" with each path moved; other forms stay as they are. Keys hold
// patterns within the folder, not paths.
std::string MapSpecPaths(const std::string& spec, const std::function<path(const path&)>& move) {
  const size_t begin = spec.find(':');
  const size_t end = std::min(spec.find(','), spec.size());
  if (begin >= end) return spec;
  std::string moved = spec.substr(0, begin + 1);
  size_t at = begin + 1;
  while (true) {
    const size_t next = std::min(spec.find('+', at), end);
    const std::string part = spec.substr(at, next - at);
    moved += part.empty() ? part : move(part).string();
    if (next == end) break;
    moved += '+';
    at = next + 1;
  }
  return moved + spec.substr(end);
}

path FolderOf(const path& file) { return file.has_parent_path() ? file.parent_path() : path("."); }

class SceneReader {
 public:
  explicit SceneReader(const path& file) : file_(file) {}

  SceneFile Read() {
    const toml::table document = Parse();
    CheckFormat(document);
    for (const auto& [key, node] : document) Take(key.str(), node);
    return std::move(scene_);
  }

 private:
  toml::table Parse() const {
    try {
      return toml::parse(ReadFile(file_), file_.string());
    } catch (const toml::parse_error& error) {
      throw InputError(file_, Place(error.source()), error.description());
    }
  }

  void CheckFormat(const toml::table& document) const {
    const toml::node* node = document.get("format");
    if (node == nullptr) {
      throw InputError(file_, fmt::format("expected format = \"{}\", found none", kFormat));
    }
    if (Text("format", *node) != kFormat) {
      Fail(*node,
           fmt::format("format: expected \"{}\", found \"{}\"", kFormat, Text("format", *node)));
    }
  }

  void Take(std::string_view key, const toml::node& node) {
    if (key == "format") return;
    if (key == "name") {
      scene_.name = Text(key, node);
    } else if (key == "thresholds") {
      scene_.thresholds = Text(key, node);
    } else if (key == "geometry") {
      TakeGeometries(node);
    } else if (key == "provenance") {
      TakeProvenance(node);
    } else {
      TakePath(key, node);
    }
  }

  void TakePath(std::string_view key, const toml::node& node) {
    for (const PathKey& known : kPathKeys) {
      if (known.key == key) {
        scene_.*known.member = Resolve(Text(key, node));
        return;
      }
    }
    Fail(node, fmt::format("\"{}\" is no key of a scene file", key));
  }

  void TakeGeometries(const toml::node& node) {
    const toml::array* array = node.as_array();
    if (array == nullptr) Fail(node, "geometry: expected [[geometry]] tables");
    std::set<std::string> names;
    for (const toml::node& element : *array) {
      const toml::table* table = element.as_table();
      if (table == nullptr) Fail(element, "geometry: expected [[geometry]] tables");
      SceneGeometry geometry;
      for (const auto& [key, value] : *table) {
        if (key.str() == "name") {
          geometry.name = Text("geometry.name", value);
        } else if (key.str() == "spec") {
          geometry.spec = MapSpecPaths(Text("geometry.spec", value),
                                       [this](const path& given) { return Resolve(given); });
        } else {
          Fail(value, fmt::format("\"{}\" is no key of a geometry", key.str()));
        }
      }
      if (geometry.name.empty() || geometry.spec.empty()) {
        Fail(element, "geometry: expected a name and a spec");
      }
      if (!names.insert(geometry.name).second) {
        Fail(element, fmt::format("geometry: the name \"{}\" stands twice", geometry.name));
      }
      scene_.geometries.push_back(std::move(geometry));
    }
  }

  void TakeProvenance(const toml::node& node) {
    const toml::table* table = node.as_table();
    if (table == nullptr) Fail(node, "provenance: expected a table");
    for (const auto& [key, value] : *table) {
      scene_.provenance.emplace_back(key.str(), Text("provenance", value));
    }
  }

  std::string Text(std::string_view key, const toml::node& node) const {
    const auto* text = node.as_string();
    if (text == nullptr) Fail(node, fmt::format("{}: expected a string", key));
    return text->get();
  }

  // Absolute paths stay as they are.
  path Resolve(const path& given) const {
    return given.empty() ? given : (FolderOf(file_) / given).lexically_normal();
  }

  static std::string Place(const toml::source_region& source) {
    return fmt::format("line {}", source.begin.line);
  }
  [[noreturn]] void Fail(const toml::node& node, std::string_view message) const {
    throw InputError(file_, Place(node.source()), message);
  }

  const path& file_;
  SceneFile scene_;
};

std::string Quoted(const std::string& text) {
  std::ostringstream stream;
  stream << toml::value<std::string>(text);
  return stream.str();
}

// As seen from a folder, whatever links lead to either.
path RelativeTo(const path& folder, const path& target) {
  return std::filesystem::weakly_canonical(target).lexically_relative(
      std::filesystem::weakly_canonical(folder));
}

// Lines of a name and one more token.
template <typename Value, typename Parse>
std::map<std::string, Value> ReadByName(const path& file, std::string_view field, Parse parse) {
  std::map<std::string, Value> values;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const std::string name(tokens.Token("name"));
    if (!values.emplace(name, parse(lines, tokens.Token(field))).second) {
      tokens.Fail(fmt::format("name: \"{}\" stands twice", name));
    }
    tokens.ExpectEnd();
  }
  return values;
}

}  // namespace

SceneFile ReadSceneFile(const path& file) { return SceneReader(file).Read(); }

void WriteSceneFile(const path& file, const SceneFile& scene) {
  const auto relative = [folder = FolderOf(file)](const path& target) {
    return RelativeTo(folder, target);
  };
  std::string text = fmt::format("format = {}\n", Quoted(std::string(kFormat)));
  const auto add = [&text](std::string_view key, const std::string& value) {
    if (!value.empty()) text += fmt::format("{} = {}\n", key, Quoted(value));
  };
  add("name", scene.name);
  for (const PathKey& known : kPathKeys) {
    const path& target = scene.*known.member;
    if (!target.empty()) add(known.key, relative(target).string());
  }
  add("thresholds", scene.thresholds);
  for (const SceneGeometry& geometry : scene.geometries) {
    text += "\n[[geometry]]\n";
    add("name", geometry.name);
    add("spec", MapSpecPaths(geometry.spec, relative));
  }
  if (!scene.provenance.empty()) text += "\n[provenance]\n";
  for (const auto& [key, value] : scene.provenance) {
    text += fmt::format("{} = {}\n", Quoted(key), Quoted(value));
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
    CheckName(file, name);
    text += fmt::format("{} {}\n", name, FormatDouble(seconds));
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
    CheckName(file, name);
    CheckName(file, group);
    text += fmt::format("{} {}\n", name, group);
  }
  WriteFile(file, text);
}

}  // namespace raylift
