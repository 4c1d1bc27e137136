// Bodies of the type multipart/form-data (RFC 7578), as browsers and curl send files and fields.

#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// A field of a form. Views point into the body.
struct FormPart {
  std::string name;
  std::optional<std::string> file_name = std::nullopt;
  std::string_view content;
};

inline constexpr size_t kMaxFormParts = 256;
inline constexpr size_t kMaxPartHeaderBytes = size_t{8} << 10;

// Returns the parts of a body, in their order. Throws InputError for a body that does not follow
// the grammar or ends too soon, for a part without a name, and for too many parts.
std::vector<FormPart> ParseMultipart(std::string_view body, std::string_view boundary);

// Returns a parameter of a header's value: the "boundary" of "multipart/form-data; boundary=abc".
// Names are compared in lower case. nullopt where there is none.
std::optional<std::string> HeaderParameter(std::string_view value, std::string_view name);

// Returns the value without its parameters, in lower case.
std::string MediaType(std::string_view value);

}  // namespace raylift
