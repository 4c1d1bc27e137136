#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

using StringVector = std::vector<std::string>;

TEST(References, EveryNthIsTakenByNameFromTheFirstOn) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto load = [&](int every) {
    return LoadReferences(scene.model(), {.every = every}).references;
  };
  EXPECT_EQ(NamesOf(load(1).images).size(), 6u);
  EXPECT_TRUE(load(1).thinned_out.empty());
  EXPECT_EQ(NamesOf(load(2).images), (StringVector{"ref/00.png", "ref/02.png", "ref/04.png"}));
  EXPECT_EQ(load(2).thinned_out, (StringVector{"ref/01.png", "ref/03.png", "ref/05.png"}));
  EXPECT_EQ(NamesOf(load(4).images), (StringVector{"ref/00.png", "ref/04.png"}));
  EXPECT_EQ(NamesOf(load(100).images), StringVector{"ref/00.png"});
  EXPECT_EQ(load(100).thinned_out.size(), 5u);
  EXPECT_EQ(load(2).model, scene.model());
}

TEST(References, SubsamplingStartsAtTheOffset) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto load = [&](const Subsampling& subsampling) {
    return LoadReferences(scene.model(), subsampling).references;
  };
  const ReferenceSet references = load({.every = 3, .offset = 1});
  EXPECT_EQ(NamesOf(references.images), (StringVector{"ref/01.png", "ref/04.png"}));
  EXPECT_EQ(references.thinned_out,
            (StringVector{"ref/00.png", "ref/02.png", "ref/03.png", "ref/05.png"}));
  EXPECT_TRUE(FailsWithInputError([&] { load({.every = 9, .offset = 6}); },
                                  {scene.model().string(), "none is left of 6 images"}));
}

TEST(References, SubsamplingPerCameraNeedsSharedCameras) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const Subsampling subsampling{.every = 2, .per_camera = true};
  // Equal parameters are one camera, whatever its ids.
  EXPECT_EQ(LoadReferences(scene.model(), subsampling).references.images.size(), 3u);
  std::string cameras;
  for (int id = 1; id <= 6; ++id) {
    cameras +=
        std::to_string(id) + " SIMPLE_RADIAL 320 240 26" + std::to_string(id) + " 160 120 0\n";
  }
  WriteFile(scene.model() / "cameras.txt", cameras);
  EXPECT_TRUE(FailsWithInputError([&] { LoadReferences(scene.model(), subsampling); },
                                  {"each has a camera of its own"}));
}

TEST(References, KeepTheirPosesAndCameras) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto images = LoadReferences(scene.model()).references.images;
  ASSERT_EQ(images.size(), scene.references.size());
  for (size_t i = 0; i < images.size(); ++i) {
    EXPECT_EQ(images[i].camera, scene.references[i].camera);
    EXPECT_TRUE(
        IsNearPose(images[i].cam_from_world, scene.references[i].cam_from_world, 1e-12, 1e-14));
  }
}

TEST(References, AModelWithoutImagesIsBadInput) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  WriteFile(scene.model() / "images.txt", "");
  EXPECT_TRUE(FailsWithInputError([&] { LoadReferences(scene.model()); },
                                  {scene.model().string(), "no images"}));
}

}  // namespace
}  // namespace raylift
