// A mesh that is seen where it belongs and read elsewhere: its place is found again, and places are
// rated as closed forms say.

#include "diagnosis/mesh_frame.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/stored_faults.h"
#include "lifting/mesh_placement.h"
#include "lifting/mesh_spec.h"
#include "lifting/room.h"
#include "support/matchers.h"
#include <Eigen/LU>
#include <gtest/gtest.h>

namespace raylift {
namespace {

// Exact matches on a mesh, which is read elsewhere: what is right is `world_from_read`.
class MisplacedMesh {
 public:
  struct Options {
    int matches_per_pair = 20;
    MeshPlacement as_placed = {};
  };
  MisplacedMesh(const TriangleMesh& truth, std::vector<PosedImage> references,
                const MeshPlacement& world_from_read, const Options& options)
      : references_(std::move(references)) {
    Rng rng = TestRng();
    Room room(0, rng);
    room.walls = std::make_shared<const MeshSource>("mesh", CasterFor(truth));
    room.references = references_;
    matches_ = room.MatchAll(options.matches_per_pair, 0, rng);
    // The same places of the first reference in all others.
    for (int other = 1; other < static_cast<int>(references_.size()); ++other) {
      Rng same(1);
      const auto shared = room.Match(0, other, options.matches_per_pair, 0, same);
      matches_.insert(matches_.end(), shared.begin(), shared.end());
    }
    as_read_ = CasterFor(Placed(truth, Inverse(world_from_read)));
    source_.emplace("mesh", as_read_);
    input_.emplace(DoctorInput{.source = *source_,
                               .references = references_,
                               .matches = matches_,
                               .mesh = as_read_,
                               .as_placed = options.as_placed});
    data_.emplace(*input_, matches_);
    data_->Prepare({&convention_, 1}, 0);
  }
  MisplacedMesh(const TriangleMesh& truth, std::vector<PosedImage> references,
                const MeshPlacement& world_from_read = {})
      : MisplacedMesh(truth, std::move(references), world_from_read, Options()) {}
  MisplacedMesh(const MisplacedMesh&) = delete;

  const ConventionResiduals& data() const { return *data_; }
  // This must outlive it.
  MeshFrameSearch Search(int threads = 1) const {
    return MeshFrameSearch(*as_read_, *input_, *data_, convention_, threads);
  }

 private:
  static std::shared_ptr<const RayCaster> CasterFor(TriangleMesh mesh) {
    return std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(std::move(mesh)));
  }

