// What a walk costs beside localizing its photographs, in one run: the Tracker's time and memory
// per photograph, with one pose of each and with three alternatives, and the graph of a whole walk.
// CPU times of one thread.
//   bench_tracking [frames = 10000] [rounds over the demo's photographs = 3]

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/statistics.h"
#include "sequences/made_walk.h"
#include "support/test_data.h"
#include <unistd.h>

#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/scene.h"
#include "raylift/sequences/tracker.h"

namespace raylift {
namespace {

double CpuMs() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

double ResidentMb() {
  size_t all = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> all >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

void Print(const char* what, std::vector<double> ms) {
  const double p50 = QuantileInPlace(std::span(ms), 0.5),
               p99 = QuantileInPlace(std::span(ms), 0.99);
  std::printf("%-52s p50 %9.3f ms, p99 %9.3f ms\n", what, p50, p99);
}

// Returns the demo's scene and its photographs.
std::pair<Scene, std::vector<Query>> OpenDemo() {
  const auto folder = DemoFolder();
  return {OpenScene({.model = folder / "model",
                     .images = folder / "images",
                     .geometry = {"mesh:" + (folder / "scene.obj").string()}}),
          ReadQueryList(folder / "queries.txt")};
}

// Returns the times of localizing photographs: features, matches, points and pose.
std::vector<double> LocalizingMs(const Scene& scene, const std::vector<Query>& queries,
                                 int rounds) {
  MatchingOptions matching;
  matching.front_end.query_images = DemoFolder() / "images";
  const Localizer localizer(std::make_shared<const Scene>(scene),
                            OpenMatches(scene, queries, matching), {});
  std::vector<double> ms;
  for (int round = 0; round < rounds; ++round) {
    for (const Query& query : queries) {
      const Image photograph =
          ReadImage(DemoFolder() / "images" / query.name, ImageChannels::kGray);
      const double start = CpuMs();
      localizer.Localize(query, photograph);
      ms.push_back(CpuMs() - start);
    }
  }
  return ms;
}

// Returns a walk of which each tenth photograph has no pose, and each other so many more poses.
MadeWalk WalkWithAlternatives(size_t frames, size_t alternatives) {
  Rng rng(7);
  MadeWalk walk = MakeWalk(rng, {.frames = frames});
  for (size_t i = 0; i < frames; ++i) {
    std::vector<SinglePose>& singles = walk.frames[i].singles;
    if (i % 10 == 9) {
      singles.clear();
      continue;
    }
    SinglePose other = singles.front();
    if (alternatives > 0) singles.front().confidence = other.confidence = 0.25;
    for (size_t k = 1; k <= alternatives; ++k) {
      other.cam_from_world.translation.x() += 2;
      singles.push_back(other);
    }
  }
  return walk;
}

void Track(const Scene& scene, const Camera& camera, const MadeWalk& walk, const char* what) {
  const SceneDistances distances(scene, 1);
  const SmoothingOptions options;
  WalkState state;
  std::vector<double> ms;
  double early_mb = 0;
  for (size_t i = 0; i < walk.frames.size(); ++i) {
    const Query query{.name = std::to_string(i), .camera = camera};
    LocalizedQuery alone = ResultOf(walk.frames[i], query.name);
    for (size_t k = 1; k < walk.frames[i].singles.size(); ++k) {
      const SinglePose& other = walk.frames[i].singles[k];
      alone.estimate.alternatives.push_back(
          {other.cam_from_world, other.confidence, other.covariance});
    }
    const double start = CpuMs();
    raylift::Track({query, alone, walk.frames[i].cam_from_odometry, static_cast<double>(i)},
                   distances, options, state);
    ms.push_back(CpuMs() - start);
    if (i == walk.frames.size() / 10) early_mb = ResidentMb();
  }
  Print(what, std::move(ms));
  std::printf("  resident after a tenth of %zu frames %.1f MB, after all %.1f MB\n",
              walk.frames.size(), early_mb, ResidentMb());
}

void Run(size_t frames, int rounds) {
  const auto [scene, queries] = OpenDemo();
  const std::vector<double> alone = LocalizingMs(scene, queries, rounds);
  Print("localize a photograph", alone);
  Track(scene, queries.front().camera, WalkWithAlternatives(frames, 0), "track it");
  Track(scene, queries.front().camera, WalkWithAlternatives(frames, 3),
        "track it, with three alternatives");
  const MadeWalk walk = WalkWithAlternatives(frames, 0);
  const double start = CpuMs();
  SmoothWalk(walk.frames, OdometryScale::kKnown);
  const double ms = (CpuMs() - start) / static_cast<double>(frames);
  std::printf("%-52s %.3f ms a frame, %.2f %% of localizing it\n", "smooth the whole walk", ms,
              100 * ms / UpperMedianOr(alone, 1));
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const size_t frames = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 10000;
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 3;
  raylift::Run(std::max<size_t>(frames, 100), std::max(rounds, 1));
}
