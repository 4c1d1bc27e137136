// Faults of stored values, planted one at a time in exact depth of a room: each has its size, and
// right or otherwise wrong depth is none of them.

#include "diagnosis/stored_faults.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "lifting/depth_convention.h"
#include "lifting/room.h"
#include "support/matchers.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// --- What maps store.

constexpr int kMapWidth = 40;
constexpr int kMapHeight = 25;
constexpr size_t kMapPixels = kMapWidth * kMapHeight;

// A different depth at each pixel, from 2 up to 3.
DepthMap MapWithoutExtremes() {
  DepthMap map{kMapWidth, kMapHeight, {}};
  for (size_t i = 0; i < kMapPixels; ++i) map.z.push_back(2 + 1e-3F * static_cast<float>(i));
  return map;
}

DepthMap MapWith(float z, size_t count, DepthMap map = MapWithoutExtremes()) {
  // From the middle on, where the depths of MapWithoutExtremes are neither largest nor smallest.
  std::fill_n(map.z.begin() + kMapPixels / 2, count, z);
  return map;
}

const Camera& CameraOfMaps() {
  static const Camera camera = CenteredPinhole(kMapWidth, kMapHeight, 30);
  return camera;
}

// A map without pixels stands for a reference that has none.
StoredStatistics LookAt(const std::vector<DepthMap>& maps, double unit, DepthKind kind,
                        int threads = 1) {
  Rng none(0);
  const Room room(0, none);  // that is not asked
  std::vector<PosedImage> references;
  for (size_t i = 0; i < maps.size(); ++i) {
    references.push_back({std::to_string(i), CameraOfMaps(), {}});
  }
  const auto load = [&](const PosedImage& reference) -> std::shared_ptr<const DepthMap> {
    const DepthMap& map = maps[static_cast<size_t>(std::stoi(reference.name))];
    return map.z.empty() ? nullptr : std::make_shared<const DepthMap>(map);
  };
  return LookAtMaps({.source = *room.walls,
                     .references = references,
                     .matches = {},
                     .as_read = {.kind = kind},
                     .stored = StoredMaps{.load = load, .unit = unit}},
                    threads);
}

MATCHER_P3(IsExtreme, value, share, largest, "") {
  *result_listener << "which is " << arg.value << ", held by " << arg.share;
  return arg.value == value && std::abs(arg.share - share) < 1e-12 && arg.largest == largest;
}

TEST(LookAtMaps, ValuesThatManyPixelsHoldAreExtremes) {
  // Millimeters as 16 bits have them, of which float depth is no exact multiple; 300 of the pixels
  // have no depth.
  const DepthMap map = MapWith(65.535F, 9);
  DepthMap holes = map;
  std::fill_n(holes.z.begin() + 100, 300, 0.0F);
  for (const int threads : {1, 3}) {
    const StoredStatistics found = LookAt({map, holes}, 0.001, DepthKind::kZ, threads);
    EXPECT_THAT(found.extremes, ElementsAre(IsExtreme(65535, 18.0 / 1700, true)));
    EXPECT_NEAR(found.largest, 65535, 0.01);  // float
  }
  DepthMap both = map;
  std::fill_n(both.z.begin(), 50, 0.25F);
  EXPECT_THAT(LookAt({both, both}, 0.001, DepthKind::kZ).extremes,
              ElementsAre(IsExtreme(65535, 0.009, true), IsExtreme(250, 0.05, false)));
}

