// Promises of files (PromisedFile in raylift/jobs/task_job.h), as lines of a manifest have them.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/json_members.h"

#include "raylift/jobs/task_job.h"

namespace raylift {

// Returns what `folder` promises of files that have just been written: all but times. Throws
// OutputError where one is gone.
std::vector<PromisedFile> PromiseFiles(const std::filesystem::path& folder,
                                       std::span<const std::filesystem::path> files);

// Returns the member "files" of a line.
nlohmann::ordered_json FilesJson(std::span<const PromisedFile> files);
void Members(JsonMembers& members, PromisedFile& file);
// Returns what a line promises; nothing where it makes no sense.
std::vector<PromisedFile> FilesOfLine(const std::string& line);
// Returns the line with its files as another folder sees them.
std::string InFolder(const std::string& line, const std::filesystem::path& from,
                     const std::filesystem::path& to);

enum class FileCheck { kSizes, kContents };
// Returns what is wrong with a file: "is missing"; nullopt if nothing is.
std::optional<std::string> FaultOf(const std::filesystem::path& folder, const PromisedFile& file,
                                   FileCheck check);
bool KeepsPromise(const std::filesystem::path& folder, const std::string& line, FileCheck check);

}  // namespace raylift
