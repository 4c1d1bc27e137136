// Photographs whose file ends too soon: decoders fill the rest with gray and say nothing.

#pragma once

#include <string_view>

namespace raylift {

// Of a JPEG or PNG file without its end; false for any other bytes.
bool IsCutShort(std::string_view bytes);

}  // namespace raylift
