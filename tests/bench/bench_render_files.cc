// Whole rendering jobs, written to files, against the bare loop (in a scene without flags and in a
// robust one, which is what Raylift renders) and against a bare pipeline (the loop without flags,
// and the format's library called directly), all in turn in the same run, as the machine's speed
// drifts. One thread, CPU time, medians over rounds. "Limit" is what a bare pipeline reached of the
// bare loop's rate when it was measured on 5 M triangles for each format.
//   bench_render_files [million triangles = 5] [rounds = 3] [folder for the files = a new one]
//       [only formats whose name contains this]
//
// Last, the same job by two workers: CPU time per image, which is what sharing a machine leaves to
// compare, and the rate.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bare_files.h"
#include "bare_loop.h"
#include "base/statistics.h"
#include "city.h"
#include <fmt/format.h>
#include <time.h>
#include <unistd.h>

#include "raylift/views/render_job.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr int kViews = 24;

struct Cost {
  double cpu_s = 0;  // per image
  double wall_s = 0;
};

double CpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

Cost Measure(const std::function<void()>& work) {
  const double start = CpuSeconds();
  const auto wall_start = std::chrono::steady_clock::now();
  work();
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - wall_start;
  return {(CpuSeconds() - start) / kViews, wall.count() / kViews};
}

struct Format {
  std::string name;
  std::string extension;
  BareFormat bare;
  double limit;  // frames per second, of those without writing
  StorageOptions storage = {};
  // Seconds per image, a round each.
  std::vector<double> bare_loop = {};
  std::vector<double> robust_loop = {};
  std::vector<double> bare_pipeline = {};
  std::vector<double> job = {};
};

std::vector<Format> Formats() {
  constexpr double kWithoutWriting = 13.2;
  std::vector<Format> formats = {
      {"NPY", "npy", BareFormat::kNpy, 13.1 / kWithoutWriting},
      {"EXR half ZIP", "exr", BareFormat::kExrHalfZip, 9.0 / kWithoutWriting},
      {"PNG16", "png", BareFormat::kPng16, 7.4 / kWithoutWriting},
      {"EXR float PXR24", "exr", BareFormat::kExrFloatPxr24, 5.4 / kWithoutWriting},
      {"EXR float ZIP", "exr", BareFormat::kExrFloatZip, 2.9 / kWithoutWriting}};
  formats[1].storage.floats.exr_compression = ExrCompression::kZip;
  formats[1].storage.floats.sample = FloatSample::kFloat16;
  formats[2].storage.floats.out_of_range = DepthWriteOptions::OutOfRange::kDrop;
  formats[4].storage.floats.exr_compression = ExrCompression::kZip;
  return formats;
}

// The median over rounds of a[i] / b[i].
double MedianRatio(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> ratios;
  for (size_t i = 0; i < a.size(); ++i) ratios.push_back(a[i] / b[i]);
  return UpperMedianOr(std::move(ratios), 0);
}

class Bench {
 public:
  Bench(double millions, const path& folder)
      : folder_(folder),
        mesh_(std::make_shared<const TriangleMesh>(MakeCity(static_cast<size_t>(millions * 1e6)))),
        bare_(*mesh_, BareLoop::SceneFlag::kNone),
        robust_(*mesh_, BareLoop::SceneFlag::kRobust),
        scene_(std::make_shared<const RayCaster>(mesh_)),
        camera_(CityCamera()),
        poses_(CityViews(kViews)) {
    for (int i = 0; i < kViews; ++i) {
      const std::string name = fmt::format("{:02}", i);
      tasks_.push_back({{name, camera_, poses_[static_cast<size_t>(i)]}, name});
    }
    std::filesystem::create_directories(folder_);
  }

  void MeasureRound(Format& format) {
    const double before = Measure([&] { RenderBare(bare_, nullptr); }).cpu_s;
    format.bare_pipeline.push_back(Measure([&] { RenderBare(bare_, &format); }).cpu_s);
    format.job.push_back(Measure([&] { RunJob(format, 1); }).cpu_s);
    format.robust_loop.push_back(Measure([&] { RenderBare(robust_, nullptr); }).cpu_s);
    const double after = Measure([&] { RenderBare(bare_, nullptr); }).cpu_s;
    format.bare_loop.push_back(0.5 * (before + after));
  }

