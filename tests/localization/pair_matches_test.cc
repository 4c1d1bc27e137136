#include <map>
#include <optional>

#include "io/depth/depth_formats.h"
#include "localization/matching/file_matches.h"
#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using Rows = std::vector<std::array<double, 4>>;

void WriteRows(const fs::path& file, const Rows& rows) {
  std::string bytes = NpyHeaderBytes("<f8", fmt::format("({}, 4)", rows.size()));
  bytes.append(reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(rows[0]));
  WriteFile(file, bytes);
}

std::vector<std::string> NamesOf(const QueryMatches& matches) {
  std::vector<std::string> names;
  for (const PosedImage& image : matches.references) names.push_back(image.name);
  return names;
}

class PairFolder : public ::testing::Test {
 protected:
  std::unique_ptr<MatchSource> Open(const MatchReading& reading = {}, int top_k = 10,
                                    const fs::path& pairs = {}, int every = 1) const {
    return OpenPairMatches(folder_, pairs,
                           LoadReferences(scene_.model(), {.every = every}).references, top_k, {},
                           reading);
  }
  QueryMatches Match(const MatchReading& reading = {}) const {
    return Open(reading)->Match(QueryA());
  }
  Query QueryA() const { return {scene_.queries[0].name, scene_.queries[0].camera}; }
  // So many matches, each of another query pixel.
  void WriteMany(const std::string& file, int count) const {
    Rows rows;
    for (int i = 0; i < count; ++i) rows.push_back({10.0 + i, 20, 30.0 + i, 40});
    WriteRows(folder_ / file, rows);
  }

  const RoomScene scene_ = WriteRoomScene(TestFolder());
  const fs::path folder_ = scene_.folder / "pairs";
};

TEST_F(PairFolder, HoldsTheSameMatchesAsHlocsFiles) {
  const auto references = LoadReferences(scene_.model()).references;
  const QueryMatches expected =
      OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()}, references, 10)
          ->Match(QueryA());
  std::map<int, Rows> rows;
  for (const Match2D2D& match : expected.matches) {
    rows[match.reference].push_back({match.query_px.x() - 0.5, match.query_px.y() - 0.5,
                                     match.reference_px.x() - 0.5, match.reference_px.y() - 0.5});
  }
  for (const auto& [reference, of_pair] : rows) {
    const std::string stem =
        fs::path(expected.references[static_cast<size_t>(reference)].name).stem().string();
    WriteRows(folder_ / ("query-a.png__ref-" + stem + ".png.npy"), of_pair);
  }
  const QueryMatches read = Open({}, 10, scene_.pairs())->Match(QueryA());
  EXPECT_EQ(NamesOf(read), NamesOf(expected));
  ASSERT_EQ(read.matches.size(), expected.matches.size());
  // Keypoints are the same, whatever their numbers.
  std::map<int, int> number_of_keypoint;
  for (size_t i = 0; i < read.matches.size(); ++i) {
    EXPECT_EQ(read.matches[i].reference, expected.matches[i].reference);
    EXPECT_EQ(read.matches[i].query_px, expected.matches[i].query_px);
    EXPECT_EQ(read.matches[i].reference_px, expected.matches[i].reference_px);
    const int number = read.matches[i].query_keypoint.value();
    const auto known =
        number_of_keypoint.emplace(expected.matches[i].query_keypoint.value(), number).first;
    EXPECT_EQ(known->second, number);
  }
  EXPECT_LT(number_of_keypoint.size(), read.matches.size());
}

