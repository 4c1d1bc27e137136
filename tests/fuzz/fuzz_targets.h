// What is fuzzed: each reader and each parser of options, as a function over bytes. libFuzzer calls
// them (fuzz_main.cc, tests/fuzz/run.sh), and a test on all inputs that were a finding once
// (replay_test.cc).

#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

struct FuzzTarget {
  std::string_view name;
  // Reads the bytes. It may succeed or throw InputError or OptionError; all else is a finding.
  void (*read)(std::string_view bytes);
  // Inputs to begin with, made by our own writers where there are any.
  std::vector<std::string> (*seeds)();
  // Words of the format, separated by blanks: what mutations put in.
  std::string_view words = {};
  // Mends what a mutation has broken and no reader would go past: checksums.
  void (*repair)(std::string& bytes) = nullptr;
};

// All of them, group by group.
std::vector<FuzzTarget> AllFuzzTargets();
std::vector<FuzzTarget> ColmapFuzzTargets();
std::vector<FuzzTarget> ConfigFuzzTargets();
std::vector<FuzzTarget> SceneFuzzTargets();
std::vector<FuzzTarget> DepthFuzzTargets();
std::vector<FuzzTarget> FeatureFuzzTargets();
std::vector<FuzzTarget> MeshFuzzTargets();
std::vector<FuzzTarget> CloudFuzzTargets();
std::vector<FuzzTarget> SplatFuzzTargets();
std::vector<FuzzTarget> DatasetFuzzTargets();
std::vector<FuzzTarget> OptionFuzzTargets();
std::vector<FuzzTarget> RunFuzzTargets();
std::vector<FuzzTarget> ServiceFuzzTargets();

// Calls the target's reader. Returns the message of its error, empty where there was none; what it
// may not throw leaves this function.
std::string RunFuzzTarget(const FuzzTarget& target, std::string_view bytes);

// ---- what targets are made of ----

// A file of these bytes in a folder of this process, in memory. Its name may hold folders.
std::filesystem::path PutFile(const std::filesystem::path& name, std::string_view bytes);
std::string TakeFile(const std::filesystem::path& file);
std::filesystem::path ScratchFolder();

// One input of several files, in the order of the names. SplitFiles gives those that are there back
// to `folder` (in the scratch folder) and removes the others.
std::string JoinFiles(const std::filesystem::path& folder, std::span<const std::string_view> names);
std::filesystem::path SplitFiles(std::string_view bytes, const std::filesystem::path& folder,
                                 std::span<const std::string_view> names);

}  // namespace raylift
