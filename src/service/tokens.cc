#include "service/tokens.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/input_paths.h"
#include "service/problem.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// Compares every byte, whether or not those before it differ.
bool AreEqual(std::string_view known, std::string_view given) {
  volatile unsigned difference = known.size() == given.size() ? 0 : 1;
  for (size_t i = 0; i < given.size(); ++i) {
    const char c = known.empty() ? '\0' : known[i % known.size()];
    difference = difference | static_cast<unsigned char>(c ^ given[i]);
  }
  return difference == 0;
}

}  // namespace

Tokens::Tokens(const std::filesystem::path& file) {
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    const std::vector<std::string_view> words = SplitTokens(*line);
    Entry entry{.token = std::string(words.front()), .per_minute = std::nullopt};
    if (words.size() > 1) {
      entry.per_minute = lines.Double(words[1], "requests per minute");
      if (!(*entry.per_minute > 0)) lines.Fail("requests per minute: expected a positive number");
      entry.left = std::max(1.0, *entry.per_minute);
    }
    if (words.size() > 2) lines.Fail("expected TOKEN [REQUESTS_PER_MINUTE]");
    entries_.push_back(std::move(entry));
  }
  if (entries_.empty()) throw InputError(file, "holds no token");
}

void Tokens::Admit(std::string_view authorization, Time now) {
  constexpr std::string_view kScheme = "bearer ";
  constexpr size_t kMaxToken = 1000;
  std::string_view given;
  if (Lower(authorization.substr(0, kScheme.size())) == kScheme) {
    given = Trim(authorization.substr(kScheme.size())).substr(0, kMaxToken);
  }
  const std::lock_guard lock(mutex_);
  Entry* found = nullptr;
  for (Entry& entry : entries_) {
    if (AreEqual(entry.token, given)) found = &entry;
  }
  if (found == nullptr) {
    throw Problem(401, "Authorization", "expected Authorization: Bearer TOKEN with a known token");
  }
  if (!found->per_minute) return;
  constexpr double kSecondsPerMinute = 60;
  const double rate = *found->per_minute / kSecondsPerMinute;
  const double most = std::max(1.0, *found->per_minute);
  const std::chrono::duration<double> passed = now - found->counted;
  found->left = std::min(most, found->left + passed.count() * rate);
  found->counted = now;
  if (found->left < 1) {
    Problem problem(429, "Authorization", "the token's requests of this minute are used up");
    constexpr double kLongestWait = 3600;
    problem.retry_after_s =
        static_cast<int>(std::min(kLongestWait, std::ceil((1 - found->left) / rate)));
    throw problem;
  }
  found->left -= 1;
}

}  // namespace raylift
