#include <map>
#include <set>
#include <tuple>

#include "job_runs.h"
#include "program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::Not;

std::set<std::string> FindingsOf(const nlohmann::json& comparison, const std::string& source) {
  std::set<std::string> names;
  for (const auto& entry : comparison["sources"]) {
    if (entry["name"] != source) continue;
    for (const auto& finding : entry["findings"]) names.insert(finding["distortion"]);
  }
  return names;
}

TEST(Compare, NamesAPlantedScaleAndWritesAllItsTables) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const std::string mesh = "mesh:" + scene.mesh().string();
  const fs::path worse = scene.folder / "worse", out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift({"perturb", "--model", scene.model(), "--geometry", mesh, "--out",
                                   worse, "--scale", "0.9", "--quiet"})));
  const CommandResult result = RunRaylift(
      {"compare", "--model", scene.model(), "--geometry", "mesh=" + mesh, "--geometry",
       "worse=depth:" + worse.string(), "--truth", "mesh", "--max-side", "160", "--out", out});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_THAT(result.out, ::testing::HasSubstr("worse: scale: depth is 10.0 % too small"));
  EXPECT_EQ(FilesBelow(out),
            (std::vector<std::string>{"comparison.json", "curves.csv", "images.csv",
                                      "manifest.jsonl", "options.json", "sources.csv"}));
  const auto json = nlohmann::json::parse(ReadFile(out / "comparison.json"));
  EXPECT_NEAR(json["sources"][1]["means"]["abs_rel"].get<double>(), 0.1, 1e-3);
  EXPECT_EQ(Lines(ReadFile(out / "images.csv")).size(), 1 + 2 * scene.references.size());
}

// What perturb misaligns compare names, with its size.
TEST(Compare, NamesPlantedMisalignments) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const std::string mesh = "mesh:" + scene.mesh().string();
  const std::vector<std::tuple<std::string, Arguments, std::string>> planted = {
      {"shift", {"--shift", "3,0"}, "shift: shift: maps lie 3.0, 0.0 px off"},
      {"zoom", {"--zoom", "1.03"}, "zoom: zoom: the focal length is 3.0 % too long"},
      {"rotation", {"--rotate", "0,1.5,0"}, "rotation: rotation: maps are turned by 0.0"},
      {"offset", {"--offset", "0.1"}, "offset: offset: depth is 0.1 units too large"},
      {"smooth", {"--smooth", "3"}, "smooth: smoothing: by 3.0 px"},
      {"bits", {"--quantize-bits", "6"}, ", 6.0 bits"},
      {"good", {}, "good: nothing to complain of"}};
  Arguments compare = {"compare", "--model", scene.model(), "--geometry", "mesh=" + mesh,
                       "--truth", "mesh",    "--overlaps",  "0"};
  for (const auto& [name, options, text] : planted) {
    ASSERT_TRUE(Succeeds(RunRaylift(Arguments{"perturb", "--model", scene.model(), "--geometry",
                                              mesh, "--out", scene.folder / name, "--quiet"} +
                                    options)));
    compare = compare + Arguments{"--geometry", name + "=depth:" + (scene.folder / name).string()};
  }
  const CommandResult result = RunRaylift(compare);
  ASSERT_TRUE(Succeeds(result));
  for (const auto& [name, options, text] : planted) {
    EXPECT_THAT(result.out, ::testing::HasSubstr(text)) << name;
  }
}

