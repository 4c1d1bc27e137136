// Loading a binary PLY mesh, each time in a process of its own, so that peak memory is its own:
// Raylift's reader, the least that any reader must do (the file mapped, copied and its indices
// checked, on one thread), and assimp. Interleaved; medians.
//   bench_load [million triangles = 5] [rounds = 5]

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "base/statistics.h"
#include "city.h"
#include "surfaces/input_files.h"
#include <assimp/Importer.hpp>
#include <assimp/scene.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

// The numbers of the header that WritePly wrote.
size_t CountOf(std::string_view contents, std::string_view element) {
  return std::strtoull(contents.data() + contents.find(element) + element.size(), nullptr, 10);
}

void LoadDirectly(const std::filesystem::path& path) {
  const MappedFile file(path);
  const std::string_view contents = file.contents();
  const size_t num_vertices = CountOf(contents, "element vertex ");
  const size_t num_faces = CountOf(contents, "element face ");
  const char* body = contents.data() + contents.find("end_header\n") + 11;
  const std::unique_ptr<float[]> vertices(new float[3 * num_vertices + 1]);
  const std::unique_ptr<uint32_t[]> triangles(new uint32_t[3 * num_faces]);
  std::memcpy(vertices.get(), body, 12 * num_vertices);
  const char* face = body + 12 * num_vertices;
  uint32_t largest = 0;
  for (size_t i = 0; i < num_faces; ++i, face += 13) {
    if (*face != 3) std::abort();
    std::memcpy(&triangles[3 * i], face + 1, 12);
    largest = std::max({largest, triangles[3 * i], triangles[3 * i + 1], triangles[3 * i + 2]});
  }
  if (largest >= num_vertices) std::abort();
  for (size_t i = 0; i < 3 * num_vertices; ++i) {
    if (!(std::abs(vertices[i]) < 1e30f)) std::abort();
  }
}

void LoadWithAssimp(const std::filesystem::path& path) {
  Assimp::Importer importer;
  if (importer.ReadFile(path.string(), 0) == nullptr) std::abort();
}

struct Cost {
  double wall_s;
  double cpu_s;  // of all threads
  double peak_mb;
};

// Has the host of a virtual machine back so much memory, in large pages, and gives it back: what a
// first touch costs there is no property of a reader.
void WarmMemory() {
  if (fork() == 0) {
    constexpr size_t kBytes = size_t{512} << 20;
    void* memory =
        mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) _exit(1);
    madvise(memory, kBytes, MADV_HUGEPAGE);
    std::memset(memory, 1, kBytes);
    _exit(0);
  }
  wait(nullptr);
}

Cost Measure(const std::function<void()>& load) {
  WarmMemory();
  int pipe_ends[2];
  if (pipe(pipe_ends) != 0) std::abort();
  const pid_t child = fork();
  if (child == 0) {
    const auto start = std::chrono::steady_clock::now();
    const double before = static_cast<double>(clock()) / CLOCKS_PER_SEC;
    load();
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    const auto seconds = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    const Cost cost{elapsed.count(), seconds(usage.ru_utime) + seconds(usage.ru_stime) - before,
                    static_cast<double>(usage.ru_maxrss) / 1024};
    if (write(pipe_ends[1], &cost, sizeof(cost)) != sizeof(cost)) std::abort();
    _exit(0);
  }
  Cost cost{};
  if (read(pipe_ends[0], &cost, sizeof(cost)) != sizeof(cost)) std::abort();
  close(pipe_ends[0]);
  close(pipe_ends[1]);
  waitpid(child, nullptr, 0);
  return cost;
}

void WriteCity(const std::filesystem::path& path, double millions) {
  if (fork() == 0) {  // so that the measured processes do not inherit its memory
    WritePly(path, MakeCity(static_cast<size_t>(millions * 1e6)));
    _exit(0);
  }
  wait(nullptr);
}

void Run(double millions, int rounds) {
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() / fmt::format("bench_load.{}.ply", getpid());
  WriteCity(path, millions);
  struct Contestant {
    std::string name;
    std::function<void()> load;
    std::vector<double> wall_s = {};
    std::vector<double> cpu_s = {};
    double peak_mb = 0;
  };
  std::vector<Contestant> contestants = {{"direct, one thread", [&] { LoadDirectly(path); }},
                                         {"Raylift", [&] { ReadMesh(path); }},
                                         {"assimp", [&] { LoadWithAssimp(path); }}};
  for (int round = 0; round < rounds; ++round) {
    for (Contestant& contestant : contestants) {
      const Cost cost = Measure(contestant.load);
      contestant.wall_s.push_back(cost.wall_s);
      contestant.cpu_s.push_back(cost.cpu_s);
      contestant.peak_mb = std::max(contestant.peak_mb, cost.peak_mb);
    }
  }
  const double megabytes = static_cast<double>(std::filesystem::file_size(path)) / 1e6;
  std::printf("binary PLY, %.1f MB, warm, %d rounds\n", megabytes, rounds);
  std::printf("%-20s %8s %8s %12s %15s %15s\n", "", "wall ms", "CPU ms", "peak / file",
              "wall of direct", "CPU of direct");
  for (const Contestant& contestant : contestants) {
    const auto ratio = [&](const std::vector<double>& reference, const std::vector<double>& own) {
      std::vector<double> ratios;
      for (size_t i = 0; i < own.size(); ++i) ratios.push_back(reference[i] / own[i]);
      return UpperMedianOr(std::move(ratios), 0);
    };
    std::printf("%-20s %8.1f %8.1f %12.2f %15.2f %15.2f\n", contestant.name.c_str(),
                UpperMedianOr(contestant.wall_s, 0) * 1e3, UpperMedianOr(contestant.cpu_s, 0) * 1e3,
                contestant.peak_mb * 1.048576 / megabytes,
                ratio(contestants[0].wall_s, contestant.wall_s),
                ratio(contestants[0].cpu_s, contestant.cpu_s));
  }
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  raylift::Run(argc > 1 ? std::atof(argv[1]) : 5, argc > 2 ? std::atoi(argv[2]) : 5);
}
