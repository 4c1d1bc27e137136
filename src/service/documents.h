// The server's own documents, made from the files in src/service/documents.

#pragma once

#include <string_view>

namespace raylift {

extern const std::string_view kOpenApi;    // JSON
extern const std::string_view kStartPage;  // HTML: drop a photograph, see the answer

}  // namespace raylift
