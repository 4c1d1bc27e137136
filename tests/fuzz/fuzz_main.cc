// All targets as one program for libFuzzer:
//   fuzz_readers --list
//   fuzz_readers --target=NAME --prepare=DIR    writes the seeds and, to DIR.dict, the words
//   fuzz_readers --target=NAME [libFuzzer's own arguments]

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>

#include "fuzz/fuzz_targets.h"
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace raylift {
namespace {

std::optional<FuzzTarget> chosen;  // for libFuzzer's functions, which take nothing but bytes

void Choose(std::string_view name) {
  for (const FuzzTarget& target : AllFuzzTargets()) {
    if (target.name == name) chosen = target;
  }
  if (!chosen) {
    fmt::print(stderr, "expected --target=NAME, one of those of --list, found \"{}\"\n", name);
    std::exit(2);
  }
}

void Prepare(const std::filesystem::path& folder) {
  int count = 0;
  for (const std::string& seed : chosen->seeds()) {
    WriteFile(folder / fmt::format("seed{}", count++), seed);
  }
  std::string dictionary;
  for (const std::string_view word : SplitTokens(chosen->words)) {
    std::string escaped;
    for (const char c : word) {
      const bool is_special = c == '"' || c == '\\';
      escaped += is_special ? fmt::format("\\{}", c) : std::string(1, c);
    }
    dictionary += fmt::format("\"{}\"\n", escaped);
  }
  WriteFile(folder.string() + ".dict", dictionary);
}

}  // namespace
}  // namespace raylift

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  std::string_view target, folder;
  for (int i = 1; i < *argc; ++i) {
    const std::string_view argument = (*argv)[i];
    if (argument == "--list") {
      for (const auto& listed : raylift::AllFuzzTargets()) fmt::print("{}\n", listed.name);
      std::exit(0);
    }
    constexpr std::string_view kTarget = "--target=", kPrepare = "--prepare=";
    if (argument.starts_with(kTarget)) target = argument.substr(kTarget.size());
    if (argument.starts_with(kPrepare)) folder = argument.substr(kPrepare.size());
  }
  raylift::Choose(target);
  if (!folder.empty()) {
    raylift::Prepare(folder);
    std::exit(0);
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  raylift::RunFuzzTarget(*raylift::chosen, {reinterpret_cast<const char*>(data), size});
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned int) {
  size = LLVMFuzzerMutate(data, size, max_size);
  if (raylift::chosen->repair == nullptr) return size;
  std::string bytes(reinterpret_cast<const char*>(data), size);
  raylift::chosen->repair(bytes);
  std::copy_n(bytes.data(), std::min(bytes.size(), max_size), data);
  return std::min(bytes.size(), max_size);
}
