// doctor, and its quick form in localize: the program around the library's diagnosis.

#include <algorithm>

#include "apps/program.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

Arguments DoctorWithHloc(const RoomScene& scene) {
  return Arguments{"doctor", "--model", scene.model(), "--geometry",
                   "mesh:" + scene.mesh().string()} +
         HlocMatches(scene);
}

TEST(Doctor, SaysThatARightReadingIsRight) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path json = scene.folder / "doctor.json";
  const CommandResult result = RunRaylift(DoctorWithHloc(scene) + Arguments{"--json", json});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_TRUE(Lines(result.out).back().starts_with("the input is read as the matches suggest"))
      << result.out;
  const auto written = nlohmann::json::parse(ReadFile(json));
  EXPECT_EQ(written["verdict"], "as_meant");
  EXPECT_EQ(written["suspicious"], false);
  EXPECT_EQ(written["readings"][0]["reading"], "as read");
}

TEST(Doctor, NamesTheOptionThatRepairs) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const CommandResult result =
      RunRaylift(DoctorWithHloc(scene) + Arguments{"--model-poses", "opengl"});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_TRUE(Lines(result.out).back().ends_with("Repair: --model-poses cam_from_world"))
      << result.out;
}

TEST(Doctor, RefusesOptionsThatDoNotFit) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  EXPECT_TRUE(FailsWith(2, {"--model-poses = colmap", "cam_from_world|world_from_cam"},
                        RunRaylift(DoctorWithHloc(scene) + Arguments{"--model-poses", "colmap"})));
  EXPECT_TRUE(FailsWith(2, {"--images"},
                        RunRaylift({"doctor", "--model", scene.model(), "--geometry",
                                    "mesh:" + scene.mesh().string()})));
}

TEST(Doctor, ReferencesAloneSuffice) {
  const fs::path demo = DemoFolder();
  const fs::path folder = TestFolder();
  const fs::path json = folder / "doctor.json";
  const auto verdict_on = [&](const std::string& keys) {
    EXPECT_TRUE(Succeeds(
        RunRaylift({"doctor", "--model", demo / "model", "--images", demo / "images",
                    "--max-features", "500", "--cache", folder / "cache", "--geometry",
                    "mesh:" + (demo / "scene.obj").string() + keys, "--json", json, "--quiet"})));
    return nlohmann::json::parse(ReadFile(json));
  };
  EXPECT_EQ(verdict_on("")["verdict"], "as_meant");
  // A mesh in millimeters, by the same key that repairs it.
  const auto repaired = verdict_on(",scale=1000");
  EXPECT_EQ(repaired["verdict"], "repair");
  EXPECT_EQ(repaired["fault"], "mesh_frame");
  EXPECT_TRUE(repaired["repair"]["geometry_keys"].empty());
  EXPECT_EQ(repaired["repair"]["replaced_keys"], nlohmann::json({"scale=1000"}));
  EXPECT_FALSE(repaired.contains("best"));
}

// Eight references have too few pairs to tell a spread by.
TEST(Doctor, NamesAMeshElsewhereWithEightReferences) {
  const fs::path demo = DemoFolder();
  const fs::path folder = TestFolder();
  for (const std::string key : {"scale=1000", "axes=x/-z/y"}) {
    const CommandResult result =
        RunRaylift({"doctor", "--model", demo / "model", "--images", demo / "images", "--every",
                    "3", "--cache", folder / "cache", "--geometry",
                    "mesh:" + (demo / "scene.obj").string() + "," + key, "--quiet", "--json",
                    folder / "doctor.json"});
    EXPECT_TRUE(Succeeds(result));
    const auto found = nlohmann::json::parse(ReadFile(folder / "doctor.json"));
    EXPECT_EQ(found["verdict"], "repair") << key;
    EXPECT_EQ(found["repair"]["replaced_keys"], nlohmann::json({key}));
  }
}

// Walls that lie upon each other let half of what is seen fit, and a reading that is far off has
// depths that would be even worse at random.
TEST(Doctor, NamesAMeshThatHalfFitsWhereItIs) {
  const fs::path demo = DemoFolder();
  const fs::path folder = TestFolder();
  for (const std::string key : {"axes=x/-z/y", "shift=2/0/0"}) {
    const CommandResult result = RunRaylift(
        {"doctor", "--model", demo / "model", "--images", demo / "images", "--queries",
         demo / "queries.txt", "--query-images", demo / "images", "--cache", folder / "cache",
         "--geometry", "mesh:" + (demo / "scene.obj").string() + "," + key, "--quiet", "--json",
         folder / "doctor.json"});
    EXPECT_TRUE(Succeeds(result));
    const auto found = nlohmann::json::parse(ReadFile(folder / "doctor.json"));
    EXPECT_EQ(found["verdict"], "repair") << key;
    EXPECT_EQ(found["repair"]["replaced_keys"], nlohmann::json({key}));
  }
}

