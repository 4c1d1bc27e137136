// Reads and writes photographs and pictures. Orientation tags are ignored: pixels are in the order
// of the file, for which the camera's intrinsics hold.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "raylift/geometry/camera.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Reads the size alone, from the header. Throws InputError where the file is missing or no image.
PlaneSize ReadImageSize(const std::filesystem::path& path);

// Returns what the photograph's EXIF and XMP say of its lens.
LensTags ReadLensTags(const std::filesystem::path& path);

// Returns what is wrong where the photograph `name` has another size than its camera: whether
// viewers rotate it by its EXIF, and the camera at the photograph's size; nullopt where the sizes
// agree.
std::optional<std::string> WhyOtherSize(const Camera& camera, const std::string& name,
                                        PlaneSize size, bool is_turned);
// Throws InputError with that text where there is one; `file` is the photograph's.
void RequireSizeOf(const Camera& camera, const std::string& name, PlaneSize size,
                   const std::filesystem::path& file);

// Throws InputError where the file is missing or no image.
Image ReadImage(const std::filesystem::path& path, ImageChannels channels);
// Decodes the bytes of such a file. The InputError names no file.
Image DecodePhotograph(std::string_view bytes, ImageChannels channels);

// Writes a PNG or JPEG, by the extension: png, jpg.
void WriteImage(const std::filesystem::path& path, const Image& image, int jpeg_quality = 92);

}  // namespace raylift
