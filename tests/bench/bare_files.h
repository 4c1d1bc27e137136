// The reference that written frames are measured against: each format's library called directly on
// what the bare loop has rendered, with no checks, names or reports.

#pragma once

#include <filesystem>
#include <span>

namespace raylift {

enum class BareFormat { kNpy, kExrHalfZip, kPng16, kExrFloatPxr24, kExrFloatZip };

// `depth` is infinite where there is no surface.
void WriteBare(BareFormat format, const std::filesystem::path& file, int width_px, int height_px,
               std::span<float> depth);

}  // namespace raylift
