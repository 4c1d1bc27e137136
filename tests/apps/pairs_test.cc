// pairs, and retrieval in localize: the program around the library's.

#include <algorithm>

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class Pairs : public ::testing::Test {
 protected:
  Arguments Command(const Arguments& more) const {
    return Arguments{"pairs", "--model", scene_.model(), "--out", out_} + more;
  }
  // One-hot descriptors: query a is like reference 4 and then 2, query b like no other.
  void WriteGlobal(const std::vector<std::string>& without = {}) const {
    std::vector<std::string> names;
    for (const auto* images : {&scene_.queries, &scene_.references}) {
      for (const PosedImage& image : *images) {
        if (std::find(without.begin(), without.end(), image.name) == without.end()) {
          names.push_back(image.name);
        }
      }
    }
    std::sort(names.begin(), names.end());
    Eigen::MatrixXf descriptors =
        Eigen::MatrixXf::Identity(8, static_cast<Eigen::Index>(names.size()));
    for (size_t i = 0; i < names.size(); ++i) {
      if (names[i] == "ref/04.png") descriptors(0, static_cast<Eigen::Index>(i)) = 2;
      if (names[i] == "ref/02.png") descriptors(0, static_cast<Eigen::Index>(i)) = 1;
      if (names[i] == "ref/03.png") descriptors(0, static_cast<Eigen::Index>(i)) = -1;
    }
    WriteGlobalDescriptors(global_, names, descriptors);
  }

  RoomScene scene_ = WriteRoomScene(TestFolder());
  fs::path out_ = scene_.folder / "made_pairs.txt";
  fs::path global_ = scene_.folder / "global.h5";
};

TEST_F(Pairs, OfQueriesByGlobalFeatures) {
  WriteGlobal();
  const CommandResult result =
      RunRaylift(Command({"--queries", scene_.query_list(), "--global-features", global_, "--top-k",
                          "3", "--scores", scene_.folder / "scores.txt"}));
  EXPECT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("6 pairs of 2 queries with 6 references by global"), std::string::npos)
      << result.out;
  const RetrievalPairs pairs = ReadPairs(out_);
  EXPECT_EQ(pairs.at("query/a.png"),
            (std::vector<std::string>{"ref/04.png", "ref/02.png", "ref/00.png"}));
  EXPECT_EQ(pairs.at("query/b.png"),
            (std::vector<std::string>{"ref/00.png", "ref/01.png", "ref/02.png"}));
  EXPECT_EQ(ReadPairs(scene_.folder / "scores.txt"), pairs);
  EXPECT_EQ(Lines(ReadFile(scene_.folder / "scores.txt")).at(0), "query/a.png, ref/04.png, 2");
}

TEST_F(Pairs, OfReferencesByPoseOverlapAndGlobalFeatures) {
  WriteGlobal();
  const std::string mesh = "mesh:" + scene_.mesh().string();
  for (const Arguments& method :
       {Arguments{"--retrieval", "pose"}, Arguments{"--retrieval", "pose", "--view-range", "0.5,6"},
        Arguments{"--retrieval", "overlap", "--geometry", mesh},
        Arguments{"--retrieval", "global", "--global-features", global_}}) {
    ASSERT_TRUE(Succeeds(RunRaylift(Command({"--top-k", "2"}) + method)));
    const std::string one = ReadFile(out_);
    const RetrievalPairs pairs = ReadPairs(out_);
    EXPECT_EQ(pairs.size(), scene_.references.size());
    for (const auto& [query, references] : pairs) {
      EXPECT_LE(references.size(), 2u);
      EXPECT_EQ(std::count(references.begin(), references.end(), query), 0);
    }
    ASSERT_TRUE(Succeeds(RunRaylift(Command({"--top-k", "2", "--threads", "3"}) + method)));
    EXPECT_EQ(ReadFile(out_), one);
  }
}

