#include "localization/vlad_cache.h"

#include <optional>
#include <vector>

#include "base/hash.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>

#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Changes whenever the vectors of the same features do.
constexpr int kVladVersion = 1;

// What the vectors depend on; none where that is not known.
std::optional<std::string> KeyOf(std::span<const std::string> references,
                                 const FeatureStore& features, uint64_t seed) {
  std::string key = fmt::format("vlad version {} seed {}\n", kVladVersion, seed);
  for (const std::string& name : references) {
    const std::string& stamp = features.StampOf(name);
    if (stamp.empty()) return std::nullopt;
    key += stamp + "\n";
  }
  return key;
}

// A vocabulary is kept as if its words were images.
std::vector<std::string> WordNames(size_t count) {
  std::vector<std::string> names;
  for (size_t i = 0; i < count; ++i) names.push_back(fmt::format("word/{:04}", i));
  return names;
}

struct Files {
  path words;
  path vectors;  // written last
};

std::optional<VladVectors> Read(const Files& files, std::span<const std::string> references) {
  std::error_code error;
  if (!std::filesystem::exists(files.vectors, error)) return std::nullopt;
  const GlobalFeatureFile words(files.words);
  return VladVectors{{words.Read(words.ImageNames())},
                     GlobalFeatureFile(files.vectors).Read(references)};
}

void Write(const Files& files, std::span<const std::string> references,
           const VladVectors& vectors) {
  std::error_code ignored;
  std::filesystem::create_directories(files.words.parent_path(), ignored);
  const Eigen::MatrixXf& words = vectors.vocabulary.words;
  WriteGlobalDescriptors(files.words, WordNames(static_cast<size_t>(words.cols())), words);
  WriteGlobalDescriptors(files.vectors, references, vectors.of_references);
}

}  // namespace

VladVectors ComputeOrReadVladVectors(std::span<const std::string> references,
                                     const FeatureStore& features, const path& folder,
                                     uint64_t seed, int threads) {
  std::optional<std::string> key;
  if (!folder.empty()) key = KeyOf(references, features, seed);
  if (!key) return ComputeVladVectors(references, features, seed, threads);
  const std::string hash = HexText(HashBytes64(*key));
  const Files files{folder / "vlad" / (hash + ".words.h5"), folder / "vlad" / (hash + ".h5")};
  const FolderLock lock(folder, FolderLock::Mode::kExclusive, FolderLock::IfHeld::kWait);
  if (auto kept = Read(files, references)) return *std::move(kept);
  VladVectors vectors = ComputeVladVectors(references, features, seed, threads);
  // Where no reference has a feature there is nothing to keep.
  if (vectors.of_references.size() > 0) Write(files, references, vectors);
  return vectors;
}

}  // namespace raylift
