#include "raylift/io/pose_problem_json.h"

#include <algorithm>
#include <cmath>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

PoseProblemFile RandomProblem(Rng& rng) {
  PoseProblemFile file;
  PoseProblem& problem = file.problem;
  problem.name = "query/\"odd\" \xC3\xA9.jpg";
  problem.query_camera =
      Camera(CameraModel::kOpenCv, 640, 480,
             std::vector<double>{525.4, 526.4, 320.5, 238.4, 0.1, -0.2, 1e-5, 1e-300});
  file.gt_cam_from_world = RandomRigid3(rng, 1e7);
  for (int i = 0; i < 3; ++i) {
    problem.references.push_back(
        {"ref/" + std::to_string(i) + ".jpg",
         Camera(CameraModel::kSimplePinhole, 64, 48, std::vector<double>{50.0 / 3, 32, 24}),
         RandomRigid3(rng, 10)});
  }
  for (int i = 0; i < 20; ++i) {
    problem.matches_2d2d.push_back({i % 3,
                                    {rng.Uniform(0, 640), rng.Uniform(0, 480)},
                                    {rng.Uniform(0, 64), rng.Uniform(0, 48)}});
    problem.matches_2d3d.push_back({{rng.Uniform(0, 640), std::ldexp(rng.Normal(), -i * 20)},
                                    {rng.Normal() * 1e20, -0.0, static_cast<double>(i)},
                                    {},
                                    {}});
  }
  return file;
}

void ExpectSamePose(const Rigid3& a, const Rigid3& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
}

void ExpectSameProblem(const PoseProblemFile& a, const PoseProblemFile& b) {
  EXPECT_EQ(a.problem.name, b.problem.name);
  EXPECT_EQ(a.problem.query_camera, b.problem.query_camera);
  ASSERT_EQ(a.gt_cam_from_world.has_value(), b.gt_cam_from_world.has_value());
  if (a.gt_cam_from_world) {
    ExpectSamePose(*a.gt_cam_from_world, *b.gt_cam_from_world);
  }
  ASSERT_EQ(a.problem.references.size(), b.problem.references.size());
  for (size_t i = 0; i < a.problem.references.size(); ++i) {
    EXPECT_EQ(a.problem.references[i].name, b.problem.references[i].name);
    EXPECT_EQ(a.problem.references[i].camera, b.problem.references[i].camera);
    ExpectSamePose(a.problem.references[i].cam_from_world, b.problem.references[i].cam_from_world);
  }
  ASSERT_EQ(a.problem.matches_2d2d.size(), b.problem.matches_2d2d.size());
  for (size_t i = 0; i < a.problem.matches_2d2d.size(); ++i) {
    EXPECT_EQ(a.problem.matches_2d2d[i].reference, b.problem.matches_2d2d[i].reference);
    EXPECT_EQ(a.problem.matches_2d2d[i].query_px, b.problem.matches_2d2d[i].query_px);
    EXPECT_EQ(a.problem.matches_2d2d[i].reference_px, b.problem.matches_2d2d[i].reference_px);
    EXPECT_EQ(a.problem.matches_2d2d[i].reference_sigma_px,
              b.problem.matches_2d2d[i].reference_sigma_px);
  }
  ASSERT_EQ(a.problem.matches_2d3d.size(), b.problem.matches_2d3d.size());
  for (size_t i = 0; i < a.problem.matches_2d3d.size(); ++i) {
    const Match2D3D& x = a.problem.matches_2d3d[i];
    const Match2D3D& y = b.problem.matches_2d3d[i];
    EXPECT_EQ(x.query_px, y.query_px);
    EXPECT_EQ(x.point_in_world, y.point_in_world);
    EXPECT_EQ(std::signbit(x.point_in_world.y()), std::signbit(y.point_in_world.y()));
    EXPECT_EQ(x.reference, y.reference);
    EXPECT_EQ(x.point_sigma, y.point_sigma);
    EXPECT_EQ(x.log_depth_sigma, y.log_depth_sigma);
  }
}

