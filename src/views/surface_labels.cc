#include "views/surface_labels.h"

#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fnmatch.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

bool IsNameOf(const SemanticRule& rule, const std::string& name) {
  if (name.empty()) return false;
  return rule.pattern == name || fnmatch(rule.pattern.c_str(), name.c_str(), 0) == 0;
}

}  // namespace

std::vector<SemanticRule> ReadSemanticRules(const std::filesystem::path& path) {
  LineReader reader(path);
  std::vector<SemanticRule> rules;
  while (const auto line = reader.NextContent()) {
    const auto tokens = SplitTokens(*line);
    if (tokens.size() < 2) reader.Fail("expected \"ID PATTERN\"");
    const uint64_t id = reader.Uint(tokens[0], "id");
    if (id >= SurfaceLabel::kNone) reader.Fail("id: expected a number up to 4294967294");
    const auto pattern = line->substr(static_cast<size_t>(tokens[1].data() - line->data()));
    rules.push_back({static_cast<uint32_t>(id), std::string(Trim(pattern))});
  }
  if (rules.empty()) throw InputError(path, "expected lines of \"ID PATTERN\", found none");
  return rules;
}

std::vector<std::string> AssignSemantics(std::span<const SemanticRule> rules, TriangleMesh& mesh) {
  if (rules.empty()) return {};
  std::vector<bool> used(rules.size());
  std::vector<std::string> unnamed;
  for (SurfaceLabel& label : mesh.labels) {
    const auto rule = std::find_if(rules.begin(), rules.end(), [&label](const auto& candidate) {
      return IsNameOf(candidate, label.material) || IsNameOf(candidate, label.instance_name);
    });
    if (rule == rules.end()) {
      label.semantic = SurfaceLabel::kNone;
      unnamed.push_back(label.material.empty() ? label.instance_name : label.material);
      continue;
    }
    label.semantic = rule->id;
    label.semantic_name = IsNameOf(*rule, label.material) ? label.material : label.instance_name;
    used[static_cast<size_t>(rule - rules.begin())] = true;
  }
  std::vector<std::string> warnings;
  if (!unnamed.empty()) {
    warnings.push_back(fmt::format("semantics: {} of {} parts of the meshes have no id: {}{}",
                                   unnamed.size(), mesh.labels.size(), Printable(unnamed.front()),
                                   unnamed.size() > 1 ? ", ..." : ""));
  }
  for (size_t i = 0; i < rules.size(); ++i) {
    if (used[i]) continue;
    warnings.push_back(
        fmt::format("semantics: nothing is called \"{}\" but what lines before it "
                    "say",
                    Printable(rules[i].pattern)));
  }
  return warnings;
}

void RequireIds(std::span<const ProductOutput> products, const TriangleMesh& mesh) {
  for (const ProductOutput& output : products) {
    if (!HasNames(output.product)) continue;
    const bool any = std::any_of(mesh.labels.begin(), mesh.labels.end(), [&](const auto& label) {
      return IdOf(output.product, label) != SurfaceLabel::kNone;
    });
    if (any) continue;
    throw OptionError(
        "products", std::string(ToString(output.product)),
        output.product == Product::kInstance
            ? "no mesh has names of nodes (glTF), groups (OBJ) or objects (city models)"
            : "no mesh has names of materials or kinds of surfaces, or that a table tells");
  }
}

uint32_t IdOf(Product product, const SurfaceLabel& label) {
  return product == Product::kInstance ? label.instance : label.semantic;
}

std::string NamesOfIds(Product product, const TriangleMesh& mesh) {
  std::set<std::pair<uint32_t, std::string>> names;
  for (const SurfaceLabel& label : mesh.labels) {
    const uint32_t id = IdOf(product, label);
    if (id == SurfaceLabel::kNone) continue;
    names.emplace(
        id, Printable(product == Product::kInstance ? label.instance_name : label.semantic_name));
  }
  std::string text;
  for (const auto& [id, name] : names) text += fmt::format("{} {}\n", id, name);
  return text;
}

std::string FileOfNames(Product product) { return fmt::format("{}.txt", ToString(product)); }

}  // namespace raylift
