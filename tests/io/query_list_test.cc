#include "raylift/io/query_list.h"

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/file.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

TEST(QueryList, ReadsWhatItWritesAndSkipsComments) {
  const auto folder = TestFolder();
  WriteFile(folder / "a.txt",
            "# comment\n\nquery/b.jpg PINHOLE 640 480 525.4 526.4 320.5 238.4\r\n"
            "a.jpg SIMPLE_RADIAL 4 3 5.1 2 1.5 -0.01");
  const auto queries = ReadQueryList(folder / "a.txt");
  ASSERT_EQ(queries.size(), 2u);
  EXPECT_EQ(queries[0].name, "query/b.jpg");
  EXPECT_EQ(queries[0].camera, Camera(CameraModel::kPinhole, 640, 480,
                                      std::vector<double>{525.4, 526.4, 320.5, 238.4}));
  EXPECT_EQ(queries[1].camera.model(), CameraModel::kSimpleRadial);
  WriteQueryList(folder / "b.txt", queries);
  const auto again = ReadQueryList(folder / "b.txt");
  ASSERT_EQ(again.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(again[i].name, queries[i].name);
    EXPECT_EQ(again[i].camera, queries[i].camera);
  }
}

TEST(QueryList, ANameAloneIsAPhotographOfUnknownFocalLength) {
  const auto folder = TestFolder();
  WriteFile(folder / "queries.txt", "new/a.png\nb.png SIMPLE_PINHOLE 4 3 5 2 1.5\n");
  WriteImage(folder / "images/new/a.png", {30, 40, 1, std::vector<uint8_t>(1200, 90)});
  const auto queries = ReadQueryList(folder / "queries.txt", folder / "images");
  ASSERT_EQ(queries.size(), 2u);
  EXPECT_EQ(queries[0].name, "new/a.png");
  EXPECT_EQ(queries[0].camera,
            Camera(CameraModel::kSimplePinhole, 30, 40, std::vector<double>{48, 15, 20}));
  EXPECT_EQ(queries[0].priors.focal_range, 2);
  EXPECT_TRUE(queries[1].priors.empty());
  // Without the photographs nothing can be guessed.
  EXPECT_TRUE(FailsWithInputError([&] { ReadQueryList(folder / "queries.txt"); }, {"line 1"}));
  WriteFile(folder / "queries.txt", "no.png\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadQueryList(folder / "queries.txt", folder / "images"); },
                                  {"no.png"}));
}

TEST(QueryList, ExifTellsTheFocalLengthOfAPhotographOfUnknownCamera) {
  const auto folder = TestFolder();
  WriteImage(folder / "a.jpg", {40, 30, 1, std::vector<uint8_t>(1200, 90)});
  const std::string jpeg = ReadFile(folder / "a.jpg");
  // A directory with the place of the camera's, and that with 26 mm on film.
  const std::string exif(
      "\xFF\xE1\0\x34"
      "Exif\0\0"
      "II*\0\x08\0\0\0"
      "\x01\0\x69\x87\x04\0\x01\0\0\0\x1A\0\0\0\0\0\0\0"
      "\x01\0\x05\xA4\x03\0\x01\0\0\0\x1A\0\0\0\0\0\0\0",
      54);
  WriteFile(folder / "a.jpg", jpeg.substr(0, 2) + exif + jpeg.substr(2));
  WriteFile(folder / "queries.txt", "a.jpg\n");
  const auto queries = ReadQueryList(folder / "queries.txt", folder);
  EXPECT_NEAR(queries[0].camera.MeanFocalPx(), 26 / 43.267 * 50, 1e-9);
  EXPECT_EQ(queries[0].priors.focal_range, 1.2);
}

TEST(QueryList, ALensIsThatOfTheDronesCalibrationWhereNothingContradictsIt) {
  const LensTags lens{.film_mm = std::nullopt,
                      .calibration = {{4000, 4010, 20, -10, -0.1, 0.02, 0.001, 0.002, -0.01}},
                      .taken_width_px = 5280};
  // Of a photograph of half the size.
  const Query query = QueryOfUnknownCamera("a", {2640, 1978}, lens);
  EXPECT_EQ(query.camera, Camera(CameraModel::kFullOpenCv, 2640, 1978,
                                 std::vector<double>{2000, 2005, 1330, 984, -0.1, 0.02, 0.001,
                                                     0.002, -0.01, 0, 0, 0}));
  EXPECT_EQ(query.priors.focal_range, 1);
  EXPECT_GT(query.priors.focal_sigma, 0);
  LensTags other = lens;
  other.film_mm = 40;  // 24 mm would be right: another lens
  EXPECT_EQ(QueryOfUnknownCamera("a", {2640, 1978}, other).priors.focal_range, 1.2);
  other = lens;
  other.taken_width_px = 1e-306;
  EXPECT_EQ(QueryOfUnknownCamera("a", {2640, 1978}, other).priors.focal_range, 2);
  other = lens;
  other.calibration->at(2) = 3000;
  EXPECT_EQ(QueryOfUnknownCamera("a", {2640, 1978}, other).priors.focal_range, 2);
}

