// Which file of a folder holds the matches of which pair. Private to localization.

#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/io/hloc_files.h"

namespace raylift {

struct PairFile {
  std::filesystem::path file;
  bool reference_first = false;
};

class PairFiles {
 public:
  // InputError where none of the files is of a pair with one of the references.
  PairFiles(std::filesystem::path folder, std::span<const std::string> references);

  // The files of a query by the names of the references. InputError where a file could be of more
  // than one pair. Thread safe.
  std::map<std::string, PairFile> Of(const std::string& query) const;

  // The references of each query, best first, as pairs.txt lists them; none without it.
  const std::optional<RetrievalPairs>& listed() const { return listed_; }
  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path ListFile() const;

 private:
  struct Half {
    std::vector<std::string> references;  // that the other half of the name may stand for
    PairFile pair;
  };
  void ReadList();
  void ReadNames(std::span<const std::string> references);
  void Claim(const std::string& half, const std::string& query,
             const std::filesystem::path& file) const;

  std::filesystem::path folder_;
  std::optional<RetrievalPairs> listed_;
  std::map<std::string, std::map<std::string, PairFile>> files_of_query_;  // by pairs.txt
  std::multimap<std::string, Half> by_query_half_;                         // by the files' names
  // Kept apart, so that the whole can be moved.
  struct Claims {
    std::mutex mutex;
    std::map<std::string, std::string> query_of_half;
  };
  std::unique_ptr<Claims> claims_ = std::make_unique<Claims>();
};

}  // namespace raylift
