// Photographs and pictures in files. Orientation tags are ignored: pixels are those that the
// camera's intrinsics mean.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "raylift/geometry/camera.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The size alone, from the header. Throws InputError where the file is
// missing or no image.
PlaneSize ReadImageSize(const std::filesystem::path& path);

// Returns what the photograph says of its lens, by EXIF and XMP.
LensTags ReadLensTags(const std::filesystem::path& path);

// Returns what is wrong where the photograph `name` has another size than its camera: whether
// viewers turn it, as its EXIF says, and what the camera is at the photograph's size.
std::optional<std::string> WhyOtherSize(const Camera& camera, const std::string& name,
                                        PlaneSize size, bool is_turned);
// Throws InputError with that where there is something; `file` is the photograph's.
void RequireSizeOf(const Camera& camera, const std::string& name, PlaneSize size,
                   const std::filesystem::path& file);

// Throws InputError where the file is missing or no image.
Image ReadImage(const std::filesystem::path& path, ImageChannels channels);
// The same of the bytes of such a file. InputError names none.
Image DecodePhotograph(std::string_view bytes, ImageChannels channels);

// The format follows the extension: png, jpg.
void WriteImage(const std::filesystem::path& path, const Image& image, int jpeg_quality = 92);

}  // namespace raylift
