// Lifting keypoints against the bare loop with the same rays, interleaved in the same run, as the
// machine's speed drifts: a round lifts each view's keypoints by each contestant in turn; printed
// are medians over views and rounds. Of the time of the bare loop whose rays are given, lifting
// should take at most 1.5, and at most 3.5 where it also measures the depth jump around keypoints.
//   bench_lifting [million triangles = 1] [rounds = 15] [keypoints per view = 2000]
//                 [only contestants of that name]

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>

#include "bare_loop.h"
#include "base/rng.h"
#include "base/statistics.h"
#include "city.h"
#include <time.h>

#include "raylift/lifting/mesh_source.h"

namespace raylift {
namespace {

constexpr int kViews = 20;

double CpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct CityView {
  PosedImage pinhole;
  PosedImage distorted;  // the same with a lens that bends by up to some 20 px
  std::vector<Eigen::Vector2d> pixels;
  std::vector<BareRay> rays;
};

std::vector<CityView> MakeViews(size_t num_keypoints) {
  Rng rng(1);
  const Camera camera = CityCamera();
  const Eigen::Vector2d center = camera.principal_point_px();
  const double params[] = {camera.focal_x_px(),
                           camera.focal_y_px(),
                           center.x(),
                           center.y(),
                           -0.03,
                           0.01,
                           0.0005,
                           -0.0003};
  const Camera distorted(CameraModel::kOpenCv, camera.width_px(), camera.height_px(), params);
  std::vector<CityView> views;
  for (const Rigid3& pose : CityViews(kViews)) {
    CityView view{{"view", camera, pose}, {"view", distorted, pose}, {}, {}};
    for (size_t i = 0; i < num_keypoints; ++i) {
      view.pixels.emplace_back(rng.Uniform(0, camera.width_px()),
                               rng.Uniform(0, camera.height_px()));
      const Eigen::Vector3d ray = camera.RayInCam(view.pixels.back()).value();
      view.rays.push_back(
          {pose.OriginInSource().cast<float>(), (pose.rotation.conjugate() * ray).cast<float>()});
    }
    views.push_back(std::move(view));
  }
  return views;
}

struct Contestant {
  std::string name;
  std::function<void(const CityView&)> lift;
  std::vector<double> seconds = {};
};

void Run(size_t num_triangles, int rounds, size_t num_keypoints, const std::string& only) {
  const auto mesh = std::make_shared<const TriangleMesh>(MakeCity(num_triangles));
  const BareLoop bare(*mesh, BareLoop::SceneFlag::kNone);
  const BareLoop bare_robust(*mesh, BareLoop::SceneFlag::kRobust);
  const auto caster = std::make_shared<const RayCaster>(mesh);
  const MeshSource points("points", caster);
  MeshOptions with_jumps;
  with_jumps.limits.max_depth_jump = 1e9;  // measured, and none dropped
  const MeshSource records("records", caster, with_jumps);
  const std::vector<CityView> views = MakeViews(num_keypoints);
  std::vector<float> ray_t(num_keypoints);
  std::vector<Contestant> contestants = {
      {"bare rtcIntersect1, rays given", [&](const CityView& v) { bare.Cast(v.rays, ray_t); }},
      {"bare rtcIntersect1, robust scene, rays given",
       [&](const CityView& v) { bare_robust.Cast(v.rays, ray_t); }},
      {"bare rtcIntersect1, rays made from pixels",
       [&](const CityView& v) {
         bare.CastPixels(v.pinhole.camera, v.pinhole.cam_from_world, v.pixels, ray_t);
       }},
      {"points, normals, incidence", [&](const CityView& v) { points.Lift(v.pinhole, v.pixels); }},
      {"the same through a distorted lens",
       [&](const CityView& v) { points.Lift(v.distorted, v.pixels); }},
      {"with the depth jump (four more rays each)",
       [&](const CityView& v) { records.Lift(v.pinhole, v.pixels); }}};
  std::erase_if(contestants, [&](const Contestant& c) { return !only.empty() && c.name != only; });
  // In random order, as who comes first, or after a large one, finds colder caches.
  std::vector<Contestant*> order;
  for (Contestant& contestant : contestants) order.push_back(&contestant);
  Rng rng(2);
  for (int round = 0; round < rounds; ++round) {
    for (const CityView& view : views) {
      for (size_t k = order.size(); k > 1; --k) std::swap(order[k - 1], order[rng.UniformIndex(k)]);
      for (Contestant* contestant : order) {
        const double start = CpuSeconds();
        contestant->lift(view);
        contestant->seconds.push_back(CpuSeconds() - start);
      }
    }
  }
  std::printf("%.1f M triangles, %d views of %zu keypoints, one thread, %d rounds, CPU time\n",
              static_cast<double>(mesh->triangles.size()) / 1e6, kViews, num_keypoints, rounds);
  std::printf("%-46s %8s %10s %8s %10s %10s\n", "", "ms", "keypt/ms", "of bare", "of robust",
              "of pixels");
  for (const Contestant& contestant : contestants) {
    const auto times_of = [&](const Contestant& reference) {
      std::vector<double> ratios;
      for (size_t i = 0; i < reference.seconds.size(); ++i) {
        ratios.push_back(contestant.seconds[i] / reference.seconds[i]);
      }
      return UpperMedianOr(std::move(ratios), 0);
    };
    const double ms = 1e3 * UpperMedianOr(contestant.seconds, 0);
    std::printf("%-46s %8.3f %10.0f %8.2f %10.2f %10.2f\n", contestant.name.c_str(), ms,
                static_cast<double>(num_keypoints) / ms, times_of(contestants[0]),
                times_of(contestants[contestants.size() > 1 ? 1 : 0]),
                times_of(contestants[contestants.size() > 1 ? 2 : 0]));
  }
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const double millions = argc > 1 ? std::atof(argv[1]) : 1;
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 15;
  const int keypoints = argc > 3 ? std::atoi(argv[3]) : 2000;
  raylift::Run(static_cast<size_t>(millions * 1e6), rounds, static_cast<size_t>(keypoints),
               argc > 4 ? argv[4] : "");
}
