#include "views/task_list.h"

#include "base/rng.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

PosedImage MakeView(const std::string& name) {
  const double params[] = {100, 110, 30, 20, 0.1, 0, 0, 0};
  return {name, Camera(CameraModel::kOpenCv, 64, 40, params), Rigid3()};
}

std::vector<PosedImage> Views(const std::vector<std::string>& names) {
  std::vector<PosedImage> views;
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
  const Camera half = camera({.scale = 0.5});
  EXPECT_EQ(half.ToString(), "OPENCV 32 20 50 55 15 10 0.1 0 0 0");
  EXPECT_EQ(camera({.size = PlaneSize{128, 40}}).ToString(),
            "OPENCV 128 40 200 110 60 20 0.1 0 0 0");
  EXPECT_EQ(camera({.panorama = PlaneSize{200, 100}}).ToString(),
            "EQUIRECTANGULAR 200 100 200 100");
  EXPECT_TRUE(
      FailsWithInputError([&] { camera({.scale = 1e-3}); }, {"a.jpg", "pixels times 0.001"}));
}

Eigen::Vector3d DirectionInWorld(const PosedImage& face, const Eigen::Vector2d& pixel) {
  return face.cam_from_world.rotation.conjugate() * face.camera.RayInCam(pixel).value();
}

// The faces of a camera that stands somewhere, turned somehow, in the order of CubeFaces().
std::vector<PosedImage> FacesOf(const PosedImage& view) {
  std::vector<PosedImage> faces = CubeFaces(view, 64);
  EXPECT_EQ(faces.size(), 6u);
  return faces;
}

PosedImage TurnedView() {
  PosedImage view = MakeView("seq/a.color.jpg");
  view.cam_from_world = LookAt({1, -2, 3}, {4, 0, 5});
  return view;
}

TEST(CubeFaces, FrontIsTheCameraAndAllStandAtItsPlace) {
  const PosedImage view = TurnedView();
  const std::vector<PosedImage> faces = FacesOf(view);
  Strings names;
  for (const PosedImage& face : faces) {
    names.push_back(face.name);
    EXPECT_EQ(face.camera.ToString(), "SIMPLE_PINHOLE 64 64 32 32 32");
    EXPECT_TRUE(face.cam_from_world.OriginInSource().isApprox(Eigen::Vector3d(1, -2, 3), 1e-14));
  }
  EXPECT_EQ(names,
            (Strings{"seq/a.color/front.jpg", "seq/a.color/right.jpg", "seq/a.color/back.jpg",
                     "seq/a.color/left.jpg", "seq/a.color/up.jpg", "seq/a.color/down.jpg"}));
  EXPECT_TRUE(IsNearPose(faces[0].cam_from_world, view.cam_from_world, 1e-6, 1e-12));
  // What is to the right of the camera is ahead of `right`, and what is above it ahead of `up`.
  const Eigen::Matrix3d world_from_cam =
      view.cam_from_world.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector2d middle(32, 32);
  const auto looks = [&](size_t face, const Eigen::Vector3d& in_cam) {
    return DirectionInWorld(faces[face], middle).isApprox(world_from_cam * in_cam, 1e-14);
  };
  EXPECT_TRUE(looks(1, Eigen::Vector3d::UnitX()));
  EXPECT_TRUE(looks(2, -Eigen::Vector3d::UnitZ()));
  EXPECT_TRUE(looks(3, -Eigen::Vector3d::UnitX()));
  EXPECT_TRUE(looks(4, -Eigen::Vector3d::UnitY()));
  EXPECT_TRUE(looks(5, Eigen::Vector3d::UnitY()));
}

TEST(CubeFaces, EdgesMeetAsStated) {
  const std::vector<PosedImage> faces = FacesOf(TurnedView());
  for (double along = 0; along <= 64; along += 8) {
    const auto meet = [&](size_t a, const Eigen::Vector2d& in_a, size_t b,
                          const Eigen::Vector2d& in_b) {
      return DirectionInWorld(faces[a], in_a)
          .normalized()
          .isApprox(DirectionInWorld(faces[b], in_b).normalized(), 1e-14);
    };
    for (size_t k = 0; k < 4; ++k) {
      EXPECT_TRUE(meet(k, {64, along}, (k + 1) % 4, {0, along})) << k << " " << along;
    }
    EXPECT_TRUE(meet(4, {along, 64}, 0, {along, 0})) << along;
    EXPECT_TRUE(meet(5, {along, 0}, 0, {along, 64})) << along;
  }
}

TEST(CubeFaces, EachDirectionIsSeenByOne) {
  const std::vector<PosedImage> faces = FacesOf(TurnedView());
  Rng rng(3);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d direction(rng.Normal(), rng.Normal(), rng.Normal());
    int seen = 0;
    for (const PosedImage& face : faces) {
      const auto pixel =
          face.camera.ImgFromCam(face.cam_from_world.rotation * direction.normalized());
      seen += pixel && face.camera.Contains(*pixel) ? 1 : 0;
    }
    EXPECT_EQ(seen, 1) << direction.transpose();
  }
}

TEST(SelectTasks, ACubemapHasSixTasksOfEachImageThatIsSelected) {
  const auto tasks = SelectTasks(Views({"s/a.jpg", "s/b.jpg", "s/c.jpg"}),
                                 {.subsampling = {.every = 2}, .cubemap = 8});
  ASSERT_EQ(tasks.size(), 12u);
  EXPECT_EQ(tasks.front().view.name, "s/a/back.jpg");
  EXPECT_EQ(tasks.front().stem, "s/a/back");
  EXPECT_EQ(tasks.back().stem, "s/c/up");
  EXPECT_TRUE(ModelOf(tasks).has_value());
  EXPECT_EQ(SelectTasks(Views({"a.jpg"}), {.cubemap = 8, .pattern = "{index}"}).back().stem,
            "00000005");
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