TEST(PoseProblemJson, NumbersReadBackAsTheSameDoubles) {
  Rng rng = TestRng();
  const auto path = TestFolder() / "p.json";
  const PoseProblemFile file = RandomProblem(rng);
  WritePoseProblem(path, file);
  ExpectSameProblem(ReadPoseProblem(path), file);
  EXPECT_EQ(FormatPoseProblem(ReadPoseProblem(path)), ReadFile(path));
}

TEST(PoseProblemJson, ReferencesOf3DPointsAndSigmasAreKept) {
  Rng rng = TestRng();
  PoseProblemFile file = RandomProblem(rng);
  file.gt_cam_from_world.reset();
  file.problem.matches_2d3d[4].reference = 2;
  file.problem.matches_2d3d[5].point_sigma = 0.01;
  file.problem.matches_2d3d[6].log_depth_sigma = 0.02;
  file.problem.matches_2d2d[1].reference_sigma_px = 3.5;
  const std::string json = FormatPoseProblem(file);
  ExpectSameProblem(ParsePoseProblem(json, "p.json"), file);
}

TEST(PoseProblemJson, KeypointsAndWhereAPointWasLiftedFromAreKept) {
  Rng rng = TestRng();
  PoseProblemFile file = RandomProblem(rng);
  PoseProblem& problem = file.problem;
  for (size_t i = 0; i < 20; ++i) {
    problem.matches_2d2d[i].query_keypoint = static_cast<int>(i * i % 13);
    problem.matches_2d3d[i].query_keypoint = static_cast<int>(3 * i % 17);
  }
  problem.matches_2d3d.pop_back();
  problem.matches_2d2d[4].reference_keypoint = 40;
  problem.matches_2d3d[7].match_2d2d = 19;
  const std::string json = FormatPoseProblem(file);
  const PoseProblem read = ParsePoseProblem(json, "p.json").problem;
  ExpectSameProblem({read, file.gt_cam_from_world}, file);
  ASSERT_EQ(read.matches_2d3d.size(), 19u);
  for (size_t i = 0; i < 20; ++i) {
    const Match2D2D& match = problem.matches_2d2d[i];
    EXPECT_EQ(read.matches_2d2d[i].query_keypoint, match.query_keypoint);
    EXPECT_EQ(read.matches_2d2d[i].reference_keypoint, match.reference_keypoint);
  }
  for (size_t i = 0; i < 19; ++i) {
    EXPECT_EQ(read.matches_2d3d[i].query_keypoint, problem.matches_2d3d[i].query_keypoint);
    EXPECT_EQ(read.matches_2d3d[i].match_2d2d, problem.matches_2d3d[i].match_2d2d);
  }
  EXPECT_EQ(FormatPoseProblem({read, file.gt_cam_from_world}), json);
}

TEST(PoseProblemJson, RigsAreKept) {
  Rng rng = TestRng();
  PoseProblemFile file = RandomProblem(rng);
  PoseProblem& problem = file.problem;
  EXPECT_THAT(FormatPoseProblem(file), testing::HasSubstr("pose-problem/1"));
  for (int i = 0; i < 2; ++i) {
    problem.other_cameras.push_back(
        {"right/" + std::to_string(i) + ".jpg",
         Camera(CameraModel::kSimplePinhole, 64, 48, std::vector<double>{50.0 / 3, 32, 24}),
         RandomRigid3(rng, 1)});
  }
  for (size_t i = 0; i < 20; ++i) {
    problem.matches_2d2d[i].camera = static_cast<int>(i * i % 3);
    problem.matches_2d3d[i].camera = static_cast<int>(i % 2);
  }
  // Equal pixels of two cameras are two keypoints.
  problem.matches_2d2d[2].query_px = problem.matches_2d2d[3].query_px;
  const std::string json = FormatPoseProblem(file);
  EXPECT_THAT(json, testing::HasSubstr("pose-problem/2"));
  const PoseProblemFile read = ParsePoseProblem(json, "p.json");
  ExpectSameProblem(read, file);
  ASSERT_EQ(read.problem.other_cameras.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    const RigCamera& camera = read.problem.other_cameras[i];
    EXPECT_EQ(camera.name, problem.other_cameras[i].name);
    EXPECT_EQ(camera.camera, problem.other_cameras[i].camera);
    ExpectSamePose(camera.cam_from_query, problem.other_cameras[i].cam_from_query);
  }
  for (size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(read.problem.matches_2d2d[i].camera, problem.matches_2d2d[i].camera);
    EXPECT_EQ(read.problem.matches_2d3d[i].camera, problem.matches_2d3d[i].camera);
  }
  EXPECT_EQ(FormatPoseProblem(read), json);
  const KeypointNumbers numbers =
      NumberQueryKeypoints(read.problem.matches_2d2d, read.problem.matches_2d3d);
  EXPECT_EQ(numbers.count, 40u);
}

