#include "raylift/lifting/depth_alignment.h"

#include <algorithm>
#include <cmath>

#include "lifting/alignment_text.h"
#include "lifting/room.h"
#include "support/enum_names.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

// A different number for each reference.
double NumberOf(const PosedImage& reference) { return std::stod(reference.name.substr(1)); }

double FactorOf(const PosedImage& reference) { return std::exp(0.07 * (NumberOf(reference) - 2)); }

double RelativeError(const GeometrySource& source, const Room& room, Rng& rng) {
  double worst = 0;
  for (const PosedImage& reference : room.references) {
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < 200; ++i) pixels.emplace_back(rng.Uniform(0, 640), rng.Uniform(0, 480));
    const auto truth = room.walls->Lift(reference, pixels);
    const auto points = source.Lift(reference, pixels);
    for (size_t i = 0; i < pixels.size(); ++i) {
      worst = std::max(worst, std::abs(points[i]->depth_z / truth[i]->depth_z - 1));
      const auto back =
          reference.camera.ImgFromCam(reference.cam_from_world * points[i]->point_in_world);
      EXPECT_LT((*back - pixels[i]).norm(), 1e-3) << "still on its pixel's ray";
    }
  }
  return worst;
}

struct Aligned {
  DepthAlignment alignment;
  AlignedSource source;
};

Aligned Align(const Room& room, DistortedSource::Distortion distortion,
              const std::vector<ReferenceMatch>& matches, AlignMode mode) {
  const auto source = std::make_shared<DistortedSource>(room.walls, std::move(distortion));
  DepthAlignment alignment = AlignDepth(*source, room.references, matches, mode, 1);
  const auto corrections = alignment.Corrections();
  return {std::move(alignment), AlignedSource(source, corrections)};
}

TEST(AlignDepth, FindsEachMapsFactor) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const auto distort = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return z * FactorOf(r);
  };
  for (const AlignMode mode : {AlignMode::kScale, AlignMode::kAffine, AlignMode::kGrid}) {
    const Aligned aligned = Align(room, distort, room.MatchAll(100, 0, rng), mode);
    EXPECT_LT(RelativeError(aligned.source, room, rng), 2e-3) << ToString(mode);
    EXPECT_GT(aligned.alignment.median_before_px, 3) << ToString(mode);
    EXPECT_LT(aligned.alignment.median_after_px, 0.1) << ToString(mode);
    for (const MapAlignment& map : aligned.alignment.maps) EXPECT_TRUE(map.own_correction);
  }
}

TEST(AlignDepth, FindsAUnitThatIsAThousandTimesOff) {
  Rng rng = TestRng();
  const Room room(4, rng);
  const auto in_millimeters = [](const PosedImage&, const Eigen::Vector2d&, double z) {
    return 1000 * z;
  };
  const Aligned aligned =
      Align(room, in_millimeters, room.MatchAll(100, 0, rng), AlignMode::kScale);
  EXPECT_NEAR(aligned.alignment.median_factor, 0.001, 1e-6);
  EXPECT_LT(RelativeError(aligned.source, room, rng), 1e-3);
}

TEST(AlignDepth, FindsFactorAndShift) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const auto distort = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return (z - 0.3) / FactorOf(r);
  };
  const Aligned aligned = Align(room, distort, room.MatchAll(100, 0, rng), AlignMode::kAffine);
  EXPECT_LT(RelativeError(aligned.source, room, rng), 3e-3);
  for (size_t i = 0; i < room.references.size(); ++i) {
    const DepthCorrection& correction = aligned.alignment.maps[i].correction;
    EXPECT_NEAR(correction.shift, 0.3, 0.02);
    EXPECT_NEAR(correction.log_factors[0], std::log(FactorOf(room.references[i])), 0.01);
  }
}

