#include "service/multipart.h"

#include <algorithm>
#include <utility>

#include "base/input_paths.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr std::string_view kLineEnd = "\r\n";
constexpr size_t kMaxBoundary = 70;  // RFC 2046, 5.1.1

// Takes the parameters that follow a header's value, one after the other.
class Parameters {
 public:
  explicit Parameters(std::string_view value)
      : rest_(value.substr(std::min(value.find(';'), value.size()))) {}

  struct Parameter {
    std::string name;  // in lower case
    std::string value;
  };
  std::optional<Parameter> Next() {
    while (!rest_.empty() &&
           (rest_.front() == ';' || rest_.front() == ' ' || rest_.front() == '\t'))
      rest_.remove_prefix(1);
    const size_t equals = rest_.find_first_of("=;");
    if (equals == std::string_view::npos || rest_[equals] == ';') return std::nullopt;
    Parameter parameter{.name = Lower(Trim(rest_.substr(0, equals))), .value = {}};
    rest_.remove_prefix(equals + 1);
    parameter.value = rest_.starts_with('"') ? TakeQuoted() : TakeToken();
    return parameter;
  }

 private:
  std::string TakeToken() {
    const size_t end = std::min(rest_.find(';'), rest_.size());
    const std::string token(Trim(rest_.substr(0, end)));
    rest_.remove_prefix(end);
    return token;
  }

  // A backslash stands before what would end the text, and before itself. (Internet Explorer's
  // "C:\a.jpg" is of the past.)
  std::string TakeQuoted() {
    std::string text;
    size_t at = 1;
    for (; at < rest_.size() && rest_[at] != '"'; ++at) {
      if (rest_[at] == '\\' && at + 1 < rest_.size()) ++at;
      text += rest_[at];
    }
    rest_.remove_prefix(std::min(at + 1, rest_.size()));
    return text;
  }

  std::string_view rest_;
};

FormPart ReadPartHeader(std::string_view header, size_t index) {
  FormPart part;
  bool is_named = false;
  while (!header.empty()) {
    const size_t end = std::min(header.find(kLineEnd), header.size());
    const std::string_view line = header.substr(0, end);
    header.remove_prefix(std::min(end + kLineEnd.size(), header.size()));
    const size_t colon = line.find(':');
    if (colon == std::string_view::npos) {
      throw InputError(fmt::format("part {}: expected lines \"Name: value\" above it", index));
    }
    if (Lower(Trim(line.substr(0, colon))) != "content-disposition") continue;
    const std::string_view value = Trim(line.substr(colon + 1));
    if (const auto name = HeaderParameter(value, "name")) {
      part.name = *name;
      is_named = true;
    }
    part.file_name = HeaderParameter(value, "filename");
  }
  if (!is_named) {
    throw InputError(fmt::format("part {}: expected a Content-Disposition with a name", index));
  }
  return part;
}

[[noreturn]] void FailCutShort() {
  throw InputError("the body ends too soon: its last boundary is missing");
}

// Takes a line's end behind blanks; nullopt where something else stands there.
std::optional<std::string_view> AfterLineEnd(std::string_view rest) {
  while (rest.starts_with(' ') || rest.starts_with('\t')) rest.remove_prefix(1);
  if (!rest.starts_with(kLineEnd)) return std::nullopt;
  return rest.substr(kLineEnd.size());
}

}  // namespace

std::optional<std::string> HeaderParameter(std::string_view value, std::string_view name) {
  Parameters parameters(value);
  while (auto parameter = parameters.Next()) {
    if (parameter->name == name) return std::move(parameter->value);
  }
  return std::nullopt;
}

std::string MediaType(std::string_view value) {
  return Lower(Trim(value.substr(0, std::min(value.find(';'), value.size()))));
}

std::vector<FormPart> ParseMultipart(std::string_view body, std::string_view boundary) {
  if (boundary.empty() || boundary.size() > kMaxBoundary) {
    throw InputError(fmt::format("the boundary: expected 1 to {} characters", kMaxBoundary));
  }
  const std::string delimiter = fmt::format("{}--{}", kLineEnd, boundary);
  // The first one may stand at the beginning of the body, without a line's end.
  const std::string_view opening = std::string_view(delimiter).substr(kLineEnd.size());
  std::string_view rest = body;
  if (body.starts_with(opening)) {
    rest.remove_prefix(opening.size());
  } else if (const size_t begin = body.find(delimiter); begin != std::string_view::npos) {
    rest.remove_prefix(begin + delimiter.size());
  } else {
    throw InputError("the body does not hold its boundary");
  }
  std::vector<FormPart> parts;
  while (!rest.starts_with("--")) {
    const auto header_begin = AfterLineEnd(rest);
    if (!header_begin) FailCutShort();
    if (parts.size() == kMaxFormParts) {
      throw InputError(fmt::format("expected at most {} parts", kMaxFormParts));
    }
    constexpr std::string_view kHeaderEnd = "\r\n\r\n";
    const size_t header_end =
        header_begin->substr(0, kMaxPartHeaderBytes + kHeaderEnd.size()).find(kHeaderEnd);
    if (header_end == std::string_view::npos) {
      throw InputError(fmt::format("part {}: its header does not end within {} bytes", parts.size(),
                                   kMaxPartHeaderBytes));
    }
    FormPart part = ReadPartHeader(header_begin->substr(0, header_end), parts.size());
    rest = header_begin->substr(header_end + kHeaderEnd.size());
    const size_t content_end = rest.find(delimiter);
    if (content_end == std::string_view::npos) FailCutShort();
    part.content = rest.substr(0, content_end);
    parts.push_back(std::move(part));
    rest.remove_prefix(content_end + delimiter.size());
  }
  return parts;
}

}  // namespace raylift
