// The error of a request as the client is told of it: a JSON object of RFC 9457 ("problem
// details"), with the field of the request that it is about.

#pragma once

#include <optional>
#include <stdexcept>
#include <string>

#include <nlohmann/json_fwd.hpp>

namespace raylift {

class Problem : public std::runtime_error {
 public:
  Problem(int status, const std::string& detail) : std::runtime_error(detail), status_(status) {}
  Problem(int status, std::string field, const std::string& detail)
      : std::runtime_error(detail), status_(status), field_(std::move(field)) {}

  int status() const { return status_; }
  const std::string& field() const { return field_; }  // empty: it is about none

  // Seconds until the same request may be answered; nullopt where it never will be.
  std::optional<int> retry_after_s = std::nullopt;

 private:
  int status_;
  std::string field_;
};

// Returns a problem that may be gone in a second.
Problem TryLater(int status, const std::string& detail);

// Returns the problem of a request whose reader threw this: "query: camera: expected ..." is about
// the field query.camera.
Problem ProblemOfInput(const std::string& message);

nlohmann::ordered_json ProblemObject(const Problem& problem);
std::string ProblemJson(const Problem& problem);

// Returns the phrase of a status: "Bad Request" of 400.
const char* PhraseOf(int status);

}  // namespace raylift
