#include "views/surface_labels.h"

#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

// Parts as readers leave them: materials are numbered.
TriangleMesh MeshOf(const std::vector<std::pair<std::string, std::string>>& parts) {
  TriangleMesh mesh;
  for (const auto& [instance, material] : parts) {
    SurfaceLabel& label = mesh.labels.emplace_back();
    label.instance = static_cast<uint32_t>(mesh.labels.size() - 1);
    label.instance_name = instance;
    label.material = material;
    label.semantic = label.instance;
    label.semantic_name = material;
  }
  return mesh;
}

std::vector<uint32_t> SemanticsOf(const TriangleMesh& mesh) {
  std::vector<uint32_t> ids;
  for (const SurfaceLabel& label : mesh.labels) ids.push_back(label.semantic);
  return ids;
}

TEST(AssignSemantics, TheFirstRuleThatFitsEitherNameDecides) {
  const auto file = TestFolder() / "table.txt";
  WriteFile(file, "5 brick*\n6 house/*\n5 *\n");
  TriangleMesh mesh = MeshOf({{"house/door", "wood"}, {"house/wall", "brick red"}, {"", "grass"}});
  EXPECT_TRUE(AssignSemantics(ReadSemanticRules(file), mesh).empty());
  EXPECT_EQ(SemanticsOf(mesh), (std::vector<uint32_t>{6, 5, 5}));
  EXPECT_EQ(NamesOfIds(Product::kSemantic, mesh), "5 brick red\n5 grass\n6 house/door\n");
}

TEST(AssignSemantics, WhatNoRuleNamesHasNoId) {
  const std::vector<SemanticRule> rules = {{1, "wood"}};
  TriangleMesh mesh = MeshOf({{"a", "wood"}, {"b", "brick"}});
  const auto warnings = AssignSemantics(rules, mesh);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("1 of 2 parts of the meshes have no id: brick"), std::string::npos);
  EXPECT_EQ(SemanticsOf(mesh), (std::vector<uint32_t>{1, SurfaceLabel::kNone}));
}

}  // namespace
}  // namespace raylift