TEST_F(PairFolder, FilesAreCalledAfterTheirPairInManyWays) {
  for (const char* name : {"query-a.png__ref-00.png.npy", "query_a__ref_00.npy", "a__00.npy",
                           "a_00_matches.npy", "a.png_-_00.png.npy", "query/a.png/ref/00.png.npy",
                           "query-a.png/ref-00.png.npy", "00__a.npy"}) {
    fs::remove_all(folder_);
    const bool reference_first = std::string_view(name) == "00__a.npy";
    WriteRows(folder_ / name, {reference_first ? std::array<double, 4>{3, 4, 1, 2}
                                               : std::array<double, 4>{1, 2, 3, 4}});
    const QueryMatches matches = Match();
    ASSERT_THAT(NamesOf(matches), ElementsAre("ref/00.png")) << name;
    ASSERT_EQ(matches.matches.size(), 1u);
    EXPECT_EQ(matches.matches[0].query_px, Eigen::Vector2d(1.5, 2.5)) << name;
    EXPECT_EQ(matches.matches[0].reference_px, Eigen::Vector2d(3.5, 4.5)) << name;
  }
}

TEST_F(PairFolder, AListSaysWhichFileIsOfWhichPair) {
  WriteMany("x/1.npy", 1);
  WriteMany("2.npy", 2);
  WriteFile(folder_ / "pairs.txt",
            "query/a.png ref/03.png x/1.npy\n# comment\nquery/a.png ref/01.png 2.npy\n");
  EXPECT_THAT(NamesOf(Match()), ElementsAre("ref/03.png", "ref/01.png"));
  EXPECT_EQ(Match().matches.size(), 3u);
  WriteFile(folder_ / "pairs.txt", "query/a.png ref/03.png x/1.npy\nquery/a.png ref/01.png\n");
  EXPECT_TRUE(FailsWithInputError([&] { Open(); }, {"pairs.txt", "line 2"}));
  WriteFile(folder_ / "pairs.txt", "query/a.png ref/99.png x/1.npy\n");
  EXPECT_TRUE(FailsWithInputError([&] { Open(); }, {"pairs.txt", "ref/99.png"}));
}

TEST_F(PairFolder, ReferencesAreRankedByTheListOrByTheirMatches) {
  WriteMany("a__00.npy", 1);
  WriteMany("a__01.npy", 3);
  WriteMany("a__02.npy", 2);
  EXPECT_THAT(NamesOf(Match()), ElementsAre("ref/01.png", "ref/02.png", "ref/00.png"));
  EXPECT_THAT(NamesOf(Open({}, 2)->Match(QueryA())), ElementsAre("ref/01.png", "ref/02.png"));
  // Thinned out is the second of two.
  EXPECT_THAT(NamesOf(Open({}, 2, {}, 2)->Match(QueryA())),
              ElementsAre("ref/02.png", "ref/00.png"));
  WriteFile(folder_ / "pairs.txt", "query/a.png ref/02.png\nquery/a.png ref/04.png\n");
  const auto source = Open();
  EXPECT_THAT(NamesOf(source->Match(QueryA())), ElementsAre("ref/02.png", "ref/04.png"));
  EXPECT_THAT(source->Warnings(),
              ElementsAre(HasSubstr("no matches of query/a.png with ref/04.png")));
  EXPECT_THAT(source->Match({"query/unknown.png", QueryA().camera}).references, IsEmpty());
}

TEST_F(PairFolder, EqualPixelsOrThoseOfACellAreOneKeypoint) {
  WriteRows(folder_ / "a__00.npy", {{10, 20, 1, 1}, {10.4, 20, 2, 2}, {13, 20, 1, 1}});
  WriteRows(folder_ / "a__01.npy", {{10, 20, 5, 5}});
  const auto keypoints = [&](const MatchReading& reading) {
    std::vector<int> of_query;
    for (const Match2D2D& match : Match(reading).matches) {
      of_query.push_back(match.query_keypoint.value());
    }
    return of_query;
  };
  EXPECT_THAT(keypoints({}), ElementsAre(0, 1, 2, 0));
  EXPECT_THAT(keypoints({.cell_px = 2}), ElementsAre(0, 0, 1, 0));
  EXPECT_EQ(Match().matches[0].reference_keypoint, Match().matches[2].reference_keypoint);
  EXPECT_THROW(Match({.cell_px = -1}), OptionError);
  EXPECT_THROW(Match({.first_pixel = 2}), OptionError);
}

