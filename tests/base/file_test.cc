#include "raylift/base/file.h"

#include <array>
#include <iterator>

#include "base/input_paths.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

TEST(File, WritesWhatItReadsAndMakesFolders) {
  const auto path = TestFolder() / "a" / "b.bin";
  const std::string contents("one\0two\n", 8);
  WriteFile(path, contents);
  EXPECT_EQ(ReadFile(path), contents);
  // No temporary file is left beside it.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(path.parent_path()),
                          std::filesystem::directory_iterator()),
            1);
}

TEST(File, PartsFollowEachOther) {
  const auto path = TestFolder() / "parts.bin";
  const std::array<std::string_view, 3> parts = {"one ", "", "two"};
  WriteFile(path, parts);
  EXPECT_EQ(ReadFile(path), "one two");
}

// A drop folder: whoever writes to it may not list it.
TEST(File, IsWrittenToAFolderThatCannotBeRead) {
  const fs::path folder = TestFolder() / "drop";
  fs::create_directories(folder);
  fs::permissions(folder, fs::perms(0333));
  const fs::path before = fs::current_path();
  fs::current_path(folder);
  constexpr uid_t kNobody = 65534;
  const uid_t user = geteuid();  // root may list all folders
  const bool is_other = user != 0 || seteuid(kNobody) == 0;
  if (is_other) {
    EXPECT_NO_THROW(WriteFile("a", "a"));
  }
  EXPECT_EQ(seteuid(user), 0);
  fs::current_path(before);
  if (!is_other) GTEST_SKIP();
  fs::permissions(folder, fs::perms::owner_all);
  EXPECT_EQ(ReadFile(folder / "a"), "a");
}

TEST(MakeFolders, MakesParentsAndNamesWhatIsNoFolder) {
  const fs::path folder = TestFolder();
  MakeFolders(folder / "a/b/c");
  MakeFolders(folder / "a/b/c");
  EXPECT_TRUE(fs::is_directory(folder / "a/b/c"));
  WriteFile(folder / "file", "");
  EXPECT_TRUE(FailsWithInputError([&] { MakeFolders(folder / "file/d"); }, {"file/d", "folder"}));
}

// Few files are synced one by one, many by their file system.
TEST(SyncFiles, PassesOverFilesThatAreGoneAndNamesOthers) {
  const fs::path folder = TestFolder();
  std::vector<fs::path> files = {folder / "a", folder / "gone/b"};
  WriteFile(files[0], "a");
  for (int more = 0; more < 2; ++more) {
    EXPECT_NO_THROW(SyncFiles(files));
    files.push_back(folder / "a/below-a-file");
    EXPECT_TRUE(FailsWithInputError([&] { SyncFiles(files); }, {"below-a-file", "be synced"}));
    files.back() = folder / "a";
    files.resize(6, folder / "a");
  }
}

TEST(CommittedFiles, AreNotedByTheLastThatWasMade) {
  const fs::path folder = TestFolder();
  const CommittedFiles outer;
  WriteFile(folder / "a", "");
  {
    const CommittedFiles inner(CommittedFiles::Sync::kByPromise);
    WriteFile(folder / "b", "");
    EXPECT_EQ(inner.paths(), std::vector<fs::path>{folder / "b"});
  }
  WriteFile(folder / "c", "");
  EXPECT_EQ(outer.paths(), (std::vector<fs::path>{folder / "a", folder / "c"}));
}

TEST(File, MissingFileAndFolderAreNamed) {
  const auto folder = TestFolder();
  EXPECT_TRUE(FailsWithInputError([&] { ReadFile(folder / "x.txt"); }, {"x.txt", "no such file"}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadFile(folder); }, {"found a folder"}));
  WriteFile(folder / "file", "");
  EXPECT_TRUE(FailsWithInputError([&] { WriteFile(folder / "file" / "x", ""); }, {"file"}));
}

TEST(File, AnUncommittedFileLeavesNothing) {
  const auto folder = TestFolder();
  {
    AtomicFile file(folder / "x.png");
    EXPECT_EQ(file.temporary_path().extension(), ".png");
    WriteFile(file.temporary_path(), "half");
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder));
}

