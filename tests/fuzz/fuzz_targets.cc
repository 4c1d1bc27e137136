#include "fuzz/fuzz_targets.h"

#include <algorithm>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

// What other libraries do not give back where a file is broken is no finding.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions() {
  return "leak:libhdf5\nleak:libassimp\nleak:libopencv\n";
}

namespace raylift {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kNextFile = "\n=FILE=\n";

// Of this process; removed when it ends.
class Scratch {
 public:
  Scratch() {
    std::error_code ignored;
    const fs::path memory = "/dev/shm";
    folder_ = (fs::is_directory(memory, ignored) ? memory : fs::temp_directory_path()) /
              fmt::format("raylift-fuzz-{}", getpid());
    fs::create_directories(folder_);
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  const fs::path& folder() const { return folder_; }

 private:
  fs::path folder_;
};

}  // namespace

std::vector<FuzzTarget> AllFuzzTargets() {
  std::vector<FuzzTarget> all;
  for (const auto group :
       {ColmapFuzzTargets, ConfigFuzzTargets, SceneFuzzTargets, DepthFuzzTargets,
        FeatureFuzzTargets, MeshFuzzTargets, CloudFuzzTargets, DatasetFuzzTargets, SplatFuzzTargets,
        OptionFuzzTargets, RunFuzzTargets, ServiceFuzzTargets}) {
    std::ranges::copy(group(), std::back_inserter(all));
  }
  return all;
}

std::string RunFuzzTarget(const FuzzTarget& target, std::string_view bytes) {
  try {
    target.read(bytes);
    return {};
  } catch (const InputError& error) {
    return error.what();
  } catch (const OptionError& error) {
    return error.what();
  }
}

fs::path ScratchFolder() {
  static const Scratch scratch;
  return scratch.folder();
}

fs::path PutFile(const fs::path& name, std::string_view bytes) {
  const fs::path file = ScratchFolder() / name;
  fs::create_directories(file.parent_path());
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  stream.close();
  RAYLIFT_CHECK(stream.good());
  return file;
}

std::string TakeFile(const fs::path& file) { return ReadFile(file); }

std::string JoinFiles(const fs::path& folder, std::span<const std::string_view> names) {
  std::string bytes;
  for (const std::string_view name : names) {
    if (name != names.front()) bytes += kNextFile;
    if (fs::exists(folder / name)) bytes += ReadFile(folder / name);
  }
  return bytes;
}

fs::path SplitFiles(std::string_view bytes, const fs::path& folder,
                    std::span<const std::string_view> names) {
  for (const std::string_view name : names) {
    const size_t end = std::min(bytes.find(kNextFile), bytes.size());
    if (end > 0) {
      PutFile(folder / name, bytes.substr(0, end));
    } else {
      fs::remove(ScratchFolder() / folder / name);
    }
    bytes.remove_prefix(std::min(end + kNextFile.size(), bytes.size()));
  }
  return ScratchFolder() / folder;
}

}  // namespace raylift