  void Print(const std::vector<Format>& formats, int rounds) const {
    std::printf("%.1f M triangles, 1920 x 1080, one thread, %d images, %d rounds, CPU time\n",
                static_cast<double>(mesh_->triangles.size()) / 1e6, kViews, rounds);
    std::printf("%-16s %28s %38s %10s %9s\n", "", "images/s of", "raylift's share of", "limit's",
                "share of");
    std::printf("%-16s %8s %9s %9s %12s %12s %12s %10s %9s\n", "", "loop", "pipeline", "raylift",
                "bare loop", "robust loop", "pipeline", "of loop", "limit");
    for (const Format& format : formats) {
      const double share = MedianRatio(format.bare_loop, format.job);
      std::printf(
          "%-16s %8.1f %9.1f %9.1f %12.2f %12.2f %12.2f %10.2f %9.2f\n", format.name.c_str(),
          1 / UpperMedianOr(format.bare_loop, 0), 1 / UpperMedianOr(format.bare_pipeline, 0),
          1 / UpperMedianOr(format.job, 0), share, MedianRatio(format.robust_loop, format.job),
          MedianRatio(format.bare_pipeline, format.job), format.limit, share / format.limit);
    }
  }

  void PrintTwoWorkers(std::vector<Format>& formats, int rounds) const {
    std::printf("\n%-16s %26s %26s %12s\n", "two workers", "CPU ms/image, one : two",
                "images/s, one : two", "CPU ratio");
    for (Format& format : formats) {
      std::vector<double> cpu_one, cpu_two, wall_one, wall_two;
      for (int round = 0; round < rounds; ++round) {
        const Cost one = Measure([&] { RunJob(format, 1); });
        const Cost two = Measure([&] { RunJob(format, 2); });
        cpu_one.push_back(one.cpu_s);
        cpu_two.push_back(two.cpu_s);
        wall_one.push_back(one.wall_s);
        wall_two.push_back(two.wall_s);
      }
      std::printf("%-16s %15.1f %10.1f %15.1f %10.1f %12.2f\n", format.name.c_str(),
                  UpperMedianOr(cpu_one, 0) * 1e3, UpperMedianOr(cpu_two, 0) * 1e3,
                  1 / UpperMedianOr(wall_one, 0), 1 / UpperMedianOr(wall_two, 0),
                  MedianRatio(cpu_one, cpu_two));
    }
  }

 private:
  // Written where there is a format.
  void RenderBare(const BareLoop& loop, const Format* format) {
    for (size_t i = 0; i < poses_.size(); ++i) {
      loop.Render(camera_, poses_[i], depth_);
      if (format == nullptr) continue;
      const path file = folder_ / fmt::format("bare{}.{}", i, format->extension);
      WriteBare(format->bare, file, camera_.width_px(), camera_.height_px(), depth_);
    }
  }

  void RunJob(const Format& format, int threads) const {
    RenderJobOptions options{.out = folder_ / "job",
                             .products = {{Product::kDepth, format.extension}}};
    options.storage = format.storage;
    options.overwrite = true;
    options.threads = threads;
    RunRenderJob(scene_, tasks_, options, {});
  }

  path folder_;
  std::shared_ptr<const TriangleMesh> mesh_;
  BareLoop bare_;
  BareLoop robust_;
  std::shared_ptr<const RayCaster> scene_;
  Camera camera_;
  std::vector<Rigid3> poses_;
  std::vector<RenderTask> tasks_;
  std::vector<float> depth_;
};

void Run(double millions, int rounds, const path& folder, const std::string& only) {
  std::vector<Format> formats = Formats();
  std::erase_if(formats,
                [&](const Format& format) { return format.name.find(only) == std::string::npos; });
  Bench bench(millions, folder);
  for (int round = 0; round < rounds; ++round) {
    for (Format& format : formats) bench.MeasureRound(format);
  }
  bench.Print(formats, rounds);
  bench.PrintTwoWorkers(formats, rounds);
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const bool keep = argc > 3 && argv[3][0] != '\0';
  const std::filesystem::path folder = keep ? std::filesystem::path(argv[3])
                                            : std::filesystem::temp_directory_path() /
                                                  fmt::format("bench_render_files.{}", getpid());
  raylift::Run(argc > 1 ? std::atof(argv[1]) : 5, argc > 2 ? std::atoi(argv[2]) : 3, folder,
               argc > 4 ? argv[4] : "");
  if (!keep) std::filesystem::remove_all(folder);
}