TEST(LookAtMaps, WhatOneMapHoldsOrExceedsIsNoExtremeOfAll) {
  const auto extremes = [](const std::vector<DepthMap>& maps) {
    return LookAt(maps, 1, DepthKind::kZ).extremes;
  };
  const DepthMap full = MapWith(5, 100);
  EXPECT_THAT(extremes({full, MapWithoutExtremes()}), IsEmpty());
  EXPECT_THAT(extremes({full, full, MapWith(5.001F, 1)}), IsEmpty());
  DepthMap one = MapWith(5, 1);
  std::fill_n(one.z.begin(), 400, 0.0F);
  std::fill_n(one.z.rbegin(), 400, 0.0F);
  EXPECT_THAT(extremes({one, one}), IsEmpty()) << "a pixel each is chance";
  const DepthMap none = MapWithoutExtremes();
  EXPECT_THAT(extremes({MapWith(5, 2), MapWith(5, 2), none, none, none}), IsEmpty());
  EXPECT_THAT(extremes({full}), ElementsAre(IsExtreme(5, 0.1, true)));
  EXPECT_THAT(extremes({full, MapWith(4, 1), full}), ElementsAre(IsExtreme(5, 200.0 / 3000, true)));
}

TEST(LookAtMaps, ValuesAreThoseOfTheFiles) {
  // Where all ray lengths are 5, z is not.
  DepthMap sphere{kMapWidth, kMapHeight, RayZOfPixels(CameraOfMaps())};
  for (float& z : sphere.z) z *= 5;
  const StoredStatistics ray = LookAt({sphere, sphere}, 0.5, DepthKind::kRay);
  EXPECT_THAT(ray.extremes, ElementsAre(IsExtreme(10, 1, true), IsExtreme(10, 1, false)));
  // The farthest has the smallest inverse depth.
  const DepthMap far = MapWith(8, 20);
  const StoredStatistics inverse = LookAt({far, far}, 0.125, DepthKind::kInverse);
  EXPECT_THAT(inverse.extremes, ElementsAre(IsExtreme(1, 0.02, false)));
  EXPECT_NEAR(inverse.largest, 0.5 / 0.125, 1e-6);
}

TEST(LookAtMaps, WhereNothingIsStoredThereAreNoExtremes) {
  const DepthMap holes{kMapWidth, kMapHeight, std::vector<float>(kMapPixels)};
  const StoredStatistics found = LookAt({holes, DepthMap{}}, 1, DepthKind::kZ);
  EXPECT_THAT(found.extremes, IsEmpty());
  EXPECT_EQ(found.largest, 0);
  Rng none(0);
  const Room room(0, none);
  EXPECT_THAT(LookAtMaps({.source = *room.walls, .references = {}, .matches = {}}, 1).extremes,
              IsEmpty());
  // Maps that have none do not count among those that hold a value.
  EXPECT_THAT(LookAt({MapWith(5, 100), DepthMap{}, holes}, 1, DepthKind::kZ).extremes,
              ElementsAre(IsExtreme(5, 0.1, true)));
}

// --- What matches tell of it.

constexpr double kWallZ = 6;  // where cameras are not turned, of most keypoints

// Cameras side by side, turned from the wall by this angle: a depth z' in place of z projects
// f * baseline * |1 / z - 1 / z'| beside the match.
Room WithParallelCameras(double turn_deg) {
  Rng none(0);
  Room room(0, none);
  const Eigen::Quaterniond turn = RotationFromVector({0, turn_deg * std::numbers::pi / 180, 0});
  for (const auto& [x, y] : std::vector<std::pair<double, double>>{
           {-1.5, -0.8}, {0, -0.9}, {1.4, -0.7}, {-1.3, 0.8}, {0.1, 0.9}, {1.5, 0.6}}) {
    room.references.push_back({std::to_string(room.references.size()),
                               CenteredPinhole(640, 480, 300),
                               {turn, turn * Eigen::Vector3d(-x, -y, 1)}});
  }
  return room;
}

// Maps that hold, where the true depth is z, what is read as z'.
using StoredZ = std::function<double(double z, int map)>;
double Right(double z, int /*map*/) { return z; }