TEST(Localize, WarnsWhereAnotherReadingIsFarBetter) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  const Arguments wrong =
      LocalizeWithHloc(scene, out) + Arguments{"--model-poses", "world_from_cam"};
  const CommandResult result = RunRaylift(wrong);
  EXPECT_EQ(result.exit_code, 0);
  ASSERT_EQ(Lines(result.err).size(), 1u) << result.err;
  EXPECT_NE(result.err.find("Repair: --model-poses cam_from_world"), std::string::npos)
      << result.err;
  const auto summary = nlohmann::json::parse(ReadFile(out / "summary.json"));
  EXPECT_EQ(summary["warnings"].size(), 1u);
  EXPECT_TRUE(Succeeds(RunRaylift(wrong + Arguments{"--no-doctor", "--overwrite"})));
}

// Its matches alone do not tell: the references' own are asked, too.
TEST(Localize, WarnsByOneQueryAsByMany) {
  const fs::path demo = DemoFolder();
  const fs::path folder = TestFolder();
  WriteFile(folder / "one.txt", Lines(ReadFile(demo / "queries.txt")).front() + '\n');
  const CommandResult result = RunRaylift(
      {"localize", "--model", demo / "model", "--images", demo / "images", "--geometry",
       "mesh:" + (demo / "scene.obj").string(), "--queries", folder / "one.txt", "--max-features",
       "500", "--model-poses", "world_from_cam", "--out", folder / "out", "--quiet"});
  EXPECT_EQ(result.exit_code, 0);
  ASSERT_EQ(Lines(result.err).size(), 1u) << result.err;
  EXPECT_NE(result.err.find("Repair: --model-poses cam_from_world"), std::string::npos)
      << result.err;
  const auto summary = nlohmann::json::parse(ReadFile(folder / "out" / "summary.json"));
  EXPECT_EQ(summary["verdicts"]["doubtful"], 1);
  EXPECT_EQ(summary["localized"], 0);
}

TEST(Localize, WarnsWhereTheMeshBelongsElsewhere) {
  const fs::path demo = DemoFolder();
  const fs::path folder = TestFolder();
  WriteFile(folder / "one.txt", Lines(ReadFile(demo / "queries.txt")).front() + '\n');
  for (const std::string key : {"", "scale=1.2", "shift=2/0/0"}) {
    const CommandResult result =
        RunRaylift({"localize", "--model", demo / "model", "--images", demo / "images", "--cache",
                    folder / "cache", "--geometry",
                    "mesh:" + (demo / "scene.obj").string() + (key.empty() ? "" : "," + key),
                    "--queries", folder / "one.txt", "--max-features", "500", "--out",
                    folder / ("out" + key.substr(0, 5)), "--quiet"});
    EXPECT_EQ(result.exit_code, 0);
    if (key.empty()) {
      EXPECT_EQ(result.err, "");
    } else {
      EXPECT_NE(result.err.find("leave out " + key), std::string::npos) << key << result.err;
    }
  }
}

// Writes the triangles of the demo's mesh whose x is at most this.
void WritePartOfDemo(double most_x, const fs::path& file) {
  TriangleMesh part = ReadMesh(DemoFolder() / "scene.obj");
  std::string text;
  for (uint32_t i = 0; i < part.vertices.size(); ++i) {
    const Eigen::Vector3d v = part.VertexInWorld(i);
    text += fmt::format("v {} {} {}\n", v.x(), v.y(), v.z());
  }
  for (const auto& t : part.triangles) {
    const bool is_in =
        std::ranges::all_of(t, [&](uint32_t i) { return part.VertexInWorld(i).x() <= most_x; });
    if (is_in) text += fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  }
  WriteFile(file, text);
}

// Another place, where it would meet more of what is seen, explains what it meets here far worse.
TEST(Localize, AMeshOfAPartOfTheSceneIsInItsPlace) {
  const fs::path demo = DemoFolder();
  const fs::path folder = TestFolder();
  WritePartOfDemo(5, folder / "part.obj");
  const CommandResult result =
      RunRaylift({"localize", "--model", demo / "model", "--images", demo / "images", "--geometry",
                  "mesh:" + (folder / "part.obj").string(), "--queries", demo / "queries.txt",
                  "--max-features", "1000", "--out", folder / "out", "--quiet"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.err, "");
}

}  // namespace
}  // namespace raylift
