// Bytes as text of 64 letters (RFC 4648).

#pragma once

#include <string>
#include <string_view>

namespace raylift {

std::string EncodeBase64(std::string_view bytes);

// Throws InputError where the text is none. The padding may be left out.
std::string DecodeBase64(std::string_view text);

}  // namespace raylift
