// Counters of the service, in the text format of Prometheus.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace raylift {

// A present value, beside those that are counted.
struct Gauge {
  std::string_view name, help;
  double value;
};

// Counts what the service does; any thread may call its functions.
class Metrics {
 public:
  void CountRequest(const std::string& route, int status);
  void CountVerdict(const std::string& scene, std::string_view verdict);
  void ObserveStage(std::string_view stage, double seconds);

  std::string Text(const std::vector<Gauge>& gauges) const;

 private:
  static constexpr std::array<double, 12> kBounds = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05,
                                                     0.1,   0.25,   0.5,   1,    2.5,   10};
  struct Histogram {
    std::array<uint64_t, kBounds.size() + 1> counts = {};  // the last beyond all bounds
    double sum = 0;
  };

  mutable std::mutex mutex_;  // guards what follows
  std::map<std::pair<std::string, int>, uint64_t> requests_;
  std::map<std::pair<std::string, std::string>, uint64_t> verdicts_;
  std::map<std::string, Histogram, std::less<>> stages_;
};

// Returns the resident memory of this process, in bytes; 0 where it is not known.
double ResidentBytes();

}  // namespace raylift
