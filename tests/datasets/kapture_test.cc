// The traps of kapture data sets, as Gangnam Station is one.

#include "datasets/importers.h"
#include "datasets/test_input.h"
#include "io/scene/trajectory_file.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/datasets/dataset.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class Gangnam : public ::testing::Test {
 protected:
  fs::path Sensors(const std::string& part) const {
    return layout_.folder / "release" / part / "sensors";
  }
  ImportedScene Import(const ImportOptions& options = {}) const {
    return ImportDataset("gangnam", layout_.folder, options).at(0);
  }
  ::testing::AssertionResult Fails(const fs::path& file, const std::string& text,
                                   const std::vector<std::string>& parts) const {
    const std::string before = ReadFile(file);
    WriteFile(file, text);
    const auto result = FailsWithInputError([&] { Import(); }, parts);
    WriteFile(file, before);
    return result;
  }

  const std::string header_ = "# kapture format: 1.1\n";
  Layout layout_ = WriteGangnam(TestFolder(), RandomInput());
};

TEST_F(Gangnam, ThePoseOfADeviceGoesBeforeThatOfItsRig) {
  const fs::path file = Sensors("validation") / "trajectories.txt";
  WriteFile(file, ReadFile(file) + "1575366894000000, 40027089_00, 1, 0, 0, 0, 1, 2, 3\n");
  const ImportedScene scene = Import();
  ASSERT_EQ(scene.ground_truth.size(), 2u);
  EXPECT_EQ(scene.ground_truth[0].cam_from_world.translation, Eigen::Vector3d(1, 2, 3));
}

TEST_F(Gangnam, TimesAreSeconds) {
  const ImportedScene scene = Import();
  EXPECT_EQ(scene.times.size(), 8u);
  EXPECT_NEAR(scene.times.at(layout_.references[1].name), 1575366894.1, 1e-6);
  EXPECT_EQ(scene.thresholds, "gangnam");

  const fs::path records = Sensors("validation") / "records_camera.txt";
  for (const std::string zeros : {"", "000", "000000", "000000000"}) {
    WriteFile(records, header_ + "1575366894" + zeros + ", 40027089_00, a.jpg\n");
    EXPECT_NEAR(Import().times.at("a.jpg"), 1575366894, 1e-3) << zeros;
  }
}

TEST_F(Gangnam, ReferencesWithoutPoseOrCameraAreCounted) {
  const fs::path trajectories = Sensors("mapping") / "trajectories.txt";
  std::string text = ReadFile(trajectories);
  text.erase(text.rfind("1575366894500000"));  // the last
  // Only a rotation is known of the one before.
  const size_t before = text.rfind("1575366894400000");
  text.replace(before, text.size() - before, "1575366894400000, rig0, 1, 0, 0, 0, , , \n");
  WriteFile(trajectories, text);
  const fs::path records = Sensors("mapping") / "records_camera.txt";
  WriteFile(records, ReadFile(records) + "1575366894700000, phone, z/1.jpg\n");
  const fs::path sensors = Sensors("mapping") / "sensors.txt";
  WriteFile(sensors, ReadFile(sensors) + "phone, , camera, UNKNOWN_CAMERA, 64, 48\n");
  const ImportedScene scene = Import();
  EXPECT_EQ(scene.references.size(), 4u);
  EXPECT_THAT(scene.warnings,
              ElementsAre(HasSubstr("2 images are skipped: it has no pose"),
                          HasSubstr("1 image is skipped: the model of its camera is unknown "
                                    "(first: z/1.jpg)")));
}

// kapture_format.adoc: fields of a pose may be empty where it is not known; kapture's own samples
// list such sensors of a rig.
TEST_F(Gangnam, SensorsOfARigWithoutAPlaceHaveNoPose) {
  const fs::path rigs = Sensors("mapping") / "rigs.txt";
  const std::string text = ReadFile(rigs);
  const size_t second = text.find("rig0, 40027089_01");
  WriteFile(rigs, text.substr(0, second) + "rig0, 40027089_01, , , , , , , \n");
  const ImportedScene scene = Import();
  EXPECT_EQ(scene.references.size(), 3u);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("3 images are skipped: it has no pose")));
}

