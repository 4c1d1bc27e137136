// import: from a data set's own layout to poses and a table, by scene files alone.

#include <map>

#include "apps/program.h"
#include "support/dataset_layouts.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

struct Case {
  std::string name;
  Layout (*write)(const fs::path& folder, const LayoutInput& input);
};
void PrintTo(const Case& c, std::ostream* stream) { *stream << c.name; }

class Import : public ::testing::TestWithParam<Case> {};

INSTANTIATE_TEST_SUITE_P(
    , Import,
    ::testing::Values(Case{"7scenes", &Write7Scenes}, Case{"12scenes", &Write12Scenes},
                      Case{"cambridge", &WriteCambridge}, Case{"aachen", &WriteAachen},
                      Case{"cmu", &WriteCmu}, Case{"gangnam", &WriteGangnam},
                      Case{"nerfstudio", &WriteNerfstudio}, Case{"tum", &WriteTum},
                      Case{"scannet", &WriteScanNet}, Case{"scannetpp", &WriteScanNetPp},
                      Case{"eth3d", &WriteEth3d}, Case{"lamar", &WriteLamar}),
    [](const auto& test) { return "of_" + test.param.name; });

// The room, photographed in a data set's layout.
Layout PhotographRoom(const Case& dataset, const RoomScene& room) {
  const RayCaster caster(std::make_shared<const TriangleMesh>(ReadMesh(room.mesh())));
  LayoutInput input;
  input.width_px = 240;
  input.height_px = 180;
  for (const PosedImage& view : room.references) input.references.push_back(view.cam_from_world);
  for (const PosedImage& view : room.queries) input.queries.push_back(view.cam_from_world);
  input.write_picture = [&caster](const fs::path& file, const PosedImage& view) {
    ColorOptions colors;
    colors.samples_per_pixel_side = 2;
    WriteImage(file, RenderColor(caster, view.camera, view.cam_from_world, colors, 1));
  };
  return dataset.write(room.folder / "data", input);
}

// Of data sets whose folder holds several scenes: the one of the layout's queries.
fs::path SceneFileOf(const Case& dataset, const fs::path& scenes) {
  const std::map<std::string, std::string> folders = {
      {"cmu", "slice2"}, {"scannetpp", "dslr"}, {"lamar", "query_val_phone"}};
  const auto folder = folders.find(dataset.name);
  return (folder == folders.end() ? scenes : scenes / folder->second) / "scene.toml";
}

// Aachen's true poses are not public: those that the test knows stand in for them.
Arguments TruthOf(const Case& dataset, const Layout& layout, const RoomScene& room) {
  if (dataset.name != "aachen") return {};
  std::vector<NamedPose> truth;
  for (const PosedImage& query : layout.queries)
    truth.push_back({query.name, query.cam_from_world});
  WritePoseFile(room.folder / "truth.txt", truth);
  return {"--ground-truth", room.folder / "truth.txt"};
}

TEST_P(Import, LocalizesAndEvaluatesTheScene) {
  const RoomScene room = WriteRoomScene(TestFolder(), {.matches = false});
  const Layout layout = PhotographRoom(GetParam(), room);
  const fs::path scenes = room.folder / "scenes", out = room.folder / "out";
  const CommandResult import =
      RunRaylift({"import", GetParam().name, layout.folder, "--out", scenes, "--query-every",
                  std::to_string(layout.query_every)});
  ASSERT_TRUE(Succeeds(import));
  EXPECT_NE(import.out.find("queries"), std::string::npos) << import.out;
  const fs::path scene = SceneFileOf(GetParam(), scenes);
  ASSERT_TRUE(Succeeds(RunRaylift(
      {"localize", "--scene", scene, "--geometry", "mesh:" + room.mesh().string(), "--out", out})));
  // A pixel is about 0.25 degrees and 10 mm here; SIFT is good for a fraction of it.
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", layout.queries, 0.4, 0.03));
  const fs::path csv = room.folder / "table.csv";
  ASSERT_TRUE(Succeeds(RunRaylift(
      Arguments{"evaluate", "--scene", scene, "--poses", out / "poses.txt", "--csv", csv} +
      TruthOf(GetParam(), layout, room))));
  const auto lines = Lines(ReadFile(csv));
  ASSERT_GE(lines.size(), 2u);
  const std::string queries = std::to_string(layout.queries.size());
  EXPECT_TRUE(lines[1].starts_with("out,false," + queries + "," + queries + ",0,100")) << lines[1];
  EXPECT_EQ(lines.size() > 2, !ReadSceneFile(scene).groups.empty());
}

TEST(ImportCommand, BadInputIsNamed) {
  const fs::path folder = TestFolder(), out = folder / "out";
  EXPECT_TRUE(FailsWith(2, {"DATASET = inloc: expected 7scenes|12scenes"},
                        RunRaylift({"import", "inloc", folder, "--out", out})));
  EXPECT_TRUE(
      FailsWith(3, {"TrainSplit.txt"}, RunRaylift({"import", "7scenes", folder, "--out", out})));
  EXPECT_TRUE(FailsWith(2, {"--query-every = 1"},
                        RunRaylift({"import", "tum", folder, "--out", out, "--query-every", "1"})));
  EXPECT_TRUE(
      FailsWith(3, {"--camera"},
                RunRaylift({"import", "tum", folder, "--out", out, "--camera", "PINHOLE 64"})));
}

}  // namespace
}  // namespace raylift
