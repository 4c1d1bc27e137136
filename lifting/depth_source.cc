#include "raylift/lifting/depth_source.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <future>
#include <iterator>
#include <list>
#include <map>
#include <mutex>
#include <unordered_map>

#include "io/map/packed_map.h"
#include "lifting/depth_bundle.h"
#include "lifting/depth_convention.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/depth_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr double kMaxTimeDifferenceS = 0.02;
constexpr double kMaxAspectDifference = 0.01;
constexpr std::string_view kTime = "{time}";

std::vector<std::string> UsualPatterns() {
  std::vector<std::string> patterns;
  for (const char* name : {"{dir}/{stem}", "{name}", "{stem}"}) {
    for (const char* extension :
         {".exr", ".npy", ".npz", ".npy.gz", ".png", ".tiff", ".tif", ".pfm", ".bin", ".pgm"}) {
      patterns.push_back(std::string(name) + extension);
    }
  }
  patterns.insert(patterns.end(),
                  {"{name}.geometric.bin", "{dir}/{base}.depth.png", "{dir}/{base}.depth.tiff",
                   "{dir}/{base}_depth.npz", "{flat}_depth.npz"});
  return patterns;
}

// Finds files by the time in their names; the listing of a folder is read once.
class TimeIndex {
 public:
  // `expanded` holds {time} once, in its file name.
  std::optional<path> Find(const path& folder, const std::string& expanded,
                           std::string_view image_stem) {
    const path place = folder / expanded;
    const std::string file = place.filename().string();
    const size_t at = file.find(kTime);
    const auto wanted = ParseDouble(image_stem);
    if (!wanted || at == std::string::npos) return std::nullopt;
    const auto& files =
        List(place.parent_path(), file.substr(0, at), file.substr(at + kTime.size()));
    const auto after = files.lower_bound(*wanted);
    std::optional<path> best;
    double best_difference = kMaxTimeDifferenceS;
    const auto consider = [&](const auto& entry) {
      const double difference = std::abs(entry->first - *wanted);
      if (difference <= best_difference) {
        best_difference = difference;
        best = entry->second;
      }
    };
    if (after != files.end()) consider(after);
    if (after != files.begin()) consider(std::prev(after));
    return best;
  }

 private:
  using FilesByTime = std::map<double, path>;

  const FilesByTime& List(const path& folder, const std::string& prefix,
                          const std::string& suffix) {
    const auto [listing, is_new] = listings_.try_emplace((folder / (prefix + suffix)).string());
    if (!is_new) return listing->second;
    std::error_code missing;
    for (const auto& entry : std::filesystem::directory_iterator(folder, missing)) {
      const std::string name = entry.path().filename().string();
      if (name.size() <= prefix.size() + suffix.size() || !name.starts_with(prefix) ||
          !name.ends_with(suffix)) {
        continue;
      }
      const auto time = ParseDouble(std::string_view(name).substr(
          prefix.size(), name.size() - prefix.size() - suffix.size()));
      if (time) listing->second.emplace(*time, entry.path());
    }
    return listing->second;
  }

  std::unordered_map<std::string, FilesByTime> listings_;
};

using FilesByImage = std::unordered_map<std::string, path>;

FilesByImage FindFiles(const path& folder, const std::string& pattern,
                       std::span<const PosedImage> references, TimeIndex& times) {
  FilesByImage files;
  std::error_code ignored;
  for (const PosedImage& reference : references) {
    const std::string expanded = ExpandPattern(pattern, reference.name);
    if (expanded.find(kTime) != std::string::npos) {
      const std::string stem = path(reference.name).stem().string();
      if (const auto file = times.Find(folder, expanded, stem)) files[reference.name] = *file;
    } else if (std::filesystem::is_regular_file(folder / expanded, ignored)) {
      files[reference.name] = folder / expanded;
    }
  }
  return files;
}

struct FoundFiles {
  std::string pattern;
  FilesByImage files;
};

// Returns the first pattern of those that find the most maps.
FoundFiles FindByBestPattern(const path& folder, const std::vector<std::string>& patterns,
                             std::span<const PosedImage> references) {
  FoundFiles best;
  TimeIndex times;
  for (const std::string& pattern : patterns) {
    FilesByImage files = FindFiles(folder, pattern, references, times);
    if (files.size() > best.files.size()) best = {pattern, std::move(files)};
    if (best.files.size() == references.size() && !best.files.empty()) break;
  }
  return best;
}

// Returns the file that holds the maps of many images; nullopt where each has its own.
std::optional<path> FindBundle(const path& place, const std::vector<std::string>& bundles) {
  std::error_code ignored;
  if (std::filesystem::is_regular_file(place, ignored)) return place;
  for (const std::string& bundle : bundles) {
    if (std::filesystem::is_regular_file(place / bundle, ignored)) return place / bundle;
  }
  return std::nullopt;
}

