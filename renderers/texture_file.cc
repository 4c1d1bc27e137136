#include "texture_file.h"

#include <algorithm>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/pictures/picture_codec.h"

namespace raylift {

std::optional<Image> DecodeTexture(std::span<const uint8_t> bytes) {
  try {
    return DecodePicture({reinterpret_cast<const char*>(bytes.data()), bytes.size()},
                         ImageChannels::kRgb);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

int32_t AddTextureFile(const std::filesystem::path& mesh_path, const std::string& name,
                       RawMesh& mesh) {
  std::string portable = name;
  std::replace(portable.begin(), portable.end(), '\\', '/');
  const std::filesystem::path path = mesh_path.parent_path() / portable;
  try {
    const std::string bytes = ReadFile(path);
    auto image = DecodeTexture({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
    if (image) {
      mesh.textures.push_back(std::move(*image));
      return static_cast<int32_t>(mesh.textures.size()) - 1;
    }
    mesh.warnings.push_back(fmt::format("{}: texture {}: cannot be decoded as a picture",
                                        mesh_path.string(), path.string()));
  } catch (const InputError& error) {
    mesh.warnings.push_back(fmt::format("{}: texture {}", mesh_path.string(), error.what()));
  }
  return -1;
}

}  // namespace raylift