TEST(File, TemporaryNamesTellTheirTarget) {
  const auto folder = TestFolder();
  for (const std::string name : {"x.png", "a.b.jpg", "plain", "x.tmp.png"}) {
    const AtomicFile file(folder / name);
    EXPECT_EQ(TargetOfTemporary(file.temporary_path()), folder / name);
    EXPECT_FALSE(TargetOfTemporary(folder / name));
  }
  for (const std::string name : {".x.1-2-3.png", ".x.1-2.tmp.png", ".x.-2-3.tmp.png",
                                 ".x.1-two-3.tmp.png", "x.1-2-3.tmp.png", ".tmp", "..tmp"}) {
    EXPECT_FALSE(TargetOfTemporary(folder / name)) << name;
  }
}

TEST(File, TemporariesOfEndedProcessesOfThisMachineAreRemoved) {
  const auto folder = TestFolder();
  fs::create_directory(folder / "below");
  const pid_t ended = fork();
  if (ended == 0) _exit(0);
  waitpid(ended, nullptr, 0);
  // .x.HOST-PROCESS-COUNT.tmp.png
  const std::string own = AtomicFile(folder / "x.png").temporary_path().filename().string();
  const size_t process = own.find('-') + 1, count = own.find('-', process);
  std::string left = own;
  left.replace(process, count - process, std::to_string(ended));
  std::string elsewhere = left;
  elsewhere.replace(3, 8, "somehost");
  for (const std::string& name : {own, left, elsewhere, "below/" + left, std::string("x.png")}) {
    WriteFile(folder / name, "half");
  }
  RemoveLeftTemporaries(folder);
  EXPECT_TRUE(fs::exists(folder / own));
  EXPECT_TRUE(fs::exists(folder / elsewhere));
  EXPECT_TRUE(fs::exists(folder / "x.png"));
  EXPECT_FALSE(fs::exists(folder / left));
  EXPECT_FALSE(fs::exists(folder / "below" / left));
  RemoveLeftTemporaries(folder / "missing");
}

// What never ends is refused before it is read.
TEST(ReadFile, TakesNeitherDevicesNorPipesWithNames) {
  EXPECT_TRUE(FailsWithInputError([] { ReadFile("/dev/zero"); }, {"/dev/zero", "found a device"}));
  const fs::path pipe = TestFolder() / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_TRUE(FailsWithInputError([&] { ReadFile(pipe); }, {"pipe", "found a pipe"}));
}

// As `<(...)` of a shell.
TEST(ReadFile, TakesPipesOfShells) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  ASSERT_EQ(write(ends[1], "a list", 6), 6);
  close(ends[1]);
  EXPECT_EQ(ReadFile("/dev/fd/" + std::to_string(ends[0])), "a list");
  close(ends[0]);
}

TEST(Below, KnowsTheParentFromNamesThatBeginLikeIt) {
  EXPECT_EQ(Below("/a/..odd/b.jpg", "/a"), "..odd/b.jpg");
  EXPECT_EQ(Below("/a/..odd/b.jpg", "/a/..odd"), "b.jpg");
  EXPECT_EQ(Below("/a", "/a/"), ".");
  EXPECT_FALSE(Below("/a/b.jpg", "/a/..odd"));
  EXPECT_FALSE(Below("/a/b.jpg", ""));
}

TEST(ListFilesBelow, FollowsLinksThatDoNotLeadBack) {
  const fs::path elsewhere = TestFolder() / "elsewhere";
  const fs::path folder = elsewhere.parent_path() / "folder";
  WriteFile(folder / "a/b.txt", "");
  WriteFile(elsewhere / "c.txt", "");
  fs::create_directory_symlink(elsewhere, folder / "link");
  fs::create_directory_symlink(folder, folder / "a/back");
  fs::create_directory_symlink(".", folder / "self");
  fs::create_symlink("loop", folder / "loop");
  EXPECT_EQ(ListFilesBelow(folder),
            (std::vector<fs::path>{folder / "a/b.txt", folder / "link/c.txt"}));
}

}  // namespace
}  // namespace raylift