class StoredRoom {
 public:
  struct Options {
    DepthKind kind = DepthKind::kZ;
    double unit = 1;
    double noise_px = 0;
    int matches_per_pair = 20;
    double turn_deg = 35;  // all depths from 2 to 7, and none of many keypoints
  };
  StoredRoom(StoredZ planted, const Options& options)
      : room_(WithParallelCameras(options.turn_deg)), planted_(std::move(planted)) {
    Rng rng = TestRng();
    convention.kind = options.kind;
    matches = room_.MatchAll(options.matches_per_pair, options.noise_px, rng);
    source_ = std::make_shared<const DistortedSource>(
        room_.walls, [this](const PosedImage& reference, const Eigen::Vector2d&, double z) {
          return planted_(z, std::stoi(reference.name));
        });
    input.emplace(DoctorInput{
        .source = *source_,
        .references = room_.references,
        .matches = matches,
        .as_read = convention,
        .map_size_px = PlaneSize{640, 480},
        .stored =
            StoredMaps{.load = [](const PosedImage&) { return nullptr; }, .unit = options.unit}});
  }
  explicit StoredRoom(StoredZ planted) : StoredRoom(std::move(planted), Options()) {}
  StoredRoom(const StoredRoom&) = delete;

  ConventionResiduals Data(const std::vector<double>& masked = {}) const {
    ConventionResiduals data(*input, matches);
    for (const double value : masked) data.MaskStored(value);
    data.Prepare({&convention, 1}, 1);
    return data;
  }
  double TrueZ(const ConventionResiduals::Keypoint& keypoint) const {
    const PosedImage& map = room_.references[static_cast<size_t>(keypoint.map)];
    return room_.walls->Lift(map, {&keypoint.pixel, 1})[0]->depth_z;
  }

  DataConvention convention;
  std::vector<ReferenceMatch> matches;
  std::optional<DoctorInput> input;

 private:
  const Room room_;
  StoredZ planted_;
  std::shared_ptr<const GeometrySource> source_;
};

bool IsFarBetterThanChance(const ConventionFit& fit, double /*baseline_error_px*/) {
  return fit.median_px < 0.25 * fit.median_chance_px && fit.upper_px < 0.4 * fit.upper_chance_px;
}
bool IsAnyFit(const ConventionFit& /*fit*/, double /*baseline_error_px*/) { return true; }

constexpr double kUsualPx = 0.5;
// Walls, rays and depth are float.
constexpr double kRoundingPx = 0.01;

std::map<Half, std::set<std::pair<int, int>>> PairsByHalf(const ConventionResiduals& data,
                                                          const std::vector<Half>& halves) {
  std::map<Half, std::set<std::pair<int, int>>> pairs;
  for (size_t i = 0; i < halves.size(); ++i) {
    pairs[halves[i]].insert(std::minmax(data.keypoints()[i].map, data.keypoints()[i].other));
  }
  return pairs;
}

TEST(SplitKeypoints, EachPairOfImagesIsInOneHalf) {
  const StoredRoom room(Right);
  const ConventionResiduals data = room.Data();
  const std::vector<Half> halves = SplitKeypoints(data);
  ASSERT_EQ(halves.size(), data.keypoints().size());
  const auto pairs = PairsByHalf(data, halves);
  // No place is matched twice: all keypoints are in one of the halves.
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs.count(Half::kNeither), 0u);
  const size_t fitting = pairs.at(Half::kFitting).size();
  const size_t held_out = pairs.at(Half::kHeldOut).size();
  EXPECT_EQ(fitting + held_out, 15u) << "a pair is in both";
  EXPECT_GE(std::min(fitting, held_out), 4u) << "hardly a half";
}

