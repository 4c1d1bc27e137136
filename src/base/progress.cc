#include "raylift/base/progress.h"

#include <algorithm>
#include <cstdio>

#include <fmt/format.h>
#include <unistd.h>

namespace raylift {
namespace {

std::string FormatSeconds(double seconds) {
  if (seconds < 100) return fmt::format("{:.0f} s", seconds);
  if (seconds < 6000) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.1f} h", seconds / 3600);
}

}  // namespace

Progress::Progress(std::string what, size_t total, Show show)
    : what_(std::move(what)),
      total_(total),
      visible_(show == Show::kAuto && isatty(STDERR_FILENO) != 0),
      watch_(CallWatch::Current()),
      start_(std::chrono::steady_clock::now()),
      last_print_(start_) {}

Progress::~Progress() {
  if (visible_) {
    Print(done_);
    std::fputc('\n', stderr);
  }
}

void Progress::CountAlso(std::string unit, double total) {
  unit_ = std::move(unit);
  total_amount_ = total;
}

void Progress::Advance(double amount) {
  const size_t done = ++done_;
  const bool told = watch_ != nullptr && watch_->hooks().on_progress;
  if (!visible_ && !told) {
    return;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  amount_ += amount;
  const auto now = std::chrono::steady_clock::now();
  const bool due = now - last_print_ > std::chrono::milliseconds(200);
  if (due) last_print_ = now;
  if (visible_ && due) Print(done);
  if (told && (due || done == total_)) watch_->hooks().on_progress(what_, done, total_);
}

void Progress::Print(size_t done) {
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
  const double seconds = std::max(elapsed.count(), 1e-9);
  const double rate = static_cast<double>(done) / seconds;
  const bool by_amount = !unit_.empty() && amount_ > 0;
  const double left_s = by_amount  ? (total_amount_ - amount_) / (amount_ / seconds)
                        : rate > 0 ? static_cast<double>(total_ - done) / rate
                                   : 0;
  const std::string amounts =
      unit_.empty() ? "" : fmt::format(", {:.1f} {} / s", amount_ / seconds, unit_);
  const std::string line = fmt::format("\r{} / {} {}, {:.1f} / s{}, {} left\033[K", done, total_,
                                       what_, rate, amounts, FormatSeconds(std::max(left_s, 0.0)));
  std::fputs(line.c_str(), stderr);
  std::fflush(stderr);
}

}  // namespace raylift
