// Lists of pairs to match: hloc's and those of MeshLoc and kapture.

#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace raylift {

// `query reference` per line; the order of a query's lines is the rank; a reference that stands
// twice keeps its better one. Also takes the comma separated forms of MeshLoc and kapture (query,
// reference, score).
using RetrievalPairs = std::map<std::string, std::vector<std::string>>;
RetrievalPairs ReadPairs(const std::filesystem::path& path);
void WritePairs(const std::filesystem::path& path,
                std::span<const std::pair<std::string, std::string>> pairs);

}  // namespace raylift
