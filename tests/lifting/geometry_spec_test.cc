#include "raylift/lifting/geometry_spec.h"

#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

std::string WriteTriangle(const std::string& name) {
  const auto path = TestFolder() / name;
  WriteFile(path, "v -1 -1 2\nv 1 -1 2\nv 0 1 2\nf 1 2 3\nf 1 1 2\n");
  return path.string();
}

std::string OptionErrorOf(const std::string& spec) {
  try {
    MakeGeometrySource(spec);
  } catch (const OptionError& error) {
    return error.what();
  }
  return "no OptionError";
}

TEST(MakeGeometrySource, OpensAMeshAndPassesItsWarningsOn) {
  const std::string path = WriteTriangle("one.obj");
  for (const std::string options : {"", ",build=low", ",build=medium"}) {
    const NamedGeometry geometry = MakeGeometrySource("mesh:" + path + options);
    EXPECT_EQ(geometry.source->Description(), "mesh:" + path);
    ASSERT_EQ(geometry.warnings.size(), 1u);
    EXPECT_NE(geometry.warnings[0].find("no area"), std::string::npos);
    const Eigen::Vector2d pixel(0.5, 0.5);
    EXPECT_TRUE(geometry.source->Lift({}, {&pixel, 1})[0]);
  }
}

TEST(MakeGeometrySource, UnknownKindsKeysAndValuesAreOptionErrors) {
  EXPECT_EQ(OptionErrorOf("foo:x"), "--geometry = foo:x: expected mesh:PATH[,key=value...]");
  EXPECT_EQ(OptionErrorOf("mesh"), "--geometry = mesh: expected mesh:PATH[,key=value...]");
  EXPECT_EQ(OptionErrorOf("mesh:"), "--geometry = mesh:: expected mesh:PATH[,key=value...]");
  EXPECT_EQ(OptionErrorOf(""), "--geometry = : expected mesh:PATH[,key=value...]");
  EXPECT_EQ(OptionErrorOf("mesh:a.ply,size=3"),
            "--geometry = mesh:a.ply,size=3: unknown key \"size\"; a mesh has build=low|medium");
  EXPECT_EQ(OptionErrorOf("mesh:a.ply,build=best"),
            "--geometry = mesh:a.ply,build=best: expected build=low or build=medium");
}

TEST(MakeGeometrySource, AFileThatIsMissingIsAnInputError) {
  EXPECT_TRUE(FailsWithInputError([] { MakeGeometrySource("mesh:/nowhere/a.ply"); },
                                  {"/nowhere/a.ply", "no such file"}));
}

}  // namespace
}  // namespace raylift
