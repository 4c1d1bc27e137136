#include "service/metrics.h"

#include <algorithm>
#include <fstream>

#include <fmt/format.h>
#include <unistd.h>

namespace raylift {
namespace {

std::string Heading(std::string_view name, std::string_view help, std::string_view type) {
  return fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n", name, help, type);
}

// Escapes a text as a label's value in quotes.
std::string Escaped(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\' || c == '"') escaped += '\\';
    escaped += c == '\n' ? ' ' : c;
  }
  return escaped;
}

}  // namespace

void Metrics::CountRequest(const std::string& route, int status) {
  const std::lock_guard lock(mutex_);
  ++requests_[{route, status}];
}

void Metrics::CountVerdict(const std::string& scene, std::string_view verdict) {
  const std::lock_guard lock(mutex_);
  ++verdicts_[{scene, std::string(verdict)}];
}

void Metrics::ObserveStage(std::string_view stage, double seconds) {
  const std::lock_guard lock(mutex_);
  auto histogram = stages_.find(stage);
  if (histogram == stages_.end()) histogram = stages_.emplace(stage, Histogram()).first;
  const auto* bound = std::lower_bound(kBounds.begin(), kBounds.end(), seconds);
  ++histogram->second.counts[static_cast<size_t>(bound - kBounds.begin())];
  histogram->second.sum += seconds;
}

std::string Metrics::Text(const std::vector<Gauge>& gauges) const {
  const std::lock_guard lock(mutex_);
  std::string text = Heading("raylift_requests_total", "Answered requests.", "counter");
  for (const auto& [key, count] : requests_) {
    text += fmt::format("raylift_requests_total{{route=\"{}\",status=\"{}\"}} {}\n",
                        Escaped(key.first), key.second, count);
  }
  text += Heading("raylift_verdicts_total", "Photographs by what became of them.", "counter");
  for (const auto& [key, count] : verdicts_) {
    text += fmt::format("raylift_verdicts_total{{scene=\"{}\",verdict=\"{}\"}} {}\n",
                        Escaped(key.first), key.second, count);
  }
  text += Heading("raylift_stage_seconds", "Time of each stage of a photograph.", "histogram");
  for (const auto& [stage, histogram] : stages_) {
    uint64_t below = 0;
    for (size_t i = 0; i < histogram.counts.size(); ++i) {
      below += histogram.counts[i];
      const std::string bound = i < kBounds.size() ? fmt::format("{}", kBounds[i]) : "+Inf";
      text += fmt::format("raylift_stage_seconds_bucket{{stage=\"{}\",le=\"{}\"}} {}\n", stage,
                          bound, below);
    }
    text += fmt::format(
        "raylift_stage_seconds_sum{{stage=\"{0}\"}} {1}\n"
        "raylift_stage_seconds_count{{stage=\"{0}\"}} {2}\n",
        stage, histogram.sum, below);
  }
  for (const Gauge& gauge : gauges) {
    text += Heading(gauge.name, gauge.help, "gauge");
    text += fmt::format("{} {}\n", gauge.name, gauge.value);
  }
  return text;
}

double ResidentBytes() {
  std::ifstream file("/proc/self/statm");
  double pages = 0, resident = 0;
  file >> pages >> resident;
  return file ? resident * static_cast<double>(sysconf(_SC_PAGESIZE)) : 0;
}

}  // namespace raylift
