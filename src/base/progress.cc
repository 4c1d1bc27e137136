#include "base/progress.h"

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

Progress::Progress(std::string what, size_t total, Show show,
                   std::chrono::milliseconds between_lines)
    : what_(std::move(what)),
      total_(total),
      form_(show == Show::kNever         ? Form::kNone
            : isatty(STDERR_FILENO) != 0 ? Form::kTerminal
                                         : Form::kLines),
      between_lines_(between_lines),
      watch_(CallWatch::Current()),
      start_(std::chrono::steady_clock::now()),
      last_print_(start_),
      last_line_(start_) {}

Progress::~Progress() {
  if (form_ == Form::kTerminal) {
    Print(done_);
    std::fputc('\n', stderr);
  }
  const bool has_lines = last_line_ != start_;
  if (form_ == Form::kLines && has_lines) Print(done_);
}

void Progress::CountAlso(std::string unit, double total) {
  unit_ = std::move(unit);
  total_amount_ = total;
}

void Progress::Advance(double amount) {
  const size_t done = ++done_;
  const bool told = watch_ != nullptr && watch_->hooks().on_progress;
  if (form_ == Form::kNone && !told) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  amount_ += amount;
  const auto now = std::chrono::steady_clock::now();
  const bool due = now - last_print_ > std::chrono::milliseconds(200);
  if (due) last_print_ = now;
  if (form_ == Form::kTerminal && due) Print(done);
  if (form_ == Form::kLines && now - last_line_ >= between_lines_) {
    last_line_ = now;
    Print(done);
  }
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
  const std::string line = fmt::format("{} / {} {}, {:.1f} / s{}, {} left", done, total_, what_,
                                       rate, amounts, FormatSeconds(std::max(left_s, 0.0)));
  const bool is_terminal = form_ == Form::kTerminal;
  std::fputs((is_terminal ? "\r" + line + "\033[K" : line + '\n').c_str(), stderr);
  std::fflush(stderr);
}

}  // namespace raylift