  const DataConvention convention_;
  std::vector<PosedImage> references_;
  std::vector<ReferenceMatch> matches_;
  std::shared_ptr<const RayCaster> as_read_;
  std::optional<MeshSource> source_;
  std::optional<DoctorInput> input_;
  std::optional<ConventionResiduals> data_;
};

// --- Rating: cameras side by side look straight at a plane. Depth z' in place of z projects
// f * baseline * |1 / z - 1 / z'| beside the match.

constexpr double kFocalPx = 300;
constexpr double kPlaneZ = 6;
constexpr double kExactPx = 0.01;  // vertices and hits are float

std::vector<PosedImage> CamerasSideBySide() {
  std::vector<PosedImage> references;
  for (const auto& [x, y] : std::vector<std::pair<double, double>>{
           {-1.5, -0.8}, {0, -0.9}, {1.4, -0.7}, {-1.3, 0.8}, {0.1, 0.9}, {1.5, 0.6}}) {
    references.push_back({std::to_string(references.size()),
                          CenteredPinhole(640, 480, kFocalPx),
                          {Eigen::Quaterniond::Identity(), {-x, -y, 0}}});
  }
  return references;
}

// All that the cameras see is on it.
TriangleMesh FrontalPlane() {
  return MakePlane({Eigen::Quaterniond::Identity(), {0, 0, kPlaneZ}}, 9, 4);
}

Eigen::Vector2d CenterOf(int reference) {
  return CamerasSideBySide()[static_cast<size_t>(reference)]
      .cam_from_world.OriginInSource()
      .head<2>();
}

TEST(MeshFrameSearch, APlacesErrorsAreThoseOfItsDepth) {
  const MisplacedMesh plane(FrontalPlane(), CamerasSideBySide());
  const MeshFrameSearch search = plane.Search();
  struct Case {
    MeshPlacement placement;
    double z;
  };
  for (const auto& [placement, z] :
       {Case{{}, 6}, Case{{.shift = {0.3, -0.2, 1.5}}, 7.5}, Case{{.scale = 0.5}, 3},
        Case{{.scale = 1.5, .shift = {0, 0, 1}}, 10},
        // Points go to -z, then shifted.
        Case{{.axes = *AxesFromName("y/x/-z"), .shift = {0, 0, 11}}, 5}}) {
    const PlacedMesh placed = search.Judge(placement);
    std::vector<double> expected_px;
    const auto& keypoints = plane.data().keypoints();
    ASSERT_EQ(placed.errors_px.size(), keypoints.size());
    for (size_t i = 0; i < keypoints.size(); ++i) {
      if (!placed.errors_px[i]) continue;
      const double baseline = (CenterOf(keypoints[i].map) - CenterOf(keypoints[i].other)).norm();
      expected_px.push_back(kFocalPx * baseline * std::abs(1 / kPlaneZ - 1 / z));
      EXPECT_NEAR(*placed.errors_px[i], expected_px.back(), kExactPx) << KeysOf(placement);
    }
    ASSERT_FALSE(expected_px.empty());
    EXPECT_EQ(placed.fit.count, expected_px.size());
    EXPECT_EQ(placed.fit.coverage, 1);
    std::sort(expected_px.begin(), expected_px.end());
    EXPECT_NEAR(placed.fit.median_px, expected_px[expected_px.size() / 2], kExactPx);
    EXPECT_EQ(KeysOf(placed.placement), KeysOf(placement));
  }
}

TEST(MeshFrameSearch, PlacesAreRatedByKeypointsThatAreHeldOut) {
  const MisplacedMesh plane(FrontalPlane(), CamerasSideBySide());
  const std::vector<Half> halves = SplitKeypoints(plane.data());
  const PlacedMesh placed = plane.Search().Judge({});
  ASSERT_EQ(placed.errors_px.size(), halves.size());
  EXPECT_GT(std::count(halves.begin(), halves.end(), Half::kNeither), 0);
  for (size_t i = 0; i < halves.size(); ++i) {
    EXPECT_EQ(placed.errors_px[i].has_value(), halves[i] == Half::kHeldOut);
  }
  EXPECT_EQ(placed.fit.asked,
            static_cast<size_t>(std::count(halves.begin(), halves.end(), Half::kHeldOut)));
  EXPECT_GT(placed.fit.asked, 100u);
}

TEST(MeshFrameSearch, RaysThatPassTheMeshByAreNotCovered) {
  const MisplacedMesh plane(FrontalPlane(), CamerasSideBySide());
  const MeshFrameSearch search = plane.Search();
  // Its left edge is where x is 1 then; behind the cameras it is nowhere.
  for (const MeshPlacement& placement :
       {MeshPlacement{.shift = {10, 0, 0}}, MeshPlacement{.axes = *AxesFromName("x/y/-z")}}) {
    const PlacedMesh placed = search.Judge(placement);
    size_t met = 0;
    for (size_t i = 0; i < placed.errors_px.size(); ++i) {
      if (!placed.errors_px[i]) continue;
      const auto& keypoint = plane.data().keypoints()[i];
      const double x = CenterOf(keypoint.map).x() + kPlaneZ * (keypoint.pixel.x() - 320) / kFocalPx;
      const bool is_met = x > 1 && placement.shift.x() > 0;
      met += is_met;
      EXPECT_NEAR(*placed.errors_px[i], is_met ? 0 : ConventionResiduals::kLargestPx, kExactPx);
    }
    EXPECT_EQ(met > 0, placement.shift.x() > 0);
    EXPECT_EQ(placed.fit.count, met);
    EXPECT_EQ(placed.fit.coverage,
              static_cast<double>(met) / static_cast<double>(placed.fit.asked));
  }
}

TEST(MeshFrameSearch, APlaceIsSaidOfTheFilesToo) {
  const MisplacedMesh plane(FrontalPlane(), CamerasSideBySide(), {},
                            {.as_placed = {.scale = 2, .shift = {1, 0, 0}}});
  const PlacedMesh placed = plane.Search().Judge({.scale = 0.5, .shift = {0, 3, 0}});
  EXPECT_EQ(KeysOf(placed.placement), "scale=0.5,shift=0/3/0");
  EXPECT_EQ(KeysOf(placed.from_files), "shift=0.5/3/0");
}

// --- Finding: a hall with plane walls that no symmetry brings onto itself, seen from within. It is
// convex: nothing hides anything.

// Two across each axis, each where n * p = 1.
using Walls = std::array<std::array<Eigen::Vector3d, 2>, 3>;

TriangleMesh MakeHall(const Walls& walls) {
  TriangleMesh mesh = MakeBox({0, 0, 0}, {1, 1, 1});
  for (size_t i = 0; i < 8; ++i) {
    Eigen::Matrix3d normals;
    normals << walls[0][i & 1].transpose(), walls[1][i / 2 & 1].transpose(),
        walls[2][i / 4].transpose();
    const Eigen::Vector3d corner = normals.inverse() * Eigen::Vector3d::Ones();
    mesh.vertices[i] = corner.cast<float>();
  }
  return mesh;
}

// All of its walls lean.
TriangleMesh CrookedHall() {
  return MakeHall({{{{{-0.32, 0.05, 0.04}, {0.27, 0.09, -0.06}}},
                    {{{0.06, -0.38, 0.07}, {-0.10, 0.36, 0.08}}},
                    {{{0.05, -0.08, -0.40}, {-0.07, 0.06, 0.36}}}}});
}

std::vector<PosedImage> CamerasWithin(int count, const Eigen::Vector3d& middle) {
  Rng rng = TestRng();
  std::vector<PosedImage> references;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d center =
        middle +
        Eigen::Vector3d(rng.Uniform(-1, 1), rng.Uniform(-0.5, 0.5), rng.Uniform(-0.5, 0.5));
    const double angle = 1.3 * i;
    const Eigen::Vector3d ahead(std::cos(angle), rng.Uniform(-0.8, 0.8), std::sin(angle));
    references.push_back(
        {std::to_string(i), CenteredPinhole(640, 480, 300), LookAt(center, center + ahead)});
  }
  return references;
}

