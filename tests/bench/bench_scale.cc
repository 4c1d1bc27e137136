// What a city costs: `raylift localize` as a process of its own on a city's mesh, references and
// queries with features and matches as hloc's files hold them, at an eighth of the size, at eight
// times that along each of triangles, references, queries and matches, and whole. Prints time, CPU
// and peak memory of each run, their growth along each axis (1 is linear), the stages of a query,
// and what shards on 1, 2, 4 ... 64 machines would take by the times measured.
//   bench_scale RAYLIFT FOLDER [million triangles = 50] [references = 100000] [queries = 10000]
//               [keypoints of a query = 500]
// The folder is made, holds some GB, and is kept; a mesh that is there is used.

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "../support/match_file.h"
#include "base/rng.h"
#include "city.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/io/colmap_model.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/query_list.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

constexpr int kRetrieved = 10;
constexpr int kOtherKeypoints = 200;  // of every reference, matched by no query
constexpr double kWrongShare = 0.2;
constexpr double kNoisePx = 0.5;

struct Size {
  double million_triangles = 0;
  int references = 0;
  int queries = 0;
  int keypoints = 0;
};

struct Cost {
  double seconds = 0;
  double cpu_seconds = 0;
  double peak_gb = 0;
};

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Throws where the program fails.
Cost Run(const std::vector<std::string>& command) {
  std::vector<char*> arguments;
  for (const std::string& argument : command) {
    arguments.push_back(const_cast<char*>(argument.c_str()));
  }
  arguments.push_back(nullptr);
  const auto start = Clock::now();
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    if (std::freopen("/dev/null", "w", stdout) == nullptr) std::_Exit(127);
    execv(arguments[0], arguments.data());
    std::_Exit(127);
  }
  int status = 0;
  rusage usage{};
  if (child < 0 || wait4(child, &status, 0, &usage) != child || status != 0) {
    throw std::runtime_error(fmt::format("{} failed", fmt::join(command, " ")));
  }
  const double passed = SecondsSince(start);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return {passed, seconds(usage.ru_utime) + seconds(usage.ru_stime),
          static_cast<double>(usage.ru_maxrss) / (1 << 20)};
}

double Yaw(const Rigid3& cam_from_world) {
  const Eigen::Vector3d forward = cam_from_world.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  return std::atan2(forward.y(), forward.x());
}

// The views of a crossing, where those of one direction see the same.
class Crossings {
 public:
  explicit Crossings(std::span<const Rigid3> views) {
    for (size_t i = 0; i < views.size(); ++i) {
      views_[KeyOf(views[i])].push_back({Yaw(views[i]), i});
    }
  }

  std::vector<size_t> Nearest(const Rigid3& view, size_t count) const {
    const auto found = views_.find(KeyOf(view));
    if (found == views_.end()) return {};
    std::vector<std::pair<double, size_t>> near = found->second;
    for (auto& [yaw, index] : near) {
      yaw = std::abs(std::remainder(yaw - Yaw(view), 2 * std::numbers::pi));
    }
    count = std::min(count, near.size());
    std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), near.end());
    std::vector<size_t> indices;
    for (size_t i = 0; i < count; ++i) indices.push_back(near[i].second);
    return indices;
  }

 private:
  using Key = std::array<int, 3>;
  static Key KeyOf(const Rigid3& view) {
    constexpr double kBlock = 20;
    const Eigen::Vector3d center = view.OriginInSource();
    return {static_cast<int>(center.x() / kBlock), static_cast<int>(center.y() / kBlock),
            center.z() > kBlock ? 1 : 0};
  }

  std::map<Key, std::vector<std::pair<double, size_t>>> views_;
};

std::string ReferenceName(size_t i) { return fmt::format("reference/{:06}.jpg", i); }
std::string QueryName(size_t i) { return fmt::format("query/{:06}.jpg", i); }

fs::path MeshOf(const fs::path& folder, double million_triangles) {
  return folder / fmt::format("city_{:g}.ply", million_triangles);
}

void MakeMesh(const fs::path& path, double million_triangles) {
  if (!fs::exists(path)) WritePly(path, MakeCity(static_cast<size_t>(1e6 * million_triangles)));
}

