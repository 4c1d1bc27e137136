// Whole rendering jobs, written to files, against the bare loop in the same run. For each format
// the share of the bare loop's rate is compared with what a pipeline without anything around it
// reached when it was measured in the same way on 5 M triangles ("limit"): rendering by the bare
// loop, and the format's library called directly. One thread, CPU time.
//   bench_render_files [million triangles = 5] [rounds = 3] [folder for the files]

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "bare_loop.h"
#include "city.h"
#include <fmt/format.h>
#include <time.h>
#include <unistd.h>

#include "raylift/rendering/render_job.h"

namespace raylift {
namespace {

double CpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

struct Format {
  std::string name;
  std::string extension;
  double limit;  // frames per second, of those without writing
  StorageOptions storage = {};
  std::vector<double> shares = {};  // of the bare loop, a round each
  std::vector<double> seconds = {};
};

std::vector<Format> Formats() {
  constexpr double kWithoutWriting = 13.2;
  std::vector<Format> formats = {{"NPY", "npy", 13.1 / kWithoutWriting},
                                 {"EXR half ZIP", "exr", 9.0 / kWithoutWriting},
                                 {"PNG16", "png", 7.4 / kWithoutWriting},
                                 {"EXR float PXR24", "exr", 5.4 / kWithoutWriting},
                                 {"EXR float ZIP", "exr", 2.9 / kWithoutWriting}};
  formats[1].storage.floats.exr_compression = ExrCompression::kZip;
  formats[1].storage.floats.sample = FloatSample::kFloat16;
  formats[2].storage.floats.out_of_range = DepthWriteOptions::OutOfRange::kDrop;
  formats[4].storage.floats.exr_compression = ExrCompression::kZip;
  return formats;
}

void Run(double millions, int rounds, const std::filesystem::path& folder) {
  constexpr int kViews = 32;
  const auto mesh =
      std::make_shared<const TriangleMesh>(MakeCity(static_cast<size_t>(millions * 1e6)));
  const BareLoop bare(*mesh, BareLoop::SceneFlag::kNone);
  const auto scene = std::make_shared<const RayCaster>(mesh);
  const Camera camera = CityCamera();
  const std::vector<Rigid3> poses = CityViews(kViews);
  std::vector<RenderTask> tasks;
  for (int i = 0; i < kViews; ++i) {
    const std::string name = fmt::format("{:02}", i);
    tasks.push_back({{name, camera, poses[static_cast<size_t>(i)]}, name});
  }
  std::vector<Format> formats = Formats();
  std::vector<double> bare_seconds;
  std::vector<float> depth;
  for (int round = 0; round < rounds; ++round) {
    for (Format& format : formats) {
      const auto bare_views = [&] {
        const double start = CpuSeconds();
        for (const Rigid3& pose : poses) bare.Render(camera, pose, depth);
        return CpuSeconds() - start;
      };
      const double before = bare_views();
      RenderJobOptions options{.out = folder, .products = {{Product::kDepth, format.extension}}};
      options.storage = format.storage;
      options.threads = 1;
      const double start = CpuSeconds();
      RunRenderJob(scene, tasks, options, {});
      const double seconds = CpuSeconds() - start;
      const double reference = 0.5 * (before + bare_views());
      bare_seconds.push_back(reference / kViews);
      format.seconds.push_back(seconds / kViews);
      format.shares.push_back(reference / seconds);
    }
  }
  std::printf("%.1f M triangles, 1920 x 1080, one thread, %d images, %d rounds, CPU time\n",
              static_cast<double>(mesh->triangles.size()) / 1e6, kViews, rounds);
  std::printf("%-20s %10s %14s %10s %10s\n", "", "images/s", "of bare loop", "limit", "of limit");
  std::printf("%-20s %10.1f\n", "bare, not written", 1 / Median(bare_seconds));
  for (const Format& format : formats) {
    const double share = Median(format.shares);
    std::printf("%-20s %10.1f %14.2f %10.2f %10.2f\n", format.name.c_str(),
                1 / Median(format.seconds), share, format.limit, share / format.limit);
  }
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const std::filesystem::path folder =
      argc > 3
          ? std::filesystem::path(argv[3])
          : std::filesystem::temp_directory_path() / fmt::format("bench_render_files.{}", getpid());
  raylift::Run(argc > 1 ? std::atof(argv[1]) : 5, argc > 2 ? std::atoi(argv[2]) : 3, folder);
  if (argc <= 3) std::filesystem::remove_all(folder);
}
