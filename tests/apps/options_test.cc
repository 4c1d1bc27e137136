// Options, help and exit codes.

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

void ExpectHelpLists(const std::string& command, const std::vector<std::string>& options) {
  const CommandResult result = RunRaylift({command, "--help"});
  EXPECT_TRUE(Succeeds(result));
  for (const std::string& option : options) {
    EXPECT_NE(result.out.find("\n  " + option + " "), std::string::npos)
        << command << " " << option;
  }
  EXPECT_NE(result.out.find("Example"), std::string::npos) << command;
}

const std::vector<std::string> kEstimatorOptions = {"--method",
                                                    "--score",
                                                    "--lo",
                                                    "--alpha",
                                                    "--reprojection-threshold-px",
                                                    "--sampson-threshold-px",
                                                    "--min-iterations",
                                                    "--max-iterations",
                                                    "--confidence",
                                                    "--seed"};

TEST(Options, VersionIsOneLine) {
  const CommandResult result = RunRaylift({"--version"});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_TRUE(result.out.starts_with("raylift ")) << result.out;
  EXPECT_EQ(Lines(result.out).size(), 1u);
}

TEST(Options, VersionTellsWhatItRunsWithIfAsked) {
  const CommandResult result = RunRaylift({"--version", "--verbose"});
  EXPECT_TRUE(Succeeds(result));
  for (const std::string part : {"raylift ", "compiled by ", "Eigen 3", "libembree",
                                 "libopencv_core", "libOpenEXR", "libassimp", "libtbb"}) {
    EXPECT_NE(result.out.find(part), std::string::npos) << part << " in " << result.out;
  }
}

