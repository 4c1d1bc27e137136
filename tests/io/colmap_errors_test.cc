// Broken COLMAP models: the message names file, record and field; nothing crashes.
#include <cstring>
#include <limits>

#include "io/colmap_test_models.h"
#include "support/test_data.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class ColmapErrors : public testing::Test {
 protected:
  ColmapErrors() : folder_(TestFolder()), rng_(TestRng()), model_(SmallColmapModel(rng_)) {}

  // Writes the model in both forms; reading must fail with all of `parts`.
  void ExpectModelFails(const std::vector<std::string>& text_parts,
                        const std::vector<std::string>& binary_parts) {
    WriteColmapModel(folder_ / "text", model_, ColmapForm::kText);
    EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_ / "text"); }, text_parts));
    WriteColmapModel(folder_ / "binary", model_, ColmapForm::kBinary);
    EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_ / "binary"); }, binary_parts));
  }

  // Writes the model in text form with one file replaced.
  void ExpectTextFails(const std::string& file, const std::string& contents,
                       const std::vector<std::string>& parts) {
    WriteColmapModel(folder_ / "text", model_, ColmapForm::kText);
    WriteFile(folder_ / "text" / file, contents);
    EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_ / "text"); }, parts));
  }

  // The same with a binary file whose bytes from `offset` on are those of `value`.
  template <typename T>
  void ExpectPatchedFails(const std::string& file, size_t offset, T value,
                          const std::vector<std::string>& parts) {
    WriteColmapModel(folder_, model_, ColmapForm::kBinary);
    std::string bytes = ReadFile(folder_ / file);
    ASSERT_LE(offset + sizeof(T), bytes.size());
    std::memcpy(bytes.data() + offset, &value, sizeof(T));
    WriteFile(folder_ / file, bytes);
    EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_); }, parts));
  }

  std::filesystem::path folder_;
  Rng rng_;
  ColmapModel model_;
};

TEST_F(ColmapErrors, MissingFilesAreListed) {
  EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_ / "none"); },
                                  {"none: no COLMAP model: expected cameras.bin and images.bin, or "
                                   "cameras.txt and images.txt"}));
  WriteFile(folder_ / "cameras.txt", "");
  EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_); }, {"no COLMAP model"}));
}

TEST_F(ColmapErrors, NotFiniteNumbers) {
  model_.images[5].pose.tvec.y() = kNan;
  ExpectModelFails({"images.txt: line 5", "tvec", "expected a finite number, found \"nan\""},
                   {"images.bin: image 1 of 3, tvec: expected a finite number, found nan"});
  model_.images[5].pose.tvec.y() = 0;
  model_.points3d[100].position_in_world.x() = std::numeric_limits<double>::infinity();
  ExpectModelFails({"points3D.txt: line 4", "xyz"},
                   {"points3D.bin: point 2 of 3, xyz: expected a finite number, found inf"});
  model_.points3d[100].position_in_world.x() = 0;
  ExpectPatchedFails("cameras.bin", 8 + 24, kNan, {"cameras.bin: camera 1 of 2, params"});
}

TEST_F(ColmapErrors, ZeroQuaternions) {
  model_.images[1].pose.qvec_wxyz.setZero();
  ExpectModelFails({"images.txt: line 7: qvec: expected a rotation"},
                   {"images.bin: image 2 of 3, qvec: expected a rotation"});
}

TEST_F(ColmapErrors, MissingCamerasAndDuplicateNames) {
  model_.images[5].camera_id = 99;
  ExpectModelFails({"images.txt: image 5 (\"query/img 5.jpg\"): refers to camera 99"},
                   {"images.bin: image 5 (\"query/img 5.jpg\"): refers to camera 99"});
  model_.images[5].camera_id = 7;
  model_.images[5].name = model_.images[1].name;
  ExpectModelFails({"images.txt: image 5", "image 1 has the same name"},
                   {"images.bin: image 5", "image 1 has the same name"});
}