struct SearchOptions {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();  // where all is moved to
  MeshPlacement as_placed = {};
  int threads = 0;
};
std::vector<PlacedMesh> FindPlaces(const TriangleMesh& truth, const MeshPlacement& world_from_read,
                                   const SearchOptions& options = {}) {
  const MisplacedMesh mesh(Placed(truth, {.shift = options.middle}),
                           CamerasWithin(12, options.middle), world_from_read,
                           {.matches_per_pair = 5, .as_placed = options.as_placed});
  return mesh.Search(options.threads).Find();
}

MeshPlacement PlacementBy(const std::string& keys) {
  return ParseMeshSpec("mesh:hall," + keys, MeshUse::kLift).placement;
}

// By so much a placement may be worse for its keys to be simpler.
constexpr double kFoundPx = 0.1;

// What is found first has these keys exactly; nothing else is as good.
void ExpectFound(const std::string& keys, const std::string& keys_of_files,
                 const std::vector<PlacedMesh>& found) {
  ASSERT_FALSE(found.empty()) << keys;
  EXPECT_EQ(KeysOf(found[0].placement), keys);
  EXPECT_EQ(KeysOf(found[0].from_files), keys_of_files);
  EXPECT_LT(found[0].fit.median_px, kFoundPx);
  EXPECT_GT(found[0].fit.coverage, 0.99);
  for (size_t i = 1; i < found.size(); ++i) {
    EXPECT_GT(found[i].fit.median_px, found[0].fit.median_px);
  }
}

TEST(MeshFrameSearch, AMeshInItsPlaceIsLeftThere) {
  ExpectFound("", "", FindPlaces(CrookedHall(), {}));
}

TEST(MeshFrameSearch, FindsAMirrorAtAnyScale) {
  const std::string keys = "scale=0.0023,axes=-x/y/z";
  ExpectFound(keys, keys, FindPlaces(CrookedHall(), PlacementBy(keys)));
}

TEST(MeshFrameSearch, FindsAShiftOfATurnedAndScaledMesh) {
  const std::string keys = "scale=2,axes=y/z/x,shift=30/-20/10";
  ExpectFound(keys, keys, FindPlaces(CrookedHall(), PlacementBy(keys), {.middle = {20, -10, 5}}));
}

// A third of the keypoints are on its ends, which alone tell where it is along itself.
TEST(MeshFrameSearch, AShiftThatMostKeypointsDoNotSeeIsFound) {
  const TriangleMesh corridor = MakeHall({{{{{-0.25, 0.04, 0.03}, {0.25, 0.05, -0.04}}},
                                           {{{0, -0.7, 0}, {0, 0.7, 0}}},
                                           {{{0, 0, -0.7}, {0, 0, 0.7}}}}});
  const auto found = FindPlaces(corridor, {.shift = {2, 0, 0}});
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(KeysOf(found[0].placement), "shift=2/0/0");
}