TEST_F(PairFolder, ScoresBelowTheLeastAreLeftOut) {
  const std::vector<std::array<double, 5>> rows = {{1, 2, 3, 4, 0.2}, {5, 6, 7, 8, 0.5}};
  std::string bytes = NpyHeaderBytes("<f8", "(2, 5)");
  bytes.append(reinterpret_cast<const char*>(rows.data()), sizeof(rows[0]) * 2);
  WriteFile(folder_ / "a__00.npy", bytes);
  EXPECT_EQ(Match().matches.size(), 2u);
  const QueryMatches best = Match({.min_score = 0.5});
  ASSERT_EQ(best.matches.size(), 1u);
  EXPECT_EQ(best.matches[0].query_px, Eigen::Vector2d(5.5, 6.5));
}

TEST_F(PairFolder, HlocsScoresAreUsed) {
  const auto references = LoadReferences(scene_.model()).references;
  const HlocFiles files = {scene_.features(), scene_.matches(), scene_.pairs()};
  const auto count = [&](double min_score) {
    return OpenHlocMatches(files, references, 10, {}, {.min_score = min_score})
        ->Match(QueryA())
        .matches.size();
  };
  EXPECT_GT(count(0), 0u);
  EXPECT_EQ(count(1.5), 0u);  // there is none above 1
}

TEST_F(PairFolder, PixelsOutsideOfTheirImageAreLeftOutOrRefused) {
  const double w = QueryA().camera.width_px();
  // The center of the last pixel is at w - 1 by first_pixel 0, and the margin of some matchers
  // beyond.
  WriteRows(folder_ / "a__00.npy", {{w - 1, 2, 3, 4}, {w + 7, 2, 3, 4}, {5, 6, 7, 8}});
  const auto source = Open();
  EXPECT_EQ(source->Match(QueryA()).matches.size(), 2u);
  EXPECT_THAT(source->Warnings(), ElementsAre(HasSubstr("outside of their images")));
  WriteRows(folder_ / "a__00.npy", {{2 * w, 2, 3, 4}, {3 * w, 2, 3, 4}, {5, 6, 7, 8}});
  EXPECT_TRUE(
      FailsWithInputError([&] { Match(); }, {"a__00.npy", "2 of 3", "query/a.png", "resized"}));
}

TEST_F(PairFolder, WhatCouldBeOfTwoPairsIsRefused) {
  WriteMany("a__00.npy", 1);
  const auto source = Open();
  source->Match(QueryA());
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        source->Match({"night/a.png", QueryA().camera});
      },
      {"a__00.npy", "night/a.png", "query/a.png", "pairs.txt"}));
  // Whoever is called by more of its name goes first.
  WriteMany("night-a__00.npy", 2);
  const auto both = Open();
  EXPECT_EQ(both->Match(QueryA()).matches.size(), 1u);
  EXPECT_EQ(both->Match({"night/a.png", QueryA().camera}).matches.size(), 2u);

  ReferenceSet references = LoadReferences(scene_.model()).references;
  references.images.push_back(references.images[0]);
  references.images.back().name = "other/00.png";
  EXPECT_TRUE(
      FailsWithInputError([&] { OpenPairMatches(folder_, {}, references, 10)->Match(QueryA()); },
                          {"a__00.npy", "other/00.png", "ref/00.png"}));
}

TEST_F(PairFolder, AFolderOfSomethingElseIsNamed) {
  WriteFile(folder_ / "readme.txt", "no matches");
  EXPECT_TRUE(FailsWithInputError([&] { Open(); },
                                  {folder_.string(), "6 references", "QUERY__ref-00.png.npz"}));
}

}  // namespace
}  // namespace raylift
