#include "views/task_list.h"

#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

View MakeView(const std::string& name) {
  const double params[] = {100, 110, 30, 20, 0.1, 0, 0, 0};
  return {name, Camera(CameraModel::kOpenCv, 64, 40, params), Rigid3()};
}

std::vector<View> Views(const std::vector<std::string>& names) {
  std::vector<View> views;
  for (const std::string& name : names) views.push_back(MakeView(name));
  return views;
}

std::vector<std::string> Names(const std::vector<RenderTask>& tasks) {
  std::vector<std::string> names;
  for (const RenderTask& task : tasks) names.push_back(task.view.name);
  return names;
}

using Strings = std::vector<std::string>;

TEST(SelectTasks, TakesListGlobAndEveryNthByName) {
  const auto views = Views({"b/2.jpg", "a/1.jpg", "a/3.jpg", "b/4.jpg", "a/2.jpg"});
  EXPECT_EQ(Names(SelectTasks(views, {.glob = "a/*"})), (Strings{"a/1.jpg", "a/2.jpg", "a/3.jpg"}));
  EXPECT_EQ(Names(SelectTasks(views, {.subsampling = {.every = 2}})),
            (Strings{"a/1.jpg", "a/3.jpg", "b/4.jpg"}));
  const auto list = TestFolder() / "list.txt";
  WriteFile(list, "# two\nb/4.jpg\na/2.jpg\n");
  EXPECT_EQ(Names(SelectTasks(views, {.list = list})), (Strings{"a/2.jpg", "b/4.jpg"}));
  WriteFile(list, "a/2.jpg\nc.jpg\n");
  EXPECT_TRUE(FailsWithInputError([&] { SelectTasks(views, {.list = list}); },
                                  {"list.txt", "\"c.jpg\" is not among"}));
  EXPECT_TRUE(
      FailsWithInputError([&] { SelectTasks(views, {.glob = "c*"}); }, {"no images to render"}));
}

TEST(SelectTasks, ScalesTheLensWithThePicture) {
  const auto views = Views({"a.jpg"});
  const auto camera = [&](const TaskSelection& selection) {
    return SelectTasks(views, selection).front().view.camera;
  };
  const ViewCamera half = camera({.scale = 0.5});
  EXPECT_EQ(half.ToString(), "OPENCV 32 20 50 55 15 10 0.1 0 0 0");
  EXPECT_EQ(camera({.size = PlaneSize{128, 40}}).ToString(),
            "OPENCV 128 40 200 110 60 20 0.1 0 0 0");
  EXPECT_EQ(camera({.panorama = PlaneSize{200, 100}}).ToString(), "EQUIRECTANGULAR 200 100");
  EXPECT_TRUE(
      FailsWithInputError([&] { camera({.scale = 1e-3}); }, {"a.jpg", "pixels times 0.001"}));
}

TEST(StretchWarning, IsGivenWhereTheShapeChangesByMoreThanRounding) {
  const auto views = Views({"a.jpg", "b.jpg"});
  const auto warning = [&](int width, int height) {
    return StretchWarning(views, {.size = PlaneSize{width, height}});
  };
  EXPECT_FALSE(warning(32, 20));
  EXPECT_FALSE(warning(33, 21));  // 33 x 20.6
  EXPECT_FALSE(warning(128, 80));
  EXPECT_FALSE(StretchWarning(views, {}));
  ASSERT_TRUE(warning(128, 128));
  EXPECT_NE(warning(128, 128)->find("2 of 2 images (a.jpg: 64x40)"), std::string::npos)
      << *warning(128, 128);
}

TEST(SelectTasks, NamesMirrorThoseOfTheImages) {
  const auto stem = [](const std::string& name, const std::string& pattern) {
    return SelectTasks(Views({name}), {.pattern = pattern}).front().stem;
  };
  EXPECT_EQ(stem("seq/a.color.png", "{dir}/{stem}"), "seq/a.color");
  EXPECT_EQ(stem("seq/a.color.png", "{dir}/{base}_depth"), "seq/a_depth");
  EXPECT_EQ(stem("seq/a.color.png", "{name}.geometric"), "seq/a.color.png.geometric");
  EXPECT_EQ(stem("a.png", "{dir}/{stem}"), "a");
}

TEST(SelectTasks, RefusesFilesThatCollideOrLieElsewhere) {
  EXPECT_TRUE(FailsWithInputError(
      [] {
        SelectTasks(Views({"a.jpg", "a.png"}), {});
      },
      {"a.jpg", "a.png", "give a pattern"}));
  EXPECT_EQ(SelectTasks(Views({"a.jpg", "a.png"}), {.pattern = "{name}"}).size(), 2u);
  for (const std::string name : {"../a.jpg", "/etc/a.jpg", "b/../../a.jpg"}) {
    EXPECT_TRUE(FailsWithInputError([&] { SelectTasks(Views({name}), {}); },
                                    {name, "not below the output folder"}));
  }
}

}  // namespace
}  // namespace raylift
