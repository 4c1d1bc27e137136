#include "support/meshes.h"
#include "views/job_files.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

using Centers = std::vector<Eigen::Vector3d>;

::testing::AssertionResult Says(const std::string& part, const TriangleMesh& mesh,
                                const Centers& centers) {
  const std::string text =
      WhyTheMeshIsUnseen(RayCaster(std::make_shared<const TriangleMesh>(mesh)), centers);
  if (text.find(part) != std::string::npos) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << text << "\nwanted: " << part;
}

TEST(UnseenMesh, SaysWhereBothAre) {
  const TriangleMesh box = MakeBox({10, 0, 0}, {1, 2, 3});
  EXPECT_TRUE(Says("(9, -2, -3) to (11, 2, 3)", box, {{1, 2, 3}, {0, 5, 4}}));
  EXPECT_TRUE(Says("(0, 2, 3) to (1, 5, 4)", box, {{1, 2, 3}, {0, 5, 4}}));
  EXPECT_TRUE(Says("none of 2 images", box, {{1, 2, 3}, {0, 5, 4}}));
}

TEST(UnseenMesh, TellsUnitsFromFramesAndDirections) {
  // A room of 4 m, in which the cameras stand, and the same in millimeters.
  const Centers inside = {{0.5, 0.2, 0.1}, {1.5, 1, 0.3}, {1.2, 1.8, 0.2}};
  const TriangleMesh room = MakeBox({1, 1, 1}, {2, 2, 2});
  EXPECT_TRUE(Says("axes=", room, inside));
  const Centers outside = {{1500, 1000, 900}, {1200, 1100, 800}};
  EXPECT_TRUE(Says("scale=1000 ", MakeBox({1, 1, 1}, {0.5, 0.5, 0.5}), outside));
  const Centers meters = {{15, 14, 15}, {16, 15, 15}};
  EXPECT_TRUE(Says("scale=0.001 ", MakeBox({15000, 15000, 15000}, {2000, 2000, 2000}), meters));
  EXPECT_TRUE(Says("another frame", room, {{4.6e5, 5.2e6, 120}, {4.6e5, 5.2e6, 121}}));
}

}  // namespace
}  // namespace raylift
