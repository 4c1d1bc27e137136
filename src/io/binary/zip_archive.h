// ZIP files in memory, by libzip.

#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

bool IsZip(std::string_view bytes);

class ZipReader {
 public:
  // `bytes` must outlive the reader. Throws InputError where they are no complete archive.
  ZipReader(std::filesystem::path path_for_messages, std::string_view bytes);
  ~ZipReader();

  const std::vector<std::string>& names() const { return names_; }

  // Returns the contents of an entry. Throws InputError where it is damaged, or where its stated
  // size is larger than its compressed bytes can become.
  std::string Read(const std::string& name) const;

 private:
  struct Archive;
  std::filesystem::path path_;
  std::unique_ptr<Archive> archive_;
  std::vector<std::string> names_;
};

enum class ZipMethod { kStore, kDeflate };

// Returns an archive of one entry; the same contents give the same bytes, as its time is that of
// 1980.
std::string MakeZip(const std::filesystem::path& path_for_messages, const std::string& name,
                    const std::string& contents, ZipMethod method);

struct ZipEntry {
  std::string name;                       // UTF-8
  std::function<std::string()> contents;  // asked for once, in the entries' order
};

// Writes the entries as they are, one after the other, so that they need not be in memory together.
// The file appears complete or not at all. Throws OutputError where it cannot be written, and what
// an entry throws.
void WriteZip(const std::filesystem::path& path, std::span<const ZipEntry> entries);

}  // namespace raylift