TEST_F(Pairs, OptionsThatDoNotFitAreRefused) {
  WriteGlobal();
  const auto refuses = [&](const Arguments& arguments, const std::vector<std::string>& parts) {
    return FailsWith(2, parts, RunRaylift(Command(arguments)));
  };
  EXPECT_TRUE(refuses({"--retrieval", "bow"}, {"--retrieval = bow", "vlad|global|pose"}));
  EXPECT_TRUE(refuses({"--retrieval", "global"}, {"needs --global-features"}));
  EXPECT_TRUE(refuses({"--retrieval", "pose", "--global-features", global_},
                      {"--global-features goes with --retrieval global, not pose"}));
  EXPECT_TRUE(refuses({"--retrieval", "overlap"}, {"needs --geometry mesh:PATH"}));
  EXPECT_TRUE(refuses({"--retrieval", "pose", "--queries", scene_.query_list()},
                      {"--retrieval pose needs --prior-poses"}));
  EXPECT_TRUE(
      refuses({"--retrieval", "pose", "--view-range", "3,2"}, {"--view-range", "NEAR,FAR"}));
  EXPECT_TRUE(refuses({"--retrieval", "pose", "--max-angle-deg", "0"}, {"--max-angle-deg = 0"}));
  EXPECT_TRUE(refuses({}, {"--retrieval vlad needs --images"}));
}

TEST_F(Pairs, InputThatDoesNotFitIsNamed) {
  WriteGlobal({"ref/05.png"});
  EXPECT_TRUE(FailsWith(3, {"global.h5: ref/05.png/global_descriptor: is not in the file"},
                        RunRaylift(Command({"--global-features", global_}))));
  EXPECT_TRUE(FailsWith(3, {"observe no points of the model"},
                        RunRaylift(Command({"--retrieval", "covisibility"}))));
  EXPECT_FALSE(fs::exists(out_));
}

TEST(LocalizeRetrieval, TakesTheReferencesThatItIsTold) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const fs::path out = scene.folder / "out";
  const Arguments command = LocalizeFromImages(scene, out) + Arguments{"--top-k", "4"};
  EXPECT_TRUE(Succeeds(
      RunRaylift(command + Arguments{"--retrieval", "overlap", "--prior-poses", scene.truth()})));
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene.queries, 0.3, 0.02));
  const RetrievalPairs pairs = ReadPairs(out / "cache" / "pairs.txt");
  EXPECT_EQ(pairs.at("query/a.png").size(), 4u);
  const std::string options = ReadFile(out / "options.json");
  EXPECT_NE(options.find("\"retrieval\": \"overlap\""), std::string::npos);

  // hloc's way to the same: the pairs made apart.
  ASSERT_TRUE(Succeeds(RunRaylift({"pairs", "--model", scene.model(), "--queries",
                                   scene.query_list(), "--retrieval", "overlap", "--prior-poses",
                                   scene.truth(), "--geometry", "mesh:" + scene.mesh().string(),
                                   "--top-k", "4", "--out", scene.folder / "made_pairs.txt"})));
  EXPECT_EQ(ReadFile(scene.folder / "made_pairs.txt"), ReadFile(out / "cache" / "pairs.txt"));

  EXPECT_TRUE(FailsWith(2, {"--retrieval = covisibility"},
                        RunRaylift(command + Arguments{"--retrieval", "covisibility"})));
  EXPECT_TRUE(FailsWith(2, {"--retrieval pose needs --prior-poses"},
                        RunRaylift(command + Arguments{"--retrieval", "pose"})));
}

TEST(PairsOfPictures, OfAFolderThatIsCalledAlmostAsTheParent) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const fs::path odd = scene.images() / "..odd", out = scene.folder / "made_pairs.txt";
  fs::rename(scene.images() / "query", odd);
  EXPECT_TRUE(Succeeds(RunRaylift({"pairs", "--model", scene.model(), "--images", scene.images(),
                                   "--queries", odd, "--out", out})));
  EXPECT_TRUE(ReadPairs(out).contains("..odd/a.png"));
}

TEST(LocalizeRetrieval, HasNoUseBesidePairs) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  EXPECT_TRUE(FailsWith(2, {"--pairs = ", "names the references"},
                        RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                   Arguments{"--retrieval", "vlad"})));
}

}  // namespace
}  // namespace raylift
