#include "service/problem.h"

#include <algorithm>
#include <cctype>
#include <string_view>
#include <utility>

#include "base/json_text.h"
#include <nlohmann/json.hpp>

namespace raylift {
namespace {

// Returns whether the text holds names of members and their indices, as in "matches[2].query_px".
bool IsField(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '.' || c == '[' || c == ']';
  });
}

}  // namespace

Problem TryLater(int status, const std::string& detail) {
  Problem problem(status, detail);
  problem.retry_after_s = 1;
  return problem;
}

Problem ProblemOfInput(const std::string& message) {
  constexpr std::string_view kSeparator = ": ";
  std::string field;
  std::string_view rest = message;
  for (size_t end = rest.find(kSeparator); end != std::string_view::npos;
       end = rest.find(kSeparator)) {
    if (!IsField(rest.substr(0, end))) break;
    if (!field.empty()) field += '.';
    field += rest.substr(0, end);
    rest.remove_prefix(end + kSeparator.size());
  }
  return {400, std::move(field), message};
}

nlohmann::ordered_json ProblemObject(const Problem& problem) {
  nlohmann::ordered_json json;
  SetMember(json, "type", "about:blank");
  SetMember(json, "title", PhraseOf(problem.status()));
  SetMember(json, "status", problem.status());
  SetMember(json, "detail", problem.what());
  if (!problem.field().empty()) SetMember(json, "field", problem.field());
  return json;
}

std::string ProblemJson(const Problem& problem) { return JsonText(ProblemObject(problem)); }

const char* PhraseOf(int status) {
  constexpr std::pair<int, const char*> kPhrases[] = {{200, "OK"},
                                                      {204, "No Content"},
                                                      {400, "Bad Request"},
                                                      {401, "Unauthorized"},
                                                      {404, "Not Found"},
                                                      {405, "Method Not Allowed"},
                                                      {409, "Conflict"},
                                                      {410, "Gone"},
                                                      {413, "Content Too Large"},
                                                      {415, "Unsupported Media Type"},
                                                      {422, "Unprocessable Content"},
                                                      {429, "Too Many Requests"},
                                                      {431, "Request Header Fields Too Large"},
                                                      {500, "Internal Server Error"},
                                                      {503, "Service Unavailable"}};
  for (const auto& [known, phrase] : kPhrases) {
    if (known == status) return phrase;
  }
  return "Error";
}

}  // namespace raylift
