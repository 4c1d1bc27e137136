#include "raylift/views/render_job.h"

#include <algorithm>
#include <chrono>
#include <future>
#include <limits>
#include <list>
#include <mutex>
#include <set>

#include "base/json_members.h"
#include "base/lap_clock.h"
#include "jobs/file_promises.h"
#include "jobs/manifest_file.h"
#include "renderers/view_frame.h"
#include "views/job_files.h"
#include "views/surface_labels.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/io/image_file.h"
#include "raylift/jobs/task_job.h"
#include "raylift/renderers/pixel_rays.h"

namespace raylift {

using std::filesystem::path;

static void Members(JsonMembers& members, ManifestEntry& entry) {
  members("name", entry.name);
  members.If(true, "place", entry.place);
  members("key", entry.key);
  members("camera", entry.camera);
  members("pixels", entry.pixels);
  members("hits", entry.hits);
  members("depth_range", entry.depth_range);
  members("dropped", entry.dropped);
  members("files", entry.files);
}

std::string ToJsonLine(const ManifestEntry& entry) { return JsonText(ToJson(entry)); }

// Returns nullopt if the line is no entry of a manifest.
static std::optional<ManifestEntry> ParseEntry(const std::string& line) {
  try {
    return ParseJson<ManifestEntry>(line);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

ManifestEntries ReadManifest(const path& file) {
  ManifestEntries entries;
  for (const std::string& line : ReadManifestText(file).lines) {
    if (auto entry = ParseEntry(line)) entries.insert_or_assign(entry->name, std::move(*entry));
  }
  return entries;
}

namespace {

// Returns the range of the depths that are not 0. It is computed in lanes, which compilers turn
// into vector instructions.
std::optional<std::pair<float, float>> DepthRange(const std::vector<float>& depth) {
  constexpr size_t kLanes = 16;
  std::array<float, kLanes> lows, highs;
  lows.fill(std::numeric_limits<float>::infinity());
  highs.fill(0);
  const auto take = [&](size_t lane, float z) {
    const float low = z > 0 ? z : std::numeric_limits<float>::infinity();
    lows[lane] = low < lows[lane] ? low : lows[lane];
    highs[lane] = z > highs[lane] ? z : highs[lane];
  };
  const size_t whole = depth.size() / kLanes * kLanes;
  for (size_t i = 0; i < whole; i += kLanes) {
    for (size_t lane = 0; lane < kLanes; ++lane) take(lane, depth[i + lane]);
  }
  for (size_t i = whole; i < depth.size(); ++i) take(i - whole, depth[i]);
  const float high = *std::max_element(highs.begin(), highs.end());
  if (high == 0) return std::nullopt;
  return std::pair(*std::min_element(lows.begin(), lows.end()), high);
}

// Keeps the tables of rays of the cameras in use: views of one camera share one.
class RayTables {
 public:
  // Keeps at most `capacity` tables, besides those that are held by others.
  explicit RayTables(size_t capacity) : capacity_(capacity) {}

  // Makes the table where it is not there. Thread safe; a table is made once.
  std::shared_ptr<const PixelRays> Get(const Camera& camera);

 private:
  using Table = std::shared_future<std::shared_ptr<const PixelRays>>;

  size_t capacity_;
  std::mutex mutex_;
  std::list<std::pair<std::string, Table>> tables_;  // the last used first
};

std::shared_ptr<const PixelRays> RayTables::Get(const Camera& camera) {
  const std::string key = camera.ToString();
  std::promise<std::shared_ptr<const PixelRays>> promise;
  Table table;
  bool make = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = std::find_if(tables_.begin(), tables_.end(),
                                    [&key](const auto& entry) { return entry.first == key; });
    if (found != tables_.end()) {
      tables_.splice(tables_.begin(), tables_, found);
    } else {
      tables_.emplace_front(key, promise.get_future().share());
      if (tables_.size() > capacity_) tables_.pop_back();
      make = true;
    }
    table = tables_.front().second;
  }
  if (make) {
    try {
      promise.set_value(std::make_shared<const PixelRays>(camera, 1));
    } catch (...) {
      promise.set_exception(std::current_exception());
    }
  }
  return table.get();
}

// Frames that are not in use, so that their memory is used again.
class FramePool {
 public:
  std::unique_ptr<Frame> Take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (frames_.empty()) return std::make_unique<Frame>();
    std::unique_ptr<Frame> frame = std::move(frames_.back());
    frames_.pop_back();
    return frame;
  }
  void Return(std::unique_ptr<Frame> frame) {
    const std::lock_guard<std::mutex> lock(mutex_);
    frames_.push_back(std::move(frame));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<Frame>> frames_;
};

FrameOptions OptionsOfFrames(const RenderJobOptions& options) {
  FrameOptions frame = options.frame;
  frame.depth = true;  // for the summary; it costs next to nothing
  Request(options.products, frame);
  return frame;
}

// Orders views of one camera after each other, so that few tables of rays are needed at a time; all
// shards deal the same list.
std::vector<RenderTask> InOrder(std::vector<RenderTask> tasks) {
  std::sort(tasks.begin(), tasks.end(), [](const RenderTask& a, const RenderTask& b) {
    return std::pair(a.view.camera.ToString(), a.view.name) <
           std::pair(b.view.camera.ToString(), b.view.name);
  });
  return tasks;
}

std::vector<std::string> NamesOf(std::span<const RenderTask> tasks) {
  std::vector<std::string> names;
  for (const RenderTask& task : tasks) names.push_back(task.view.name);
  return names;
}

// Returns the files that a former run lists and this one does not write.
std::vector<std::string> ListForeignFiles(std::span<const RenderTask> tasks,
                                          const RenderJobOptions& options) {
  std::set<std::string> foreign;
  for (const path& manifest : ListManifests(options.out)) {
    for (const auto& [name, entry] : ReadManifest(manifest)) {
      for (const PromisedFile& file : entry.files) foreign.insert(file.path);
    }
  }
  if (foreign.empty()) return {};
  for (const RenderTask& task : tasks) {
    for (const std::string& file : TaskFiles(task, options.products)) foreign.erase(file);
  }
  std::erase_if(foreign,
                [&options](const std::string& file) { return !Exists(options.out / file); });
  return {foreign.begin(), foreign.end()};
}

void RemoveLeftoversOfShard(std::span<const RenderTask> tasks, const RenderJobOptions& options) {
  std::vector<std::string> files = {"summary.json", "timing.jsonl", "preview.png",
                                    std::string(kFileGuideName),
                                    ManifestPath({}, options.shard).string()};
  for (const Product product : kNamedProducts) files.push_back(FileOfNames(product));
  for (size_t i = 0; i < tasks.size(); ++i) {
    if (!options.shard.Contains(i)) continue;
    for (std::string& file : TaskFiles(tasks[i], options.products)) {
      files.push_back(std::move(file));
    }
  }
  RemoveLeftovers(options.out, files);
}

size_t NumRays(const Camera& camera, const RenderJobOptions& options) {
  const size_t pixels =
      static_cast<size_t>(camera.width_px()) * static_cast<size_t>(camera.height_px());
  const auto side = static_cast<size_t>(options.frame.color_options.samples_per_pixel_side);
  const bool has_color = std::any_of(options.products.begin(), options.products.end(), &HasColors);
  return has_color && side > 1 ? pixels * (1 + side * side) : pixels;
}

// Warns where no image sees anything, or all look very far, which comes of a mistake.
std::vector<std::string> WarningsOf(const ManifestEntries& entries,
                                    std::span<const RenderTask> tasks, const RayCaster& scene) {
  if (entries.empty()) return {};
  std::vector<double> farthest;
  bool seen = false;
  for (const auto& [name, entry] : entries) {
    seen = seen || entry.hits > 0;
    if (entry.depth_range) farthest.push_back(static_cast<double>(entry.depth_range->second));
  }
  std::vector<Eigen::Vector3d> centers;
  for (const RenderTask& task : tasks) {
    if (entries.contains(task.view.name)) {
      centers.push_back(task.view.cam_from_world.OriginInSource());
    }
  }
  if (!seen) return {WhyTheMeshIsUnseen(scene, centers)};
  const auto question = AskForUnit(centers, std::move(farthest));
  return question ? std::vector{*question} : std::vector<std::string>{};
}

// Writes README.txt unless there is another file of that name.
void WriteGuide(const RenderJobOptions& options) {
  const path file = options.out / kFileGuideName;
  if (Exists(file) && !ReadFile(file).starts_with(kFileGuideTitle)) {
    return;
  }
  WriteFile(file, FileGuide(options.products, options.storage, options.frame.normals_in));
}

std::vector<RenderTask> ByName(std::vector<RenderTask> tasks) {
  std::sort(tasks.begin(), tasks.end(),
            [](const RenderTask& a, const RenderTask& b) { return a.view.name < b.view.name; });
  return tasks;
}

ManifestEntries EntriesOf(const TaskManifest& manifest) {
  ManifestEntries entries;
  for (const auto& [key, record] : manifest.records) {
    ManifestEntry entry = ParseEntry(record.line).value();
    entries.emplace(entry.name, std::move(entry));
  }
  return entries;
}

class RenderJob {
 public:
  RenderJob(const std::shared_ptr<const RayCaster>& scene, std::vector<RenderTask> tasks,
            const RenderJobOptions& options, const RenderHooks& hooks)
      : options_(options),
        hooks_(hooks),
        scene_(scene),
        tasks_(InOrder(std::move(tasks))),
        renderer_(scene, OptionsOfFrames(options)),
        threads_(ResolveThreads(options.threads)),
        tables_(static_cast<size_t>(threads_) + 1),
        header_(JobHeader(*scene, options)),
        job_(NamesOf(tasks_), ManifestHeader(header_, tasks_.size()),
             {options.out, options.shard, options.resume, options.overwrite, options.wait},
             Form()) {}

  RenderSummary Run() {
    const std::vector<size_t> missing = job_.Missing();
    kept_ = job_.manifest().records.size();
    size_t rays = 0;
    for (const size_t i : missing) rays += NumRays(tasks_[i].view.camera, options_);
    if (hooks_.on_start) hooks_.on_start(missing.size(), rays);
    std::vector<std::string> foreign_files = ListForeignFiles(tasks_, options_);
    RemoveLeftoversOfShard(tasks_, options_);
    job_.Begin(std::nullopt);
    const bool all_done = RenderAll(missing);
    const bool complete = all_done && Finish();
    ManifestEntries done = EntriesOf(job_.manifest());
    std::vector<std::string> warnings = WarningsOf(done, tasks_, *scene_);
    warnings.insert(warnings.end(), of_machines_.begin(), of_machines_.end());
    warnings.insert(warnings.end(), of_cameras_.begin(), of_cameras_.end());
    return {.images = done.size(),
            .rendered = rendered_,
            .kept = kept_,
            .left = job_.Missing().size(),
            .complete = complete,
            .foreign_files = std::move(foreign_files),
            .warnings = std::move(warnings),
            .totals = TotalsOf(done),
            .rays = rays_,
            .seconds = clock_.Seconds(),
            .entries = std::move(done)};
  }

 private:
  JobForm Form() const {
    JobForm form{.results = {}, .is_readable = [](const std::string& line) {
                   return ParseEntry(line).has_value();
                 }};
    for (const RenderTask& task : tasks_) form.keys.push_back(TaskKey(header_, task));
    form.threads = threads_;
    return form;
  }

  // Returns whether none was left out.
  bool RenderAll(const std::vector<size_t>& to_do) {
    if (to_do.empty()) return true;
    std::atomic<bool> failed{false};
    const int frame_threads = std::max(1, threads_ / static_cast<int>(to_do.size()));
    ParallelFor(to_do.size(), threads_, [&](size_t i) {
      if (failed || (hooks_.stop != nullptr && *hooks_.stop)) return;
      try {
        RenderOne(to_do[i], frame_threads);
      } catch (...) {
        failed = true;
        throw;
      }
    });
    return rendered_ == to_do.size();
  }

  void RenderOne(size_t index, int frame_threads) {
    const RenderTask& task = tasks_[index];
    LapClock clock;
    std::unique_ptr<Frame> frame = frames_.Take();
    renderer_.Render(*tables_.Get(task.view.camera), task.view.cam_from_world, frame_threads,
                     *frame);
    const double render_s = clock.Lap();
    ManifestEntry entry{.name = task.view.name,
                        .place = index,
                        .key = job_.key(index),
                        .camera = task.view.camera.ToString(),
                        .pixels = frame->depth.size(),
                        .hits = frame->num_hits,
                        .depth_range = DepthRange(frame->depth)};
    const CommittedFiles written(CommittedFiles::Sync::kByPromise);
    const std::vector<std::string> files = TaskFiles(task, options_.products);
    for (size_t k = 0; k < files.size(); ++k) {
      entry.dropped += WriteProduct(options_.out / files[k], options_.products[k], *frame,
                                    scene_->mesh(), options_.storage)
                           .dropped;
    }
    entry.files = PromiseFiles(options_.out, written.paths());
    frames_.Return(std::move(frame));
    job_.Add(index, ToJsonLine(entry));
    const std::lock_guard<std::mutex> lock(mutex_);
    const size_t rays = NumRays(task.view.camera, options_);
    rays_ += rays;
    ++rendered_;
    if (hooks_.on_image) {
      hooks_.on_image({entry, render_s, clock.Seconds(), rays});
    }
  }

  // Writes what the job as a whole leaves, once all shards are complete; the last one to see that
  // does it (or several, which then write the same). Returns whether they are.
  bool Finish() {
    const std::optional<TaskManifest> whole = job_.Whole();
    if (!whole) return false;
    of_machines_ = MachineWarnings(*whole);
    const ManifestEntries all = EntriesOf(*whole);
    const CommittedFiles results;
    const std::vector<RenderTask> by_name = ByName(tasks_);
    std::vector<PosedImage> views;
    for (const RenderTask& task : by_name) views.push_back(task.view);
    if (options_.preview) {
      WriteImage(options_.out / "preview.png", MakeContactSheet(scene_, views, threads_));
    }
    for (const CameraFiles files : options_.camera_files) {
      if (files == CameraFiles::kTransforms) {
        WriteFile(options_.out / "transforms.json", TransformsJson(by_name, options_));
      } else {
        of_cameras_ = WriteMvsnetCameras(options_.out, *scene_, views, threads_);
      }
    }
    for (const ProductOutput& output : options_.products) {
      if (!HasNames(output.product)) continue;
      WriteFile(options_.out / FileOfNames(output.product),
                NamesOfIds(output.product, scene_->mesh()));
    }
    WriteGuide(options_);
    WriteFile(options_.out / "summary.json",
              SummaryJson(header_, all, WarningsOf(all, tasks_, *scene_)));
    if (!options_.command.empty()) {
      WriteFile(options_.out / "timing.jsonl",
                TimingJson({options_.command, wall_start_, clock_.Seconds(), rendered_, kept_}));
    }
    job_.Finish(*whole, results.paths());
    return true;
  }

  std::vector<std::string> of_machines_, of_cameras_;
  const LapClock clock_;
  const std::chrono::system_clock::time_point wall_start_ = std::chrono::system_clock::now();
  const RenderJobOptions& options_;
  const RenderHooks& hooks_;
  std::shared_ptr<const RayCaster> scene_;
  std::vector<RenderTask> tasks_;
  FrameRenderer renderer_;
  int threads_;
  RayTables tables_;
  std::string header_;
  TaskJob job_;
  FramePool frames_;

  std::mutex mutex_;  // guards what follows while images are rendered
  size_t kept_ = 0;
  size_t rendered_ = 0;
  size_t rays_ = 0;
};

}  // namespace

RenderSummary RunRenderJob(const std::shared_ptr<const RayCaster>& scene,
                           std::vector<RenderTask> tasks, const RenderJobOptions& options,
                           const RenderHooks& hooks) {
  RAYLIFT_CHECK(scene != nullptr);
  RAYLIFT_CHECK(!options.products.empty());
  CheckCameraFiles(tasks, options);
  RequireIds(options.products, scene->mesh());
  return RenderJob(scene, std::move(tasks), options, hooks).Run();
}

}  // namespace raylift