std::string DescribeStored(const StoredDepth& stored, const std::optional<DepthBundle>& bundle,
                           bool is_packed, const DepthConvention& convention) {
  std::string text = bundle ? bundle->Description()
                            : fmt::format("{} {} x {}",
                                          is_packed ? "16 bits of the logarithm"
                                                    : fmt::format("{} {}", ToString(stored.format),
                                                                  stored.sample_type),
                                          stored.width_px, stored.height_px);
  text += fmt::format(", {}", ToString(convention.kind));
  if (!stored.layer.empty()) text += fmt::format(", layer {}", stored.layer);
  if (convention.sensor) text += ", registered into the photograph's camera";
  return text;
}

}  // namespace

struct DepthFolder::Impl {
  using MapPointer = std::shared_ptr<const DepthMap>;
  struct Entry {
    std::shared_future<MapPointer> map;
    std::list<std::string>::iterator place;  // in `order`
    size_t bytes = 0;                        // 0 while it is being read
  };

  path folder;
  DepthConvention convention;
  std::optional<PackedMap> packed;    // all that there is, or
  std::optional<DepthBundle> bundle;  // the maps of many images, or
  FilesByImage files;
  size_t max_cache_bytes = 0;

  mutable std::mutex mutex;
  mutable std::unordered_map<std::string, Entry> cache;
  mutable std::list<std::string> order;  // the most recently used first
  mutable size_t cache_bytes = 0;
  // These are of the camera that was seen last; most scenes have one.
  mutable std::mutex ray_mutex;
  mutable std::optional<Camera> ray_camera;
  mutable std::shared_ptr<const std::vector<float>> ray_z;

  DepthReadOptions ReadOptions(const Camera& camera) const {
    DepthReadOptions options{.layer = convention.layer};
    if (convention.headerless) {
      options.raw_size =
          convention.raw_size.value_or(PlaneSize{camera.width_px(), camera.height_px()});
    }
    return options;
  }

  std::shared_ptr<const std::vector<float>> RayZ(const Camera& camera) const {
    const std::lock_guard<std::mutex> lock(ray_mutex);
    if (!ray_camera || !(*ray_camera == camera)) {
      ray_z = std::make_shared<const std::vector<float>>(RayZOfPixels(camera));
      ray_camera = camera;
    }
    return ray_z;
  }

  bool Has(const std::string& name) const {
    if (packed) return packed->HasDepth(name);
    return bundle ? bundle->Has(name) : files.contains(name);
  }

  // Finds a file for each reference and returns their pattern. Throws InputError where there are
  // none.
  std::string FindMaps(std::span<const PosedImage> references) {
    const std::vector<std::string>& bundles = convention.bundle.files;
    const std::vector<std::string> patterns =
        convention.patterns.empty() && bundles.empty() ? UsualPatterns() : convention.patterns;
    FoundFiles found = FindByBestPattern(folder, patterns, references);
    files = std::move(found.files);
    if (!files.empty()) return (folder / found.pattern).string();
    throw InputError(
        folder,
        fmt::format("no depth map of any of the {} references is here; looked for {}",
                    references.size(), fmt::join(patterns.empty() ? bundles : patterns, ", ")));
  }

  // Takes all maps from one file and returns their scale by its poses. Throws InputError where it
  // has no map of a reference.
  DepthBundle::Scale OpenBundle(const path& file, std::span<const PosedImage> references) {
    bundle.emplace(file, convention);
    // The first camera is often the points' frame itself, the last one seldom.
    const auto last =
        std::find_if(references.rbegin(), references.rend(),
                     [this](const PosedImage& reference) { return Has(reference.name); });
    if (last == references.rend()) {
      throw InputError(
          file, fmt::format("none of the {} images that {} lists is a reference, not {}",
                            convention.bundle.names.size(), convention.bundle.names_file.string(),
                            convention.bundle.names.front()));
    }
    bundle->CheckPoints(*last);
    DepthBundle::Scale scale = bundle->FindScale(references);
    const bool is_inverse = convention.kind == DepthKind::kInverse;
    convention.scale *= is_inverse ? 1 / scale.factor : scale.factor;
    return scale;
  }

  void OpenPacked(std::span<const PosedImage> references) {
    packed.emplace(folder);
    if (std::ranges::none_of(references, [&](const PosedImage& r) { return Has(r.name); })) {
      throw InputError(folder, "the packed map has no depth of any of the references");
    }
  }

  // Returns the file that holds a reference's map.
  const path& FileOf(const PosedImage& reference) const {
    if (packed) return packed->file();
    return bundle ? bundle->file() : files.at(reference.name);
  }

