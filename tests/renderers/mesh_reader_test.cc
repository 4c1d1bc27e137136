#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/renderers/triangle_mesh.h"

namespace raylift {
namespace {

TEST(ReadMesh, MissingFileIsNamed) {
  EXPECT_TRUE(FailsWithInputError([] { ReadMesh("/nowhere/mesh.ply"); },
                                  {"/nowhere/mesh.ply", "no such file"}));
}

}  // namespace
}  // namespace raylift
