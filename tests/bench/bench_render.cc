// Rendering against the bare loop, interleaved in the same run, as the machine's speed drifts: a
// round renders each view by each contestant in turn; printed are medians over rounds.
//   bench_render [million triangles = 1] [rounds = 7] [only contestants of that name]

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>

#include "bare_loop.h"
#include "base/statistics.h"
#include "city.h"
#include <time.h>

#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

double CpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct Contestant {
  std::string name;
  std::function<void(const Rigid3&)> render;
  std::vector<double> seconds = {};
};

void Run(size_t num_triangles, int rounds, const std::string& only) {
  const auto mesh = std::make_shared<const TriangleMesh>(MakeCity(num_triangles));
  const BareLoop bare(*mesh, BareLoop::SceneFlag::kNone);
  const BareLoop bare_robust(*mesh, BareLoop::SceneFlag::kRobust);
  const auto caster = std::make_shared<const RayCaster>(mesh);
  const Camera camera = CityCamera();
  const std::vector<Rigid3> views = CityViews(4);
  const PixelRays rays(camera, 0);
  std::vector<float> bare_depth;
  Frame frame;
  const auto make = [&](const std::function<void(FrameOptions&)>& choose) {
    FrameOptions options;
    choose(options);
    const auto renderer = std::make_shared<FrameRenderer>(caster, options);
    return
        [renderer, &rays, &frame](const Rigid3& view) { renderer->Render(rays, view, 1, frame); };
  };
  std::vector<Contestant> contestants = {
      {"bare rtcIntersect16, scene without flags",
       [&](const Rigid3& view) { bare.Render(camera, view, bare_depth); }},
      {"bare rtcIntersect16, robust scene",
       [&](const Rigid3& view) { bare_robust.Render(camera, view, bare_depth); }},
      {"depth", make([](FrameOptions& o) { o.depth = true; })},
      {"depth, distance, triangle, mask",
       make([](FrameOptions& o) { o.depth = o.distance = o.triangle = o.mask = true; })},
      {"depth, normals, incidence",
       make([](FrameOptions& o) { o.depth = o.normals = o.incidence = true; })},
      {"color (headlight)", make([](FrameOptions& o) {
         o.color = true;
         o.color_options.shading = ColorOptions::Shading::kHeadlight;
       })}};
  std::erase_if(contestants, [&](const Contestant& c) { return !only.empty() && c.name != only; });
  for (int round = 0; round < rounds; ++round) {
    for (const Rigid3& view : views) {
      for (Contestant& contestant : contestants) {
        const double start = CpuSeconds();
        contestant.render(view);
        contestant.seconds.push_back(CpuSeconds() - start);
      }
    }
  }
  const double pixels = double{1920} * 1080;
  std::printf("%.1f M triangles, 1920 x 1080, one thread, %zu views, %d rounds, CPU time\n",
              static_cast<double>(mesh->triangles.size()) / 1e6, views.size(), rounds);
  std::printf("%-42s %8s %8s %10s %12s\n", "", "ms", "Mray/s", "of bare", "of robust");
  for (const Contestant& contestant : contestants) {
    const auto ratio = [&](const Contestant& reference) {
      std::vector<double> ratios;
      for (size_t i = 0; i < reference.seconds.size(); ++i) {
        ratios.push_back(reference.seconds[i] / contestant.seconds[i]);
      }
      return UpperMedianOr(std::move(ratios), 0);
    };
    const double seconds = UpperMedianOr(contestant.seconds, 0);
    std::printf("%-42s %8.1f %8.1f %10.2f %12.2f\n", contestant.name.c_str(), seconds * 1e3,
                pixels / seconds / 1e6, ratio(contestants[0]),
                ratio(contestants[contestants.size() > 1 ? 1 : 0]));
  }
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const double millions = argc > 1 ? std::atof(argv[1]) : 1;
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 7;
  raylift::Run(static_cast<size_t>(millions * 1e6), rounds, argc > 3 ? argv[3] : "");
}
