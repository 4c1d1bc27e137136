// The fixed parts of the report's page.

#pragma once

#include <string>
#include <string_view>

namespace raylift {

// Returns the page around a JSON document. Title and JSON may hold anything.
std::string MakePage(std::string_view title, std::string_view json);

}  // namespace raylift