TEST(AlignDepth, FindsASlowDriftOverTheImageDespiteNoiseAndWrongMatches) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const auto distort = [](const PosedImage& r, const Eigen::Vector2d& px, double z) {
    return z * FactorOf(r) * std::exp(0.06 * std::sin(px.x() / 150) * std::cos(px.y() / 200));
  };
  std::vector<ReferenceMatch> matches = room.MatchAll(400, 0.5, rng);
  for (size_t i = 0; i < matches.size(); i += 4) {
    matches[i].b_px = {rng.Uniform(0, 640), rng.Uniform(0, 480)};
  }
  const Aligned scale = Align(room, distort, matches, AlignMode::kScale);
  const Aligned grid = Align(room, distort, matches, AlignMode::kGrid);
  EXPECT_GT(RelativeError(scale.source, room, rng), 0.04) << "one factor cannot";
  EXPECT_LT(RelativeError(grid.source, room, rng), 0.03);
  EXPECT_LT(grid.alignment.median_after_px, 0.5 * scale.alignment.median_after_px);
}

TEST(AlignDepth, ChoosesTheSimplestCorrectionThatHoldsForOtherMatches) {
  const auto exact = [](const PosedImage&, const Eigen::Vector2d&, double z) { return z; };
  const auto scaled = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return z * FactorOf(r);
  };
  const auto shifted = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return (z - 0.3) / FactorOf(r);
  };
  const auto drifting = [](const PosedImage& r, const Eigen::Vector2d& px, double z) {
    return z * FactorOf(r) * std::exp(0.06 * std::sin(px.x() / 150) * std::cos(px.y() / 200));
  };
  const std::vector<std::pair<DistortedSource::Distortion, AlignMode>> cases = {
      {exact, AlignMode::kOff},
      {scaled, AlignMode::kScale},
      {shifted, AlignMode::kAffine},
      {drifting, AlignMode::kGrid}};
  Rng rng = TestRng();
  for (int i = 0; i < 5; ++i) {
    const Room room(5, rng);
    for (const auto& [distort, mode] : cases) {
      std::vector<ReferenceMatch> matches = room.MatchAll(300, 0.5, rng);
      for (size_t m = 0; m < matches.size(); m += 4) {
        matches[m].b_px = {rng.Uniform(0, 640), rng.Uniform(0, 480)};
      }
      EXPECT_EQ(Align(room, distort, matches, AlignMode::kAuto).alignment.mode, mode);
    }
  }
}

TEST(AlignDepth, LeavesWhatHasTooFewMatchesToChooseBy) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const auto distort = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return z * FactorOf(r);
  };
  const Aligned aligned = Align(room, distort, room.MatchAll(1, 0, rng), AlignMode::kAuto);
  EXPECT_EQ(aligned.alignment.mode, AlignMode::kOff);
  for (const MapAlignment& map : aligned.alignment.maps) {
    EXPECT_FALSE(map.own_correction);
    EXPECT_EQ(map.correction.log_factors, std::vector<double>{0});
  }
}

TEST(AlignDepth, MapsWithFewMatchesTakeTheOthersFactor) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const auto distort = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return z * FactorOf(r);
  };
  std::vector<ReferenceMatch> matches = room.MatchAll(100, 0, rng);
  std::erase_if(matches,
                [](const ReferenceMatch& m) { return m.reference_a == 4 || m.reference_b == 4; });
  const Aligned aligned = Align(room, distort, matches, AlignMode::kScale);
  const MapAlignment& lonely = aligned.alignment.maps[4];
  EXPECT_EQ(lonely.num_matches, 0u);
  EXPECT_FALSE(lonely.own_correction);
  EXPECT_EQ(lonely.correction.log_factors[0], std::log(aligned.alignment.median_factor));
}

