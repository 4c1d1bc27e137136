// Names parts of surfaces, and gives them ids in pictures: the instances and semantics of data
// sets.

#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "raylift/surfaces/triangle_mesh.h"
#include "raylift/views/render_job.h"

namespace raylift {

// A line of a table of semantics: the id of the parts whose names match the pattern, as in a shell.
struct SemanticRule {
  uint32_t id;
  std::string pattern;
};

// Reads lines of "ID PATTERN", ids up to 4294967294. Throws InputError naming the line.
std::vector<SemanticRule> ReadSemanticRules(const std::filesystem::path& path);

// Sets the `semantic` of each label, where there are rules: the id of the first one that its
// material or instance has a name of. Returns warnings on rules and names that do not meet.
std::vector<std::string> AssignSemantics(std::span<const SemanticRule> rules, TriangleMesh& mesh);

// The products whose ids have names. All below is for these alone.
inline constexpr std::array kNamedProducts = {Product::kInstance, Product::kSemantic};
inline bool HasNames(Product product) {
  return product == kNamedProducts[0] || product == kNamedProducts[1];
}

uint32_t IdOf(Product product, const SurfaceLabel& label);

// Throws OptionError where no part of the mesh has an id of a product.
void RequireIds(std::span<const ProductOutput> products, const TriangleMesh& mesh);

// Returns the lines "ID NAME", by id, and the name of the file that has them.
std::string NamesOfIds(Product product, const TriangleMesh& mesh);
std::string FileOfNames(Product product);

}  // namespace raylift
