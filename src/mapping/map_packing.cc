#include "raylift/mapping/map_packing.h"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "io/map/map_codec.h"
#include "io/map/packed_map.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/features/vlad.h"

namespace raylift {
namespace {

using std::filesystem::path;

// A reference of the map that is written, with its entries where they are new.
struct Entry {
  PosedImage image;
  bool is_new = true;
  std::string depth = {};
  std::string features = {};
};

// The references of a map in the making: those of `former`, if there is one, and new ones.
class Packing {
 public:
  Packing(path file, MapHeader header, std::string calibration, const PackedMap* former,
          const PackingHooks& hooks)
      : file_(std::move(file)),
        header_(std::move(header)),
        calibration_(std::move(calibration)),
        former_(former),
        hooks_(hooks) {}

  void Keep(const PosedImage& image) { entries_.push_back({image, false}); }

  void Add(const ReferencesToPack& references, const std::vector<PosedImage>& images) {
    for (const PosedImage& image : images) NameText(file_, image.name);  // refuses what cannot be
    const size_t first = entries_.size();
    entries_.resize(first + images.size());
    ParallelFor(images.size(), hooks_.threads, [&](size_t i) {
      Entry& entry = entries_[first + i];
      entry.image = images[i];
      if (const auto depth = references.depth(images[i])) {
        try {
          entry.depth = EncodeDepth(*depth);
        } catch (const InputError& error) {
          throw InputError(file_, images[i].name, error.what());
        }
      }
      entry.features = EncodeFeatures(references.features(images[i]), header_.descriptors);
      if (hooks_.on_reference) hooks_.on_reference();
    });
  }

  void Write() {
    std::sort(entries_.begin(), entries_.end(),
              [](const Entry& a, const Entry& b) { return a.image.name < b.image.name; });
    MapContents contents{.header = header_, .calibration = calibration_};
    for (const Entry& entry : entries_) {
      const std::string& name = entry.image.name;
      if (!contents.references.empty() && contents.references.back().name == name) {
        throw InputError(file_, fmt::format("the reference \"{}\" stands twice", name));
      }
      contents.references.push_back(entry.image);
      contents.has_depth.push_back(entry.is_new ? !entry.depth.empty() : former_->HasDepth(name));
      contents.has_features.push_back(entry.is_new || former_->HasFeatures(name));
    }
    contents.depth = [this](size_t i) {
      const Entry& entry = entries_[i];
      return entry.is_new ? entry.depth : former_->DepthBytes(entry.image.name);
    };
    contents.features = [this](size_t i) { return FeatureBytes(i); };
    contents.retrieval = Retrieval();
    WritePackedMap(file_, contents);
  }

 private:
  std::string FeatureBytes(size_t i) const {
    const Entry& entry = entries_[i];
    return entry.is_new ? entry.features : former_->FeatureBytes(entry.image.name);
  }
  Features FeaturesOf(size_t i) const {
    return DecodeFeatures(file_, entries_[i].image.name, FeatureBytes(i));
  }

  std::optional<PackedRetrieval> Retrieval() const {
    const Vocabulary vocabulary =
        TrainVocabulary(entries_.size(), [&](size_t i, const auto& look) { look(FeaturesOf(i)); },
                        {.seed = header_.seed, .threads = hooks_.threads});
    if (vocabulary.words.size() == 0) return std::nullopt;
    PackedRetrieval retrieval{vocabulary.words, {}};
    retrieval.vectors.resize(vocabulary.words.size(), static_cast<Eigen::Index>(entries_.size()));
    ParallelFor(entries_.size(), hooks_.threads, [&](size_t i) {
      retrieval.vectors.col(static_cast<Eigen::Index>(i)) = ComputeVlad(FeaturesOf(i), vocabulary);
    });
    return retrieval;
  }

  path file_;
  MapHeader header_;
  std::string calibration_;
  const PackedMap* former_;
  const PackingHooks& hooks_;
  std::vector<Entry> entries_;
};

}  // namespace

void PackMap(const path& file, const ReferencesToPack& references, const MapOptions& options,
             const PackingHooks& hooks) {
  if (options.seed > kMaxMapSeed) {
    throw OptionError("seed", std::to_string(options.seed), "must be at most 2^53");
  }
  Packing packing(file,
                  {.descriptors = options.descriptors,
                   .features = options.features,
                   .seed = options.seed,
                   .depth_keys = options.depth_keys,
                   .crs = options.crs},
                  options.calibration, nullptr, hooks);
  packing.Add(references, {references.images.begin(), references.images.end()});
  packing.Write();
}

size_t AddToMap(const path& file, const ReferencesToPack& references,
                const std::string& calibration, const PackingHooks& hooks) {
  const PackedMap former(file);
  Packing packing(file, former.header(),
                  calibration.empty() ? former.ReadCalibration() : calibration, &former, hooks);
  std::set<std::string> known;
  for (const PosedImage& image : former.references()) {
    packing.Keep(image);
    known.insert(image.name);
  }
  std::vector<PosedImage> added;
  for (const PosedImage& image : references.images) {
    if (!known.contains(image.name)) added.push_back(image);
  }
  packing.Add(references, added);
  packing.Write();
  return added.size();
}

void RemoveFromMap(const path& file, std::span<const std::string> names,
                   const PackingHooks& hooks) {
  const PackedMap former(file);
  std::set<std::string> removed(names.begin(), names.end());
  Packing packing(file, former.header(), former.ReadCalibration(), &former, hooks);
  size_t num_kept = 0;
  for (const PosedImage& image : former.references()) {
    if (removed.erase(image.name) > 0) continue;
    packing.Keep(image);
    ++num_kept;
  }
  if (!removed.empty()) {
    throw InputError(file, fmt::format("has no reference \"{}\"", *removed.begin()));
  }
  if (num_kept == 0) throw InputError(file, "no reference would be left");
  packing.Write();
}

}  // namespace raylift
