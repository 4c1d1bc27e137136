#include <string>
#include <vector>

#include "io/colmap_test_models.h"
#include "support/matchers.h"
#include "support/test_data.h"

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

const Camera kCamera(CameraModel::kPinhole, 4, 3, std::vector<double>{5, 5, 2, 1.5});

constexpr std::string_view kConfig = R"([
  {"cameras": [
    {"image_prefix": "a/right/", "cam_from_rig_rotation": [0, 1, 0, 0],
     "cam_from_rig_translation": [1, 2, 3]},
    {"image_prefix": "a/", "ref_sensor": true, "camera_model_name": "PINHOLE"}]},
  {"cameras": [{"image_prefix": "b/left_", "ref_sensor": true},
               {"image_prefix": "b/right_", "ref_sensor": false,
                "cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [0.5, 0, 0]}]}
])";

std::vector<Query> Named(const std::vector<std::string>& names) {
  std::vector<Query> queries;
  for (const std::string& name : names) queries.push_back({.name = name, .camera = kCamera});
  return queries;
}

std::filesystem::path FileOf(std::string_view text) {
  const std::filesystem::path file = TestFolder() / "rig_config.json";
  WriteFile(file, text);
  return file;
}

TEST(RigList, NamesAlikeAfterThePrefixAreOneFrame) {
  std::vector<Query> queries = Named({"a/right/1.jpg", "a/1.jpg", "b/right_1.jpg", "b/left_1.jpg",
                                      "b/left_2.jpg", "c/1.jpg", "a/right/2.jpg"});
  TakeRigs(FileOf(kConfig), queries);
  ASSERT_TRUE(queries[0].rig && queries[1].rig && queries[2].rig && queries[3].rig);
  EXPECT_EQ(queries[0].rig->frame, queries[1].rig->frame);
  EXPECT_EQ(queries[2].rig->frame, queries[3].rig->frame);
  EXPECT_NE(queries[0].rig->frame, queries[2].rig->frame);
  EXPECT_TRUE(IsNearPose(queries[0].rig->cam_from_rig, {{0, 1, 0, 0}, {1, 2, 3}}, 1e-6, 0));
  EXPECT_TRUE(IsNearPose(queries[1].rig->cam_from_rig, Rigid3(), 0, 0));
  // The reference speaks for its frame, wherever it stands.
  EXPECT_GT(queries[0].rig->sensor, queries[1].rig->sensor);
  EXPECT_GT(queries[2].rig->sensor, queries[3].rig->sensor);
}

TEST(RigList, PhotographsAloneInTheirFrameStayAsTheyAre) {
  std::vector<Query> queries = Named({"b/left_2.jpg", "c/1.jpg", "a/right/2.jpg"});
  TakeRigs(FileOf(kConfig), queries);
  for (const Query& query : queries) EXPECT_FALSE(query.rig) << query.name;
}

TEST(RigList, MistakesAreNamedByTheirPath) {
  const auto fails = [](const std::string& from, const std::string& to,
                        const std::vector<std::string>& parts) {
    std::string text(kConfig);
    const size_t position = text.find(from);
    EXPECT_NE(position, std::string::npos) << from;
    const auto file = FileOf(text.replace(position, from.size(), to));
    return FailsWithInputError(
        [&] {
          std::vector<Query> queries = Named({"a/1.jpg"});
          TakeRigs(file, queries);
        },
        parts);
  };
  EXPECT_TRUE(fails("[0, 1, 0, 0]", "[0, 1, 1, 0]",
                    {"rig_config.json: [0].cameras[0].cam_from_rig_rotation",
                     "expected a quaternion of length 1, found one of length 1.41421"}));
  EXPECT_TRUE(fails("[1, 2, 3]", "[1, 2]",
                    {"cameras[0].cam_from_rig_translation: expected 3 elements, found 2"}));
  EXPECT_TRUE(fails("[1, 2, 3]", "[1, 2, null]",
                    {"cam_from_rig_translation[2]: expected a number, found null"}));
  EXPECT_TRUE(fails("[1, 2, 3]", "[1, 2, 1e999]", {"rig_config.json", "1e999"}));
  EXPECT_TRUE(fails("\"cam_from_rig_rotation\": [0, 1, 0, 0],", "",
                    {"cameras[0]: the member \"cam_from_rig_rotation\" is missing"}));
  EXPECT_TRUE(fails("\"ref_sensor\": true, \"camera_model_name\"", "\"camera_model_name\"",
                    {"cameras[1]: the member \"cam_from_rig_rotation\" is missing"}));
  EXPECT_TRUE(fails("\"ref_sensor\": false", "\"ref_sensor\": true",
                    {"[1].cameras: expected one camera with \"ref_sensor\": true, found 2"}));
  EXPECT_TRUE(
      fails("b/right_", "b/left_", {"[1].cameras[1].image_prefix: \"b/left_\" stands twice"}));
  EXPECT_TRUE(fails("\"a/right/\"", "7", {"image_prefix: expected a string, found 7"}));
  EXPECT_TRUE(fails("[\n", "{", {"rig_config.json"}));
  const auto file = FileOf(kConfig);
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        std::vector<Query> queries = Named({"x", "y"});
        TakeRigs(file, queries);
      },
      {"rig_config.json", "knows none of the 2 queries by name"}));
}

