#include "library_versions.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>
#include <system_error>

#include <link.h>

namespace raylift {
namespace {

constexpr std::array<std::string_view, 16> kNames = {
    "libassimp.", "libceres.",  "libembree", "libfmt.",    "libhdf5",   "libjpeg.",
    "libopencv_", "libOpenEXR", "libpng",    "libraylift", "libsqlite", "libstdc++.",
    "libtbb.",    "libtiff.",   "libwebp.",  "libzip."};

int Add(dl_phdr_info* library, size_t, void* names) {
  std::error_code failed;
  const std::string name =
      std::filesystem::canonical(library->dlpi_name, failed).filename().string();
  const bool known = std::any_of(kNames.begin(), kNames.end(),
                                 [&](std::string_view begin) { return name.starts_with(begin); });
  if (!failed && known) static_cast<std::vector<std::string>*>(names)->push_back(name);
  return 0;  // go on
}

}  // namespace

std::vector<std::string> LoadedLibraries() {
  std::vector<std::string> names;
  dl_iterate_phdr(&Add, &names);
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace raylift
