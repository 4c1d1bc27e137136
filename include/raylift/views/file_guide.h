// What the files of a rendering job hold, for who reads them: units, conventions, names.

#pragma once

#include <span>
#include <string>
#include <string_view>

#include "raylift/renderers/frame_renderer.h"
#include "raylift/views/product.h"

namespace raylift {

// The file that a job leaves beside its products, and how it starts.
inline constexpr std::string_view kFileGuideName = "README.txt";
inline constexpr std::string_view kFileGuideTitle = "What these files hold";

// Of a job that writes these products in these formats.
std::string FileGuide(std::span<const ProductOutput> outputs, const StorageOptions& storage,
                      FrameOptions::NormalsIn normals_in);

// Of all products and formats.
std::string FileGuide();

}  // namespace raylift