// One city's features and matches.
class Photographs {
 public:
  Photographs(const RayCaster& mesh, const Size& size)
      : mesh_(mesh), size_(size), camera_(CityCamera()) {
    views_ = CityViews(size.references + size.queries);
    std::rotate(views_.begin(), views_.begin() + size.queries, views_.end());
    references_.resize(static_cast<size_t>(size.references));
    queries_.resize(static_cast<size_t>(size.queries));
    Rng rng(2);
    for (Features& reference : references_) {
      reference = Empty();
      for (int i = 0; i < kOtherKeypoints; ++i) reference.keypoints_px.push_back(Anywhere(rng));
    }
    const Crossings crossings(ReferenceViews());
    for (size_t q = 0; q < queries_.size(); ++q) {
      Match(q, crossings.Nearest(QueryView(q), kRetrieved), rng);
    }
  }

  void Write(const fs::path& folder) const {
    ColmapModel model;
    model.cameras.emplace(1, camera_);
    for (size_t i = 0; i < references_.size(); ++i) {
      ColmapImage& image = model.images[static_cast<uint32_t>(i + 1)];
      image.name = ReferenceName(i);
      image.camera_id = 1;
      image.SetCamFromWorld(views_[i]);
    }
    fs::create_directories(folder / "model");
    WriteColmapModel(folder / "model", model, ColmapForm::kBinary);

    std::map<std::string, Features> features;
    for (size_t i = 0; i < references_.size(); ++i) {
      features.emplace(ReferenceName(i), references_[i]);
    }
    std::vector<Query> list;
    for (size_t i = 0; i < queries_.size(); ++i) {
      features.emplace(QueryName(i), queries_[i]);
      list.push_back({QueryName(i), camera_});
    }
    WriteFeatureFile(folder / "features.h5", features, false);
    WriteMatchFile(folder / "matches.h5", matches_);
    WriteQueryList(folder / "queries.txt", list);
    std::vector<std::pair<std::string, std::string>> pairs;
    for (const MatchedPair& pair : matches_)
      pairs.emplace_back(pair.query_name, pair.reference_name);
    WritePairs(folder / "pairs.txt", pairs);
  }

  std::vector<NamedPose> Truth() const {
    std::vector<NamedPose> truth;
    for (size_t i = 0; i < queries_.size(); ++i) truth.push_back({QueryName(i), QueryView(i)});
    return truth;
  }

 private:
  Features Empty() const {
    Features features;
    features.image_width_px = camera_.width_px();
    features.image_height_px = camera_.height_px();
    return features;
  }
  std::span<const Rigid3> ReferenceViews() const { return {views_.data(), references_.size()}; }
  const Rigid3& QueryView(size_t q) const { return views_[references_.size() + q]; }

  Eigen::Vector2d Anywhere(Rng& rng) const {
    return {rng.Uniform(0, camera_.width_px()), rng.Uniform(0, camera_.height_px())};
  }

  Eigen::Vector2d Measured(const Eigen::Vector2d& pixel, Rng& rng) const {
    return pixel + Eigen::Vector2d(kNoisePx * rng.Normal(), kNoisePx * rng.Normal());
  }

  Ray Through(const Rigid3& view, const Eigen::Vector2d& pixel) const {
    return {view.OriginInSource(), view.rotation.conjugate() * camera_.RayInCam(pixel).value()};
  }

  // Where a view sees a point, if it does.
  std::optional<Eigen::Vector2d> Seen(const Eigen::Vector3d& point, const Rigid3& view) const {
    const auto pixel = camera_.ImgFromCam(view * point);
    if (!pixel || !(pixel->array() >= 0).all() || pixel->x() >= camera_.width_px() ||
        pixel->y() >= camera_.height_px()) {
      return std::nullopt;
    }
    const Ray ray = Through(view, *pixel);
    const std::optional<RayHit> hit = mesh_.Cast(std::span(&ray, 1)).front();
    constexpr double kSame = 0.05;
    const double distance = (point - ray.origin_in_world).norm();
    return hit && std::abs(hit->ray_t - distance) < kSame ? pixel : std::nullopt;
  }

