#include "localization/retrieval/retrieval.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "io/h5py.h"
#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace raylift {
namespace {

using Names = std::vector<std::string>;

// "name name ..." of each query's references.
std::string Join(const RetrievedLists& lists, const Names& references) {
  std::string text;
  for (const auto& list : lists) {
    for (const RetrievedReference& found : list) {
      text += references.at(static_cast<size_t>(found.reference_index)) + " ";
    }
    text += "\n";
  }
  return text;
}

Names NumberedNames(const std::string& pattern, int count) {
  Names names;
  for (int i = 0; i < count; ++i) names.push_back(fmt::format(fmt::runtime(pattern), i));
  return names;
}

class GlobalFeatures : public ::testing::Test {
 protected:
  RetrievedLists Retrieve(const Names& queries, const Names& references, int top_k,
                          int threads = 2) const {
    return RetrieveByGlobalFeatures(queries, references, {path_, {}}, top_k, threads, false);
  }

  std::filesystem::path path_ = TestFolder() / "global.h5";
};

// hloc's own way: all scores, negative ones out; equal ones by name.
TEST_F(GlobalFeatures, AreRankedAsNumpyDoes) {
  const std::string expected = RunH5py(path_, "w", R"(
rng = np.random.default_rng(1)
references = ['db/%04d.jpg' % i for i in range(1500)]
queries = ['query/%d/night.jpg' % i for i in range(30)]
r = rng.normal(size=(1500, 64))
r[700:800] = r[:100]
q = r[::50] + rng.normal(size=(30, 64))
names = references + queries
values = np.concatenate([r, q])
values = (values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float16)
for name, value in zip(names, values):
    f.create_group(name).create_dataset('global_descriptor', data=value)
values = values.astype(np.float64)
for q in values[1500:]:
    scores = values[:1500] @ q
    order = sorted(range(1500), key=lambda i: (-round(scores[i], 12), references[i]))
    print(''.join(references[i] + ' ' for i in order[:25] if scores[i] >= 0))
)");
  const Names queries = NumberedNames("query/{}/night.jpg", 30);
  const Names references = NumberedNames("db/{:04}.jpg", 1500);
  EXPECT_EQ(Join(Retrieve(queries, references, 25, 1), references), expected);
  EXPECT_EQ(Retrieve(queries, references, 25, 1), Retrieve(queries, references, 25, 4));
}

TEST_F(GlobalFeatures, LeaveOutTheQueryItselfAndNegativeScores) {
  RunH5py(path_, "w", R"(
for name, value in [('a', [1, 0]), ('b', [0.8, 0.6]), ('c', [-1, 0]), ('d', [0, 1])]:
    f.create_dataset(name + '/global_descriptor', data=np.array(value, np.float32))
)");
  const Names all = {"a", "b", "c", "d"};
  EXPECT_EQ(Join(Retrieve(all, all, 3), all), "b d \na d \nd \nb a c \n");
  EXPECT_EQ(Join(Retrieve(all, all, 1), all), "b \na \nd \nb \n");
}

TEST_F(GlobalFeatures, ErrorsNameFileAndDataSet) {
  RunH5py(path_, "w", R"(
for i in range(3):
    f.create_dataset('db/%d/global_descriptor' % i, data=np.ones(4, np.float32))
f.create_dataset('bad/global_descriptor', data=np.array([1, 1, np.inf, 1], np.float32))
)");
  const auto other = path_.parent_path() / "queries.h5";
  RunH5py(other, "w", "f.create_dataset('q/global_descriptor', data=np.ones(5, np.float32))");
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        Retrieve({"db/0"}, {"db/1", "db/7"}, 5);
      },
      {"global.h5: db/7/global_descriptor: is not in the file"}));
  EXPECT_TRUE(FailsWithInputError([&] { Retrieve({"q"}, {"db/1"}, 5); },
                                  {"global.h5: q/global_descriptor: is not in the file"}));
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        Retrieve({"db/0"}, {"db/1", "bad"}, 5);
      },
      {"global.h5: bad/global_descriptor: expected finite numbers, number 3 is inf"}));
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        RetrieveByGlobalFeatures(Names{"q"}, Names{"db/1"}, {path_, other}, 5, 1, false);
      },
      {"global.h5: db/1/global_descriptor: expected 5 numbers as in", "queries.h5, found 4"}));
}

// 90 degrees wide; the grid's 16 columns are at x / z = -15/16, -13/16, ... 15/16.
PosedImage ImageAt(const std::string& name, const Eigen::Vector3d& center,
                   const Eigen::Vector3d& target) {
  const std::array<double, 4> params = {32, 32, 32, 24};
  return {name, Camera(CameraModel::kPinhole, 64, 48, params), LookAt(center, target)};
}

