#include "raylift/io/scene_file.h"

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::Pair;

TEST(SceneFile, PathsAreRelativeToTheFile) {
  const fs::path folder = TestFolder() / "scenes";
  const fs::path file = folder / "scene.toml";
  WriteFile(file,
            "format = 'raylift-scene/1'\n"
            "name = 'chess'\n"
            "references = 'model'\n"
            "images = '../data/chess'\n"
            "queries = './*_queries.txt'\n"
            "query_images = '/elsewhere'\n"
            "thresholds = '7scenes'\n"
            "crs = 'EPSG:25832@460000,5420000,0'\n"
            "[[geometry]]\n"
            "name = 'sensor'\n"
            "spec = 'depth:../data/chess,preset=7scenes,pattern={dir}/a.png'\n"
            "[[geometry]]\n"
            "name = 'parts'\n"
            "spec = 'mesh:a.ply+/b/*.ply'\n"
            "[[geometry]]\n"
            "name = 'sfm'\n"
            "spec = 'sfm,radius=3'\n"
            "[[geometry]]\n"
            "name = 'town'\n"
            "spec = 'dsm:town.tif,far=100,ortho=maps/town.tif'\n"
            "[[geometry]]\n"
            "name = 'splats'\n"
            "spec = 'splat:a.ply,transform=none'\n"
            "[[geometry]]\n"
            "name = 'network'\n"
            "spec = 'depth:results.npz,names=lists/names.txt,layer=depth'\n"
            "[provenance]\n"
            "dataset = '7scenes'\n");
  const SceneFile scene = ReadSceneFile(file);
  const fs::path data = TestFolder() / "data" / "chess";
  EXPECT_EQ(scene.name, "chess");
  EXPECT_EQ(scene.references, folder / "model");
  EXPECT_EQ(scene.images, data);
  EXPECT_EQ(scene.queries, folder / "*_queries.txt");
  EXPECT_EQ(scene.query_images, "/elsewhere");
  EXPECT_EQ(scene.ground_truth, "");
  EXPECT_EQ(scene.times, "");
  EXPECT_EQ(scene.groups, "");
  EXPECT_EQ(scene.thresholds, "7scenes");
  EXPECT_EQ(scene.crs, "EPSG:25832@460000,5420000,0");
  ASSERT_EQ(scene.geometries.size(), 6u);
  EXPECT_EQ(scene.geometries[0].name, "sensor");
  EXPECT_EQ(scene.geometries[0].spec,
            "depth:" + data.string() + ",preset=7scenes,pattern={dir}/a.png");
  EXPECT_EQ(scene.geometries[1].spec, "mesh:" + (folder / "a.ply").string() + "+/b/*.ply");
  EXPECT_EQ(scene.geometries[2].spec, "sfm,radius=3");
  EXPECT_EQ(scene.geometries[3].spec, "dsm:" + (folder / "town.tif").string() + ",far=100,ortho=" +
                                          (folder / "maps" / "town.tif").string());
  EXPECT_EQ(scene.geometries[4].spec, "splat:" + (folder / "a.ply").string() + ",transform=none");
  EXPECT_EQ(scene.geometries[5].spec, "depth:" + (folder / "results.npz").string() +
                                          ",names=" + (folder / "lists" / "names.txt").string() +
                                          ",layer=depth");
  EXPECT_THAT(scene.provenance, ElementsAre(Pair("dataset", "7scenes")));
}

TEST(SceneFile, ReadsBackWhatWasWritten) {
  const fs::path folder = TestFolder();
  SceneFile scene;
  scene.name = "a \"name\"\nof two lines";
  scene.references = folder / "out" / "references";
  scene.images = folder / "data";
  scene.queries = folder / "out" / "queries.txt";
  scene.query_images = folder / "data" / "queries";
  scene.ground_truth = folder / "out" / "ground_truth";
  scene.times = folder / "out" / "times.txt";
  scene.groups = folder / "out" / "groups.txt";
  scene.priors = folder / "out" / "priors.txt";
  scene.thresholds = "0.1,1:0.25,2";
  scene.crs = "EPSG:32632";
  scene.geometries = {{"mesh", "mesh:" + (folder / "data" / "a.ply").string() + ",far=3"},
                      {"all points", "sfm"}};
  scene.provenance = {{"dataset", "tum"}, {"skipped frames", "3"}};
  const fs::path file = folder / "out" / "scene.toml";
  WriteSceneFile(file, scene);
  const SceneFile back = ReadSceneFile(file);
  EXPECT_EQ(back.name, scene.name);
  EXPECT_EQ(back.references, scene.references);
  EXPECT_EQ(back.images, scene.images);
  EXPECT_EQ(back.queries, scene.queries);
  EXPECT_EQ(back.query_images, scene.query_images);
  EXPECT_EQ(back.ground_truth, scene.ground_truth);
  EXPECT_EQ(back.times, scene.times);
  EXPECT_EQ(back.groups, scene.groups);
  EXPECT_EQ(back.priors, scene.priors);
  EXPECT_EQ(back.thresholds, scene.thresholds);
  EXPECT_EQ(back.crs, scene.crs);
  ASSERT_EQ(back.geometries.size(), 2u);
  EXPECT_EQ(back.geometries[0].spec, scene.geometries[0].spec);
  EXPECT_EQ(back.geometries[1].name, "all points");
  EXPECT_EQ(back.provenance, scene.provenance);
}

