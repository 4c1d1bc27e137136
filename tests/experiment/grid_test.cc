#include "experiment/test_experiments.h"
#include "support/enum_names.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/experiment/experiment.h"

namespace raylift {
namespace {

std::vector<std::string> Names(const std::vector<Setting>& settings) {
  std::vector<std::string> names;
  for (const Setting& setting : settings) names.push_back(setting.Name());
  return names;
}

TEST(Grid, LeavesOutWhatDoesNotMatterToAMethod) {
  const Experiment experiment = ReadText(kTwoScenes + R"(
[[grid]]
scene = "room"
geometry = "mesh"
method = ["p3p", "e5p1", "adaptive", "select"]
score = ["sum_inl", "sum_msac"]
lo = "split"
alpha = [0.7, 1.0]
)");
  const std::string mesh = "scene=room every=1 geometry=mesh align=off filter=off method=";
  EXPECT_THAT(Names(ExpandGrid(experiment)),
              ::testing::ElementsAre(mesh + "p3p", "scene=room every=1 method=e5p1",
                                     mesh + "adaptive score=sum_inl lo=split",
                                     mesh + "adaptive score=sum_msac lo=split",
                                     mesh + "select alpha=0.7", mesh + "select alpha=1"));
}

TEST(Grid, BlocksAreJoinedAndNothingStandsTwice) {
  const Experiment experiment = ReadText(kTwoScenes + R"(
[[grid]]
scene = "room"
every = [1, 5]
method = ["e5p1", "p3p"]
[[grid]]
scene = "room"
every = 5
method = "e5p1"
[[grid]]
scene = "hall"
method = "e5p1"
)");
  // 2 subsamplings x (E5+1 and P3P by two geometries), and the hall.
  EXPECT_EQ(ExpandGrid(experiment).size(), 7u);
}

TEST(Grid, WhatIsChosenIsNotEstimated) {
  const Experiment experiment = ReadText(kTwoScenes + R"(
[[grid]]
scene = "room"
geometry = "mesh"
filter = ["off", "auto"]
method = ["select", "oracle"]
)");
  const std::vector<Setting> settings = ExpandGrid(experiment);
  EXPECT_EQ(settings.size(), 4u);
  const std::string mesh = "scene=room every=1 geometry=mesh align=off filter=";
  // P3P is filtered otherwise when Select asks for it, so that it is not shared where that matters.
  EXPECT_THAT(Names(SettingsToEstimate(settings, experiment)),
              ::testing::UnorderedElementsAre(
                  mesh + "off method=p3p", "scene=room every=1 method=e5p1",
                  mesh + "auto method=select alpha=0.8", mesh + "auto method=p3p"));
}

TEST(Grid, AMethodThatNeedsGeometryAndHasNoneIsAnError) {
  const Experiment experiment = ReadText(kTwoScenes + "[[grid]]\nmethod = \"p3p\"\n");
  try {
    ExpandGrid(experiment);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("p3p needs geometry, the scene hall has none"));
  }
}

TEST(Axis, EachHasAName) {
  EXPECT_TRUE(NamesEveryValue<Axis>());
  EXPECT_TRUE(NamesEveryValue<TableValue>());
  EXPECT_TRUE(NamesEveryValue<FilterPart>());
  EXPECT_TRUE(NamesEveryValue<SubsamplingOffsets>());
}

}  // namespace
}  // namespace raylift
