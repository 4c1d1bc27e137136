#include "localization/feature_cache.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <set>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/progress.h"
#include "raylift/base/text.h"
#include "raylift/features/root_sift.h"
#include "raylift/io/hloc_features.h"
#include "raylift/io/image_file.h"
#include "raylift/jobs/folder_lock.h"
#include "raylift/localization/front_end.h"

namespace raylift {
namespace {

// Changes whenever extraction changes, so that old caches are not used.
constexpr int kExtractionVersion = 1;
constexpr bool kHalfDescriptors = true;

// A line per image: what the features depend on.
std::string DescribeInputs(const std::vector<ImageFile>& images,
                           const FeatureCacheOptions& options) {
  std::string text = fmt::format("rootsift version {} max_features {}\n", kExtractionVersion,
                                 options.max_features);
  for (const ImageFile& image : images) {
    std::error_code error;
    const auto size = std::filesystem::file_size(image.path, error);
    if (error) {
      throw InputError(image.path, "no such image");
    }
    const auto time = std::filesystem::last_write_time(image.path, error).time_since_epoch();
    text += fmt::format("{} {} {}\n", image.name, size, time.count());
  }
  return text;
}

// Whether the stored features are those of at least these inputs: thinned references are a part.
bool HoldsInputs(const std::string& stored, const std::string& wanted) {
  const std::vector<std::string_view> stored_lines = SplitBy(stored, '\n');
  const std::set<std::string_view> known(stored_lines.begin(), stored_lines.end());
  const std::vector<std::string_view> lines = SplitBy(wanted, '\n');
  return std::all_of(lines.begin(), lines.end(),
                     [&](std::string_view line) { return known.contains(line); });
}

// As they are read back from the cache.
std::map<std::string, Features> ExtractAll(const std::vector<ImageFile>& images,
                                           const FeatureCacheOptions& options) {
  std::vector<Features> extracted(images.size());
  Progress progress("images", images.size(),
                    options.show_progress ? Progress::Show::kAuto : Progress::Show::kNever);
  ParallelFor(images.size(), options.threads, [&](size_t i) {
    extracted[i] = ExtractFrontEndFeatures(ReadImage(images[i].path, ImageChannels::kGrey),
                                           options.max_features);
    progress.Advance();
  });
  std::map<std::string, Features> by_name;
  for (size_t i = 0; i < images.size(); ++i) {
    by_name.emplace(images[i].name, std::move(extracted[i]));
  }
  return by_name;
}

}  // namespace

Features ExtractFrontEndFeatures(const Image& photograph, int max_features) {
  return AsStored(ExtractRootSift(ToGrey(photograph), {.max_features = max_features}),
                  kHalfDescriptors);
}

std::map<std::string, Features> ExtractOrReadFeatures(const std::vector<ImageFile>& images,
                                                      const FeatureCacheOptions& options) {
  std::vector<ImageFile> sorted = images;
  std::sort(sorted.begin(), sorted.end(),
            [](const ImageFile& a, const ImageFile& b) { return a.name < b.name; });
  if (options.folder.empty()) return ExtractAll(sorted, options);
  const std::string inputs = DescribeInputs(sorted, options);
  std::error_code error;
  std::filesystem::create_directories(options.folder, error);
  // Shards that begin at once: one extracts, the others wait and read.
  const FolderLock lock(options.folder, FolderLock::Mode::kExclusive, FolderLock::IfHeld::kWait);
  const std::filesystem::path file = options.folder / "features.h5";
  const std::filesystem::path inputs_file = options.folder / "features.inputs.txt";
  const bool cached = std::filesystem::exists(file, error) &&
                      std::filesystem::exists(inputs_file, error) &&
                      HoldsInputs(ReadFile(inputs_file), inputs);
  if (!cached) {
    const std::map<std::string, Features> by_name = ExtractAll(sorted, options);
    // Killed in between, the new features must not pass for what the old list describes.
    std::filesystem::remove(inputs_file, error);
    WriteFeatureFile(file, by_name, kHalfDescriptors);
    WriteFile(inputs_file, inputs);
  }
  const FeatureFile features(file);
  std::map<std::string, Features> result;
  for (const ImageFile& image : sorted) {
    result.emplace(image.name, features.Read(image.name));
  }
  return result;
}

}  // namespace raylift
