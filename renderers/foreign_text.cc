#include "foreign_text.h"

#include <algorithm>
#include <cctype>

namespace raylift {

std::string Lower(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

std::string LowerExtension(const std::filesystem::path& path) {
  return Lower(path.extension().string());
}

std::string Shown(std::string_view token) {
  std::string text(token.substr(0, 40));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

}  // namespace raylift
