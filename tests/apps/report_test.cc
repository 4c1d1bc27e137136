// The report's page in a real browser: no errors, tables sort, the 3D view turns.

#include <algorithm>

#include "program.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

// Frames come by the clock: without a display a browser that is short of time makes none.
constexpr std::string_view kPrepare = R"html(<script>
window.found = { errors: [] };
window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
window.addEventListener("error", (event) => window.found.errors.push(event.message));
console.error = (...what) => window.found.errors.push(what.join(" "));
</script>)html";

constexpr std::string_view kProbe = R"html(<script>
setTimeout(() => {
  const found = window.found;
  found.ready = document.documentElement.dataset.ready;
  found.sections = [...document.querySelectorAll("section")].map((node) => node.id);
  found.wide = document.documentElement.scrollWidth > window.innerWidth;
  const table = document.querySelector("#images table, #localization table, #queries table, #readings table");
  const cells = (index) => [...table.querySelectorAll(`tbody tr td:nth-child(${index + 1})`)].map((cell) => parseFloat(cell.textContent));
  const buttons = [...table.querySelectorAll("th button")];
  const numeric = buttons.findIndex((_, index) => cells(index).every((value) => !isNaN(value)));
  const column = () => cells(numeric);
  const button = buttons[numeric];
  button.click();
  found.once = column();
  button.click();
  found.twice = column();
  const swipe = document.querySelector("input[aria-label=swipe]");
  if (swipe) {
    const clip = () => document.querySelector(".rendering").style.clipPath;
    const unmoved = clip();
    swipe.value = 20;
    swipe.dispatchEvent(new Event("input"));
    found.swiped = clip() !== unmoved && clip().includes("20%");
    found.marks = document.querySelectorAll(".photo .layer g").length;
    found.lines = document.querySelectorAll(".photo.pair line").length;
    const search = document.querySelector("input[type=search]");
    const lines = () => document.querySelectorAll("#queries tbody tr").length;
    const all = lines();
    search.value = document.querySelector("#queries tbody a").textContent;
    search.dispatchEvent(new Event("input"));
    found.searched = all > 1 && lines() === 1;
  }
  const images = document.querySelector("input[aria-label='search images']");
  if (images) {
    const rows = () => document.querySelectorAll("#images tbody tr").length;
    const all = rows();
    images.value = document.querySelector("#images tbody td").textContent;
    images.dispatchEvent(new Event("input"));
    found.searchedImages = all > 1 && rows() === 1;
  }
  const canvas = document.querySelector("canvas");
  const pixels = () => [...canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data].join();
  const before = pixels();
  const point = (type, x) => canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX: x, clientY: 50, bubbles: true }));
  canvas.setPointerCapture = () => {};
  point("pointerdown", 50); point("pointermove", 150); point("pointerup", 150);
  setTimeout(() => {
    found.turned = pixels() !== before;
    found.cutOff = [...document.querySelectorAll(".scroll")].filter((frame) =>
      frame.scrollWidth - frame.clientWidth > 4 && frame.nextElementSibling.hidden).length;
    const camera = canvas.view.cameras[canvas.view.cameras.length - 1];
    const scale = canvas.width / canvas.clientWidth;
    const [x, y] = canvas.view.project(camera.center);
    const frame = canvas.getBoundingClientRect();
    for (const type of ["pointerdown", "pointerup"]) {
      canvas.dispatchEvent(new PointerEvent(type,
        { pointerId: 2, clientX: frame.left + x / scale, clientY: frame.top + y / scale, bubbles: true }));
    }
    setTimeout(() => {
      found.flew = canvas.dataset.at !== undefined;
      const result = document.createElement("pre");
      result.id = "found";
      result.textContent = "FOUND" + JSON.stringify(found) + "END";
      document.body.append(result);
    }, 1500);
  }, 100);
}, 500);
</script>)html";

// Opens the page with a probe in it and returns what the probe found.
nlohmann::json Probe(const fs::path& page, int width_px) {
  std::string html = ReadFile(page);
  html.insert(html.find("<main"), kPrepare);
  html.insert(html.rfind("</body>"), kProbe);
  const fs::path probed = page.parent_path() / "probed.html";
  WriteFile(probed, html);
  const fs::path profile = page.parent_path() / "profile";
  const CommandResult result =
      RunProcess({"/usr/bin/chromium", "--headless=new", "--no-sandbox", "--disable-gpu",
                  "--disable-dev-shm-usage", "--user-data-dir=" + profile.string(),
                  "--window-size=" + std::to_string(width_px) + ",900",
                  "--virtual-time-budget=8000", "--dump-dom", "file://" + probed.string()});
  const size_t begin = result.out.rfind("FOUND{"), end = result.out.rfind("END");
  if (begin == std::string::npos || end == std::string::npos) {
    return {{"errors", {"the probe did not end: " + result.err}}};
  }
  std::string json = result.out.substr(begin + 5, end - begin - 5);
  for (size_t at = 0; (at = json.find("&amp;", at)) != std::string::npos;) json.erase(at + 1, 4);
  return nlohmann::json::parse(json);
}