TEST(QueryList, ALineMayTellHowSureItsFocalLengthIs) {
  const auto folder = TestFolder();
  const std::string text =
      "a.jpg PINHOLE 4 3 5 5 2 1\nb.jpg PINHOLE 4 3 5 5 2 1 focal_sigma 0.03\n"
      "c.jpg PINHOLE 4 3 5 5 2 1 focal_sigma 0\n";
  WriteFile(folder / "a.txt", text);
  const auto queries = ReadQueryList(folder / "a.txt");
  ASSERT_EQ(queries.size(), 3u);
  EXPECT_FALSE(queries[0].priors.focal_sigma);
  EXPECT_EQ(queries[1].priors.focal_sigma, 0.03);
  EXPECT_EQ(queries[1].camera, queries[0].camera);
  EXPECT_EQ(queries[2].priors.focal_sigma, 0);
  WriteQueryList(folder / "b.txt", queries);
  EXPECT_EQ(ReadFile(folder / "b.txt"), text);
}

TEST(QueryList, NamesMayHoldBlanksAndStandInQuotes) {
  const auto folder = TestFolder();
  WriteImage(folder / "images/my photo.png", {4, 3, 1, std::vector<uint8_t>(12, 90)});
  WriteFile(folder / "a.txt",
            "\xEF\xBB\xBF"
            "a b.jpg PINHOLE 4 3 5 5 2 1\n\"PINHOLE FOV.jpg\" PINHOLE 4 3 5 5 2 1\n"
            "\"c.jpg\" PINHOLE 4 3 5 5 2 1 focal_sigma 0.1\nmy photo.png\n");
  const auto queries = ReadQueryList(folder / "a.txt", folder / "images");
  ASSERT_EQ(queries.size(), 4u);
  EXPECT_EQ(queries[0].name, "a b.jpg");
  EXPECT_EQ(queries[1].name, "PINHOLE FOV.jpg");
  EXPECT_EQ(queries[2].name, "c.jpg");
  EXPECT_EQ(queries[2].priors.focal_sigma, 0.1);
  EXPECT_EQ(queries[3].name, "my photo.png");
  EXPECT_EQ(queries[3].camera.width_px(), 4);
  WriteQueryList(folder / "b.txt", queries);
  EXPECT_EQ(ReadQueryList(folder / "b.txt")[3].name, "my photo.png");
  WriteFile(folder / "a.txt", "\"a.jpg PINHOLE 4 3 5 5 2 1\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadQueryList(folder / "a.txt"); },
                                  {"a.txt: line 1: name: expected it between quotes"}));
}

TEST(QueryList, AListOfNothingIsAnError) {
  const auto file = TestFolder() / "empty.txt";
  WriteFile(file, "# none yet\n\n");
  EXPECT_TRUE(
      FailsWithInputError([&] { ReadQueryList(file); }, {"empty.txt: lists no photograph"}));
}

TEST(QueryList, AFolderStandsForItsPhotographs) {
  const auto images = TestFolder() / "images";
  const Image image = {30, 40, 1, std::vector<uint8_t>(1200, 90)};
  for (const char* name : {"new/b.png", "new/deep/a.JPG", "old/c.png"}) {
    WriteFile(images / name, "");  // makes the folder
    WriteImage(images / "it.png", image);
    std::filesystem::rename(images / "it.png", images / name);
  }
  WriteFile(images / "new/notes.txt", "no photograph");
  const auto names = [](const std::vector<Query>& queries) {
    std::vector<std::string> all;
    for (const Query& query : queries) all.push_back(query.name);
    return all;
  };
  const auto queries = ReadQueryList(images / "new", images);
  EXPECT_THAT(names(queries), testing::ElementsAre("new/b.png", "new/deep/a.JPG"));
  EXPECT_EQ(queries[0].camera.width_px(), 30);
  EXPECT_EQ(queries[0].priors.focal_range, 2);
  EXPECT_THAT(names(ReadQueryList(images / "new")), testing::ElementsAre("b.png", "deep/a.JPG"));
  EXPECT_TRUE(FailsWithInputError([&] { ReadQueryList(images / "new", images / "old"); },
                                  {"new: expected a folder in", "old"}));
  std::filesystem::create_directory(images / "none");
  EXPECT_TRUE(
      FailsWithInputError([&] { ReadQueryList(images / "none"); }, {"none: holds no photograph"}));
}