// An image that looks along z.
PosedImage ImageAlongZ(const std::string& name, const Eigen::Vector3d& center) {
  return ImageAt(name, center, center + Eigen::Vector3d::UnitZ());
}

TriangleMesh Joined(const TriangleMesh& a, const TriangleMesh& b) {
  std::vector<Eigen::Vector3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles = a.triangles;
  const auto offset = static_cast<uint32_t>(a.vertices.size());
  for (uint32_t i = 0; i < offset; ++i) positions.push_back(a.VertexInWorld(i));
  for (uint32_t i = 0; i < b.vertices.size(); ++i) positions.push_back(b.VertexInWorld(i));
  for (const auto& t : b.triangles) {
    triangles.push_back({t[0] + offset, t[1] + offset, t[2] + offset});
  }
  return MeshOfShape(positions, triangles);
}

TEST(RetrieveByOverlap, IsTheShareOfRaysThatTheReferenceSees) {
  // A wall at z = 4 and, close before the eye of "hidden", a screen over its left half.
  const TriangleMesh wall = MakePlane({Eigen::Quaterniond::Identity(), {0, 0, 4}}, 20, 4);
  const TriangleMesh screen = MakePlane({Eigen::Quaterniond::Identity(), {1.9, 0, 0.05}}, 0.1, 1);
  const RayCaster mesh(std::make_shared<TriangleMesh>(Joined(wall, screen)));
  const std::vector<PosedImage> queries = {ImageAlongZ("query", {0, 0, 0})};
  const std::vector<PosedImage> references = {ImageAt("behind the wall", {0, 0, 8}, {0, 0, 4}),
                                              ImageAlongZ("hidden", {2, 0, 0}),
                                              ImageAt("looks away", {0, 0, 0}, {0, 0, -1}),
                                              ImageAlongZ("near", {-2, 0, 0}),
                                              ImageAlongZ("query", {0, 0, 0}),
                                              ImageAlongZ("same", {0, 0, 0})};
  // Columns see x = -3.75, -3.25, ...; "near" sees x in [-6, 2], "hidden" x in [2, 6].
  const std::vector<RetrievedReference> expected = {{5, 1.0}, {3, 12 / 16.0}, {1, 4 / 16.0}};
  EXPECT_EQ(RetrieveByOverlap(queries, references, mesh, 10, 1).at(0), expected);
  EXPECT_EQ(RetrieveByOverlap(queries, references, mesh, 2, 1).at(0),
            (std::vector<RetrievedReference>{expected[0], expected[1]}));
  EXPECT_TRUE(RetrieveByOverlap(queries, references, mesh, 0, 1).at(0).empty());
}

// That only the promising ones are looked at closely changes nothing.
TEST(RetrieveByOverlap, FindsTheBestOfAllWithFewRays) {
  Rng rng = TestRng();
  const TriangleMesh sphere = MakeSphere({0, 0, 0}, 1, 12, 24);
  const RayCaster mesh(
      std::make_shared<TriangleMesh>(Joined(sphere, MakeBox({0, 0, 0}, {6, 6, 6}))));
  std::vector<PosedImage> images;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d direction(rng.Normal(), rng.Normal(), rng.Normal());
    const Eigen::Vector3d target(rng.Normal(), rng.Normal(), rng.Normal());
    images.push_back(ImageAt(fmt::format("{:02}", i), 4 * direction.normalized(), target));
  }
  const auto all = RetrieveByOverlap(images, images, mesh, 60, 2);
  const auto best = RetrieveByOverlap(images, images, mesh, 5, 1);
  for (size_t i = 0; i < images.size(); ++i) {
    ASSERT_GE(all[i].size(), 5u);
    EXPECT_TRUE(std::equal(best[i].begin(), best[i].end(), all[i].begin()));
    EXPECT_EQ(best[i].size(), 5u);
  }
}

TEST(RetrieveByDistance, TakesTheNearestThatLookTheSameWay) {
  const std::vector<PosedImage> queries = {ImageAlongZ("q", {0, 0, 0})};
  const std::vector<PosedImage> references = {
      ImageAlongZ("far", {0, 3, 0}), ImageAlongZ("near", {0, -1, 0}),
      ImageAt("turned by 40 degrees", {0, 0, 0}, {std::tan(40 * M_PI / 180), 0, 1}),
      ImageAt("turned by 20 degrees", {2, 0, 0}, {2 + std::tan(20 * M_PI / 180), 0, 1})};
  const auto lists = RetrieveByDistance(queries, references, 30, 10, 1);
  ASSERT_EQ(lists.at(0).size(), 3u);
  EXPECT_EQ(lists[0][0], (RetrievedReference{1, -1}));
  EXPECT_EQ(lists[0][1].reference_index, 3);
  EXPECT_EQ(lists[0][2].reference_index, 0);
  EXPECT_EQ(RetrieveByDistance(queries, references, 50, 1, 1)[0][0].reference_index, 2);
}

