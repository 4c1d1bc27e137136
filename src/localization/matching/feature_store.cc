#include "localization/matching/feature_store.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <functional>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "base/hash.h"
#include "base/progress.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/features/local_features.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/image_file.h"
#include "raylift/scene/keypoints.h"

namespace raylift {

namespace {

std::shared_ptr<const ImageFeatures> Indexed(Features features) {
  auto indexed = std::make_shared<ImageFeatures>();
  indexed->keypoints = CanonicalKeypoints(features.keypoints_px);
  indexed->features = std::move(features);
  return indexed;
}

size_t BytesOf(const ImageFeatures& image) {
  const Features& features = image.features;
  return features.keypoints_px.size() * sizeof(features.keypoints_px[0]) +
         static_cast<size_t>(features.descriptors.size()) * sizeof(float) +
         features.scores.size() * sizeof(float) + image.keypoints.size() * sizeof(int);
}

}  // namespace

void FeatureStore::Add(const std::string& image, Features features) {
  const auto [entry, is_new] = entries_.try_emplace(image);
  if (is_new) entry->second.held = Indexed(std::move(features));
}

void FeatureStore::Add(const std::string& image, std::shared_ptr<const FeatureFile> file,
                       std::string stamp) {
  const auto [entry, is_new] = entries_.try_emplace(image);
  if (!is_new) return;
  entry->second.file = std::move(file);
  entry->second.stamp = std::move(stamp);
}

std::shared_ptr<const ImageFeatures> FeatureStore::Get(const std::string& image) const {
  Entry& entry = entries_.at(image);
  {
    const std::scoped_lock lock(mutex_);
    if (entry.held != nullptr) {
      if (entry.file != nullptr) recent_.splice(recent_.begin(), recent_, entry.recency);
      return entry.held;
    }
  }
  // Two threads that want the same image may both read it.
  const auto features = ReadOpened([&] { return Indexed(entry.file->Read(image)); });
  const std::scoped_lock lock(mutex_);
  if (entry.held == nullptr) Keep(&entry, features);
  return entry.held;
}

void FeatureStore::Keep(Entry* entry, const std::shared_ptr<const ImageFeatures>& features) const {
  entry->held = features;
  entry->bytes = BytesOf(*features);
  entry->recency = recent_.insert(recent_.begin(), entry);
  bytes_ += entry->bytes;
  while (bytes_ > most_bytes_ && recent_.size() > 1) {
    Entry& oldest = *recent_.back();
    bytes_ -= oldest.bytes;
    oldest.held = nullptr;
    recent_.pop_back();
  }
}

PlaneSize FeatureStore::SizeOf(const std::string& image) const {
  const Entry& entry = entries_.at(image);
  if (entry.file != nullptr) return entry.file->ReadImageSize(image);
  return {entry.held->features.image_width_px, entry.held->features.image_height_px};
}

const std::string& FeatureStore::StampOf(const std::string& image) const {
  return entries_.at(image).stamp;
}

namespace {

using std::filesystem::path;

// Changes whenever extraction changes, so that old caches are not used.
constexpr int kExtractionVersion = 2;
constexpr bool kHalfDescriptors = true;
// Images that are extracted together and then kept.
constexpr size_t kImagesPerPart = 16;

// An image with all that its features depend on but the options: a line of the cache's lists.
struct Input {
  ImageFile image;
  std::string line;
};

// Returns the inputs in the order of their names.
std::vector<Input> InputsOf(const std::vector<ImageFile>& images) {
  std::vector<Input> inputs;
  for (const ImageFile& image : images) {
    std::error_code error;
    const auto size = std::filesystem::file_size(image.path, error);
    if (error) throw InputError(image.path, "no such image");
    const auto time = std::filesystem::last_write_time(image.path, error).time_since_epoch();
    inputs.push_back({image, fmt::format("{} {} {}", image.name, size, time.count())});
  }
  std::sort(inputs.begin(), inputs.end(),
            [](const Input& a, const Input& b) { return a.image.name < b.image.name; });
  return inputs;
}

std::string NameIn(std::string_view line) {
  const size_t time = line.rfind(' ');
  const size_t size = time == std::string_view::npos ? time : line.rfind(' ', time - 1);
  return std::string(line.substr(0, size));
}

// Extracts features, as they are read back from the cache.
std::map<std::string, Features> Extract(std::span<const Input> inputs,
                                        const FeatureCacheOptions& options, Progress& progress) {
  const auto channels = options.extractor ? ImageChannels::kRgb : ImageChannels::kGray;
  std::vector<Features> extracted(inputs.size());
  ParallelFor(inputs.size(), options.threads, [&](size_t i) {
    extracted[i] = ExtractAsStored(ReadImage(inputs[i].image.path, channels), options);
    progress.Advance();
  });
  std::map<std::string, Features> by_name;
  for (size_t i = 0; i < inputs.size(); ++i) {
    by_name.emplace(inputs[i].image.name, std::move(extracted[i]));
  }
  return by_name;
}

// The contents of a cache folder: features.h5, whose images features.inputs.txt lists, and parts in
// the same form that were not joined with it yet. A list is written after its features.
class Cache {
 public:
  explicit Cache(const FeatureCacheOptions& options)
      : options_(options),
        header_(options.extractor ? fmt::format("extractor {}", options.extractor_name)
                                  : fmt::format("rootsift version {} max_features {}",
                                                kExtractionVersion, options.max_features)) {
    MakeFolders(options.folder);
  }