void ExpectWorks(const nlohmann::json& found) {
  EXPECT_EQ(found["errors"], nlohmann::json::array());
  ASSERT_EQ(found.value("ready", ""), "true");
  EXPECT_FALSE(found["wide"]) << "the page is wider than the window";
  const auto once = found["once"].get<std::vector<double>>();
  auto twice = found["twice"].get<std::vector<double>>();
  EXPECT_TRUE(std::is_sorted(once.begin(), once.end()) ||
              std::is_sorted(once.rbegin(), once.rend()));
  std::reverse(twice.begin(), twice.end());
  EXPECT_EQ(once, twice);
  EXPECT_EQ(found["cutOff"], 0) << "a table goes on to the right without a word";
  EXPECT_TRUE(found["turned"]);
  EXPECT_TRUE(found["flew"]);
}

class Report : public ::testing::Test {
 protected:
  const RoomScene scene_ = WriteRoomScene(TestFolder(), {.pictures = true});
  const fs::path folder_ = scene_.folder / "report";

  // A comparison with everything that the page can show.
  void Compare() {
    const std::string mesh = "mesh:" + scene_.mesh().string();
    const fs::path worse = scene_.folder / "worse";
    ASSERT_TRUE(Succeeds(
        RunRaylift({"perturb", "--model", scene_.model(), "--geometry", mesh, "--out", worse,
                    "--scale", "1.1", "--relative-noise", "0.01", "--holes", "0.1", "--quiet"})));
    ASSERT_TRUE(Succeeds(RunRaylift({"compare",
                                     "--model",
                                     scene_.model(),
                                     "--geometry",
                                     "mesh=" + mesh,
                                     "--geometry",
                                     "</script><b>worse=depth:" + worse.string(),
                                     "--truth",
                                     "mesh",
                                     "--max-side",
                                     "160",
                                     "--queries",
                                     scene_.query_list(),
                                     "--features",
                                     scene_.features(),
                                     "--matches",
                                     scene_.matches(),
                                     "--pairs",
                                     scene_.pairs(),
                                     "--ground-truth",
                                     scene_.truth(),
                                     "--methods",
                                     "p3p,e5p1,select:0.8",
                                     "--images",
                                     scene_.images(),
                                     "--report",
                                     folder_})));
  }
};

TEST_F(Report, IsOneFileThatNeedsNoNetwork) {
  Compare();
  const std::string page = ReadFile(folder_ / "index.html");
  EXPECT_THAT(page, Not(HasSubstr("http:")));
  EXPECT_THAT(page, Not(HasSubstr("https:")));
  EXPECT_THAT(page, Not(HasSubstr("</script><b>")));
  EXPECT_LT(page.size(), 15u << 20);
  EXPECT_EQ(FilesBelow(folder_),
            (std::vector<std::string>{"comparison.json", "curves.csv", "images.csv", "index.html",
                                      "localization.csv", "localization.json", "manifest.jsonl",
                                      "options.json", "sources.csv"}));
}

TEST_F(Report, WorksInABrowserOfAnyWidth) {
  if (!HasProgram("/usr/bin/chromium")) GTEST_SKIP() << "chromium is not installed";
  Compare();
  for (const int width_px : {1280, 500}) {
    const auto found = Probe(folder_ / "index.html", width_px);
    ExpectWorks(found);
    EXPECT_EQ(found["sections"], nlohmann::json({"summary", "curves", "localization", "queries",
                                                 "images", "strips", "scene"}));
  }
}

TEST_F(Report, OfALocalizationWorksInABrowser) {
  if (!HasProgram("/usr/bin/chromium")) GTEST_SKIP() << "chromium is not installed";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene_, scene_.folder / "out") +
                                  Arguments{"--query-images", scene_.images(), "--report", folder_,
                                            "--ground-truth", scene_.truth()})));
  const std::string page = ReadFile(folder_ / "index.html");
  EXPECT_THAT(page, HasSubstr("the median error of "));
  EXPECT_THAT(page, HasSubstr("\"kind\":\"true\""));
  for (const int width_px : {390, 1280, 2000}) {
    const auto found = Probe(folder_ / "index.html", width_px);
    ExpectWorks(found);
    EXPECT_EQ(found["sections"], nlohmann::json({"queries", "scene"}));
    EXPECT_TRUE(found["swiped"]);
    EXPECT_GT(found["marks"], 100);
    EXPECT_GT(found["lines"], 20);
    EXPECT_TRUE(found["searched"]);
  }
}