TEST_F(Gangnam, TheTestHasNoPublicPoses) {
  fs::rename(layout_.folder / "release/validation", layout_.folder / "release/test");
  fs::remove(Sensors("test") / "trajectories.txt");
  EXPECT_TRUE(FailsWithInputError([&] { Import(); },
                                  {"release/validation", "the split names that of the queries"}));
  ImportOptions options;
  options.split = "test";
  const ImportedScene scene = Import(options);
  EXPECT_EQ(scene.queries.size(), 2u);
  EXPECT_THAT(scene.ground_truth, IsEmpty());
  EXPECT_THAT(scene.notes, ElementsAre("poses of 0 of 2 queries are public"));
  // The folder below it is as good.
  EXPECT_EQ(ImportDataset("gangnam", layout_.folder / "release", options).size(), 1u);
}

TEST_F(Gangnam, WrongLinesAreNamed) {
  const fs::path sensors = Sensors("mapping") / "sensors.txt";
  const fs::path trajectories = Sensors("mapping") / "trajectories.txt";
  const fs::path records = Sensors("mapping") / "records_camera.txt";
  const fs::path rigs = Sensors("mapping") / "rigs.txt";
  EXPECT_TRUE(Fails(sensors, "id, name\n", {"sensors.txt", "kapture format"}));
  EXPECT_TRUE(Fails(sensors, header_ + "a, b\n", {"line 2: expected 3 fields, found 2"}));
  EXPECT_TRUE(Fails(sensors, header_ + "a, , camera, PINHOLE\n", {"line 2", "width"}));
  EXPECT_TRUE(
      Fails(sensors, header_ + "a, , camera, PINHOLE, 64, 48, 5\n", {"sensors.txt: line 2"}));
  EXPECT_TRUE(Fails(sensors, header_, {"records_camera.txt: line 3", "no camera \"40027089_00\""}));
  EXPECT_TRUE(
      Fails(trajectories, header_ + "1, a, 1, 0, 0, x, 1, 2, 3\n", {"line 2: pose", "\"x\""}));
  EXPECT_TRUE(Fails(trajectories, header_ + "1, a, 2, 0, 0, 0, 1, 2, 3\n", {"line 2", "length 1"}));
  EXPECT_TRUE(Fails(trajectories, header_ + "t, a, 1, 0, 0, 0, 1, 2, 3\n", {"line 2: timestamp"}));
  EXPECT_TRUE(Fails(rigs, header_ + "rig0, a, 1, 0, 0, x, 1, 2, 3\n", {"rigs.txt: line 2"}));
  EXPECT_TRUE(Fails(records, header_ + "1, a\n", {"records_camera.txt: line 2", "3 fields"}));
  EXPECT_TRUE(Fails(records, header_, {"no references are left"}));
}

TEST(WriteKapture, IsReadBack) {
  Rng rng = TestRng();
  const double pinhole[] = {500, 510, 320, 240}, radial[] = {700, 400, 300, -0.1};
  const Camera cameras[] = {{CameraModel::kPinhole, 640, 480, pinhole},
                            {CameraModel::kSimpleRadial, 800, 600, radial}};
  std::vector<PosedImage> images;
  for (const char* name : {"b/1.jpg", "a/1.jpg", "c 2.png"}) {
    images.push_back({name, cameras[images.size() % 2], RandomRigid3(rng, 10)});
  }
  const auto folder = TestFolder();
  WriteKapture(folder, images);
  const std::vector<KaptureImage> read = ReadKapture(folder);
  ASSERT_EQ(read.size(), images.size());
  const size_t by_name[] = {1, 0, 2};
  for (size_t i = 0; i < read.size(); ++i) {
    const PosedImage& written = images[by_name[i]];
    EXPECT_EQ(read[i].name, written.name);
    EXPECT_EQ(read[i].timestamp, by_name[i]);
    EXPECT_EQ(read[i].camera, written.camera);
    EXPECT_TRUE(IsNearPose(read[i].cam_from_world.value(), written.cam_from_world, 1e-9, 1e-9));
  }
}

TEST(WriteKapture, RefusesWhatKaptureCannotHold) {
  const auto folder = TestFolder();
  const double params[] = {640, 320};
  std::vector<PosedImage> images = {
      {"a.jpg", {CameraModel::kEquirectangular, 640, 320, params}, {}}};
  EXPECT_TRUE(FailsWithInputError([&] { WriteKapture(folder, images); },
                                  {"sensors.txt", "a.jpg", "EQUIRECTANGULAR"}));
  images = {{"a,b.jpg", {}, {}}};
  EXPECT_TRUE(FailsWithInputError([&] { WriteKapture(folder, images); }, {"a,b.jpg"}));
}

}  // namespace
}  // namespace raylift
