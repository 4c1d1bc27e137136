#include "raylift/io/colmap_model.h"

#include <map>

#include "io/colmap_test_models.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

// The contents of all files of a model.
std::map<std::string, std::string> FilesOf(const std::filesystem::path& folder,
                                           const std::string& extension) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() == extension) {
      files[entry.path().filename().string()] = ReadFile(entry.path());
    }
  }
  return files;
}

// EXPECT_EQ would print megabytes.
void ExpectSameFiles(const std::filesystem::path& a, const std::filesystem::path& b,
                     const std::string& extension) {
  const auto files_a = FilesOf(a, extension);
  const auto files_b = FilesOf(b, extension);
  EXPECT_EQ(files_a.size(), files_b.size());
  for (const auto& [name, contents] : files_a) {
    ASSERT_TRUE(files_b.contains(name)) << name;
    EXPECT_TRUE(files_b.at(name) == contents) << name << " differs";
  }
}

void ExpectBytesSurvive(const std::filesystem::path& source, const std::filesystem::path& folder) {
  const ColmapModel model = ReadColmapModel(source, ColmapForm::kBinary);
  EXPECT_TRUE(model.warnings.empty());
  WriteColmapModel(folder / "binary", model, ColmapForm::kBinary);
  ExpectSameFiles(source, folder / "binary", ".bin");
  WriteColmapModel(folder / "text", model, ColmapForm::kText);
  WriteColmapModel(folder / "again", ReadColmapModel(folder / "text"), ColmapForm::kBinary);
  ExpectSameFiles(source, folder / "again", ".bin");
}

TEST(ColmapModel, SmallModelSurvivesBothForms) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  WriteColmapModel(folder / "source", SmallColmapModel(rng), ColmapForm::kBinary);
  ExpectBytesSurvive(folder / "source", folder);
}

// As COLMAP 4.1 writes them: ids 16 and 17 of src/colmap/sensor/models.h, whose parameters are
// fx fy cx cy alpha beta (models/eucm.h) and w h (models/spherical.h).
TEST(ColmapModel, CamerasOfColmap41AreRead) {
  std::string bytes;
  const auto add = [&bytes](auto value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  add(uint64_t{2});
  add(uint32_t{3});
  add(int32_t{16});
  add(uint64_t{640});
  add(uint64_t{480});
  for (const double param : {300., 305., 320., 240., 0.62, 1.13}) add(param);
  add(uint32_t{4});
  add(int32_t{17});
  add(uint64_t{4096});
  add(uint64_t{2048});
  for (const double param : {4096., 2048.}) add(param);
  const auto folder = TestFolder();
  WriteFile(folder / "cameras.bin", bytes);
  WriteFile(folder / "images.bin", std::string(8, '\0'));
  WriteFile(folder / "points3D.bin", std::string(8, '\0'));
  const ColmapModel model = ReadColmapModel(folder);
  ASSERT_EQ(model.cameras.size(), 2u);
  EXPECT_EQ(model.cameras.at(3).ToString(), "EUCM 640 480 300 305 320 240 0.62 1.13");
  EXPECT_EQ(model.cameras.at(4).ToString(), "EQUIRECTANGULAR 4096 2048 4096 2048");
  ExpectBytesSurvive(folder, folder / "out");
}

TEST(ColmapModel, RealBinaryModelIsWrittenBackBitForBit) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  ExpectBytesSurvive(*data / "model_full", TestFolder());
}

TEST(ColmapModel, RealReferenceModelIsWrittenBackBitForBit) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  ExpectBytesSurvive(*data / "model_ref", TestFolder());
}

// COLMAP writes 17 digits in its text form, so both forms of a model hold the same numbers.
TEST(ColmapModel, RealTextModelEqualsTheBinaryOne) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  const auto folder = TestFolder();
  ColmapModel text = ReadColmapModel(*data / "model_full", ColmapForm::kText);
  const ColmapModel binary = ReadColmapModel(*data / "model_full", ColmapForm::kBinary);
  text.camera_order = binary.camera_order;
  text.image_order = binary.image_order;
  text.point3d_order = binary.point3d_order;
  WriteColmapModel(folder, text, ColmapForm::kBinary);
  ExpectSameFiles(*data / "model_full", folder, ".bin");
}

