#include <array>

#include "jobs/manifest_file.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

ManifestEntry Entry(const std::string& name) {
  return {.name = name,
          .place = 3,
          .key = "0123",
          .camera = "PINHOLE 4 3 1 1 2 1.5",
          .pixels = 12,
          .hits = 7,
          .depth_range = std::pair(0.1f, 1e6f),
          .dropped = 2,
          .files = {{"depth/" + name + ".exr", 99}, {"mask/" + name + ".png", 5}}};
}

TEST(Manifest, EntriesComeBackAsTheyWere) {
  const auto file = TestFolder() / "manifest.jsonl";
  ManifestEntry nothing = Entry("b \"quoted\"");
  nothing.depth_range = std::nullopt;
  WriteManifestText(file, R"({"job":1})", std::array{ToJsonLine(Entry("a")), ToJsonLine(nothing)});
  ManifestAppender(file).Append(ToJsonLine(Entry("c")));
  const ManifestEntries entries = ReadManifest(file);
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_EQ(ToJsonLine(entries.at("a")), ToJsonLine(Entry("a")));
  EXPECT_EQ(ToJsonLine(entries.at(nothing.name)), ToJsonLine(nothing));
  EXPECT_EQ(ToJsonLine(entries.at("c")), ToJsonLine(Entry("c")));
  EXPECT_EQ(entries.at("a").depth_range, Entry("a").depth_range);
}

TEST(Manifest, ALineThatWasCutOffIsNotThere) {
  const auto file = TestFolder() / "manifest.jsonl";
  WriteManifestText(file, R"({"job":1})",
                    std::array{ToJsonLine(Entry("a")), ToJsonLine(Entry("b"))});
  const std::string whole = ReadFile(file);
  const size_t last = whole.rfind("{\"name\"");
  for (size_t size = last; size < whole.size() - 1; ++size) {
    WriteFile(file, whole.substr(0, size));
    const ManifestEntries entries = ReadManifest(file);
    ASSERT_EQ(entries.size(), 1u) << size;
    EXPECT_TRUE(entries.contains("a"));
  }
}

TEST(Manifest, AMissingOneIsEmpty) {
  EXPECT_TRUE(ReadManifest(TestFolder() / "none.jsonl").empty());
}

}  // namespace
}  // namespace raylift
