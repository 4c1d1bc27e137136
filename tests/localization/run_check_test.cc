#include <string>
#include <vector>

#include "localization/checks/run_checks.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

constexpr size_t kQueries = 5;

std::vector<Query> Queries() {
  std::vector<Query> queries;
  for (size_t i = 0; i < kQueries; ++i) queries.push_back({std::to_string(i), {}});
  return queries;
}

struct CheckedRun {
  std::vector<LocalizedQuery> localized;
  std::vector<double> log_focal_factors;
};

// A result of each query, of problems that `change` changes.
template <typename Change>
CheckedRun Checked(const Change& change, const EstimatorOptions& options = {}) {
  Rng rng = TestRng();
  CheckedRun run;
  const FocalCheck check(Queries(), options);
  for (size_t i = 0; i < kQueries; ++i) {
    CoherentProblem made = MakeCoherentProblem(std::to_string(i), {}, rng);
    change(made.problem);
    QueryResult result;
    result.problem = made.problem;
    result.localized.name = made.problem.name;
    result.localized.counts.matched = made.problem.matches_2d2d.size();
    result.localized.counts.points = made.problem.matches_2d3d.size();
    result.localized.TakeEstimate(MakePoseEstimator(options)->Estimate(made.problem));
    if (const auto factor = check.LogFactor(i, result)) run.log_focal_factors.push_back(*factor);
    run.localized.push_back(std::move(result.localized));
  }
  return run;
}

void ScaleFocal(PoseProblem& problem, double factor) {
  std::vector<double> params(problem.query_camera.params().begin(),
                             problem.query_camera.params().end());
  params[0] *= factor;
  params[1] *= factor;
  problem.query_camera = Camera(problem.query_camera.model(), problem.query_camera.width_px(),
                                problem.query_camera.height_px(), params);
}

TEST(RunCheck, SaysNothingOfGoodInput) {
  const CheckedRun run = Checked([](PoseProblem&) {});
  EXPECT_EQ(WarnOfGeometry(run.localized), std::nullopt);
  EXPECT_EQ(WarnOfFocalLength(run.log_focal_factors), std::nullopt);
}

TEST(RunCheck, NamesAWrongFocalLengthAndItsRepair) {
  for (const double factor : {1.1, 1.2, 1.3, 0.85}) {
    const CheckedRun run = Checked([factor](PoseProblem& problem) { ScaleFocal(problem, factor); });
    const auto warning = WarnOfFocalLength(run.log_focal_factors);
    ASSERT_TRUE(warning) << factor;
    EXPECT_THAT(*warning, ::testing::HasSubstr(factor > 1 ? "too long" : "too short"));
    EXPECT_THAT(*warning, ::testing::HasSubstr("refine_focal"));
    const CheckedRun refined = Checked(
        [factor](PoseProblem& problem) { ScaleFocal(problem, factor); }, {.refine_focal = true});
    EXPECT_TRUE(refined.log_focal_factors.empty());
  }
}

TEST(RunCheck, NoticesGeometryThatGivesNoPoints) {
  const CheckedRun run = Checked([](PoseProblem& problem) { problem.matches_2d3d.resize(5); });
  ASSERT_TRUE(WarnOfGeometry(run.localized));
  EXPECT_THAT(*WarnOfGeometry(run.localized), ::testing::HasSubstr("have a point in the geometry"));
}

TEST(RunCheck, NoticesGeometryThatIsElsewhere) {
  // Twice as large as the scene.
  const CheckedRun run = Checked([](PoseProblem& problem) {
    for (Match2D3D& match : problem.matches_2d3d) {
      const Eigen::Vector3d center =
          problem.references[static_cast<size_t>(*match.reference)].cam_from_world.OriginInSource();
      match.point_in_world = center + 2 * (match.point_in_world - center);
    }
  });
  ASSERT_TRUE(WarnOfGeometry(run.localized));
  EXPECT_THAT(*WarnOfGeometry(run.localized), ::testing::HasSubstr("points fit the poses"));
}

TEST(WarnOfAssumedLenses, SaysWhatIsAssumedOfHowManyPhotographs) {
  const auto camera = [](double center_x) {
    return Camera(CameraModel::kSimplePinhole, 640, 480, std::vector{500., center_x, 240.});
  };
  std::vector<Query> queries = {{.name = "calibrated.jpg", .camera = camera(320)},
                                {.name = "off.jpg", .camera = camera(321)}};
  queries[1].priors.focal_range = 2;
  EXPECT_FALSE(WarnOfAssumedLenses(queries));
  queries.push_back({.name = "unknown.jpg", .camera = camera(320)});
  queries[2].priors.focal_range = 2;
  EXPECT_THAT(WarnOfAssumedLenses(queries).value_or(""),
              ::testing::AllOf(::testing::HasSubstr("1 of 3 photographs"),
                               ::testing::HasSubstr("principal point"),
                               ::testing::HasSubstr("a factor of 2 are")));
  queries.push_back(queries[2]);
  queries[3].priors.focal_range = 1.5;
  EXPECT_THAT(WarnOfAssumedLenses(queries).value_or(""),
              ::testing::HasSubstr("a factor of 1.5 to 2 are"));
}

}  // namespace
}  // namespace raylift