TEST(RetrieveByFrustum, IsTheShareOfTheViewThatTheReferenceSees) {
  const std::vector<PosedImage> queries = {ImageAlongZ("q", {0, 0, 0})};
  const std::vector<PosedImage> references = {
      ImageAt("looks away", {0, 0, 0}, {0, 0, -1}),
      ImageAt("looks across", {0, 0, 0}, {1, 0, 1}),  // turned by 45 degrees: sees the right half
      ImageAlongZ("same", {0, 0, 0}), ImageAlongZ("too far away", {0, 0, -100})};
  const auto lists = RetrieveByFrustum(queries, references, {1, 10}, 10, 1);
  ASSERT_EQ(lists.at(0).size(), 2u);
  EXPECT_EQ(lists[0][0], (RetrievedReference{2, 1.0}));
  EXPECT_EQ(lists[0][1].reference_index, 1);
  // Some of the right half's corners are above and below what it sees.
  EXPECT_NEAR(lists[0][1].score, 0.5, 0.1);
}

TEST(RetrieveReferences, RanksEqualScoresByName) {
  const std::vector<Query> queries = {{"q", ImageAlongZ("q", {0, 0, 0}).camera}};
  std::vector<PosedImage> references;
  for (const char* name : {"c", "a", "d", "b"}) references.push_back(ImageAlongZ(name, {0, 0, 0}));
  const Retrieval retrieval = RetrieveReferences(
      queries, references,
      {.method = RetrievalMethod::kPose, .prior_poses = {{"q", references[0].cam_from_world}}});
  EXPECT_EQ(Join(retrieval.lists, {"c", "a", "d", "b"}), "a b c d \n");
}

TEST(RetrieveReferences, AQueryWithoutAPriorPoseHasNone) {
  const Camera camera = ImageAlongZ("", {0, 0, 0}).camera;
  const std::vector<Query> queries = {{"known", camera}, {"unknown", camera}};
  const std::vector<PosedImage> references = {ImageAlongZ("r", {0, 0, 0})};
  RetrievalOptions options{.method = RetrievalMethod::kPose,
                           .prior_poses = {{"known", references[0].cam_from_world}}};
  const Retrieval retrieval = RetrieveReferences(queries, references, options);
  EXPECT_EQ(Join(retrieval.lists, {"r"}), "r \n\n");
  EXPECT_THAT(retrieval.warnings,
              testing::ElementsAre("1 of 2 queries, e.g. unknown, have no prior pose: they have no "
                                   "references"));
  options.prior_poses.clear();
  EXPECT_TRUE(FailsWithInputError([&] { RetrieveReferences(queries, references, options); },
                                  {"all 2 queries, e.g. known, have no prior pose"}));
}

TEST(Covisibility, RanksBySharedPoints) {
  ColmapModel model;
  // Image i observes points i ... i + 5, one of them twice; image 9 observes none.
  for (uint32_t id = 0; id < 10; ++id) {
    ColmapImage image;
    image.name = fmt::format("{}", id);
    for (uint64_t point = id; point < id + 6 && id < 9; ++point) {
      image.points2d.push_back({{0, 0}, point});
      model.points3d[point];
    }
    image.points2d.push_back({{0, 0}, std::nullopt});
    if (id < 9) image.points2d.push_back({{1, 1}, uint64_t{id}});
    model.images[id] = image;
  }
  const Covisibility covisibility(model);
  const Names names = NumberedNames("{}", 10);
  const auto lists = covisibility.MostShared(names, names, 3, 2);
  EXPECT_EQ(lists[0], (std::vector<RetrievedReference>{{1, 5}, {2, 4}, {3, 3}}));
  EXPECT_EQ(lists[4], (std::vector<RetrievedReference>{{3, 5}, {5, 5}, {2, 4}}));
  EXPECT_TRUE(lists[9].empty());
  EXPECT_TRUE(covisibility.Knows("8"));
  EXPECT_FALSE(covisibility.Knows("9"));
  EXPECT_FALSE(covisibility.Knows("x"));
}

TEST(RetrievalMethods, HaveNames) { EXPECT_TRUE(NamesEveryValue<RetrievalMethod>()); }

}  // namespace
}  // namespace raylift