// A turn beside the axes has no name: it is found as well as the mesh's floats allow.
TEST(MeshFrameSearch, FindsASmallTurn) {
  const Eigen::Matrix3d turn = RotationFromVector({0.02, -0.1, 0.05}).toRotationMatrix();
  const auto found = FindPlaces(CrookedHall(), {.scale = 0.1, .axes = turn});
  ASSERT_FALSE(found.empty());
  EXPECT_LT((found[0].placement.axes - turn).norm(), 1e-3);
  EXPECT_NEAR(found[0].placement.scale, 0.1, 1e-6);
  EXPECT_LT(found[0].fit.median_px, kFoundPx);
}

// Its files are right, the keys that it was read with are not.
TEST(MeshFrameSearch, KeysThatMisplaceTheMeshAreUndone) {
  const std::string keys = "scale=2,axes=x/z/-y,shift=1/2/3";
  const auto found =
      FindPlaces(CrookedHall(), Inverse(PlacementBy(keys)), {.as_placed = PlacementBy(keys)});
  ExpectFound(KeysOf(Inverse(PlacementBy(keys))), "", found);
}

TEST(MeshFrameSearch, ASymmetricMeshHasSeveralPlaces) {
  const TriangleMesh box = MakeBox({0, 0, 0}, {4, 3, 2.5});
  const auto found = FindPlaces(box, {.shift = {1, 0.8, -0.6}});
  ASSERT_EQ(found.size(), 3u);
  for (size_t i = 0; i < found.size(); ++i) {
    EXPECT_LT(found[i].fit.median_px, kFoundPx);
    // Each brings the box onto itself, another way.
    const MeshPlacement& placement = found[i].placement;
    EXPECT_LT((placement * Eigen::Vector3d(-1, -0.8, 0.6)).norm(), 0.01) << KeysOf(placement);
    EXPECT_TRUE(placement.axes.cwiseAbs().isIdentity(0)) << KeysOf(placement);
    for (size_t j = 0; j < i; ++j) EXPECT_NE(found[i].placement.axes, found[j].placement.axes);
  }
}

TEST(MeshFrameSearch, FindsTheSameWithAnyNumberOfThreads) {
  const std::string keys = "scale=0.001,axes=x/-z/y";
  const auto found = FindPlaces(CrookedHall(), PlacementBy(keys), {.threads = 1});
  ExpectFound(keys, keys, found);
  const auto again = FindPlaces(CrookedHall(), PlacementBy(keys), {.threads = 3});
  ASSERT_EQ(again.size(), found.size());
  for (size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(KeysOf(again[i].placement), KeysOf(found[i].placement));
    EXPECT_EQ(again[i].errors_px, found[i].errors_px);
  }
}

TEST(MeshFrameSearch, SomeMatchesAndAMeshThatIsNoTangleAreNeeded) {
  const auto obstacle = [](const TriangleMesh& mesh, int matches_per_pair) {
    const MisplacedMesh read(mesh, CamerasSideBySide(), {}, {.matches_per_pair = matches_per_pair});
    const MeshFrameSearch search = read.Search();
    if (search.Obstacle() != MeshSearch::kNoneFound) {
      EXPECT_TRUE(search.Find().empty());
    }
    return search.Obstacle();
  };
  EXPECT_EQ(obstacle(FrontalPlane(), 20), MeshSearch::kNoneFound);
  EXPECT_EQ(obstacle(FrontalPlane(), 1), MeshSearch::kTooFewMatches);
  // Before the plane stands a cube of triangles from corner to corner, each in a box as large as
  // all; a line through that crosses as many.
  for (const uint32_t count : {400u, 600u}) {
    std::vector<Eigen::Vector3d> corners;
    std::vector<std::array<uint32_t, 3>> triangles;
    for (uint32_t i = 0; i < count; ++i) {
      for (const Eigen::Vector3d& corner :
           {Eigen::Vector3d(-50, -50, 6), Eigen::Vector3d(50, 50, 106),
            Eigen::Vector3d(50, -50, 6 + 0.1 * i)}) {
        corners.push_back(corner);
      }
      triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    }
    EXPECT_EQ(obstacle(MeshOfShape(corners, triangles), 60),
              count > 500 ? MeshSearch::kTooTangled : MeshSearch::kNoneFound);
  }
}

}  // namespace
}  // namespace raylift