  StoredDepth ReadStored(const PosedImage& reference) const {
    if (packed) {
      DepthMap map = packed->ReadDepth(reference.name);
      return {
          map.width_px, map.height_px, std::move(map.z), DepthFileFormat::kRaw, "float32", {}, {}};
    }
    return bundle ? bundle->Map(reference)
                  : ReadDepthFile(files.at(reference.name), ReadOptions(reference.camera));
  }

  std::optional<StoredDepth> ReadConfidence(const PosedImage& reference) const {
    std::optional<StoredDepth> stored;
    if (bundle) {
      stored = bundle->Confidence(reference);
    } else if (!convention.confidence_pattern.empty()) {
      stored = ReadDepthFile(folder / ExpandPattern(convention.confidence_pattern, reference.name));
    }
    if (stored) stored = OnImage(*std::move(stored), reference);
    return stored;
  }

  MapPointer ReadConfidences(const PosedImage& reference) const {
    StoredDepth stored = ReadConfidence(reference).value();
    return std::make_shared<const DepthMap>(
        DepthMap{stored.width_px, stored.height_px, std::move(stored.values)});
  }

  // Returns the samples as they lie on the whole image.
  StoredDepth OnImage(StoredDepth stored, const PosedImage& reference) const {
    return OnWholeImage(Oriented(std::move(stored), convention.orientation), convention.fit,
                        {reference.camera.width_px(), reference.camera.height_px()},
                        FileOf(reference));
  }

  MapPointer Read(const PosedImage& reference) const {
    const StoredDepth stored = OnImage(ReadStored(reference), reference);
    const auto confidence =
        convention.confidence_threshold ? ReadConfidence(reference) : std::nullopt;
    std::shared_ptr<const std::vector<float>> rays;
    if (convention.kind == DepthKind::kRay) {
      const Camera& camera = convention.sensor ? convention.sensor->camera : reference.camera;
      rays = RayZ(camera.Scaled(stored.width_px, stored.height_px));
    }
    return std::make_shared<const DepthMap>(
        ToDepthMap(stored, reference.camera, convention, confidence ? &*confidence : nullptr,
                   rays ? std::span<const float>(*rays) : std::span<const float>()));
  }

  // Drops the least recently used ones, but for those that are being read and the last one; those
  // in use stay alive with their users. Needs the lock.
  void MakeRoom() const {
    for (auto place = order.end(); cache_bytes > max_cache_bytes && place != order.begin();) {
      --place;
      const auto oldest = cache.find(*place);
      if (oldest->second.bytes == 0 || place == order.begin()) continue;
      cache_bytes -= oldest->second.bytes;
      cache.erase(oldest);
      place = order.erase(place);
    }
  }

  // Removes a map that could not be read: who asks for it again, reads it again.
  void Forget(const std::string& name) const {
    const std::lock_guard<std::mutex> lock(mutex);
    const auto entry = cache.find(name);
    order.erase(entry->second.place);
    cache.erase(entry);
  }

  // Returns the map if it is there or another thread reads it. Else enters the name with what
  // `promise` will hold, which the caller has to fulfill, and returns nullopt.
  std::optional<std::shared_future<MapPointer>> FindOrEnter(
      const std::string& name, std::promise<MapPointer>& promise) const {
    const std::lock_guard<std::mutex> lock(mutex);
    if (const auto found = cache.find(name); found != cache.end()) {
      order.splice(order.begin(), order, found->second.place);
      return found->second.map;
    }
    order.push_front(name);
    cache[name] = {promise.get_future().share(), order.begin(), 0};
    return std::nullopt;
  }

  // Returns the map of this name in the cache, which `read` reads.
  MapPointer Load(const std::string& name, const PosedImage& reference,
                  MapPointer (Impl::*read)(const PosedImage&) const) const {
    std::promise<MapPointer> promise;
    if (const auto other = FindOrEnter(name, promise)) return other->get();
    try {
      MapPointer map = (this->*read)(reference);
      promise.set_value(map);
      const std::lock_guard<std::mutex> lock(mutex);
      Entry& entry = cache.at(name);
      entry.bytes = map->z.size() * sizeof(float);
      cache_bytes += entry.bytes;
      MakeRoom();
      return map;
    } catch (...) {
      promise.set_exception(std::current_exception());
      Forget(name);
      throw;
    }
  }
};