TEST_F(ColmapErrors, DuplicateIds) {
  ExpectTextFails("cameras.txt", "2 PINHOLE 4 3 5 6 2 1\n2 PINHOLE 4 3 5 6 2 1\n",
                  {"cameras.txt: line 2: id: 2 is the id of an earlier camera"});
  ExpectPatchedFails("points3D.bin", 8 + 43 + 8 + 16, uint64_t{102},
                     {"points3D.bin: point 2 of 3, id: 102 is the id of an earlier point"});
}

TEST_F(ColmapErrors, CamerasThatDoNotExist) {
  ExpectTextFails("cameras.txt", "1 EQUIRECTANGULAR 200 100\n",
                  {"cameras.txt: line 1: camera model EQUIRECTANGULAR: expected 2 parameters"});
  ExpectTextFails("cameras.txt", "2 FOO 4 3 5 6 2 1\n",
                  {"cameras.txt: line 1: camera model: expected one of SIMPLE_PINHOLE, PINHOLE, ",
                   "found \"FOO\""});
  ExpectPatchedFails(
      "cameras.bin", 8 + 4, int32_t{99},
      {"cameras.bin: camera 1 of 2, model: expected the id of a camera model", "99"});
  ExpectPatchedFails("cameras.bin", 8 + 8, uint64_t{1} << 40,
                     {"cameras.bin: camera 1 of 2, width", "1099511627776"});
  ExpectTextFails("cameras.txt", "2 PINHOLE 4 3 5 6 2\n", {"cameras.txt: line 1: "});
  ExpectTextFails("cameras.txt", "2 PINHOLE 4 3 0 6 2 1\n", {"cameras.txt: line 1: "});
}

TEST_F(ColmapErrors, WrongTokens) {
  ExpectTextFails("images.txt", "5 1 0 0 0 x 2 3 7 a.jpg\n\n",
                  {"images.txt: line 1: tvec: expected a number, found \"x\""});
  ExpectTextFails("images.txt", "-5 1 0 0 0 1 2 3 7 a.jpg\n\n",
                  {"images.txt: line 1: id: expected a non-negative integer, found \"-5\""});
  ExpectTextFails("images.txt", "5 1 0 0 0 1 2\n",
                  {"images.txt: line 1: tvec", "the line ends here"});
  ExpectTextFails("images.txt", "5 1 0 0 0 1 2 3 7\n", {"images.txt: line 1: name", "ends here"});
  ExpectTextFails("images.txt", "5 1 0 0 0 1 2 3 7 a.jpg\n1 2\n",
                  {"images.txt: line 2: points2D: expected a value, the line ends here"});
  ExpectTextFails("images.txt", "5 1 0 0 0 1 2 3 7 a.jpg\n1 2 -2\n",
                  {"images.txt: line 2: points2D: expected the id of a point or -1, found \"-2\""});
  ExpectTextFails("images.txt", "5000000000 1 0 0 0 1 2 3 7 a.jpg\n\n",
                  {"images.txt: line 1: id: expected at most 4294967295"});
  ExpectTextFails("points3D.txt", "1 0 0 0 1 2 256 1\n", {"points3D.txt: line 1: rgb"});
  ExpectTextFails("points3D.txt", "1 0 0 0 1 2 3 1 4\n", {"points3D.txt: line 1: track"});
}

TEST_F(ColmapErrors, TruncatedAndTooLongBinaries) {
  WriteColmapModel(folder_, model_, ColmapForm::kBinary);
  const std::string bytes = ReadFile(folder_ / "images.bin");
  WriteFile(folder_ / "images.bin", bytes + "xy");
  EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_); },
                                  {"images.bin: expected the end after", "found 2 more"}));
  WriteFile(folder_ / "images.bin", bytes.substr(0, 8 + 4 + 32 + 8));
  EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_); },
                                  {"images.bin: image 1 of 3, tvec: the file ends here"}));
}