TEST(Options, AnotherOptionIsNoValue) {
  const CommandResult result = RunRaylift({"localize", "--out", "--quiet", "--model", "m"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("--out needs a value, found --quiet"), std::string::npos) << result.err;
  // A folder may have any name.
  const CommandResult given = RunRaylift({"localize", "--out=--quiet", "--model", "m"});
  EXPECT_EQ(given.err.find("needs a value, found"), std::string::npos) << given.err;
}

TEST(Options, HelpNamesTheCommands) {
  const CommandResult result = RunRaylift({"--help"});
  EXPECT_TRUE(Succeeds(result));
  for (const std::string command : {"localize", "estimate", "evaluate"}) {
    EXPECT_NE(result.out.find("\n  " + command + " "), std::string::npos) << command;
  }
  // Each job with what to type for it, within the width of a terminal.
  const std::vector<std::string> lines = Lines(result.out);
  for (const std::string command : {"localize", "compare", "render"}) {
    EXPECT_NE(result.out.find("\n    raylift " + command + " "), std::string::npos) << command;
  }
  for (const std::string& line : lines) EXPECT_LE(line.size(), 110u) << line;
}

TEST(Options, ManPagesNameWhatHelpNames) {
  const std::filesystem::path folder = TestFolder() / "man1";
  EXPECT_TRUE(Succeeds(RunRaylift({"--man-pages", folder})));
  const std::string program = ReadFile(folder / "raylift.1");
  for (const std::string command :
       {"localize", "estimate", "render", "compare", "status", "serve"}) {
    EXPECT_NE(program.find("raylift\\-" + command), std::string::npos);
    const std::string page = ReadFile(folder / ("raylift-" + command + ".1"));
    EXPECT_TRUE(page.starts_with(".TH RAYLIFT-"));
    for (const std::string& line : Lines(RunRaylift({command, "--help"}).out)) {
      if (!line.starts_with("  --")) continue;
      std::string name;
      for (const char c : line.substr(2, line.find_first_of(" ,{", 2) - 2)) {
        name += c == '-' ? "\\-" : std::string(1, c);
      }
      EXPECT_NE(page.find("\\fB" + name), std::string::npos) << command << " " << name;
    }
  }
}

TEST(Options, HelpOfACommandListsItsOptions) {
  ExpectHelpLists("localize", {"--model",
                               "--images",
                               "--every",
                               "--geometry",
                               "--queries",
                               "--query-images",
                               "--features",
                               "--matches",
                               "--pairs",
                               "--top-k",
                               "--filter",
                               "--filter-reprojection-px",
                               "--filter-min-views",
                               "--filter-min-ratio",
                               "--out",
                               "--threads",
                               "--quiet",
                               "--config",
                               "--write-problems",
                               "--resume",
                               "--overwrite",
                               "--shard",
                               "--pictures"});
  ExpectHelpLists("localize", kEstimatorOptions);
  ExpectHelpLists("estimate", {"--csv", "--poses", "--threads", "--quiet", "--config"});
  ExpectHelpLists("estimate", kEstimatorOptions);
  ExpectHelpLists("status", {"OUT", "--config"});
  ExpectHelpLists("merge", {"OUT", "PART", "--config"});
  ExpectHelpLists("verify", {"OUT", "--threads", "--quiet", "--config"});
  ExpectHelpLists("evaluate", {"--ground-truth", "--poses", "--names", "--thresholds", "--json",
                               "--csv", "--quiet", "--config"});
}

TEST(Options, HelpNeedsNoOtherOption) {
  EXPECT_EQ(RunRaylift({"localize", "--model", "nowhere", "--help"}).exit_code, 0);
}

TEST(Options, NoCommandOrAnUnknownOneExitsWith2) {
  EXPECT_TRUE(FailsWith(2, {"subcommand"}, RunRaylift({})));
  EXPECT_TRUE(FailsWith(2, {"localise"}, RunRaylift({"localise"})));
}

TEST(Options, TyposGetAHint) {
  const Arguments render = {"render", "--geometry", "mesh:m", "--model", "m", "--out", "o"};
  EXPECT_TRUE(FailsWith(2, {"did you mean localize?"}, RunRaylift({"localise"})));
  EXPECT_TRUE(FailsWith(2, {"--shrad", "did you mean --shard?"},
                        RunRaylift(render + Arguments{"--shrad", "1/2"})));
  EXPECT_TRUE(FailsWith(2, {"--prducts", "did you mean --products?"},
                        RunRaylift(render + Arguments{"--prducts=depth"})));
  EXPECT_TRUE(FailsWith(2, {"colour", "did you mean color?"},
                        RunRaylift(render + Arguments{"--products", "depth,colour"})));
  EXPECT_TRUE(
      FailsWith(2, {"did you mean unlit?"}, RunRaylift(render + Arguments{"--shading", "unlti"})));
  const CommandResult far = RunRaylift(render + Arguments{"--frobnicate"});
  EXPECT_EQ(far.err.find("did you mean"), std::string::npos) << far.err;
}

TEST(Options, UnknownOptionsAreNamedBeforeMissingOnes) {
  EXPECT_TRUE(FailsWith(2, {"--modle"}, RunRaylift({"localize", "--modle", "sfm"})));
  EXPECT_TRUE(FailsWith(2, {"--out"}, RunRaylift({"localize", "--queries", "q.txt"})));
  EXPECT_TRUE(FailsWith(2, {"--top-k"}, RunRaylift({"estimate", "x", "--top-k", "3"})));
  EXPECT_TRUE(FailsWith(2, {"problems"}, RunRaylift({"estimate"})));
}

TEST(Options, ValuesOutOfTheirRangeExitWith2AndTheOptionsName) {
  const std::vector<std::vector<std::string>> options = {{"--method", "foo"},
                                                         {"--score", "foo"},
                                                         {"--lo", "foo"},
                                                         {"--alpha", "nan"},
                                                         {"--alpha", "-1"},
                                                         {"--alpha", "one"},
                                                         {"--seed", "-1"},
                                                         {"--seed", "1.5"},
                                                         {"--threads", "-2"},
                                                         {"--threads", "abc"},
                                                         {"--reprojection-threshold-px", "0"},
                                                         {"--sampson-threshold-px", "inf"},
                                                         {"--min-iterations", "1e3"},
                                                         {"--max-iterations", "99999999999"},
                                                         {"--max-iterations", "0"},
                                                         {"--confidence", "1.5"},
                                                         {"--confidence", ""}};
  for (const auto& option : options) {
    EXPECT_TRUE(
        FailsWith(2, {option[0]}, RunRaylift({"estimate", "x", option[0] + "=" + option[1]})))
        << option[0] << " " << option[1];
  }
}

// "--option = value: " of a message, or the whole of it.
void ExpectNamed(const Arguments& base, const std::vector<std::pair<std::string, std::string>>& bad,
                 const std::string& constraint = "must be") {
  for (const auto& [option, value] : bad) {
    EXPECT_TRUE(FailsWith(2, {"raylift: " + option + " = " + value, ": " + constraint},
                          RunRaylift(base + Arguments{option + "=" + value})))
        << option;
  }
}

TEST(Options, FieldsOfTheLibraryAreCalledByTheirOptions) {
  const Arguments estimate = {"estimate", "x"};
  ExpectNamed(estimate, {{"--reprojection-threshold-px", "-1"},
                         {"--filter-reprojection-px", "0"},
                         {"--filter-min-views", "0"},
                         {"--filter-min-ratio", "2"}});
  ExpectNamed(estimate, {{"--alpha", "-1"}, {"--point-sigma", "-0.5"}}, "must not be negative");
  ExpectNamed(estimate, {{"--max-iterations", "7"}}, "must not be below --min-iterations = 100\n");
  const Arguments localize = {"localize", "--model",    "m",          "--queries",
                              "q",        "--out",      "o",          "--images",
                              "i",        "--geometry", "mesh:x.ply", "--continuous"};
  ExpectNamed(localize, {{"--candidates-error-px", "0"},
                         {"--candidates-min-angle-deg", "90"},
                         {"--join-max-rotation-sigma-deg", "0"},
                         {"--join-max-position-sigma", "0"},
                         {"--join-max-difference-deg", "0"},
                         {"--join-max-difference-position", "0"}});
  ExpectNamed(localize, {{"--join-min-inliers-2d2d", "-1"}, {"--join-min-inliers-2d3d", "-1"}},
              "must not be negative");
  const Arguments perturb = {"perturb", "--model", "m", "--geometry", "mesh:x.ply", "--out", "o"};
  ExpectNamed(perturb, {{"--scale", "0"},
                        {"--scale-sigma", "-1"},
                        {"--warp", "-1"},
                        {"--bubbles", "-1"},
                        {"--bubble-height", "2"},
                        {"--floaters", "-1"},
                        {"--flying", "2"},
                        {"--noise", "-1"},
                        {"--relative-noise", "-1"},
                        {"--quantize", "-1"},
                        {"--holes", "2"}});
  ExpectNamed({"render", "--model", "m", "--geometry", "mesh:x.ply", "--out", "o"},
              {{"--shard", "3/2"}}, "expected i/n");
  ExpectNamed({"evaluate", "--ground-truth", "g", "--poses", "p"}, {{"--thresholds", "1"}},
              "expected POSITION,DEGREES");
}

TEST(Options, AnOptionGivenTwiceIsAnError) {
  EXPECT_TRUE(
      FailsWith(2, {"--alpha"}, RunRaylift({"estimate", "x", "--alpha", "1", "--alpha", "2"})));
}

TEST(Options, NumbersAreDecimal) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--top-k", "010"})));
  EXPECT_NE(ReadFile(out / "options.json").find("\"top-k\": 10"), std::string::npos);
}