TEST(QueryList, PatternsNameSeveralLists) {
  const auto folder = TestFolder() / "with [brackets]";
  WriteFile(folder / "night_queries.txt", "n.jpg PINHOLE 4 3 5 5 2 1\n");
  WriteFile(folder / "day_queries.txt", "d.jpg PINHOLE 4 3 5 5 2 1\n");
  WriteFile(folder / "other.txt", "not a list");
  const auto queries = ReadQueryList(folder / "*_queries.txt");
  ASSERT_EQ(queries.size(), 2u);
  EXPECT_EQ(queries[0].name, "d.jpg");
  EXPECT_EQ(queries[1].name, "n.jpg");
  EXPECT_EQ(ReadQueryList(folder / "da?_queries.txt").size(), 1u);
  EXPECT_TRUE(FailsWithInputError([&] { ReadQueryList(folder / "*_none.txt"); },
                                  {"*_none.txt: no file has such a name"}));
  WriteFile(folder / "night2_queries.txt", "\nd.jpg PINHOLE 4 3 5 5 2 1\n");
  EXPECT_TRUE(FailsWithInputError(
      [&] { ReadQueryList(folder / "*_queries.txt"); },
      {"night2_queries.txt: line 2: name: \"d.jpg\" stands twice", "day_queries.txt: line 1"}));
}

TEST(QueryList, WrongLinesAreNamed) {
  const auto path = TestFolder() / "q.txt";
  const auto expect_failure = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(path, text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadQueryList(path); }, parts)) << text;
  };
  expect_failure("a.jpg\n", {"q.txt: line 1: camera model", "the line ends here"});
  expect_failure("a.jpg FOO 4 3 5\n", {"q.txt: line 1: camera model", "found \"FOO\""});
  expect_failure("a.jpg PINHOLE 4 x 5 5 2 1\n", {"line 1: height: expected an integer"});
  expect_failure("a.jpg PINHOLE 4.5 3 5 5 2 1\n", {"line 1: width: expected an integer"});
  expect_failure(
      "a.jpg PINHOLE 4 3 5 5 2 1 focal_sigma 3\n",
      {"q.txt: line 1: focal_sigma: expected a share of the focal length from 0 to 0.3"});
  expect_failure("a.jpg PINHOLE 4 3 5 5 2 1 focal_sigma\n", {"line 1: focal_sigma"});
  expect_failure("a.jpg PINHOLE 4 3 5 5 2 1 focal_sigma 0 1\n", {"line 1: expected the end"});
  expect_failure("a.jpg PINHOLE 4 3 5 5 2 nan\n", {"line 1: params: expected a finite number"});
  expect_failure("# c\na.jpg PINHOLE 4 3 5 5 2\n", {"q.txt: line 2: "});
  expect_failure("a.jpg PINHOLE 4 3 5 5 2 1 0\n", {"q.txt: line 1: "});
  expect_failure("a.jpg PINHOLE -4 3 5 5 2 1\n", {"q.txt: line 1: "});
  expect_failure("a.jpg PINHOLE 4000000000 3 5 5 2 1\n", {"q.txt: line 1: width"});
}

TEST(QueryList, RealListsAreRead) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const auto queries = ReadQueryList(*data / "queries_with_intrinsics.txt");
  ASSERT_FALSE(queries.empty());
  EXPECT_EQ(queries[0].name, "query/frame-000700.jpg");
}

TEST(ImageList, OneNamePerLine) {
  const auto path = TestFolder() / "list.txt";
  WriteFile(path, "b.jpg\n\n# comment\n a/with blank.jpg \r\nlast.jpg");
  EXPECT_THAT(ReadImageList(path), testing::ElementsAre("b.jpg", "a/with blank.jpg", "last.jpg"));
}