  void Match(size_t q, const std::vector<size_t>& retrieved, Rng& rng) {
    Features& query = queries_[q] = Empty();
    std::vector<Ray> rays;
    for (int i = 0; i < size_.keypoints; ++i) {
      const Eigen::Vector2d pixel = Anywhere(rng);
      rays.push_back(Through(QueryView(q), pixel));
      query.keypoints_px.push_back(Measured(pixel, rng));
    }
    const std::vector<std::optional<RayHit>> hits = mesh_.Cast(rays);
    for (const size_t r : retrieved) {
      MatchedPair pair{QueryName(q), ReferenceName(r), rays.size(), {}};
      for (size_t i = 0; i < rays.size(); ++i) {
        if (!hits[i]) continue;
        const Eigen::Vector3d point =
            rays[i].origin_in_world + hits[i]->ray_t * rays[i].direction_in_world;
        const auto pixel = Seen(point, views_[r]);
        if (!pixel) continue;
        std::vector<Eigen::Vector2d>& keypoints = references_[r].keypoints_px;
        pair.matches.push_back({static_cast<int>(i), static_cast<int>(keypoints.size()), 1});
        keypoints.push_back(rng.Uniform() < kWrongShare ? Anywhere(rng) : Measured(*pixel, rng));
      }
      matches_.push_back(std::move(pair));
    }
  }

  const RayCaster& mesh_;
  Size size_;
  Camera camera_;
  std::vector<Rigid3> views_;  // of the references, then of the queries
  std::vector<Features> references_;
  std::vector<Features> queries_;
  std::vector<MatchedPair> matches_;
};

// The median over the queries of what each stage took.
std::map<std::string, double> StageMedians(const fs::path& timing) {
  std::map<std::string, std::vector<double>> values;
  std::ifstream file(timing);
  for (std::string line; std::getline(file, line);) {
    const auto json = nlohmann::json::parse(line);
    if (!json.contains("name")) continue;
    for (const auto& [stage, ms] : json.at("milliseconds").items()) values[stage].push_back(ms);
  }
  std::map<std::string, double> medians;
  for (auto& [stage, ms] : values) {
    std::nth_element(ms.begin(), ms.begin() + static_cast<std::ptrdiff_t>(ms.size() / 2), ms.end());
    medians[stage] = ms[ms.size() / 2];
  }
  return medians;
}

struct CityCost {
  Size size;
  Cost all;
  Cost opening;                            // with one query
  double reading_s = 0;                    // the mesh alone
  double building_s = 0;                   // its hierarchy of boxes
  std::map<std::string, double> stage_ms;  // medians over the queries
  size_t right = 0;
};

// How many poses are within 25 cm of the truth.
size_t CountRight(const fs::path& poses, const std::vector<NamedPose>& truth) {
  constexpr double kNear = 0.25;
  std::map<std::string, Eigen::Vector3d> centers;
  for (const NamedPose& pose : truth) centers[pose.name] = pose.cam_from_world.OriginInSource();
  size_t right = 0;
  for (const NamedPose& pose : ReadPoseFile(poses)) {
    right += (pose.cam_from_world.OriginInSource() - centers.at(pose.name)).norm() < kNear;
  }
  return right;
}

class Bench {
 public:
  Bench(std::string raylift, fs::path folder)
      : raylift_(std::move(raylift)), folder_(std::move(folder)) {
    fs::create_directories(folder_);
  }

  CityCost MeasureCity(const Size& size) {
    CityCost cost;
    cost.size = size;
    const std::vector<NamedPose> truth = MakeFiles(cost);
    cost.all = Localize(size, "queries.txt", {});
    cost.stage_ms = StageMedians(folder_ / "out/timing.jsonl");
    cost.right = CountRight(folder_ / "out/poses.txt", truth);
    cost.opening = Localize(size, "one.txt", {});
    return cost;
  }

  // Of the files made last.
  Cost MeasureShard(const Size& size, int count) {
    return Localize(size, "queries.txt", {"--shard", fmt::format("1/{}", count)});
  }

 private:
  // Adds what reading and building take.
  std::vector<NamedPose> MakeFiles(CityCost& cost) {
    const fs::path file = MeshOf(folder_, cost.size.million_triangles);
    MakeMesh(file, cost.size.million_triangles);
    auto start = Clock::now();
    const auto mesh = std::make_shared<const TriangleMesh>(ReadMesh(file));
    cost.reading_s = SecondsSince(start);
    start = Clock::now();
    const RayCaster caster(mesh);
    cost.building_s = SecondsSince(start);
    const Photographs photographs(caster, cost.size);
    photographs.Write(folder_);
    std::vector<Query> queries = ReadQueryList(folder_ / "queries.txt");
    queries.resize(1, queries.front());
    WriteQueryList(folder_ / "one.txt", queries);
    return photographs.Truth();
  }