// The keypoints of all matches, those of 2D-2D matches first.
std::vector<int> KeypointsOf(const PoseProblem& problem) {
  std::vector<int> keypoints;
  for (const Match2D2D& match : problem.matches_2d2d) {
    keypoints.push_back(match.query_keypoint.value());
  }
  for (const Match2D3D& match : problem.matches_2d3d) {
    keypoints.push_back(match.query_keypoint.value());
  }
  return keypoints;
}

// A file with these query pixels of matches and points, and with this text after its members.
std::string FileOf(const std::vector<std::string>& pairs, const std::vector<std::string>& points,
                   const std::string& more) {
  std::string json = R"({"format": "pose-problem/1", "name": "q",
"query": {"camera": {"model": "PINHOLE", "width": 4, "height": 3, "params": [5, 5, 2, 1.5]}},
"references": [
{"name": "a", "camera": {"model": "PINHOLE", "width": 4, "height": 3, "params": [5, 5, 2, 1.5]},
"cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [0, 0, 7]}}],
"matches_2d2d": [)";
  for (size_t i = 0; i < pairs.size(); ++i) {
    json += (i > 0 ? ", [0, " : "[0, ") + pairs[i] + ", 3, 4]";
  }
  json += "],\n\"matches_2d3d\": [";
  for (size_t i = 0; i < points.size(); ++i) {
    json += (i > 0 ? ", [" : "[") + points[i] + ", 3, 4, 5]";
  }
  return json + "]" + more + "}";
}

TEST(PoseProblemJson, WithoutIndicesEqualPixelsAreOneKeypoint) {
  const auto read = [](const std::string& more) {
    return KeypointsOf(
        ParsePoseProblem(FileOf({"1, 2", "3, 4", "1, 2"}, {"3, 4", "5, 6"}, more), "p.json")
            .problem);
  };
  EXPECT_THAT(read(""), testing::ElementsAre(0, 1, 0, 1, 2));
  EXPECT_THAT(read(R"(, "extra": {"right": [true, true, false]})"),
              testing::ElementsAre(0, 1, 0, 1, 2));
  EXPECT_THAT(read(R"(, "extra": "of somebody else")"), testing::ElementsAre(0, 1, 0, 1, 2));
}

TEST(PoseProblemJson, ExtraKeypointIsOfAllMatchesThatItHasOneFor) {
  const auto read = [](const std::vector<std::string>& pairs,
                       const std::vector<std::string>& points, const std::string& keypoint) {
    return KeypointsOf(
        ParsePoseProblem(FileOf(pairs, points, R"(, "extra": {"keypoint": )" + keypoint + "}"),
                         "p.json")
            .problem);
  };
  // As tools write them that lift every match: one index for the pair and for its point.
  EXPECT_THAT(
      read({"1, 2", "1.0000000000000002, 2", "1, 2"}, {"1, 2", "7, 7", "1, 2"}, "[30, 30, 8]"),
      testing::ElementsAre(30, 30, 8, 30, 30, 8));
  // Fewer points have those of their pixels.
  EXPECT_THAT(read({"1, 2", "3, 4"}, {"3, 4"}, "[30, 8]"), testing::ElementsAre(30, 8, 8));
  EXPECT_THAT(read({}, {"1, 2", "3, 4"}, "[30, 8]"), testing::ElementsAre(30, 8));
  const auto fails = [&](const std::string& extra, const std::string& message) {
    return FailsWithInputError(
        [&] {
          ParsePoseProblem(FileOf({"1, 2", "3, 4"}, {"3, 4"}, R"(, "extra": {)" + extra + "}"),
                           "p.json");
        },
        {"p.json: extra." + message});
  };
  EXPECT_TRUE(fails(R"("keypoint": [1, 2, 3])", "keypoint: expected 2 elements, found 3"));
  EXPECT_TRUE(fails(R"("keypoint": 1)", "keypoint: expected an array, found 1"));
  EXPECT_TRUE(
      fails(R"("keypoint": [1, -1])", "keypoint[1]: expected the index of a keypoint, found -1"));
  EXPECT_TRUE(fails(R"("keypoint": [1, 2147483647])",
                    "keypoint[1]: expected the index of a keypoint, found 2147483647"));
  EXPECT_TRUE(fails(R"("keypoint": [1, null])", "keypoint[1]: expected an integer, found null"));
  EXPECT_TRUE(fails(R"("keypoint_2d3d": [1, 2])", "keypoint_2d3d: expected 1 elements, found 2"));
  EXPECT_TRUE(
      fails(R"("reference_keypoint": [1])", "reference_keypoint: expected 2 elements, found 1"));
  EXPECT_TRUE(fails(R"("match_2d2d": [2])",
                    "match_2d2d[0]: match index 2 is out of range, there are 2 2D-2D matches"));
}

TEST(PoseProblemJson, OptionalMembersAreLeftOutWhereTheyHoldNothing) {
  Rng rng = TestRng();
  PoseProblemFile file = RandomProblem(rng);
  file.gt_cam_from_world.reset();
  const std::string json = FormatPoseProblem(file);
  EXPECT_THAT(json, testing::Not(testing::HasSubstr("matches_2d3d_")));
  EXPECT_THAT(json, testing::Not(testing::HasSubstr("matches_2d2d_")));
  EXPECT_THAT(json, testing::Not(testing::HasSubstr("gt_cam_from_world")));
}

TEST(PoseProblemJson, EmptyProblemsSurvive) {
  PoseProblemFile file;
  ExpectSameProblem(ParsePoseProblem(FormatPoseProblem(file), "p.json"), file);
}

TEST(PoseProblemJson, PythonReadsTheSameNumbers) {
  if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not installed";
  Rng rng = TestRng();
  const auto folder = TestFolder();
  const PoseProblemFile file = RandomProblem(rng);
  WritePoseProblem(folder / "p.json", file);
  WriteFile(folder / "copy.py", R"(
import json, sys
def refuse(token): raise ValueError(token)
problem = json.load(open(sys.argv[1]), parse_constant=refuse)
json.dump(problem, open(sys.argv[2], 'w'))
)");
  RunProgram("/usr/bin/python3 " + (folder / "copy.py").string() + " " +
             (folder / "p.json").string() + " " + (folder / "q.json").string());
  ExpectSameProblem(ReadPoseProblem(folder / "q.json"), file);
}

TEST(PoseProblemJson, RealProblemsSurvive) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const auto paths = ListPoseProblems(*data / "problems" / "mesh");
  ASSERT_FALSE(paths.empty());
  EXPECT_TRUE(std::is_sorted(paths.begin(), paths.end()));
  for (const auto& path : paths) {
    const PoseProblemFile file = ReadPoseProblem(path);
    EXPECT_TRUE(file.gt_cam_from_world);
    EXPECT_FALSE(file.problem.matches_2d2d.empty());
    ExpectSameProblem(ParsePoseProblem(FormatPoseProblem(file), path), file);
  }
}

constexpr std::string_view kValid = R"({"format": "pose-problem/1", "name": "q",
"query": {"camera": {"model": "PINHOLE", "width": 4, "height": 3, "params": [5, 5, 2, 1.5]}},
"references": [
{"name": "a", "camera": {"model": "PINHOLE", "width": 4, "height": 3, "params": [5, 5, 2, 1.5]},
"cam_from_world": {"qvec": [1, 0, 0, 0], "tvec": [0, 0, 7]}}],
"matches_2d2d": [[0, 1, 2, 3, 4], [0, 9, 8, 7, 6]],
"matches_2d3d": [[1, 2, 3, 4, 5]],
"matches_2d3d_reference": [0], "matches_2d3d_sigma": [0.5],
"matches_2d2d_sigma_px": [null, 2],
"extra": {"keypoint": [3, 4], "keypoint_2d3d": [3], "reference_keypoint": [null, 0],
"match_2d2d": [0]}})";