TEST(SplitKeypoints, APlaceOfBothHalvesStaysInOneByTurns) {
  StoredRoom room(Right);
  const ConventionResiduals apart = room.Data();
  const auto pairs = PairsByHalf(apart, SplitKeypoints(apart));
  // Of each match the keypoint in the first image moves to one of 8 places there.
  constexpr size_t kPlaces = 8;
  for (size_t i = 0; i < room.matches.size(); ++i) {
    room.matches[i].a_px = {40.0 * static_cast<double>(i % kPlaces) + 100, 200};
  }
  const ConventionResiduals data = room.Data();
  const std::vector<Half> halves = SplitKeypoints(data);
  std::map<std::tuple<int, double, double>, std::set<Half>> of_place;
  std::map<std::tuple<int, double, double>, std::set<bool>> pairs_of_place;
  for (size_t i = 0; i < halves.size(); ++i) {
    const auto& keypoint = data.keypoints()[i];
    const std::tuple place(keypoint.map, keypoint.pixel.x(), keypoint.pixel.y());
    const bool fits = pairs.at(Half::kFitting).contains(std::minmax(keypoint.map, keypoint.other));
    pairs_of_place[place].insert(fits);
    of_place[place].insert(halves[i]);
    if (halves[i] != Half::kNeither) {
      EXPECT_EQ(halves[i] == Half::kFitting, fits) << "a pair changed";
    }
  }
  std::map<Half, int> places;
  for (const auto& [place, found] : of_place) {
    const bool contested = pairs_of_place.at(place).size() == 2;
    EXPECT_EQ(found.contains(Half::kNeither), contested);
    EXPECT_EQ(found.size(), contested ? 2u : 1u) << "for both halves";
    if (contested) ++places[found.contains(Half::kFitting) ? Half::kFitting : Half::kHeldOut];
  }
  EXPECT_GE(places[Half::kFitting], 20);
  EXPECT_LE(std::abs(places[Half::kFitting] - places[Half::kHeldOut]), 1);
}

// The clamp that doctor finds where it masks the value.
std::optional<ClampFault> Clamp(const StoredRoom& room, const StoredExtreme& extreme) {
  const double as_read = extreme.value * room.input->stored->unit;
  return FindClamp(room.Data({as_read}), room.Data(), room.convention, extreme, kUsualPx);
}

TEST(FindClamp, ValuesThatAreCutOffHaveADepthBeyond) {
  // Wall at 6: a limit of 5 is exceeded 1.2 times, also of maps with a scale of their own.
  for (const double scale : {1.0, 1.25}) {
    const StoredRoom room([&](double z, int) { return scale * std::min(z, 5.0); },
                          {.unit = 0.001, .turn_deg = 0});
    const auto far = Clamp(room, {.value = 5000 * scale, .largest = true});
    ASSERT_TRUE(far.has_value());
    EXPECT_NEAR(far->depth_ratio, kWallZ / 5, 1e-4);
    EXPECT_TRUE(far->is_cut_off);
    EXPECT_EQ(far->extreme.value, 5000 * scale);
    const ConventionResiduals data = room.Data();
    EXPECT_EQ(far->num_keypoints,
              static_cast<size_t>(std::count_if(data.keypoints().begin(), data.keypoints().end(),
                                                [&](const auto& k) { return room.TrueZ(k) > 5; })));
  }
  const StoredRoom near_limit([](double z, int) { return std::max(z, 5.5); }, {.turn_deg = 0});
  const auto near = Clamp(near_limit, {.value = 5.5, .largest = false});
  ASSERT_TRUE(near.has_value());
  EXPECT_LT(near->depth_ratio, 1);
  EXPECT_TRUE(near->is_cut_off);
  // Inverse depth is smallest where it is cut off far away.
  const StoredRoom inverse([](double z, int) { return std::min(z, 5.0); },
                           {.kind = DepthKind::kInverse, .turn_deg = 0});
  const auto smallest = Clamp(inverse, {.value = 0.2, .largest = false});
  ASSERT_TRUE(smallest.has_value());
  EXPECT_NEAR(smallest->depth_ratio, kWallZ / 5, 1e-4);
  EXPECT_TRUE(smallest->is_cut_off);
}