  Cost Localize(const Size& size, const std::string& queries,
                const std::vector<std::string>& more) const {
    fs::remove_all(folder_ / "out");
    const auto in_folder = [&](const char* name) { return (folder_ / name).string(); };
    std::vector<std::string> command = {
        raylift_,     "localize",
        "--model",    in_folder("model"),
        "--queries",  (folder_ / queries).string(),
        "--geometry", "mesh:" + MeshOf(folder_, size.million_triangles).string(),
        "--features", in_folder("features.h5"),
        "--matches",  in_folder("matches.h5"),
        "--pairs",    in_folder("pairs.txt"),
        "--out",      in_folder("out"),
        "--quiet"};
    command.insert(command.end(), more.begin(), more.end());
    return Run(command);
  }

  std::string raylift_;
  fs::path folder_;
};

void Print(const CityCost& cost) {
  const auto stage = [&](const char* name) { return cost.stage_ms.at(name); };
  fmt::print(
      "{:9.3g} {:10} {:7} {:9} | {:8.1f} {:8.1f} {:6.2f} | {:7.1f} {:6.2f} {:6.1f} {:6.1f} | "
      "{:6.2f} {:6.2f} {:6.2f} {:8.2f} | {}\n",
      cost.size.million_triangles, cost.size.references, cost.size.queries, cost.size.keypoints,
      cost.all.seconds, cost.all.cpu_seconds, cost.all.peak_gb, cost.opening.seconds,
      cost.opening.peak_gb, cost.reading_s, cost.building_s, stage("match"), stage("lift"),
      stage("filter"), stage("estimate"), cost.right);
  std::fflush(stdout);
}

// The exponent with which a cost grows from one city to one that is larger by `factor`.
double Slope(double from, double to, double factor) {
  return std::log(to / from) / std::log(factor);
}

int Main(int argc, char** argv) {
  if (argc < 3) {
    fmt::print(stderr,
               "Usage: bench_scale RAYLIFT FOLDER [million triangles] [references] "
               "[queries] [keypoints]\n");
    return 2;
  }
  const auto number = [&](int i, double value) { return argc > i ? std::atof(argv[i]) : value; };
  constexpr int kFactor = 8;
  const Size whole{number(3, 50), static_cast<int>(number(4, 1e5)),
                   static_cast<int>(number(5, 1e4)), static_cast<int>(number(6, 500))};
  const Size part{whole.million_triangles / kFactor, whole.references / kFactor,
                  whole.queries / kFactor, whole.keypoints / kFactor};

  Bench bench(argv[1], argv[2]);
  fmt::print(
      "M triangles, references, queries, keypoints | seconds, CPU, GB | to open: seconds, GB, "
      "of them to read and build the mesh | ms of a query: match, lift, filter, estimate | within "
      "25 cm\n");
  const CityCost base = bench.MeasureCity(part);
  Print(base);
  std::vector<std::pair<const char*, Size>> axes(4, {"", part});
  axes[0] = {"triangles", part};
  axes[0].second.million_triangles = whole.million_triangles;
  axes[1] = {"references", part};
  axes[1].second.references = whole.references;
  axes[2] = {"queries", part};
  axes[2].second.queries = whole.queries;
  axes[3] = {"keypoints", part};
  axes[3].second.keypoints = whole.keypoints;
  std::vector<CityCost> costs;
  for (const auto& [name, size] : axes) {
    costs.push_back(bench.MeasureCity(size));
    Print(costs.back());
  }
  const CityCost all = bench.MeasureCity(whole);
  Print(all);

  fmt::print("\ngrowth: CPU, memory, opening\n");
  for (size_t i = 0; i < axes.size(); ++i) {
    fmt::print("{:10} {:5.2f} {:5.2f} {:5.2f}\n", axes[i].first,
               Slope(base.all.cpu_seconds, costs[i].all.cpu_seconds, kFactor),
               Slope(base.all.peak_gb, costs[i].all.peak_gb, kFactor),
               Slope(base.opening.seconds, costs[i].opening.seconds, kFactor));
  }

  constexpr int kMost = 64;
  fmt::print("\nmachines: seconds by what opening and a query take\n");
  for (int machines = 1; machines <= kMost; machines *= 2) {
    const double of_queries = all.all.seconds - all.opening.seconds;
    fmt::print("{:3} {:8.1f}\n", machines, all.opening.seconds + of_queries / machines);
  }
  const Cost shard = bench.MeasureShard(whole, kMost);
  fmt::print("a shard of {}: {:.1f} s, {:.1f} s of CPU, {:.2f} GB\n", kMost, shard.seconds,
             shard.cpu_seconds, shard.peak_gb);
  return 0;
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  try {
    return raylift::Main(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "bench_scale: {}\n", error.what());
    return 1;
  }
}