TEST(PoseProblemJson, PriorsComeBack) {
  PoseProblemFile file = ParsePoseProblem(kValid, "p.json");
  EXPECT_TRUE(file.problem.priors.empty());
  EXPECT_NE(FormatPoseProblem(file).find("pose-problem/1"), std::string::npos);
  file.problem.priors = {
      .position = PositionPrior{{1, 2, 0.1}, {3, 4, 5}},
      .gravity = GravityPrior{{0.1, 1, 0}, {0, 0, -1}, 0.5},
      .heading = HeadingPrior{{0, 1, 0}, {1, 0.1, 0}, {0, 0, -1}, 12},
      .orientation = OrientationPrior{Eigen::Quaterniond(0.6, 0, 0.8, 0), 3},
      .range = RangePrior{12.1, 0.2, RangePrior::Plane{{1, 2, 3}, {0, 0.1, -1}, 0.7}},
      .focal_range = 1.5,
  };
  const std::string text = FormatPoseProblem(file);
  EXPECT_NE(text.find("pose-problem/2"), std::string::npos);
  const PosePriors read = ParsePoseProblem(text, "p.json").problem.priors;
  EXPECT_EQ(read.position->position, file.problem.priors.position->position);
  EXPECT_EQ(read.position->sigma, file.problem.priors.position->sigma);
  EXPECT_EQ(read.gravity->down_in_cam, file.problem.priors.gravity->down_in_cam);
  EXPECT_EQ(read.gravity->down_in_world, file.problem.priors.gravity->down_in_world);
  EXPECT_EQ(read.gravity->sigma_deg, 0.5);
  EXPECT_EQ(read.heading->right_in_cam, Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(read.heading->right_in_world, Eigen::Vector3d(1, 0.1, 0));
  EXPECT_EQ(read.heading->down_in_world, Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(read.heading->sigma_deg, 12);
  EXPECT_EQ(read.orientation->cam_from_world.coeffs(), Eigen::Vector4d(0, 0.8, 0, 0.6));
  EXPECT_EQ(read.orientation->sigma_deg, 3);
  EXPECT_EQ(read.range->range, 12.1);
  EXPECT_EQ(read.range->sigma, 0.2);
  EXPECT_EQ(read.range->plane->point, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(read.range->plane->normal, Eigen::Vector3d(0, 0.1, -1));
  EXPECT_EQ(read.range->plane->sigma, 0.7);
  EXPECT_EQ(read.focal_range, 1.5);
  file.problem.priors = {.focal_sigma = 0.03};
  EXPECT_EQ(ParsePoseProblem(FormatPoseProblem(file), "p.json").problem.priors.focal_sigma, 0.03);
  file.problem.reference_sigmas = {.factor = 0.08, .position = 0};
  const ReferenceSigmas sigmas =
      ParsePoseProblem(FormatPoseProblem(file), "p.json").problem.reference_sigmas;
  EXPECT_EQ(sigmas.factor, 0.08);
  EXPECT_FALSE(sigmas.rotation_deg);
  EXPECT_EQ(sigmas.position, 0);
  file.problem.search_area_px2 = 1234.5;
  EXPECT_EQ(ParsePoseProblem(FormatPoseProblem(file), "p.json").problem.search_area_px2, 1234.5);
  file.problem.priors = {.focal_range = 2};
  EXPECT_EQ(ParsePoseProblem(FormatPoseProblem(file), "p.json").problem.priors.focal_range, 2);
}

// The valid text with the first `from` replaced must fail with all of `parts`.
void ExpectFailure(const std::string& from, const std::string& to,
                   const std::vector<std::string>& parts) {
  std::string json(kValid);
  const size_t position = json.find(from);
  ASSERT_NE(position, std::string::npos) << from;
  json.replace(position, from.size(), to);
  EXPECT_TRUE(FailsWithInputError([&] { ParsePoseProblem(json, "p.json"); }, parts)) << to;
}

TEST(PoseProblemJson, WrongValuesAreNamedByTheirPath) {
  EXPECT_EQ(ParsePoseProblem(kValid, "p.json").problem.matches_2d3d[0].point_sigma, 0.5);
  ExpectFailure("pose-problem/1", "pose-problem/3",
                {"p.json: format: expected \"pose-problem/1\" or \"pose-problem/2\", found "
                 "\"pose-problem/3\""});
  ExpectFailure("\"name\": \"q\",", "", {"p.json: the member \"name\" is missing"});
  ExpectFailure("\"name\": \"a\",", "", {"p.json: references[0]: the member \"name\" is missing"});
  ExpectFailure("\"name\": \"q\"", "\"name\": 3", {"p.json: name: expected a string, found 3"});
  ExpectFailure("PINHOLE", "FOO", {"p.json: query.camera.model: unknown camera model \"FOO\""});
  ExpectFailure("\"width\": 4", "\"width\": 4.5",
                {"p.json: query.camera.width: expected an integer, found 4.5"});
  ExpectFailure("\"width\": 4", "\"width\": 4000000000", {"query.camera.width", "4000000000"});
  ExpectFailure("\"width\": 4", "\"width\": 0", {"p.json: query.camera: "});
  ExpectFailure(
      "\"query\": {",
      "\"query\": {\"position_prior\": {\"position\": [1, 2, 3], \"sigma\": [1, -1, 1]}, ",
      {"p.json: query.position_prior.sigma: expected standard deviations"});
  ExpectFailure("\"query\": {",
                "\"query\": {\"gravity_prior\": {\"sigma_deg\": 1, \"down_in_cam\": [0, 0, 0], "
                "\"down_in_world\": [0, 0, 1]}, ",
                {"p.json: query.gravity_prior.down_in_cam: expected a direction"});
  ExpectFailure("\"query\": {",
                "\"query\": {\"range_prior\": {\"range\": 0, \"sigma\": 1, \"point\": [0, 0, 0], "
                "\"normal\": [0, 0, 1], \"plane_sigma\": 0}, ",
                {"p.json: query.range_prior.range: expected a positive range"});
  ExpectFailure("\"query\": {", "\"query\": {\"other_cameras\": [{\"name\": \"b\"}], ",
                {"p.json: query.other_cameras[0]: the member \"camera\" is missing"});
  ExpectFailure("\"query\": {", "\"query\": {\"other_cameras\": 1, ",
                {"p.json: query.other_cameras: expected an array, found 1"});
  ExpectFailure("\"matches_2d3d\"", "\"matches_2d2d_camera\": [0, 1], \"matches_2d3d\"",
                {"matches_2d2d_camera[1]: camera index 1 is out of range, there are 1 cameras"});
  ExpectFailure("\"matches_2d3d\"", "\"matches_2d3d_camera\": [0, 0], \"matches_2d3d\"",
                {"matches_2d3d_camera: expected 1 elements, found 2"});
  ExpectFailure("[5, 5, 2, 1.5]", "[5, 5, 2]", {"p.json: query.camera: "});
  ExpectFailure("[5, 5, 2, 1.5]", "[5, 5, 2, \"x\"]",
                {"p.json: query.camera.params[3]: expected a number, found \"x\""});
  ExpectFailure("[1, 0, 0, 0]", "[1, 1, 0, 0]",
                {"references[0].cam_from_world.qvec: expected a quaternion of length 1, found one "
                 "of length 1.41421"});
  ExpectFailure("[0, 0, 7]", "[0, 0]",
                {"references[0].cam_from_world.tvec: expected 3 elements, found 2"});
  ExpectFailure("[0, 9,", "[7, 9,",
                {"matches_2d2d[1][0]: reference index 7 is out of range, there are 1 references"});
  ExpectFailure("[0, 9,", "[-1, 9,", {"matches_2d2d[1][0]: reference index -1 is out of range"});
  ExpectFailure("[0, 9, 8, 7, 6]", "[0, 9, 8, 7]", {"matches_2d2d[1]: expected 5 elements"});
  ExpectFailure("[0, 9, 8, 7, 6]", "{}", {"matches_2d2d[1]: expected an array, found an object"});
  ExpectFailure("[[1, 2, 3, 4, 5]]", "[[1, 2, 3, 4, null]]",
                {"matches_2d3d[0][4]: expected a number, found null"});
  ExpectFailure("_reference\": [0]", "_reference\": [3]",
                {"matches_2d3d_reference[0]: reference index 3 is out of range"});
  ExpectFailure("_reference\": [0]", "_reference\": []",
                {"matches_2d3d_reference: expected 1 elements, found 0"});
  ExpectFailure("_sigma\": [0.5]", "_sigma\": [-0.5]", {"matches_2d3d_sigma[0]", "-0.5"});
  ExpectFailure("[null, 2]", "[null, -2]", {"matches_2d2d_sigma_px[1]", "-2"});
  ExpectFailure("[null, 2]", "[2]", {"matches_2d2d_sigma_px: expected 2 elements, found 1"});
}

TEST(PoseProblemJson, TextThatIsNoJsonIsNamedByItsLine) {
  ExpectFailure("[0, 9, 8", "[0, NaN, 8", {"p.json: parse error at line 6", "invalid literal"});
  ExpectFailure("[0, 9, 8", "[0, -Infinity, 8", {"p.json: parse error at line 6"});
  ExpectFailure("[0, 9, 8", "[0, 1e999, 8", {"p.json: ", "1e999"});
  EXPECT_TRUE(FailsWithInputError([] { ParsePoseProblem("", "p.json"); }, {"p.json: parse error"}));
  EXPECT_TRUE(FailsWithInputError([] { ParsePoseProblem("[]", "p.json"); },
                                  {"p.json: expected an object, found an array"}));
  EXPECT_TRUE(FailsWithInputError([] { ParsePoseProblem(std::string(100000, '['), "p.json"); },
                                  {"p.json: parse error"}));
}

TEST(PoseProblemJson, TruncatedAnywhereIsAnInputError) {
  for (size_t size = 0; size < kValid.size(); ++size) {
    EXPECT_TRUE(FailsWithInputError([&] { ParsePoseProblem(kValid.substr(0, size), "p.json"); },
                                    {"p.json: parse error"}))
        << size;
  }
}

TEST(PoseProblemJson, FlippedBytesNeverCrash) {
  Rng rng = TestRng();
  for (int round = 0; round < 5000; ++round) {
    std::string json(kValid);
    const uint32_t position = rng.UniformIndex(static_cast<uint32_t>(json.size()));
    json[position] = static_cast<char>(rng.UniformIndex(256));
    try {
      ParsePoseProblem(json, "p.json");
    } catch (const InputError&) {
    }
  }
}

TEST(PoseProblemJson, NamesMustBeUtf8) {
  PoseProblemFile file;
  file.problem.name = "\xff.jpg";
  EXPECT_TRUE(FailsWithInputError([&] { WritePoseProblem(TestFolder() / "p.json", file); },
                                  {"p.json: the name", "is not UTF-8"}));
}

TEST(PoseProblemJson, FoldersListTheirJsonFilesInOrder) {
  const auto folder = TestFolder();
  EXPECT_TRUE(FailsWithInputError([&] { ListPoseProblems(folder); }, {"found none"}));
  EXPECT_TRUE(FailsWithInputError([&] { ListPoseProblems(folder / "x"); }, {"x: no such file"}));
  for (const char* name : {"b.json", "a.json", "c.txt", ".hidden.json"}) {
    WriteFile(folder / name, "");
  }
  EXPECT_THAT(ListPoseProblems(folder), testing::ElementsAre(folder / "a.json", folder / "b.json"));
  EXPECT_THAT(ListPoseProblems(folder / "c.txt"), testing::ElementsAre(folder / "c.txt"));
}

}  // namespace
}  // namespace raylift