TEST(PoseFile, NumbersReadBackAsTheSameDoubles) {
  Rng rng = TestRng();
  const auto path = TestFolder() / "poses.txt";
  std::vector<NamedPose> poses;
  for (int i = 0; i < 100; ++i) {
    poses.push_back({"query/" + std::to_string(i) + ".jpg", RandomRigid3(rng, 1e6)});
  }
  WritePoseFile(path, poses);
  const auto back = ReadPoseFile(path);
  ASSERT_EQ(back.size(), poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(back[i].name, poses[i].name);
    EXPECT_EQ(back[i].cam_from_world.rotation.coeffs(), poses[i].cam_from_world.rotation.coeffs());
    EXPECT_EQ(back[i].cam_from_world.translation, poses[i].cam_from_world.translation);
  }
}

TEST(PoseFile, RoundedQuaternionsAreNormalized) {
  const auto path = TestFolder() / "poses.txt";
  WriteFile(path, "a.jpg 0.7071 0 0.7071 0 1 2 3\n");
  const auto poses = ReadPoseFile(path);
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_NEAR(poses[0].cam_from_world.rotation.norm(), 1, 1e-15);
  EXPECT_EQ(poses[0].cam_from_world.translation, Eigen::Vector3d(1, 2, 3));
}

// pgt/sfm of github.com/tsattler/visloc_pseudo_gt_limitations (focal length), dsacstar's test.py
// (errors in degrees and meters), ace's test_ace.py (and the inliers).
TEST(PoseFile, FurtherColumnsArePassedOver) {
  const auto path = TestFolder() / "poses.txt";
  const std::string pose = " 0.806216 0.0204293 -0.55204 -0.211778 0.274901 0.044219 -0.258735";
  WriteFile(path, "seq-01/frame-000768.color.png" + pose + " 527.745\nb.png" + pose +
                      " 0.173 0.0061\nc.png" + pose + " 0.173 inf 2345\n");
  const auto poses = ReadPoseFile(path);
  ASSERT_EQ(poses.size(), 3u);
  EXPECT_EQ(poses[0].name, "seq-01/frame-000768.color.png");
  for (const NamedPose& read : poses) {
    EXPECT_EQ(read.cam_from_world.translation, Eigen::Vector3d(0.274901, 0.044219, -0.258735));
  }
}

TEST(PoseFile, WrongLinesAreNamed) {
  const auto path = TestFolder() / "p.txt";
  const auto expect_failure = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(path, text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadPoseFile(path); }, parts)) << text;
  };
  expect_failure("a 1 0 0 0 1 2\n", {"p.txt: line 1: tvec", "the line ends here"});
  expect_failure("a 1 0 0 0 1 2 3 4 b\n",
                 {"line 1: expected numbers behind the pose, found \"b\""});
  expect_failure("a 1 0 0 0 1 2 3\nb 1 0 0 0 nan 2 3\n", {"line 2: tvec", "finite", "nan"});
  expect_failure("a 1 0 0 zero 1 2 3\n", {"line 1: qvec: expected a number, found \"zero\""});
  expect_failure("a 0.5 0 0 0 1 2 3\n", {"line 1: qvec: expected a quaternion of length 1", "0.5"});
  expect_failure("a 0 0 0 0 1 2 3\n", {"line 1: qvec: expected a quaternion of length 1"});
}

TEST(PoseFile, NamesWithBlanksStandInQuotes) {
  const auto path = TestFolder() / "p.txt";
  WritePoseFile(path, {{"a b.jpg", Rigid3()}, {"#c.jpg", Rigid3()}, {"d.jpg", Rigid3()}});
  EXPECT_EQ(ReadFile(path),
            "\"a b.jpg\" 1 0 0 0 0 0 0\n\"#c.jpg\" 1 0 0 0 0 0 0\nd.jpg 1 0 0 0 0 0 0\n");
  const auto poses = ReadPoseFile(path);
  ASSERT_EQ(poses.size(), 3u);
  EXPECT_EQ(poses[0].name, "a b.jpg");
  EXPECT_EQ(poses[1].name, "#c.jpg");
}

TEST(PoseFile, NamesThatWouldNotReadBackAreRefused) {
  const auto path = TestFolder() / "p.txt";
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        WritePoseFile(path, {{"a\"b.jpg", Rigid3()}});
      },
      {"p.txt: the file cannot hold the name \"a\"b.jpg\""}));
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace raylift