  // Looks at the folder anew.
  void Read() {
    file_of_.clear();
    has_parts_ = false;
    TakeList(Whole());
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(Parts(), ignored)) {
      has_parts_ = true;  // be it a list alone: joining them was cut short
      if (entry.path().extension() == ".h5") TakeList(entry.path());
    }
  }

  bool Holds(const Input& input) const { return file_of_.contains(input.line); }
  bool HoldsAll(std::span<const Input> inputs) const {
    return std::all_of(inputs.begin(), inputs.end(), [&](const Input& i) { return Holds(i); });
  }

  void Add(std::span<const Input> inputs) {
    Progress progress("images", inputs.size(),
                      options_.show_progress ? Progress::Show::kAuto : Progress::Show::kNever);
    for (size_t begin = 0; begin < inputs.size(); begin += kImagesPerPart) {
      const auto part = inputs.subspan(begin, std::min(kImagesPerPart, inputs.size() - begin));
      const auto features = Extract(part, options_, progress);
      std::vector<std::string> lines;
      for (const Input& input : part) lines.push_back(input.line);
      const std::string list = ListOf(lines);
      const path file = Parts() / (HexText(HashBytes64(list)) + ".h5");
      WriteFeatureFile(file, features, kHalfDescriptors);
      WriteFile(ListFile(file), list);
      for (const std::string& line : lines) file_of_.emplace(line, file);
      has_parts_ = true;
    }
  }

  // Joins the parts of these inputs. Features of other images, which further runs may ask for, are
  // kept.
  void Join(std::span<const Input> inputs) {
    if (!has_parts_) return;
    std::map<std::string, std::string> line_of;
    for (const Input& input : inputs) line_of.emplace(input.image.name, input.line);
    for (const auto& [line, file] : file_of_) line_of.emplace(NameIn(line), line);
    std::vector<std::string> names, lines;
    for (const auto& [name, line] : line_of) {
      names.push_back(name);
      lines.push_back(line);
    }
    // Killed in between, the new features must not pass for what the old list describes.
    std::error_code ignored;
    std::filesystem::remove(ListFile(Whole()), ignored);
    Files files;
    WriteFeatureFile(
        Whole(), names,
        [&](const std::string& name) { return FileOf(line_of.at(name), &files)->Read(name); },
        kHalfDescriptors);
    WriteFile(ListFile(Whole()), ListOf(lines));
    std::filesystem::remove_all(Parts(), ignored);
    Read();
  }

  void AddTo(std::span<const Input> inputs, FeatureStore* store) const {
    Files files;
    for (const Input& input : inputs) {
      store->Add(input.image.name, FileOf(input.line, &files),
                 fmt::format("{}: {}", header_, input.line));
    }
  }

 private:
  path Whole() const { return options_.folder / "features.h5"; }
  path Parts() const { return options_.folder / "parts"; }
  static path ListFile(path features) { return features.replace_extension(".inputs.txt"); }

  std::string ListOf(const std::vector<std::string>& lines) const {
    return fmt::format("{}\n{}\n", header_, fmt::join(lines, "\n"));
  }

  void TakeList(const path& features) {
    std::error_code error;
    const path list = ListFile(features);
    if (!std::filesystem::exists(features, error) || !std::filesystem::exists(list, error)) return;
    const std::string text = ReadFile(list);
    const std::vector<std::string_view> lines = SplitBy(text, '\n');
    if (lines.front() != header_) return;
    for (size_t i = 1; i < lines.size(); ++i) {
      if (!lines[i].empty()) file_of_.emplace(lines[i], features);
    }
  }