TEST(FindClamp, AMarkBeyondAllDepthIsNotCutOff) {
  for (const DepthKind kind : {DepthKind::kZ, DepthKind::kInverse}) {
    const StoredRoom room([](double z, int) { return z > 5 ? 60.0 : z; },
                          {.kind = kind, .turn_deg = 0});
    const bool is_inverse = kind == DepthKind::kInverse;
    const auto mark = Clamp(room, {.value = is_inverse ? 1 / 60.0 : 60, .largest = !is_inverse});
    ASSERT_TRUE(mark.has_value());
    EXPECT_NEAR(mark->depth_ratio, kWallZ / 60, 1e-4);
    EXPECT_FALSE(mark->is_cut_off);
  }
  // Nearer than anything.
  const StoredRoom room([](double z, int) { return z > 5 ? 0.5 : z; }, {.turn_deg = 0});
  const auto mark = Clamp(room, {.value = 0.5, .largest = false});
  ASSERT_TRUE(mark.has_value());
  EXPECT_NEAR(mark->depth_ratio, kWallZ / 0.5, 1e-3);
  EXPECT_FALSE(mark->is_cut_off);
}

TEST(FindClamp, RightDepthAtAnExtremeIsNotAccused) {
  const StoredExtreme wall{.value = kWallZ, .largest = true};
  EXPECT_FALSE(Clamp(StoredRoom(Right, {.turn_deg = 0}), wall));
  // A centimeter off: 300 px * 2 * (1 / 6 - 1 / 6.01) are 0.2 px; and 2 are 20.
  const auto at_depth = [](double wall_z) -> StoredZ {
    return [wall_z](double z, int) { return z > 5.999 ? wall_z : z; };
  };
  EXPECT_FALSE(
      Clamp(StoredRoom(at_depth(6.01), {.turn_deg = 0}), {.value = 6.01, .largest = true}));
  EXPECT_TRUE(Clamp(StoredRoom(at_depth(8), {.turn_deg = 0}), {.value = 8, .largest = true}));
}

TEST(FindClamp, FewKeypointsTellNothing) {
  StoredRoom room([](double z, int) { return std::min(z, 5.0); }, {.turn_deg = 0});
  std::vector<ReferenceMatch> right, cut_off;
  const ConventionResiduals data = room.Data();
  for (const ReferenceMatch& match : room.matches) {
    const bool far = room.TrueZ({match.reference_a, match.reference_b, match.a_px, {}, 1}) > 5;
    (far ? cut_off : right).push_back(match);
  }
  for (const size_t count : {4, 5}) {
    room.matches = right;
    room.matches.insert(room.matches.end(), cut_off.begin(),
                        cut_off.begin() + static_cast<std::ptrdiff_t>(count));
    const auto clamp = Clamp(room, {.value = 5, .largest = true});
    ASSERT_EQ(clamp.has_value(), count == 5);
    if (clamp) {
      EXPECT_EQ(clamp->num_keypoints, 10u);
    }
  }
}

std::optional<WrapFault> Wrap(const StoredRoom& room, double largest,
                              IsGoodFit is_good = IsFarBetterThanChance) {
  return FindWrap(*room.input, room.Data(), room.convention, largest, kUsualPx, is_good);
}

TEST(FindWrap, FindsWhereValuesStartAgain) {
  // Of millimeters, of meters that were made from them, and of 1/256 units: up to twice.
  struct Case {
    double unit, z_modulus, modulus;
  };
  for (const auto& [unit, z_modulus, modulus] : {Case{0.001, 4.096, 4096}, Case{0.001, 2.048, 2048},
                                                 Case{1, 4.096, 4.096}, Case{1.0 / 256, 4, 1024}}) {
    const StoredRoom room([m = z_modulus](double z, int) { return std::fmod(z, m); },
                          {.unit = unit});
    const auto wrap = Wrap(room, 0.98 * modulus);
    ASSERT_TRUE(wrap.has_value()) << modulus;
    EXPECT_NEAR(wrap->modulus, modulus, 1e-9 * modulus);
    EXPECT_LT(wrap->fit.upper_px, kRoundingPx);
    const ConventionResiduals data = room.Data();
    ASSERT_EQ(wrap->errors_px.size(), data.keypoints().size());
    double wrapped = 0;
    for (size_t i = 0; i < wrap->errors_px.size(); ++i) {
      ASSERT_TRUE(wrap->errors_px[i].has_value());
      EXPECT_LT(*wrap->errors_px[i], kRoundingPx);
      wrapped += room.TrueZ(data.keypoints()[i]) > z_modulus;
    }
    EXPECT_NEAR(wrap->share, wrapped / static_cast<double>(data.keypoints().size()), 1e-9);
  }
}