TEST(ColmapModel, ColmapReadsWhatIsWritten) {
  if (!HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  Rng rng = TestRng();
  const auto folder = TestFolder();
  ColmapModel model = SmallColmapModel(rng);
  for (auto& [id, image] : model.images) {
    image.name = std::to_string(id) + ".jpg";  // COLMAP's text form ends a name at a blank
    image.pose.qvec_wxyz.normalize();          // COLMAP normalizes on reading
    image.pose.qvec_wxyz.normalize();
  }
  // COLMAP drops links of images to points that do not exist, and counts the other way round.
  for (const uint32_t id : {5u, 9u}) {
    for (auto& point : model.images[id].points2d) point.point3d_id.reset();
  }
  model.points3d.clear();
  for (uint32_t i = 0; i < 2; ++i) {
    model.images[5].points2d[i].point3d_id = i + 1;
    model.images[9].points2d[i].point3d_id = i + 1;
    model.points3d[i + 1] = {{rng.Normal(), 1, 2}, {1, 2, 3}, 0.25, {{5, i}, {9, i}}};
  }
  model.camera_order.clear();
  model.image_order.clear();
  model.point3d_order.clear();
  WriteColmapModel(folder / "expected", model, ColmapForm::kBinary);
  for (const auto& [form, type] :
       {std::pair(ColmapForm::kText, "BIN"), {ColmapForm::kBinary, "TXT"}}) {
    const auto ours = folder / "ours";
    const auto theirs = folder / type;
    std::filesystem::remove_all(ours);
    std::filesystem::create_directories(theirs);
    WriteColmapModel(ours, model, form);
    RunProgram("QT_QPA_PLATFORM=offscreen colmap model_converter --input_path " + ours.string() +
               " --output_path " + theirs.string() + " --output_type " + type);
    ColmapModel back = ReadColmapModel(theirs);
    back.camera_order.clear();
    back.image_order.clear();
    back.point3d_order.clear();
    for (const auto& [id, image] : model.images) {  // normalizing may change the last bit
      EXPECT_TRUE(back.images.at(id).pose.qvec_wxyz.isApprox(image.pose.qvec_wxyz, 1e-15));
      back.images.at(id).pose.qvec_wxyz = image.pose.qvec_wxyz;
    }
    WriteColmapModel(folder / "back", back, ColmapForm::kBinary);
    ExpectSameFiles(folder / "expected", folder / "back", ".bin");
  }
}

TEST(ColmapModel, TextImagesMayHaveNoPointsAndBlanksInNames) {
  const auto folder = TestFolder();
  WriteFile(folder / "cameras.txt", "# comment\r\n1 PINHOLE 4 3 5 6 2 1.5\r\n");
  WriteFile(folder / "images.txt",
            "# comment\n3 1 0 0 0 1 2 3 1 a b.jpg\n\n# between\n2 2 0 0 0 4 5 6 1 a.jpg\n"
            "0.5 1.5 -1 1 2 7\n8 1 0 0 0 0 0 0 1 last.jpg");
  const ColmapModel model = ReadColmapModel(folder);
  ASSERT_EQ(model.images.size(), 3u);
  EXPECT_THAT(model.image_order, testing::ElementsAre(3, 2, 8));
  EXPECT_EQ(model.images.at(3).name, "a b.jpg");
  EXPECT_TRUE(model.images.at(3).points2d.empty());
  const auto& points = model.images.at(2).points2d;
  ASSERT_EQ(points.size(), 2u);
  EXPECT_FALSE(points[0].point3d_id);
  EXPECT_EQ(points[1].point3d_id, 7u);
  EXPECT_EQ(points[1].pixel, Eigen::Vector2d(1, 2));
  EXPECT_TRUE(model.images.at(8).points2d.empty());
  EXPECT_TRUE(model.points3d.empty());
}

TEST(ColmapModel, PosedImagesAreSortedByNameAndNormalized) {
  Rng rng = TestRng();
  const ColmapModel model = SmallColmapModel(rng);
  const auto posed = model.PosedImages();
  ASSERT_EQ(posed.size(), 3u);
  EXPECT_EQ(posed[0].name, "query/img 1.jpg");
  EXPECT_EQ(posed[1].name, "query/img 5.jpg");
  EXPECT_EQ(posed[2].name, "query/img 9.jpg");
  EXPECT_EQ(posed[0].camera, model.cameras.at(2));
  EXPECT_NEAR(posed[0].cam_from_world.rotation.norm(), 1, 1e-15);
  EXPECT_EQ(posed[0].cam_from_world.translation, model.images.at(1).pose.tvec);
}

TEST(ColmapModel, BinaryWinsWhereBothFormsAre) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  EXPECT_FALSE(DetectColmapForm(folder));
  WriteColmapModel(folder, SmallColmapModel(rng), ColmapForm::kText);
  EXPECT_EQ(DetectColmapForm(folder), ColmapForm::kText);
  WriteColmapModel(folder, SmallColmapModel(rng), ColmapForm::kBinary);
  EXPECT_EQ(DetectColmapForm(folder), ColmapForm::kBinary);
}

TEST(ColmapModel, ChangedModelsAreWrittenWhateverTheOrderSays) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  ColmapModel model = SmallColmapModel(rng);
  model.images.erase(5);
  model.images[20] = model.images[1];
  model.images[20].name = "new.jpg";
  WriteColmapModel(folder, model, ColmapForm::kBinary);
  const ColmapModel back = ReadColmapModel(folder);
  EXPECT_EQ(back.images.size(), 3u);
  EXPECT_EQ(back.images.at(20).name, "new.jpg");
}

}  // namespace
}  // namespace raylift