DepthFolder::DepthFolder(path folder, DepthConvention convention,
                         std::span<const PosedImage> references, size_t max_cache_bytes)
    : impl_(std::make_unique<Impl>()) {
  impl_->folder = std::move(folder);
  impl_->convention = std::move(convention);
  impl_->max_cache_bytes = max_cache_bytes;
  const bool is_packed = IsPackedMap(impl_->folder);
  const auto bundle =
      is_packed ? std::nullopt : FindBundle(impl_->folder, impl_->convention.bundle.files);
  std::string found_at;
  if (is_packed) {
    found_at = impl_->folder.string();
    impl_->OpenPacked(references);
  } else if (bundle) {
    found_at = bundle->string();
    DepthBundle::Scale scale = impl_->OpenBundle(*bundle, references);
    if (!scale.found.empty()) interpretation_ = ", " + scale.found;
    warnings_ = std::move(scale.warnings);
    const std::string& without_confidences = impl_->bundle->without_confidences();
    if (!without_confidences.empty()) {
      warnings_.push_back(fmt::format("no confidences are used: {}", without_confidences));
    }
  } else {
    found_at = impl_->FindMaps(references);
    const BundleLayout& layout = impl_->convention.bundle;
    if (layout.files.empty() &&
        (!layout.names_file.empty() || layout.points || !layout.poses.empty())) {
      throw InputError(impl_->folder, "names, points and poses are keys of maps that are one file");
    }
    // Confidences that a preset expects, and nobody asked for, are in the bundle, too.
    if (!layout.files.empty() && !impl_->convention.confidence_threshold) {
      impl_->convention.confidence_pattern.clear();
    }
  }
  const auto has_map = [this](const PosedImage& reference) { return impl_->Has(reference.name); };
  const auto first = std::ranges::find_if(references, has_map);
  RAYLIFT_CHECK(first != references.end());
  const auto missing = std::ranges::count_if(references, std::not_fn(has_map));
  if (missing > 0) {
    warnings_.push_back(fmt::format("{}: {} of {} references have no depth map, e.g. {}", found_at,
                                    missing, references.size(),
                                    std::ranges::find_if_not(references, has_map)->name));
  }
  LookAt(*first);
}

// Says how the maps are read, by the first one.
void DepthFolder::LookAt(const PosedImage& first) {
  const StoredDepth stored = impl_->ReadStored(first);
  interpretation_ =
      DescribeStored(stored, impl_->bundle, impl_->packed.has_value(), impl_->convention) +
      interpretation_;
  const std::string file = impl_->FileOf(first).string();
  if (stored.sample_type == "uint8") {
    throw InputError(file, "expected depth in 16 bits or floats, found 8 bits");
  }
  if (!impl_->convention.unit && !stored.sample_type.starts_with("float")) {
    warnings_.push_back(fmt::format("{}: integers, taken as millimeters (unit=mm says so)", file));
  }
  unit_ = StoredUnit(stored, impl_->convention);
  const StoredDepth on_image = impl_->OnImage(stored, first);
  size_px_ = {on_image.width_px, on_image.height_px};
  const double aspect = static_cast<double>(size_px_.width_px) / size_px_.height_px;
  const double image_aspect =
      static_cast<double>(first.camera.width_px()) / first.camera.height_px();
  if (std::abs(aspect / image_aspect - 1) > kMaxAspectDifference) {
    warnings_.push_back(
        fmt::format("{}: {} x {} is not the shape of its image, {} x {}: a map of a part of the "
                    "image would be read wrongly (fit={} say which part it is)",
                    file, stored.width_px, stored.height_px, first.camera.width_px(),
                    first.camera.height_px(), NameList<MapFit>()));
  }
}

DepthFolder::~DepthFolder() = default;

const DepthConvention& DepthFolder::convention() const { return impl_->convention; }

std::shared_ptr<const DepthMap> DepthFolder::Load(const PosedImage& reference) const {
  const std::string& name = reference.name;
  return impl_->Has(name) ? impl_->Load(name, reference, &Impl::Read) : nullptr;
}

bool DepthFolder::HasConfidences() const {
  if (impl_->convention.sensor) return false;  // they lie as the sensor sees them
  return impl_->bundle ? impl_->bundle->has_confidences()
                       : !impl_->convention.confidence_pattern.empty();
}

std::shared_ptr<const DepthMap> DepthFolder::LoadConfidence(const PosedImage& reference) const {
  if (!HasConfidences() || !impl_->Has(reference.name)) return nullptr;
  // No name of a file has a line's end.
  return impl_->Load(reference.name + "\nconfidence", reference, &Impl::ReadConfidences);
}

DepthSource::DepthSource(std::string description, std::shared_ptr<const DepthFolder> maps,
                         const DepthSamplingOptions& sampling, const SurfaceLimits& limits)
    : description_(std::move(description)),
      maps_(std::move(maps)),
      sampling_(sampling),
      limits_(limits) {
  RAYLIFT_CHECK(maps_ != nullptr);
}

std::string DepthSource::Description() const { return description_; }

std::vector<std::optional<SurfacePoint>> DepthSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  const auto map = maps_->Load(reference);
  if (map == nullptr) {
    return std::vector<std::optional<SurfacePoint>>(pixels.size());
  }
  auto points = LiftByDepthMap(*map, reference, pixels, sampling_);
  for (auto& point : points) {
    if (point && !limits_.Keep(*point)) point.reset();
  }
  return points;
}

}  // namespace raylift