TEST_F(Report, OfAFailedQuerySaysWhichReferencesItMatches) {
  ASSERT_TRUE(Succeeds(RunRaylift(
      LocalizeWithHloc(scene_, scene_.folder / "out") +
      Arguments{"--query-images", scene_.images(), "--report", folder_, "--min-confidence", "1"})));
  const std::string page = ReadFile(folder_ / "index.html");
  const auto begin = page.find("<script type=\"application/json\" id=\"data\">");
  ASSERT_NE(begin, std::string::npos);
  const auto data = nlohmann::json::parse(page.substr(
      page.find('>', begin) + 1, page.find("</script>", begin) - page.find('>', begin) - 1));
  for (const auto& query : data["rows"][0]["queries"]) {
    EXPECT_EQ(query["verdict"], "failed");
    ASSERT_FALSE(query["references"].empty());
    EXPECT_GT(query["references"][0]["matches"], 0);
    EXPECT_EQ(query["references"][0]["name"], query["reference"]["name"]);
    EXPECT_TRUE(query.contains("rendering")) << "the nearest candidate is not shown";
  }
}

TEST_F(Report, OfAnEvaluationWorksInABrowser) {
  if (!HasProgram("/usr/bin/chromium")) GTEST_SKIP() << "chromium is not installed";
  const fs::path poses = scene_.folder / "poses.txt";
  Rigid3 moved = scene_.queries[0].cam_from_world;
  moved.translation.x() += 0.05;
  WritePoseFile(poses, {{scene_.queries[0].name, moved}});
  const fs::path good = scene_.folder / "good.txt";
  WritePoseFile(good, {{scene_.queries[0].name, scene_.queries[0].cam_from_world},
                       {scene_.queries[1].name, scene_.queries[1].cam_from_world}});
  ASSERT_TRUE(Succeeds(RunRaylift({"evaluate", "--ground-truth", scene_.truth(), "--poses", poses,
                                   good, "--report", folder_})));
  const auto found = Probe(folder_ / "index.html", 1280);
  ExpectWorks(found);
  EXPECT_EQ(found["sections"], nlohmann::json({"localization", "queries", "scene"}));
}

TEST_F(Report, OfRenderedImagesWorksInABrowser) {
  if (!HasProgram("/usr/bin/chromium")) GTEST_SKIP() << "chromium is not installed";
  const Arguments render = {
      "render",       "--geometry", "mesh:" + scene_.mesh().string(), "--model",
      scene_.model(), "--out",      scene_.folder / "rendered",       "--report",
      folder_};
  ASSERT_TRUE(Succeeds(RunRaylift(render)));
  const std::string page = ReadFile(folder_ / "index.html");
  for (const int width_px : {390, 1280, 2000}) {
    const auto found = Probe(folder_ / "index.html", width_px);
    ExpectWorks(found);
    EXPECT_EQ(found["sections"], nlohmann::json({"images", "pictures", "scene"}));
    EXPECT_TRUE(found["searchedImages"]);
  }
  // Of kept images as of new ones.
  ASSERT_TRUE(Succeeds(RunRaylift(render + Arguments{"--resume"})));
  EXPECT_EQ(ReadFile(folder_ / "index.html"), page);
}

TEST_F(Report, OfADoctorWorksInABrowser) {
  if (!HasProgram("/usr/bin/chromium")) GTEST_SKIP() << "chromium is not installed";
  const fs::path maps = scene_.folder / "maps";
  const std::string mesh = "mesh:" + scene_.mesh().string();
  ASSERT_TRUE(Succeeds(RunRaylift({"perturb", "--model", scene_.model(), "--geometry", mesh,
                                   "--out", maps, "--scale", "1.5", "--quiet"})));
  for (const std::string& geometry : {mesh, "depth:" + maps.string()}) {
    ASSERT_TRUE(Succeeds(RunRaylift(Arguments{"doctor", "--model", scene_.model(), "--geometry",
                                              geometry, "--report", folder_} +
                                    HlocMatches(scene_))));
    for (const int width_px : {390, 1280}) {
      const auto found = Probe(folder_ / "index.html", width_px);
      ExpectWorks(found);
      EXPECT_EQ(found["sections"], nlohmann::json({"verdict", "readings", "pictures", "scene"}));
    }
  }
}

}  // namespace
}  // namespace raylift
