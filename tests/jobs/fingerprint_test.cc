#include "jobs/fingerprint.h"

#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

TEST(Fingerprint, AFileIsItsContents) {
  const fs::path folder = TestFolder();
  WriteFile(folder / "a", "contents");
  WriteFile(folder / "b", "contents");
  WriteFile(folder / "c", "Contents");
  EXPECT_EQ(FileFingerprint(folder / "a"), FileFingerprint(folder / "b"));
  EXPECT_NE(FileFingerprint(folder / "a"), FileFingerprint(folder / "c"));
  EXPECT_EQ(FileFingerprint(folder / "none"), "missing");
  EXPECT_EQ(FileFingerprint(folder), "missing");
}

TEST(Fingerprint, AFolderIsItsNamesAndSizesWithoutTheOutput) {
  const fs::path folder = TestFolder();
  WriteFile(folder / "maps/a.png", "1");
  WriteFile(folder / "maps/deep/b.png", "2");
  const std::string before = FolderFingerprint(folder / "maps", folder / "maps/out");
  EXPECT_TRUE(before.starts_with("2 ")) << before;
  WriteFile(folder / "maps/out/poses.txt", "3");
  EXPECT_EQ(FolderFingerprint(folder / "maps", folder / "maps/out"), before);
  EXPECT_EQ(FolderFingerprint(folder / "maps/../maps", folder / "maps/./out"), before);
  WriteFile(folder / "maps/outer.txt", "4");
  EXPECT_NE(FolderFingerprint(folder / "maps", folder / "maps/out"), before);
  fs::remove(folder / "maps/outer.txt");
  fs::rename(folder / "maps/a.png", folder / "maps/c.png");
  EXPECT_NE(FolderFingerprint(folder / "maps", folder / "maps/out"), before);
}

}  // namespace
}  // namespace raylift
