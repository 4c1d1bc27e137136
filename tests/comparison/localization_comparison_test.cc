#include "raylift/comparison/localization_comparison.h"

#include <algorithm>
#include <cmath>

#include "base/rng.h"
#include "comparison/compared_room.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using ::testing::HasSubstr;

// Every query is matched with all images, exactly.
class ExactMatches final : public MatchSource {
 public:
  ExactMatches(const ComparedRoom& room, std::vector<PosedImage> true_queries)
      : room_(room), queries_(std::move(true_queries)) {}

  QueryMatches Match(const Query& query) const override {
    QueryMatches matches;
    matches.references = room_.images;
    const PosedImage& true_query =
        *std::find_if(queries_.begin(), queries_.end(),
                      [&](const PosedImage& image) { return image.name == query.name; });
    Rng rng(StreamSeed(0, query.name, "matches"));
    for (int k = 0; k < 40; ++k) {
      const std::vector<Eigen::Vector2d> pixel = {{rng.Uniform(5, 187), rng.Uniform(5, 139)}};
      const auto points = room_.truth.Lift(true_query, pixel);
      if (!points[0]) continue;
      for (size_t r = 0; r < room_.images.size(); ++r) {
        const PosedImage& image = room_.images[r];
        const Eigen::Vector3d in_cam = image.cam_from_world * points[0]->point_in_world;
        const auto seen = image.camera.ImgFromCam(in_cam);
        if (!seen || !image.camera.Contains(*seen)) continue;
        const auto there = room_.truth.Lift(image, {&*seen, 1});
        if (!there[0] || std::abs(there[0]->depth_z - in_cam.z()) > 1e-3) continue;  // hidden
        matches.matches.push_back({static_cast<int>(r), pixel[0], *seen});
      }
    }
    return matches;
  }
  std::vector<std::string> Warnings() const override { return {}; }

 private:
  const ComparedRoom& room_;
  std::vector<PosedImage> queries_;
};

struct Setting {
  ComparedRoom room{4};
  std::vector<PosedImage> true_queries;
  std::vector<Query> queries;
  PosesByName truth;

  Setting() {
    for (int i = 0; i < 4; ++i) {
      const PosedImage query = {"q" + std::to_string(i), room.images[0].camera,
                                LookAt({0.2 * i, 0.1, -1.8}, {0, 0.1 * i, 1})};
      true_queries.push_back(query);
      queries.push_back({query.name, query.camera});
      truth.emplace(query.name, query.cam_from_world);
    }
  }
};

const LocalizationRow& RowOf(const LocalizationComparison& comparison, const std::string& method,
                             const std::string& source, const std::string& alignment = "off") {
  for (const LocalizationRow& row : comparison.rows) {
    if (row.method == method && row.source == source &&
        (row.alignment == alignment || source.empty())) {
      return row;
    }
  }
  throw std::logic_error("no row " + method + " " + source);
}

TEST(CompareLocalization, RatesEveryCombinationOnTheSameMatches) {
  const Setting setting;
  const auto matches = std::make_shared<ExactMatches>(setting.room, setting.true_queries);
  Scene scene;
  scene.references.images = setting.room.images;
  scene.AddGeometry(std::make_shared<const MeshSource>("mesh", setting.room.caster));
  scene.AddGeometry(setting.room.Scaled(1.15));
  scene.sources[1].name = "scaled";
  std::vector<ReferenceMatch> reference_matches;
  for (const Query& query : setting.queries) {
    const auto found = TransitiveMatches(matches->Match(query).matches);
    reference_matches.insert(reference_matches.end(), found.begin(), found.end());
  }
  LocalizationGrid grid;
  for (const Method method : {Method::kP3p, Method::kE5p1, Method::kAdaptive, Method::kSelect}) {
    grid.methods.push_back({.method = method,
                            .reprojection_threshold_px = 2,
                            .sampson_threshold_px = 0.5,
                            .max_iterations = 300});
  }
  grid.alignments = {AlignMode::kOff, AlignMode::kScale};
  grid.filters = {FilterMode::kOff, FilterMode::kAuto};
  grid.thresholds = {{0.02, 0.5}};
  const auto run = [&](int threads) {
    grid.threads = threads;
    return CompareLocalization(scene, setting.queries, matches, reference_matches, setting.truth,
                               grid);
  };
  const LocalizationComparison comparison = run(1);
  // E5+1 once; 2 sources x 2 alignments x 2 filters x 3 methods; an oracle for each P3P.
  EXPECT_EQ(comparison.rows.size(), 1u + 24 + 8);
  EXPECT_EQ(RowOf(comparison, "p3p", "mesh").summary.recalls_percent[0], 100);
  EXPECT_EQ(RowOf(comparison, "e5p1", "").summary.recalls_percent[0], 100);
  EXPECT_EQ(RowOf(comparison, "p3p", "scaled").summary.recalls_percent[0], 0);
  EXPECT_EQ(RowOf(comparison, "p3p", "scaled", "scale").summary.recalls_percent[0], 100);
  EXPECT_EQ(RowOf(comparison, "select:0.8", "scaled").summary.recalls_percent[0], 100);
  const LocalizationRow& oracle = RowOf(comparison, "oracle", "scaled");
  EXPECT_TRUE(oracle.is_oracle);
  EXPECT_EQ(oracle.summary.recalls_percent[0], 100);
  EXPECT_FALSE(RowOf(comparison, "p3p", "scaled").difference_to_best[0].Contains(0));
  const std::string text = FormatLocalizationText(comparison);
  EXPECT_THAT(text, HasSubstr("oracle *"));
  EXPECT_THAT(text, HasSubstr("worse"));
  EXPECT_EQ(FormatLocalizationJson(comparison), FormatLocalizationJson(run(4)));
}

TEST(MethodTitle, TellsWhatIsSpecialToTheMethod) {
  EXPECT_EQ(MethodTitle({.method = Method::kP3p}), "p3p");
  EXPECT_EQ(MethodTitle({.method = Method::kAdaptive, .score = ScoreCombination::kMultInliers}),
            "adaptive:mult_inl");
  EXPECT_EQ(MethodTitle({.method = Method::kSelect, .alpha = 0.7}), "select:0.7");
}

}  // namespace
}  // namespace raylift