TEST(RigList, TruncatedAnywhereIsAnInputError) {
  for (size_t size = 0; size + 1 < kConfig.size(); size += 7) {
    const auto file = FileOf(kConfig.substr(0, size));
    std::vector<Query> queries = Named({"a/1.jpg"});
    EXPECT_TRUE(FailsWithInputError([&] { TakeRigs(file, queries); }, {"rig_config.json"})) << size;
  }
}

TEST(RigList, FramesOfAModelAreTakenByTheirImages) {
  Rng rng = TestRng();
  ColmapModel model = SmallColmapModel(rng);
  const auto folder = TestFolder() / "model";
  std::vector<Query> queries =
      Named({model.images[9].name, model.images[5].name, model.images[1].name});
  WriteColmapModel(folder, model, ColmapForm::kText);
  EXPECT_TRUE(FailsWithInputError([&] { TakeRigs(folder, queries); },
                                  {"model", "expected a model with rigs and frames"}));
  model.cameras[8] = model.cameras[7];
  model.images[9].camera_id = 8;
  const ColmapPose second_from_rig{{0, 0, 1, 0}, {0.5, 1, 2}};
  model.rigs[3] = {ColmapSensor{0, 7}, {{{0, 8}, second_from_rig}}};
  model.rigs[1] = {ColmapSensor{0, 2}, {}};
  model.frames[6] = {3, {}, {{{0, 7}, 5}, {{0, 8}, 9}}};
  model.frames[2] = {1, {}, {{{0, 2}, 1}}};
  WriteColmapModel(folder, model, ColmapForm::kText);
  TakeRigs(folder, queries);
  ASSERT_TRUE(queries[0].rig && queries[1].rig);
  EXPECT_FALSE(queries[2].rig);
  EXPECT_EQ(queries[0].rig->frame, queries[1].rig->frame);
  EXPECT_LT(queries[1].rig->sensor, queries[0].rig->sensor);
  EXPECT_TRUE(IsNearPose(queries[0].rig->cam_from_rig, {{0, 0, 1, 0}, {0.5, 1, 2}}, 1e-6, 0));

  model.rigs[3].sensors[0].second.reset();
  WriteColmapModel(folder, model, ColmapForm::kText);
  EXPECT_TRUE(FailsWithInputError([&] { TakeRigs(folder, queries); },
                                  {"model", "rig 3: the pose of camera 8 is not known"}));
}

}  // namespace
}  // namespace raylift
