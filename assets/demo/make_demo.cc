// Makes the demo: the courtyard's mesh, photographs of it as references, and photographs on another
// day as queries. Usage: raylift_make_demo FOLDER [SEED]
// With a seed it is another courtyard, seen from places nearby: to measure on what nobody has seen.

#include <charconv>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string_view>

#include "base/rng.h"
#include "courtyard.h"
#include "photograph.h"
#include "scene_writer.h"
#include "viewpoints.h"

#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"

namespace raylift::demo {

namespace {

// The courtyard in assets/demo.
constexpr uint64_t kDemoSeed = 20240914;
constexpr int kReferenceJpegQuality = 82;
constexpr int kQueryJpegQuality = 82;

// A clear late morning.
const Daylight kMorning{{-0.45, -0.55, 0.80},
                        {2.3f, 2.15f, 1.9f},
                        {0.95f, 1.08f, 1.25f},
                        {0.62f, 0.58f, 0.52f},
                        {0.30f, 0.52f, 0.82f},
                        {0.78f, 0.86f, 0.93f},
                        1.15};
// A hazy afternoon: the sun from the other side, lower and warmer.
const Daylight kAfternoon{{0.75, -0.30, 0.62},
                          {1.9f, 1.45f, 0.95f},
                          {0.80f, 0.85f, 1.02f},
                          {0.60f, 0.52f, 0.42f},
                          {0.55f, 0.60f, 0.72f},
                          {0.93f, 0.84f, 0.72f},
                          1.0};

void Photograph(const std::filesystem::path& images, const RayCaster& caster,
                const PosedImage& view, const Daylight& light, const Sensor& sensor, uint64_t seed,
                int jpeg_quality) {
  const Image image = TakePhotograph(caster, view.camera, view.cam_from_world, light, sensor,
                                     StreamSeed(seed, view.name, "sensor"), 0);
  WriteImage(images / view.name, image, jpeg_quality);
  std::cout << view.name << std::endl;
}

void MakeReferences(const std::filesystem::path& folder, const Courtyard& yard,
                    const std::vector<PosedImage>& views, uint64_t seed) {
  const RayCaster caster(
      std::make_shared<const TriangleMesh>(yard.scene.ToTriangleMesh(yard.textures)));
  WriteViews(folder / "model", views);
  const Sensor sensor{.blur_px = 0.35, .vignetting = 0.1, .shot_noise = 1.5, .read_noise = 0.5};
  for (const PosedImage& view : views) {
    Photograph(folder / "images", caster, view, kMorning, sensor, seed, kReferenceJpegQuality);
  }
}

void MakeQueries(const std::filesystem::path& folder, const Courtyard& yard,
                 const std::vector<PosedImage>& views, uint64_t seed) {
  MeshBuilder changed = yard.scene;
  changed.Append(yard.newcomers);
  const RayCaster caster(
      std::make_shared<const TriangleMesh>(changed.ToTriangleMesh(yard.textures)));
  WriteViews(folder / "ground_truth", views);
  std::vector<Query> queries;
  queries.reserve(views.size());
  for (const PosedImage& view : views) queries.push_back({view.name, view.camera});
  WriteQueryList(folder / "queries.txt", queries);
  for (size_t i = 0; i < views.size(); ++i) {
    Daylight light = kAfternoon;
    light.exposure *= i % 3 == 1 ? 0.7 : i % 3 == 2 ? 1.35 : 1;
    // The last two in bad conditions: dark and shaken.
    const bool is_hard = i + 2 >= views.size();
    if (is_hard) light.exposure *= 0.38;
    const Sensor sensor{.blur_px = is_hard ? 1.6 : 0.65,
                        .vignetting = 0.35,
                        .shot_noise = is_hard ? 9.0 : 4.5,
                        .read_noise = is_hard ? 4.0 : 2.0};
    Photograph(folder / "images", caster, views[i], light, sensor, seed, kQueryJpegQuality);
  }
}

std::optional<uint64_t> ParseSeed(std::string_view text) {
  uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return seed;
}

int Main(int argc, char** argv) {
  const std::optional<uint64_t> seed = argc == 3 ? ParseSeed(argv[2]) : kDemoSeed;
  if ((argc != 2 && argc != 3) || !seed) {
    std::cerr << "usage: raylift_make_demo FOLDER [SEED]\n";
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  std::vector<PosedImage> references = ReferenceViews(), queries = QueryViews();
  if (argc == 3) {
    Rng moves(StreamSeed(*seed, "courtyard", "views"));
    MoveViews(moves, references);
    MoveViews(moves, queries);
  }
  const Courtyard yard = BuildCourtyard(*seed);
  WriteScene(folder, yard);
  MakeReferences(folder, yard, references, *seed);
  MakeQueries(folder, yard, queries, *seed);
  return 0;
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