TEST(FindWrap, RightOrOtherwiseWrongDepthIsNoWrap) {
  constexpr double kLargest = 4095;
  const auto wrap = [&](const StoredZ& planted, IsGoodFit is_good = IsAnyFit) {
    return Wrap(StoredRoom(planted, {.unit = 0.001}), kLargest, is_good);
  };
  const auto planted = [](double z, int) { return std::fmod(z, 4.096); };
  ASSERT_TRUE(wrap(planted));
  EXPECT_FALSE(wrap(Right));
  // Far depth that is too small, by another modulus or by a factor.
  EXPECT_FALSE(wrap([](double z, int) { return z > 5 ? z - 4.5 : z; }));
  EXPECT_FALSE(wrap([](double z, int) { return z > 5 ? 0.6 * z : z; }));
  // Multiples of any modulus mend some of such depth.
  Rng rng = TestRng();
  EXPECT_FALSE(wrap([&](double, int) { return rng.Uniform(0.1, 4.096); }));
  // Too few keypoints, of a hundred.
  EXPECT_FALSE(wrap([n = 0](double z, int) mutable { return ++n % 50 == 0 ? z - 4.096 : z; }));
  EXPECT_FALSE(wrap(planted, [](const ConventionFit&, double) { return false; }));
}

TEST(FindWrap, NeedsStoredDepthUpToTheModulus) {
  const StoredZ planted = [](double z, int) { return std::fmod(z, 4.096); };
  StoredRoom room(planted, {.unit = 0.001});
  for (const double largest : {3600.0, 4100.0}) EXPECT_FALSE(Wrap(room, largest)) << largest;
  for (const double largest : {3750.0, 4096.0}) EXPECT_TRUE(Wrap(room, largest)) << largest;
  EXPECT_FALSE(Wrap(StoredRoom(planted, {.kind = DepthKind::kInverse, .unit = 0.001}), 4095));
  room.input->stored.reset();
  EXPECT_FALSE(Wrap(room, 4095));
}

const std::vector<AffineForm> kAllForms = {{.inverse = true, .common = true},
                                           {.inverse = false, .common = true},
                                           {.inverse = true, .common = false},
                                           {.inverse = false, .common = false}};

std::optional<AffineFault> Affine(const StoredRoom& room,
                                  const std::vector<AffineForm>& forms = kAllForms) {
  return FindAffine(*room.input, room.Data(), room.convention, forms, kUsualPx,
                    IsFarBetterThanChance);
}

TEST(FindAffine, FindsTheLineOfDepthOrInverseDepth) {
  // 1 / z = (stored - 400) / 7000, of maps that are read as z or as its inverse, in 1/1000.
  for (const DepthKind kind : {DepthKind::kZ, DepthKind::kInverse}) {
    const StoredRoom room(
        [&](double z, int) {
          const double stored = 7 / z + 0.4;
          return kind == DepthKind::kZ ? stored : 1 / stored;
        },
        {.kind = kind, .unit = 0.001});
    const auto affine = Affine(room);
    ASSERT_TRUE(affine.has_value()) << ToString(kind);
    EXPECT_TRUE(affine->form.inverse && affine->form.common);
    EXPECT_NEAR(affine->factor, 1.0 / 7000, 1e-9);
    EXPECT_NEAR(affine->shift, -0.4 / 7, 1e-6);
    EXPECT_LT(affine->fit.upper_px, kRoundingPx);
  }
  const StoredRoom offset([](double z, int) { return 2 * z + 0.5; }, {.unit = 0.001});
  const auto affine = Affine(offset);
  ASSERT_TRUE(affine.has_value());
  EXPECT_TRUE(!affine->form.inverse && affine->form.common);
  EXPECT_NEAR(affine->factor, 0.0005, 1e-8);
  EXPECT_NEAR(affine->shift, -0.25, 1e-5);
}

