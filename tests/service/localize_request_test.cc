#include "service/localize_request.h"

#include "service/problem.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr uint64_t kPixelLimit = 1000;

// A gray picture of 4 x 3 pixels.
std::string Picture() { return "P5 4 3 255\n" + std::string(12, '\x80'); }

LocalizeRequest ReadForm(const std::string& image, const std::string& query) {
  const std::string body = fmt::format(
      "--b\r\nContent-Disposition: form-data; name=image; filename=a.pgm\r\n\r\n{}\r\n"
      "--b\r\nContent-Disposition: form-data; name=query\r\n\r\n{}\r\n--b--\r\n",
      image, query);
  return ReadLocalizeRequest("multipart/form-data; boundary=b", body, {}, kPixelLimit);
}

Problem ProblemOf(const std::string& image, const std::string& query) {
  try {
    ReadForm(image, query);
  } catch (const Problem& problem) {
    return problem;
  } catch (const InputError& error) {
    return ProblemOfInput(error.what());
  }
  return {200, ""};
}

TEST(LocalizeRequest, AFormHoldsTheImageAndWhatIsKnownOfIt) {
  const LocalizeRequest request = ReadForm(
      Picture(), R"({"name": "b.jpg", "camera": "SIMPLE_PINHOLE 4 3 5 2 1.5 focal_sigma 0.1",)"
                 R"( "priors": ["b.jpg position 1 2 3 4", "b.jpg gravity 0 1 0 2"]})");
  EXPECT_EQ(request.query.name, "b.jpg");
  EXPECT_EQ(request.query.camera.ToString(), "SIMPLE_PINHOLE 4 3 5 2 1.5");
  EXPECT_EQ(request.query.priors.focal_sigma, 0.1);
  EXPECT_EQ(request.query.priors.position->position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(request.query.priors.gravity->sigma_deg, 2);
  EXPECT_EQ(std::get<Image>(request.evidence).data, std::vector<uint8_t>(12, 0x80));
}

TEST(LocalizeRequest, WithoutACameraTheFocalLengthIsNotKnown) {
  const LocalizeRequest request = ReadForm(Picture(), "{}");
  EXPECT_EQ(request.query.name, "a.pgm");
  EXPECT_EQ(request.query.camera.width_px(), 4);
  EXPECT_GT(request.query.priors.focal_range, 1);
}

TEST(LocalizeRequest, APictureIsMeasuredByItsHeaderBeforeItIsDecoded) {
  // The header of a PNG alone, which claims 60000 x 60000 pixels.
  const std::string png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xEA\x60\0\0\xEA\x60\x08\0\0\0\0", 29);
  EXPECT_EQ(ProblemOf(png, "{}").field(), "image");
  EXPECT_EQ(ProblemOf("P5 40 30 255\n" + std::string(1200, 'a'), "{}").status(), 413);
  EXPECT_EQ(ProblemOf("P5 4 3 255\n", "{}").status(), 400);
}

TEST(LocalizeRequest, WhatIsWrongIsNamedByItsField) {
  EXPECT_EQ(ProblemOf("text", "{}").field(), "image");
  EXPECT_EQ(ProblemOf(Picture(), R"({"camera": []})").field(), "query.camera");
  EXPECT_EQ(ProblemOf(Picture(), R"({"camera": "a\nb"})").field(), "query.camera");
  EXPECT_EQ(ProblemOf(Picture(), R"({"camera": ""})").field(), "query.camera");
  EXPECT_EQ(ProblemOf(Picture(), R"({"priors": [1]})").field(), "query.priors[0]");
  const std::string long_priors(70'000, '#');
  for (const char* priors :
       {"a.pgm position 1 2 3 4 crs=EPSG:4326", "* world_crs EPSG:4326", long_priors.c_str()}) {
    EXPECT_EQ(ProblemOf(Picture(), fmt::format(R"({{"priors": "{}"}})", priors)).field(),
              "query.priors");
  }
  EXPECT_EQ(ProblemOf(Picture(), R"({"image": ""})").field(), "query.image");
  EXPECT_EQ(ProblemOf(Picture(), "{").field(), "query");
}

TEST(LocalizeRequest, MatchesAreOfTheScenesReferences) {
  const PosedImage reference{.name = "r.jpg", .camera = {}, .cam_from_world = {}};
  const std::string body =
      R"({"camera": "SIMPLE_PINHOLE 4 3 5 2 1.5", "matches": [{"reference": "r.jpg",)"
      R"( "query_px": [[1, 2], [3, 1], [1, 2]], "reference_px": [[0, 0], [1, 1], [0.5, 1]]}]})";
  const LocalizeRequest request =
      ReadLocalizeRequest("application/json", body, {{"r.jpg", &reference}}, kPixelLimit);
  const auto& matches = std::get<QueryMatches>(request.evidence);
  ASSERT_EQ(matches.references.size(), 1u);
  ASSERT_EQ(matches.matches.size(), 3u);
  EXPECT_EQ(matches.matches[0].query_keypoint, matches.matches[2].query_keypoint);
  EXPECT_EQ(matches.matches[1].query_px, Eigen::Vector2d(3, 1));
}

}  // namespace
}  // namespace raylift