  using Files = std::map<path, std::shared_ptr<const FeatureFile>>;
  std::shared_ptr<const FeatureFile> FileOf(const std::string& line, Files* open) const {
    const path& file = file_of_.at(line);
    std::shared_ptr<const FeatureFile>& opened = (*open)[file];
    if (opened == nullptr) opened = std::make_shared<const FeatureFile>(file);
    return opened;
  }

  const FeatureCacheOptions& options_;
  std::string header_;
  std::map<std::string, path> file_of_;  // by the image's line
  bool has_parts_ = false;
};

std::vector<Input> MissingIn(const Cache& cache, const std::vector<Input>& inputs,
                             const Shard& shard) {
  std::vector<Input> missing;
  for (size_t i = 0; i < inputs.size(); ++i) {
    if (shard.Contains(i) && !cache.Holds(inputs[i])) missing.push_back(inputs[i]);
  }
  return missing;
}

bool IsPacked(const ImageFile& image, const FeatureCacheOptions& options) {
  return options.packed != nullptr && options.packed->Contains(image.name);
}

std::vector<Input> InputsOf(std::vector<ImageFile> images, const FeatureCacheOptions& options) {
  std::erase_if(images, [&](const ImageFile& image) { return IsPacked(image, options); });
  return InputsOf(images);
}

}  // namespace

Features ExtractAsStored(const Image& photograph, const FeatureCacheOptions& options) {
  if (!options.extractor) return ExtractFrontEndFeatures(photograph, options.max_features);
  Features features = options.extractor(photograph);
  features.image_width_px = photograph.width_px;
  features.image_height_px = photograph.height_px;
  return AsStored(features, kHalfDescriptors);
}

Features ExtractFrontEndFeatures(const Image& photograph, int max_features) {
  return AsStored(ExtractRootSift(ToGray(photograph), {.max_features = max_features}),
                  kHalfDescriptors);
}

std::shared_ptr<const FeatureStore> ExtractOrReadFeatures(const std::vector<ImageFile>& images,
                                                          const FeatureCacheOptions& options,
                                                          std::map<std::string, Features> known) {
  auto store = std::make_shared<FeatureStore>();
  while (!known.empty()) {
    auto first = known.extract(known.begin());
    store->Add(first.key(), std::move(first.mapped()));
  }
  for (const ImageFile& image : images) {
    if (IsPacked(image, options)) store->Add(image.name, options.packed, {});
  }
  const std::vector<Input> inputs = InputsOf(images, options);
  if (inputs.empty()) return store;
  if (options.folder.empty()) {
    Progress progress("images", inputs.size(),
                      options.show_progress ? Progress::Show::kAuto : Progress::Show::kNever);
    auto extracted = Extract(inputs, options, progress);
    for (auto& [name, features] : extracted) store->Add(name, std::move(features));
    return store;
  }
  Cache cache(options);
  // Runs that begin at once: one extracts, the others wait and read.
  const FolderLock lock(options.folder, FolderLock::Mode::kExclusive, FolderLock::IfHeld::kWait);
  RemoveLeftTemporaries(options.folder);
  cache.Read();
  cache.Add(MissingIn(cache, inputs, {}));
  cache.Join(inputs);
  cache.AddTo(inputs, store.get());
  return store;
}

FeatureCount PrepareFeatures(const std::vector<ImageFile>& images, const Shard& shard,
                             const FeatureCacheOptions& options) {
  const std::vector<Input> inputs = InputsOf(images, options);
  FeatureCount count{.images = inputs.size()};
  Cache cache(options);
  {
    const FolderLock lock(options.folder, FolderLock::Mode::kShared, FolderLock::IfHeld::kWait);
    cache.Read();
    const std::vector<Input> missing = MissingIn(cache, inputs, shard);
    cache.Add(missing);
    count.extracted = missing.size();
    cache.Read();
    count.missing = MissingIn(cache, inputs, {}).size();
  }
  if (count.missing > 0) return count;
  const FolderLock lock(options.folder, FolderLock::Mode::kExclusive, FolderLock::IfHeld::kWait);
  cache.Read();
  if (cache.HoldsAll(inputs)) cache.Join(inputs);
  return count;
}

}  // namespace raylift