// Rows of papers' tables from files, as numpy makes them of the same files.
TEST(Compare, ProtocolsAreThoseOfNumpy) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path clean = scene.folder / "clean", worse = scene.folder / "worse";
  for (const auto& [folder, options] :
       {std::pair(clean, Arguments{}),
        std::pair(worse, Arguments{"--warp", "0.2", "--holes", "0.1", "--scale", "0.5"})}) {
    ASSERT_TRUE(Succeeds(
        RunRaylift(Arguments{"perturb", "--model", scene.model(), "--geometry",
                             "mesh:" + scene.mesh().string(), "--format", "npy", "--out", folder} +
                   options)));
  }
  const fs::path out = scene.folder / "out";
  const CommandResult result = RunRaylift(
      {"compare", "--model", scene.model(), "--geometry", "clean=depth:" + clean.string(),
       "--geometry", "worse=depth:" + worse.string(), "--truth", "clean", "--protocol",
       "metric,scale,affine-inverse", "--min-depth", "1", "--max-depth", "3.5", "--out", out});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_THAT(result.out, ::testing::HasSubstr("protocol affine-inverse: "));
  WriteFile(scene.folder / "rows.py", "folder = '" + scene.folder.string() + "'\n" + R"(
import glob
import numpy as np
rows = []
for path in sorted(glob.glob(folder + '/clean/**/*.npy', recursive=True)):
    t, e = (np.load(p).astype(float).ravel() for p in (path, path.replace('/clean/', '/worse/')))
    known = (t >= 1) & (t <= 3.5) & (e > 0)
    t, e = t[known], e[known]
    fit = np.polyfit(1 / e, 1 / t, 1)
    rows.append([])
    for z in (e, e * np.median(t) / np.median(e), 1 / np.maximum(np.polyval(fit, 1 / e), 1 / 3.5)):
        z = np.clip(z, 1, 3.5)
        rows[-1] += [np.mean(abs(z - t) / t), np.sqrt(np.mean((z - t) ** 2)),
                     100 * np.mean(np.maximum(z / t, t / z) < 1.25)]
print(' '.join(repr(float(x)) for x in np.mean(rows, axis=0)), end='')
)");
  const std::string printed = RunProgram("/usr/bin/python3 " + (scene.folder / "rows.py").string());
  const auto expected = SplitTokens(printed);
  ASSERT_EQ(expected.size(), 9u) << printed;
  const auto means =
      nlohmann::json::parse(ReadFile(out / "comparison.json"))["sources"][1]["means"];
  size_t next = 0;
  for (const std::string prefix : {"", "median_", "affine_inverse_"}) {
    for (const std::string key : {"abs_rel", "rmse", "delta1_percent"}) {
      const double number = *ParseDouble(expected[next++]);
      EXPECT_NEAR(means[prefix + key].get<double>(), number, 1e-5 * number) << prefix + key;
    }
  }
}

TEST(Compare, LocalizesWithEverySourceOnTheSameMatches) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  const CommandResult result =
      RunRaylift(Arguments{"compare", "--model", scene.model(), "--geometry",
                           "mesh=mesh:" + scene.mesh().string(), "--max-side", "64", "--overlaps",
                           "0", "--ground-truth", scene.truth(), "--methods",
                           "p3p,e5p1,adaptive:mult_inl,select:0.9", "--thresholds", "0.01,0.1",
                           "--filters", "off,auto", "--out", out} +
                 HlocMatches(scene));
  ASSERT_TRUE(Succeeds(result));
  const auto rows = nlohmann::json::parse(ReadFile(out / "localization.json"))["rows"];
  ASSERT_EQ(rows.size(), 9u);  // e5p1, 2 filters x 3 methods, 2 oracles
  for (const auto& row : rows) EXPECT_EQ(row["recalls"][0]["percent"], 100.0) << row["method"];
  EXPECT_EQ(Lines(ReadFile(out / "localization.csv")).size(), 10u);
}

TEST(Compare, AFinishedFolderIsReplacedOnlyWhereThatIsAskedFor) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  const Arguments compare = {
      "compare",    "--model", scene.model(), "--geometry", "mesh=mesh:" + scene.mesh().string(),
      "--max-side", "64",      "--overlaps",  "0",          "--out",
      out};
  // On a full disk nothing is finished.
  const CommandResult full = RunProcess(WithFullDisk(0, compare));
  EXPECT_EQ(full.exit_code, 5) << full.err;
  ASSERT_TRUE(Succeeds(RunRaylift(compare)));
  const std::string before = ReadFile(out / "sources.csv");
  EXPECT_TRUE(FailsWith(2, {"--overwrite", (out / "options.json").string()}, RunRaylift(compare)));
  ASSERT_TRUE(Succeeds(RunRaylift(compare + Arguments{"--overwrite"})));
  EXPECT_EQ(ReadFile(out / "sources.csv"), before);
}

// With tables and page.
class CompareJob : public ::testing::Test {
 protected:
  Arguments Compare(const fs::path& out, const Arguments& more = {}) const {
    return Arguments{"compare",
                     "--model",
                     demo_ / "model",
                     "--images",
                     demo_ / "images",
                     "--geometry",
                     "mesh=mesh:" + (demo_ / "scene.obj").string(),
                     "--queries",
                     demo_ / "queries.txt",
                     "--ground-truth",
                     demo_ / "ground_truth",
                     "--cache",
                     folder_ / "cache",
                     "--every",
                     "6",
                     "--max-features",
                     "300",
                     "--max-side",
                     "64",
                     "--quiet",
                     "--out",
                     out,
                     "--report",
                     out} +
           more;
  }

