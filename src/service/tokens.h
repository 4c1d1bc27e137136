// Bearer tokens of a file, which say who may ask, and how often.

#pragma once

#include <chrono>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// Holds the tokens of a file; any thread may call its functions.
class Tokens {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // Reads lines `TOKEN [REQUESTS_PER_MINUTE]`; `#` comments and empty lines are skipped. Throws
  // InputError for anything else, and where there is no token.
  explicit Tokens(const std::filesystem::path& file);

  // Throws Problem unless the header "Authorization" holds a known token ("Bearer TOKEN") that has
  // not been used too often. Takes as long for a wrong token as for a right one.
  void Admit(std::string_view authorization, Time now);

 private:
  struct Entry {
    std::string token;
    std::optional<double> per_minute;
    double left = 0;  // requests; at most those of a minute
    Time counted = {};
  };

  std::mutex mutex_;
  std::vector<Entry> entries_;
};

}  // namespace raylift