// Keypoints of map a, in the upper left of its image, matched where they would be in b if its depth
// were another by a factor: as of a facade with one like it.
std::vector<ReferenceMatch> MatchesOfALookAlike(const Room& room, int a, int b, double factor,
                                                const Eigen::Vector2d& extent_px, int count,
                                                Rng& rng) {
  std::vector<ReferenceMatch> matches;
  const PosedImage& map = room.references[static_cast<size_t>(a)];
  const PosedImage& other = room.references[static_cast<size_t>(b)];
  for (int tries = 0; tries < 1000 && static_cast<int>(matches.size()) < count; ++tries) {
    const Eigen::Vector2d pixel(rng.Uniform(0, extent_px.x()), rng.Uniform(0, extent_px.y()));
    const auto point = room.walls->Lift(map, {&pixel, 1})[0];
    const Eigen::Vector3d center = map.cam_from_world.OriginInSource();
    const auto seen = other.camera.ImgFromCam(other.cam_from_world *
                                              (center + factor * (point->point_in_world - center)));
    if (seen && other.camera.Contains(*seen)) matches.push_back({a, b, pixel, *seen});
  }
  return matches;
}

TEST(AlignDepth, RightDepthStaysWhereFewMatchesAreWrongTogether) {
  Rng rng = TestRng();
  const auto exact = [](const PosedImage&, const Eigen::Vector2d&, double z) { return z; };
  for (int i = 0; i < 3; ++i) {
    const Room room(5, rng);
    std::vector<ReferenceMatch> matches = room.MatchAll(60, 0.5, rng);
    std::erase_if(matches,
                  [](const ReferenceMatch& m) { return m.reference_a == 4 || m.reference_b == 4; });
    const auto wrong = MatchesOfALookAlike(room, 4, 3, 0.47, {320, 240}, 29, rng);
    matches.insert(matches.end(), wrong.begin(), wrong.end());
    EXPECT_EQ(Align(room, exact, matches, AlignMode::kAuto).alignment.mode, AlignMode::kOff);
    const Aligned scale = Align(room, exact, matches, AlignMode::kScale);
    EXPECT_NEAR(scale.alignment.maps[4].correction.log_factors[0], 0, 0.02);
  }
}

// Where most pairs show two places that look alike, what one pair says of the depth is another thing
// than what the next one says; of a fifth that is right, chance may once agree.
TEST(AlignDepth, RightDepthStaysWhereMostPairsAreOfPlacesThatLookAlike) {
  Rng rng = TestRng();
  const auto exact = [](const PosedImage&, const Eigen::Vector2d&, double z) { return z; };
  const auto is_left_alone = [&](double right_share) {
    const Room room(7, rng);
    std::vector<ReferenceMatch> matches;
    for (int a = 0; a < 7; ++a) {
      for (int b = 0; b < 7; ++b) {
        if (a == b) continue;
        const auto pair = rng.Uniform() < right_share
                              ? room.Match(a, b, 60, 0.5, rng)
                              : MatchesOfALookAlike(room, a, b, std::exp(rng.Uniform(-0.5, 0.5)),
                                                    {640, 480}, 60, rng);
        matches.insert(matches.end(), pair.begin(), pair.end());
      }
    }
    return Align(room, exact, matches, AlignMode::kAuto).alignment.mode == AlignMode::kOff;
  };
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(is_left_alone(0.4));
  int left_alone = 0;
  for (int i = 0; i < 4; ++i) left_alone += is_left_alone(0.2) ? 1 : 0;
  EXPECT_GE(left_alone, 3);
}

TEST(AlignDepth, NamesTheReferencesWhoseFactorsAreNotTold) {
  Rng rng = TestRng();
  const Room room(5, rng);
  const auto distort = [](const PosedImage& r, const Eigen::Vector2d&, double z) {
    return z * FactorOf(r);
  };
  std::vector<ReferenceMatch> matches = room.MatchAll(100, 0, rng);
  EXPECT_FALSE(WarnOfFactors(Align(room, distort, matches, AlignMode::kScale).alignment));
  std::erase_if(matches,
                [](const ReferenceMatch& m) { return m.reference_a == 4 || m.reference_b == 4; });
  const auto warning = WarnOfFactors(Align(room, distort, matches, AlignMode::kScale).alignment);
  ASSERT_TRUE(warning);
  EXPECT_NE(warning->find("1 of 5 references"), std::string::npos) << *warning;
  EXPECT_NE(warning->find("r4"), std::string::npos) << *warning;
}