TEST(SceneFile, CanBeMovedWithWhatItRefersTo) {
  const fs::path folder = TestFolder();
  SceneFile scene;
  scene.references = folder / "before" / "references";
  scene.images = folder / "before" / ".." / "before" / "images";
  WriteSceneFile(folder / "before" / "scene.toml", scene);
  fs::rename(folder / "before", folder / "after");
  const SceneFile back = ReadSceneFile(folder / "after" / "scene.toml");
  EXPECT_EQ(back.references, folder / "after" / "references");
  EXPECT_EQ(back.images, folder / "after" / "images");
}

TEST(SceneFile, WrongLinesAreNamed) {
  const fs::path file = TestFolder() / "scene.toml";
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(file, text);
    return FailsWithInputError([&] { ReadSceneFile(file); }, parts);
  };
  const std::string start = "format = 'raylift-scene/1'\n";
  EXPECT_TRUE(fails("", {"scene.toml", "format = \"raylift-scene/1\""}));
  EXPECT_TRUE(fails("format = 'raylift-scene/2'\n", {"line 1", "raylift-scene/2"}));
  EXPECT_TRUE(fails("format = 1\n", {"line 1", "format: expected a string"}));
  EXPECT_TRUE(fails(start + "name = \"open\n", {"scene.toml: line 2"}));
  EXPECT_TRUE(fails(start + "name = 3\n", {"line 2", "name: expected a string"}));
  EXPECT_TRUE(fails(start + "querys = 'a'\n", {"line 2", "\"querys\" is no key"}));
  EXPECT_TRUE(fails(start + "geometry = 'mesh:a'\n", {"line 2", "[[geometry]]"}));
  EXPECT_TRUE(fails(start + "geometry = ['mesh:a']\n", {"line 2", "[[geometry]]"}));
  EXPECT_TRUE(fails(start + "[[geometry]]\nname = 'a'\n", {"line 2", "a name and a spec"}));
  EXPECT_TRUE(fails(start + "[[geometry]]\nkind = 'a'\n", {"line 3", "\"kind\" is no key"}));
  EXPECT_TRUE(fails(start + "[[geometry]]\nname='a'\nspec='sfm'\n[[geometry]]\nname='a'\nspec='b'",
                    {"line 5", "\"a\" stands twice"}));
  EXPECT_TRUE(fails(start + "provenance = 'a'\n", {"line 2", "provenance: expected a table"}));
  EXPECT_TRUE(
      fails(start + "[provenance]\na = 1\n", {"line 3", "provenance.a: expected a string"}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadSceneFile(TestFolder() / "none.toml"); }, {"none"}));
}

TEST(TimesFile, HoldsTheSameDoubles) {
  const fs::path file = TestFolder() / "times.txt";
  const std::map<std::string, double> times = {{"a/1.jpg", 1305031102.175304}, {"b.jpg", -0.1}};
  WriteTimes(file, times);
  EXPECT_EQ(ReadTimes(file), times);
  WriteFile(file, "# comment\n\na 1\n");
  EXPECT_THAT(ReadTimes(file), ElementsAre(Pair("a", 1.0)));
  EXPECT_TRUE(FailsWithInputError([&] { WriteTimes(file, {{"a\"b", 1}}); }, {"times.txt", "a\"b"}));
}

TEST(TimesFile, WrongLinesAreNamed) {
  const fs::path file = TestFolder() / "times.txt";
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(file, text);
    return FailsWithInputError([&] { ReadTimes(file); }, parts);
  };
  EXPECT_TRUE(fails("a\n", {"times.txt: line 1: seconds"}));
  EXPECT_TRUE(fails("a x\n", {"line 1: seconds", "\"x\""}));
  EXPECT_TRUE(fails("a nan\n", {"line 1: seconds", "finite"}));
  EXPECT_TRUE(fails("a 1 2\n", {"line 1", "\"2\""}));
  EXPECT_TRUE(fails("a 1\na 2\n", {"line 2: name: \"a\" stands twice"}));
}

TEST(GroupsFile, HoldsOneGroupPerName) {
  const fs::path file = TestFolder() / "groups.txt";
  const std::map<std::string, std::string> groups = {{"a/1.jpg", "day"}, {"b.jpg", "night"}};
  WriteGroups(file, groups);
  EXPECT_EQ(ReadGroups(file), groups);
  WriteFile(file, "a day night\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadGroups(file); }, {"line 1", "\"night\""}));
  WriteFile(file, "a day\nb day\na night\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadGroups(file); }, {"line 3: name: \"a\""}));
}

}  // namespace
}  // namespace raylift
