// Makes the demo: the courtyard's mesh, photographs of it as references, and photographs on another
// day as queries. Usage: raylift_make_demo FOLDER [SEED]
// With a seed it is another courtyard, seen from places nearby: to measure on what nobody has seen.
// With --town SEED it is a town, with what a survey has of it (town_files.h).

#include <charconv>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "base/rng.h"
#include "courtyard.h"
#include "scene_writer.h"
#include "town_files.h"
#include "viewpoints.h"

namespace raylift::demo {

namespace {

// The courtyard in assets/demo.
constexpr uint64_t kDemoSeed = 20240914;
constexpr int kSamplesPerSide = 3;

void MakeCourtyard(const std::filesystem::path& folder, std::optional<uint64_t> given_seed) {
  const uint64_t seed = given_seed.value_or(kDemoSeed);
  std::vector<PosedImage> references = ReferenceViews(), queries = QueryViews();
  if (given_seed) {
    Rng moves(StreamSeed(seed, "courtyard", "views"));
    MoveViews(moves, references);
    MoveViews(moves, queries);
  }
  const Courtyard yard = BuildCourtyard(seed);
  const auto caster_of = [&](const MeshBuilder& mesh) {
    return RayCaster(
        std::make_shared<const TriangleMesh>(mesh.ToTriangleMesh(yard.scene.textures)));
  };
  WriteScene(folder, yard.scene, "A courtyard, in metres, z up");
  WriteViews(folder / "model", references);
  TakeReferences(folder / "images", caster_of(yard.scene.mesh), references, seed, kSamplesPerSide);
  MeshBuilder changed = yard.scene.mesh;
  changed.Append(yard.newcomers);
  WriteViews(folder / "ground_truth", queries);
  WriteQueries(folder / "queries.txt", queries);
  TakeQueries(folder / "images", caster_of(changed), queries, seed, kSamplesPerSide);
}

std::optional<uint64_t> ParseNumber(std::string_view text) {
  uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

constexpr uint64_t kPhotographsOfTown = 15;

// Makes what the words ask for; returns whether they ask for something.
bool Make(const std::vector<std::string_view>& words) {
  if (words.size() == 3 || words.size() == 4) {
    const auto seed = ParseNumber(words[1]);
    const auto photographs = words.size() == 4 ? ParseNumber(words[3]) : kPhotographsOfTown;
    if (words[0] != "--town" || !seed || !photographs) return false;
    MakeTown(words[2], *seed, static_cast<int>(*photographs));
    return true;
  }
  const auto seed = words.size() == 2 ? ParseNumber(words[1]) : std::nullopt;
  if (words.empty() || words.size() > 2 || (words.size() == 2 && !seed)) return false;
  MakeCourtyard(words[0], seed);
  return true;
}

int Main(int argc, char** argv) {
  if (Make({argv + 1, argv + argc})) return 0;
  std::cerr << "usage: raylift_make_demo FOLDER [SEED]\n"
               "       raylift_make_demo --town SEED FOLDER [PHOTOGRAPHS = 15]\n";
  return 2;
}

}  // namespace

}  // namespace raylift::demo

int main(int argc, char** argv) {
  try {
    return raylift::demo::Main(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "raylift_make_demo: " << error.what() << "\n";
    return 1;
  }
}