TEST_F(ColmapErrors, CountsBeyondTheFileAllocateNothing) {
  const size_t num_points_offset = 8 + 4 + 56 + 4 + model_.images[5].name.size() + 1;
  ExpectPatchedFails("images.bin", num_points_offset, ~uint64_t{0},
                     {"images.bin: image 1 of 3, points2D: the file ends here"});
  ExpectPatchedFails("images.bin", 0, ~uint64_t{0},
                     {"images.bin: image 4 of 18446744073709551615, id: the file ends here"});
  ExpectPatchedFails("points3D.bin", 8 + 43, uint64_t{1} << 61,
                     {"points3D.bin: point 1 of 3, track: the file ends here"});
}

TEST_F(ColmapErrors, TextNamesThatWouldNotReadBackAreRefused) {
  model_.images[5].name = "a\nb.jpg";
  EXPECT_TRUE(FailsWithInputError([&] { WriteColmapModel(folder_, model_, ColmapForm::kText); },
                                  {"images.txt: image 5", "the text form cannot hold"}));
}

// Reads a damaged model; only an InputError may come of it.
void ReadDamaged(const std::filesystem::path& folder) {
  try {
    ReadColmapModel(folder);
  } catch (const InputError&) {
  }
}

class ColmapFuzz : public ColmapErrors, public testing::WithParamInterface<const char*> {
 protected:
  ColmapFuzz() {
    model_.rigs[3] = {ColmapSensor{0, 7}, {{{0, 2}, ColmapPose{}}, {{1, 4}, {}}}};
    model_.frames[6] = {3, ColmapPose{}, {{{0, 7}, 5}, {{0, 2}, 1}}};
    WriteColmapModel(folder_, model_, ColmapForm::kBinary);
    file_ = folder_ / GetParam();
    bytes_ = ReadFile(file_);
  }
  std::filesystem::path file_;
  std::string bytes_;
};

TEST_P(ColmapFuzz, TruncatedAnywhereIsAnInputError) {
  for (size_t size = 0; size < bytes_.size(); ++size) {
    WriteFile(file_, bytes_.substr(0, size));
    EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder_); }, {GetParam()}))
        << "of " << bytes_.size() << " bytes the first " << size;
  }
}

TEST_P(ColmapFuzz, FlippedBytesNeverCrash) {
  for (int round = 0; round < 1000; ++round) {
    std::string damaged = bytes_;
    const uint32_t num_flips = 1 + rng_.UniformIndex(3);
    for (uint32_t i = 0; i < num_flips; ++i) {
      const uint32_t position = rng_.UniformIndex(static_cast<uint32_t>(damaged.size()));
      damaged[position] = static_cast<char>(rng_.UniformIndex(256));
    }
    WriteFile(file_, damaged);
    ReadDamaged(folder_);
  }
}

TEST_P(ColmapFuzz, FlippedTextNeverCrashes) {
  std::filesystem::remove_all(folder_);
  WriteColmapModel(folder_, model_, ColmapForm::kText);
  const auto file = (folder_ / GetParam()).replace_extension(".txt");
  const std::string text = ReadFile(file);
  constexpr std::string_view kCharacters = "0-+.e nX\n#\t\0\xff";
  for (int round = 0; round < 1000; ++round) {
    std::string damaged = text;
    const uint32_t position = rng_.UniformIndex(static_cast<uint32_t>(damaged.size()));
    damaged[position] = kCharacters[rng_.UniformIndex(kCharacters.size())];
    WriteFile(file, damaged);
    ReadDamaged(folder_);
  }
}

INSTANTIATE_TEST_SUITE_P(Files, ColmapFuzz,
                         testing::Values("cameras.bin", "images.bin", "points3D.bin", "rigs.bin",
                                         "frames.bin"),
                         [](const auto& file) {
                           const std::string name = file.param;
                           return name.substr(0, name.find('.'));
                         });

}  // namespace
}  // namespace raylift