TEST(AlignDepth, ThreadsDoNotChangeTheResult) {
  Rng rng = TestRng();
  const Room room(4, rng);
  const auto matches = room.MatchAll(50, 1, rng);
  const auto one = AlignDepth(*room.walls, room.references, matches, AlignMode::kGrid, 1);
  const auto three = AlignDepth(*room.walls, room.references, matches, AlignMode::kGrid, 3);
  for (size_t i = 0; i < one.maps.size(); ++i) {
    EXPECT_EQ(one.maps[i].correction.log_factors, three.maps[i].correction.log_factors);
  }
}

TEST(AlignedSource, DropsPointsThatWouldLieBehindTheCamera) {
  Rng rng = TestRng();
  const Room room(2, rng);
  const AlignedSource source(room.walls, {{"r0", {.shift = -100}}});
  const Eigen::Vector2d pixel(100, 100);
  EXPECT_FALSE(source.Lift(room.references[0], {&pixel, 1})[0]);
  EXPECT_EQ(source.Lift(room.references[1], {&pixel, 1})[0]->depth_z,
            room.walls->Lift(room.references[1], {&pixel, 1})[0]->depth_z)
      << "no correction for this reference";
}

TEST(GridWeights, AreBilinearFromCornerToCorner) {
  const double params[] = {500, 500, 320, 240};
  const Camera camera(CameraModel::kPinhole, 640, 480, params);
  const auto at = [&](double x, double y) {
    std::vector<double> weights(20, 0);
    for (const auto& [node, weight] : GridWeights(5, 4, camera, {x, y})) weights[node] += weight;
    return weights;
  };
  EXPECT_EQ(at(0, 0)[0], 1);
  EXPECT_EQ(at(640, 480)[19], 1);
  EXPECT_EQ(at(700, -9)[4], 1) << "the border continues outside";
  EXPECT_DOUBLE_EQ(at(40, 80)[0], 0.75 * 0.5);
  EXPECT_DOUBLE_EQ(at(40, 80)[1], 0.25 * 0.5);
  EXPECT_DOUBLE_EQ(at(40, 80)[5], 0.75 * 0.5);
  EXPECT_DOUBLE_EQ(at(40, 80)[6], 0.25 * 0.5);
}

TEST(TransitiveMatches, JoinReferencesThatAreMatchedWithOneQueryKeypoint) {
  const std::vector<Match2D2D> matches = {
      {2, {1, 1}, {20, 21}}, {0, {1, 1}, {10, 11}}, {1, {5, 5}, {30, 31}},
      {0, {1, 1}, {12, 13}}, {1, {1, 1}, {40, 41}},
  };
  const auto pairs = TransitiveMatches(matches);
  ASSERT_EQ(pairs.size(), 5u) << "two keypoints of one reference are no pair";
  EXPECT_EQ(pairs[0].reference_a, 0);
  EXPECT_EQ(pairs[0].reference_b, 1);
  EXPECT_EQ(pairs[0].a_px, Eigen::Vector2d(10, 11));
  EXPECT_EQ(pairs[0].b_px, Eigen::Vector2d(40, 41));
}

TEST(AlignMode, EachHasAName) { EXPECT_TRUE(NamesEveryValue<AlignMode>()); }

TEST(TransitiveMatches, FollowTheIndicesOfKeypointsNotTheirPixels) {
  std::vector<Match2D2D> matches = {
      {2, {1, 1}, {20, 21}}, {0, {1, 1}, {10, 11}}, {1, {5, 5}, {30, 31}}};
  const int keypoints[] = {3, 4, 3};
  for (size_t i = 0; i < 3; ++i) matches[i].query_keypoint = keypoints[i];
  const auto pairs = TransitiveMatches(matches);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].a_px, Eigen::Vector2d(30, 31));
  EXPECT_EQ(pairs[0].b_px, Eigen::Vector2d(20, 21));
}

}  // namespace
}  // namespace raylift