TEST(Options, LocalizeChecksWhatOptionsAloneCanTell) {
  const Arguments base = {"localize", "--model", "m", "--queries", "q", "--out", "o"};
  const auto fails = [&](const std::string& part, const Arguments& more) {
    return FailsWith(2, {part}, RunRaylift(base + more));
  };
  EXPECT_TRUE(fails("--geometry", {"--images", "i"}));
  EXPECT_TRUE(fails("--images", {"--method", "e5p1"}));
  EXPECT_TRUE(fails("--pairs", {"--method", "e5p1", "--features", "f", "--matches", "m"}));
  const Arguments complete = {"--images", "i", "--geometry", "mesh:x.ply"};
  EXPECT_TRUE(fails("--every", complete + Arguments{"--every", "0"}));
  EXPECT_TRUE(fails("--top-k", complete + Arguments{"--top-k", "0"}));
  EXPECT_TRUE(fails("--max-features", complete + Arguments{"--max-features", "-3"}));
  EXPECT_TRUE(fails("--max-ratio", complete + Arguments{"--max-ratio", "0"}));
  EXPECT_TRUE(fails("--max-ratio", complete + Arguments{"--max-ratio", "1.01"}));
  EXPECT_TRUE(fails("--pictures", complete + Arguments{"--pictures", "-1"}));
  EXPECT_TRUE(fails("--threads", complete + Arguments{"--threads", "-1"}));
  EXPECT_TRUE(fails("--align-depth", complete + Arguments{"--align-depth", "often"}));
  EXPECT_TRUE(fails("--filter", complete + Arguments{"--filter", "sometimes"}));
  EXPECT_TRUE(fails("--geometry-mode", complete + Arguments{"--geometry-mode", "last"}));
  EXPECT_TRUE(fails("--candidates", complete + Arguments{"--candidates", "mean"}));
  EXPECT_TRUE(fails("--candidates-error-px", complete + Arguments{"--candidates-error-px", "0"}));
  EXPECT_TRUE(fails("--candidates-min-angle-deg",
                    complete + Arguments{"--candidates-min-angle-deg", "90"}));
  EXPECT_TRUE(fails("stray", complete + Arguments{"stray"}));
}

TEST(Options, GeometryOfAnUnknownKindOrKeyExitsWith2) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  for (const std::string spec : {"voxels:x", "mesh", "mesh:room.ply,colour=red"}) {
    EXPECT_TRUE(FailsWith(
        2, {"--geometry"},
        RunRaylift({"localize", "--model", scene.model(), "--images", "i", "--queries",
                    scene.query_list(), "--out", scene.folder / "out", "--geometry", spec})))
        << spec;
  }
}

TEST(Options, EvaluateNamesBadThresholdsAndNames) {
  const Arguments base = {"evaluate", "--ground-truth", "g", "--poses", "p"};
  EXPECT_TRUE(FailsWith(2, {"--thresholds"}, RunRaylift(base + Arguments{"--thresholds", "1"})));
  EXPECT_TRUE(FailsWith(2, {"--names"}, RunRaylift(base + Arguments{"--names", "a", "b"})));
}

}  // namespace
}  // namespace raylift