TEST(FindAffine, IsRatedByMatchesThatItWasNotFittedTo) {
  const StoredRoom room([](double z, int) { return z + 0.5; });
  const auto affine = Affine(room);
  ASSERT_TRUE(affine.has_value());
  const ConventionResiduals data = room.Data();
  const std::vector<Half> halves = SplitKeypoints(data);
  ASSERT_EQ(affine->errors_px.size(), halves.size());
  for (size_t i = 0; i < halves.size(); ++i) {
    EXPECT_EQ(affine->errors_px[i].has_value(), halves[i] == Half::kHeldOut);
    EXPECT_LT(affine->errors_px[i].value_or(0), kRoundingPx);
  }
  EXPECT_EQ(affine->fit.count,
            static_cast<size_t>(std::count(halves.begin(), halves.end(), Half::kHeldOut)));
  // Were the lines fitted to all matches, they would fit these, too.
  StoredRoom overfit([](double z, int) { return z + 0.5; });
  const auto fits = PairsByHalf(data, halves).at(Half::kFitting);
  for (ReferenceMatch& match : overfit.matches) {
    if (!fits.contains(std::minmax(match.reference_a, match.reference_b))) continue;
    match.b_px = match.a_px;  // infinitely far
  }
  EXPECT_FALSE(Affine(overfit));
}

TEST(FindAffine, EachMapMayHaveALineOfItsOwn) {
  const StoredRoom room([](double z, int map) { return (2 + 0.5 * map) / z + 0.1 * (map + 1); });
  const auto affine = Affine(room);
  ASSERT_TRUE(affine.has_value());
  EXPECT_TRUE(affine->form.inverse);
  EXPECT_FALSE(affine->form.common);
  EXPECT_NEAR(affine->factor, 1 / 2.0, 1e-5) << "of the first map";
  EXPECT_NEAR(affine->shift, -0.1 / 2, 1e-5);
  EXPECT_LT(affine->fit.upper_px, kRoundingPx);
}

TEST(FindAffine, TakesTheFirstOfFormsThatAreAboutAsGoodElseTheBest) {
  const AffineForm common{.inverse = false, .common = true};
  const AffineForm own{.inverse = false, .common = false};
  const StoredRoom same([](double z, int) { return z + 0.5; }, {.noise_px = 0.5});
  EXPECT_TRUE(Affine(same, {common, own}).value().form.common);
  EXPECT_FALSE(Affine(same, {own, common}).value().form.common);
  // A common shift is good here, others are better.
  const StoredRoom different([](double z, int map) { return z + 0.5 + 0.05 * map; });
  EXPECT_TRUE(Affine(different, {common}));
  EXPECT_FALSE(Affine(different, {common, own}).value().form.common);
}

TEST(FindAffine, WhatIsNoLineOrHasFewMatchesIsNone) {
  Rng rng = TestRng();
  EXPECT_FALSE(Affine(StoredRoom([&](double, int) { return rng.Uniform(1, 9); })));
  EXPECT_FALSE(Affine(StoredRoom(Right), {{.inverse = true, .common = true}}));
  // Nearer where it stores more.
  EXPECT_FALSE(Affine(StoredRoom([](double z, int) { return 9 - z; }), {{.inverse = false}}));
  EXPECT_TRUE(Affine(StoredRoom(Right)));
  EXPECT_FALSE(Affine(StoredRoom(Right, {.matches_per_pair = 1})));
  EXPECT_FALSE(Affine(StoredRoom(Right), {}));
}

}  // namespace
}  // namespace raylift