  static std::map<std::string, std::string> Contents(const fs::path& folder) {
    std::map<std::string, std::string> contents;
    for (const std::string& file : FilesBelow(folder)) {
      if (file != "options.json") contents[file] = ReadFile(folder / file);
    }
    return contents;
  }

  const fs::path demo_ = DemoFolder();
  fs::path folder_ = TestFolder();
};

TEST_F(CompareJob, InterruptedAtRandomItEndsWithTheSameBytes) {
  ASSERT_TRUE(Succeeds(RunRaylift(Compare(folder_ / "whole"))));
  const auto whole = Contents(folder_ / "whole");
  InterruptAtRandom({.command = [&](const fs::path& out) { return Compare(out, {"--resume"}); },
                     .tasks = 12,
                     .start_microseconds = 500'000,
                     .task_microseconds = 50'000,
                     .result = "localization.json",
                     .expect_whole = [&](const fs::path& out) { EXPECT_EQ(Contents(out), whole); }},
                    folder_, 4, TestRng());
}

TEST_F(CompareJob, AFolderThatCannotBeWrittenIsNamed) {
  const fs::path file = folder_ / "file";
  WriteFile(file, "in the way");
  EXPECT_TRUE(FailsWith(5, {file.string()}, RunRaylift(Compare(file / "out"))));
}

TEST_F(CompareJob, KeepsLocalizedQueriesWhereTheDiskIsFull) {
  const fs::path out = folder_ / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(Compare(folder_ / "whole"))));
  const size_t size = fs::file_size(folder_ / "whole" / "manifest.jsonl");
  const CommandResult full = RunProcess(WithFullDisk(size / 1024, Compare(out)));
  EXPECT_EQ(full.exit_code, 5) << full.err;
  EXPECT_GT(CountDone(out), 0u);
  EXPECT_FALSE(fs::exists(out / "options.json"));
  EXPECT_TRUE(FailsWith(2, {"former run"}, RunRaylift(Compare(out))));
  EXPECT_TRUE(FailsWith(3, {"options/seed: 0 there, 1 here"},
                        RunRaylift(Compare(out, {"--resume", "--seed", "1"}))));
  ASSERT_TRUE(Succeeds(RunRaylift(Compare(out, {"--resume"}))));
  EXPECT_EQ(Contents(out), Contents(folder_ / "whole"));
  EXPECT_TRUE(Succeeds(RunRaylift({"status", out})));
}

// The matches that hloc's files hold are of the same room.
TEST(Compare, MakesItsOwnMatchesFromImages) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const fs::path out = scene.folder / "out";
  const CommandResult result = RunRaylift({"compare",
                                           "--model",
                                           scene.model(),
                                           "--geometry",
                                           "mesh=mesh:" + scene.mesh().string(),
                                           "--max-side",
                                           "64",
                                           "--overlaps",
                                           "0",
                                           "--queries",
                                           scene.query_list(),
                                           "--images",
                                           scene.images(),
                                           "--ground-truth",
                                           scene.truth(),
                                           "--methods",
                                           "p3p,adaptive",
                                           "--thresholds",
                                           "0.02,0.3",
                                           "--out",
                                           out});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_TRUE(fs::exists(out / "cache" / "features.h5"));
  const auto rows = nlohmann::json::parse(ReadFile(out / "localization.json"))["rows"];
  ASSERT_EQ(rows.size(), 2u);
  // A pixel is about 0.2 degrees and 7 mm here; SIFT is good for a fraction of it.
  for (const auto& row : rows) EXPECT_EQ(row["recalls"][0]["percent"], 100.0) << row["method"];
  const auto source = nlohmann::json::parse(ReadFile(out / "comparison.json"))["sources"][0];
  EXPECT_LT(source["means"]["match_median_px"].get<double>(), 1);
}

