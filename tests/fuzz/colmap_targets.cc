// COLMAP's models and database.

#include <array>

#include "fuzz/fuzz_targets.h"
#include "io/colmap/colmap_database.h"
#include "io/colmap_test_models.h"
#include <sqlite3.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

constexpr auto kTextFiles = std::to_array<std::string_view>(
    {"cameras.txt", "images.txt", "points3D.txt", "rigs.txt", "frames.txt"});
constexpr auto kBinaryFiles = std::to_array<std::string_view>(
    {"cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin"});

void UseModel(const ColmapModel& model) {
  for (const PosedImage& image : model.PosedImages()) {
    const Rigid3& pose = image.cam_from_world;
    RAYLIFT_CHECK(pose.translation.allFinite());
    RAYLIFT_CHECK(std::abs(pose.rotation.norm() - 1) < 1e-6);
  }
  ColmapModel cut = model;
  if (!model.images.empty()) RemoveImages(cut, {{model.images.begin()->second.name}});
}

ColmapModel ModelWithRigs() {
  Rng rng(1);
  ColmapModel model = SmallColmapModel(rng);
  ColmapRig& rig = model.rigs[3];
  rig.reference_sensor = ColmapSensor{0, 7};
  rig.sensors = {{{0, 2}, ColmapPose{}}, {{1, 1}, std::nullopt}};
  model.frames[4] = {3, {}, {{{0, 7}, 5}, {{0, 2}, 1}}};
  return model;
}

std::vector<std::string> ModelSeeds(ColmapForm form) {
  std::vector<std::string> seeds;
  Rng rng(1);
  for (const ColmapModel& model : {SmallColmapModel(rng), ModelWithRigs()}) {
    const auto folder = ScratchFolder() / "seed";
    WriteColmapModel(folder, model, form);
    seeds.push_back(JoinFiles(folder, form == ColmapForm::kText ? kTextFiles : kBinaryFiles));
  }
  return seeds;
}

void ReadDatabase(std::string_view bytes) {
  const ColmapDatabase database(PutFile("database.db", bytes));
  for (const std::string& name : database.ImageNames()) {
    database.MatchedWith(name);
    for (const std::string& other : database.ImageNames()) database.ReadMatches(name, other);
    database.ReadKeypoints(name);
  }
}

// The tables of COLMAP as far as they are read: two images with two keypoints and a match.
std::vector<std::string> DatabaseSeeds() {
  const auto file = ScratchFolder() / "seed.db";
  std::filesystem::remove(file);
  sqlite3* database = nullptr;
  const bool good =
      sqlite3_open(file.c_str(), &database) == SQLITE_OK &&
      sqlite3_exec(
          database,
          "PRAGMA page_size = 512;"
          "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, width INTEGER, height INTEGER);"
          "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);"
          "CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data "
          "BLOB);"
          "CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data "
          "BLOB);"
          "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols "
          "INTEGER, data BLOB);"
          "INSERT INTO cameras VALUES (1, 640, 480);"
          "INSERT INTO images VALUES (1, 'a.jpg', 1), (2, 'b.jpg', 1);"
          "INSERT INTO keypoints VALUES (1, 2, 2, x'0000803f0000803f0000803f0000803f'), (2, 1, 2, "
          "x'0000803f0000803f');"
          "INSERT INTO matches VALUES (2147483649, 1, 2, x'0000000001000000');"
          "INSERT INTO two_view_geometries VALUES (2147483649, 1, 2, x'0000000001000000');",
          nullptr, nullptr, nullptr) == SQLITE_OK;
  sqlite3_close(database);
  RAYLIFT_CHECK(good);
  return {TakeFile(file)};
}

}  // namespace

std::vector<FuzzTarget> ColmapFuzzTargets() {
  return {
      {"colmap_text",
       [](std::string_view bytes) {
         UseModel(ReadColmapModel(SplitFiles(bytes, "model_text", kTextFiles)));
       },
       [] { return ModelSeeds(ColmapForm::kText); },
       "=FILE= # SIMPLE_RADIAL OPENCV_FISHEYE FULL_OPENCV EQUIRECTANGULAR EUCM CAMERA IMU -1 1e308 "
       "1e-320 4294967295 2147483648 nan"},
      {"colmap_binary",
       [](std::string_view bytes) {
         UseModel(ReadColmapModel(SplitFiles(bytes, "model_binary", kBinaryFiles)));
       },
       [] { return ModelSeeds(ColmapForm::kBinary); }, "=FILE="},
      {"colmap_database", ReadDatabase, DatabaseSeeds, "CREATE TABLE VIEW SELECT rows cols data"},
  };
}

}  // namespace raylift
