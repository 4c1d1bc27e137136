// Whole files in and out. Output appears under its name only when it is complete.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// Return whether there is a file or folder, a folder or a regular file of this name; false for
// names that no file can have, too.
bool Exists(const std::filesystem::path& path);
bool IsFolder(const std::filesystem::path& path);
bool IsFile(const std::filesystem::path& path);

// Returns the bytes of a file or of a shell's pipe. Throws InputError where it is something else.
std::string ReadFile(const std::filesystem::path& path);

// Writes to a temporary name beside `path` and renames it, so that a killed run leaves no half
// file. Makes the parent folders. Throws OutputError naming the file if it cannot be written.
void WriteFile(const std::filesystem::path& path, std::string_view contents);
// Writes several parts likewise, one after the other, without joining them in memory.
void WriteFile(const std::filesystem::path& path, std::span<const std::string_view> parts);

// Tells before long work whether a file can be written later: makes the parent folders and tries.
// Throws OutputError naming the file or folder otherwise.
void RequireWritable(const std::filesystem::path& path);

// Makes a folder and its parents, which then would survive a loss of power. Throws OutputError.
void MakeFolders(const std::filesystem::path& folder);

// Returns the file of an image that is named by a relative path: it is below `folder`, whatever the
// name says.
std::filesystem::path PathBelow(const std::filesystem::path& folder,
                                const std::filesystem::path& name);

// Gives the temporary name for a writer that opens files itself (HDF5, OpenCV); Commit() renames,
// and returns when the file would survive a loss of power (but see CommittedFiles). Without
// Commit() the temporary file is removed.
class AtomicFile {
 public:
  // The temporary name keeps the extension of `path`, as some writers choose the format by it.
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& temporary_path() const { return temporary_path_; }
  void Commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_path_;
  bool committed_ = false;
};

// Syncs files and the folders that hold them; many by their whole file system. Throws OutputError
// naming one that cannot be.
void SyncFiles(std::span<const std::filesystem::path> files);

// Returns whether, after this errno, there is nothing that could be synced: file systems of
// networks may have no such call for folders, a folder may be one to write to and not to read, and
// whoever promises a file that is gone finds that out.
bool CannotSyncHere(int error);

// Keeps the names of the files that this thread commits while it is the last one that was made.
class CommittedFiles {
 public:
  // With kByPromise files are synced only before a line of a manifest promises them.
  enum class Sync { kAtOnce, kByPromise };
  explicit CommittedFiles(Sync sync = Sync::kAtOnce);
  ~CommittedFiles();
  CommittedFiles(const CommittedFiles&) = delete;
  CommittedFiles& operator=(const CommittedFiles&) = delete;

  const std::vector<std::filesystem::path>& paths() const { return paths_; }

 private:
  friend class AtomicFile;
  CommittedFiles* outer_;
  Sync sync_;
  std::vector<std::filesystem::path> paths_;
};

// Returns the file that a temporary name, as AtomicFile and WriteFile make them, stands for;
// nullopt if it is no such name. A killed run leaves such files.
std::optional<std::filesystem::path> TargetOfTemporary(const std::filesystem::path& path);

// Removes the temporary files in a folder and below it whose processes have ended on this machine:
// those of runs that were killed. Others, which may be at work, keep theirs.
void RemoveLeftTemporaries(const std::filesystem::path& folder);

}  // namespace raylift