TEST(Compare, BadOptionsAreTold) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const Arguments compare = {"compare", "--model", scene.model(), "--geometry",
                             "mesh=mesh:" + scene.mesh().string()};
  EXPECT_TRUE(FailsWith(2, {"--truth = other", "the name of a --geometry"},
                        RunRaylift(compare + Arguments{"--truth", "other"})));
  EXPECT_TRUE(FailsWith(2, {"--protocol = metric", "needs --truth"},
                        RunRaylift(compare + Arguments{"--protocol", "metric"})));
  EXPECT_TRUE(FailsWith(2, {"--max-depth = 0", "must be larger than the smallest"},
                        RunRaylift(compare + Arguments{"--max-depth", "0"})));
  EXPECT_TRUE(FailsWith(2, {"--geometry", "mesh stands twice"},
                        RunRaylift(compare + Arguments{"--geometry", "mesh=mesh:x.ply"})));
  EXPECT_TRUE(FailsWith(2, {"go together"},
                        RunRaylift(compare + Arguments{"--features", scene.features()})));
  EXPECT_TRUE(FailsWith(2, {"--queries", "needs --images, or hloc's"},
                        RunRaylift(compare + Arguments{"--queries", scene.query_list()})));
  EXPECT_TRUE(FailsWith(2, {"--queries", "needs --cache, --out or --report"},
                        RunRaylift(compare + Arguments{"--queries", scene.query_list(), "--images",
                                                       scene.images()})));
  EXPECT_TRUE(
      FailsWith(2, {"--methods = p4p: expected p3p|e5p1|d3p1|adaptive[:SCORE]|select[:ALPHA]|"},
                RunRaylift(compare + Arguments{"--methods", "p4p"})));
  for (const std::string text : {"", "p3p:1", "adaptive:best", "select:x"}) {
    EXPECT_TRUE(FailsWith(2, {"--methods = " + text + ": "},
                          RunRaylift(compare + Arguments{"--methods", text})));
  }
  EXPECT_TRUE(FailsWith(2, {"--alpha = -1: must not be negative"},
                        RunRaylift(compare + Arguments{"--methods", "p3p,select:-1"})));
  EXPECT_TRUE(FailsWith(2, {"--filters = all", "off|fixed|auto"},
                        RunRaylift(compare + Arguments{"--filters", "all"})));
}

// The real scene: simulated monocular depth, sensor depth, and planted distortions.
TEST(Compare, NamesWhatIsWrongWithRealDepth) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const fs::path folder = TestFolder();
  const std::string model = *data / "model_ref", every = "5";
  const std::string sensor = "depth:" + (*data / "depth_sensor").string() + ",unit=mm";
  const std::vector<std::pair<std::string, Arguments>> planted = {{"scaled", {"--scale", "1.1"}},
                                                                  {"warped", {"--warp", "0.06"}},
                                                                  {"holes", {"--holes", "0.3"}}};
  Arguments compare = {"compare",
                       "--model",
                       model,
                       "--every",
                       every,
                       "--geometry",
                       "mesh=mesh:" + (*data / "mesh.ply").string(),
                       "--geometry",
                       "sensor=" + sensor,
                       "--geometry",
                       "mono=depth:" + (*data / "depth_mono_sim").string(),
                       "--truth",
                       "mesh",
                       "--max-side",
                       "320",
                       "--out",
                       folder / "out"};
  for (const auto& [name, options] : planted) {
    ASSERT_TRUE(
        Succeeds(RunRaylift(Arguments{"perturb", "--model", model, "--every", every, "--geometry",
                                      sensor, "--out", folder / name, "--quiet"} +
                            options)));
    compare = compare + Arguments{"--geometry", name + "=depth:" + (folder / name).string()};
  }
  ASSERT_TRUE(Succeeds(RunRaylift(compare)));
  const auto json = nlohmann::json::parse(ReadFile(folder / "out" / "comparison.json"));
  EXPECT_THAT(FindingsOf(json, "scaled"), Contains("scale"));
  EXPECT_THAT(FindingsOf(json, "sensor"), Not(Contains("scale")));
  EXPECT_THAT(FindingsOf(json, "warped"), Contains("warp"));
  EXPECT_THAT(FindingsOf(json, "sensor"), Not(Contains("warp")));
  EXPECT_THAT(FindingsOf(json, "holes"), Contains("holes"));
  EXPECT_THAT(FindingsOf(json, "mono"), Contains("per-image scale"));
  EXPECT_THAT(FindingsOf(json, "mono"), Contains("warp"));
  std::map<std::string, double> abs_rel;
  for (const auto& source : json["sources"]) {
    if (!source["is_truth"]) abs_rel[source["name"]] = source["means"]["abs_rel"];
  }
  EXPECT_LT(abs_rel["sensor"], abs_rel["warped"]);
  EXPECT_LT(abs_rel["warped"], abs_rel["mono"]);
  EXPECT_LT(abs_rel["mono"], abs_rel["scaled"]);
}

}  // namespace
}  // namespace raylift
