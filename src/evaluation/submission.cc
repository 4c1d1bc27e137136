#include "evaluation/submission.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/text.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

constexpr double kMaxNormError = 1e-3;
// The margin by which the scene's box exceeds that of the references, on every side.
constexpr double kBoxMargin = 0.5;

// Returns each query by its name and by every end of it; an end that two queries share stands for
// none.
std::map<std::string, std::optional<size_t>> IndexNames(std::span<const std::string> names) {
  std::map<std::string, std::optional<size_t>> index;
  for (size_t i = 0; i < names.size(); ++i) {
    for (size_t k = 0; k < names[i].size(); ++k) {
      if (names[i][k] != '/') continue;
      const auto [entry, is_new] = index.try_emplace(names[i].substr(k + 1), i);
      if (!is_new) entry->second = std::nullopt;
    }
  }
  for (size_t i = 0; i < names.size(); ++i) index[names[i]] = i;
  return index;
}

class Checker {
 public:
  Checker(const std::filesystem::path& file, std::span<const std::string> names)
      : names_(names), index_(IndexNames(names)), line_of_query_(names.size()), reader_(file) {
    report_.num_queries = names.size();
  }

  SubmissionReport Run(std::span<const Eigen::Vector3d> reference_centers) {
    while (const auto line = reader_.Next()) {
      const auto tokens = SplitTokens(*line);
      if (!tokens.empty()) CheckLine(tokens);
    }
    if (!reference_centers.empty()) CheckDirection(reference_centers);
    for (size_t i = 0; i < names_.size(); ++i) {
      if (!line_of_query_[i]) report_.missing.push_back(names_[i]);
    }
    if (!report_.missing.empty()) {
      report_.remarks.push_back(fmt::format("{} of {} queries have no pose, e.g. {}",
                                            report_.missing.size(), names_.size(),
                                            report_.missing.front()));
    }
    return std::move(report_);
  }

 private:
  void Complain(const std::string& problem) {
    report_.problems.push_back(fmt::format("line {}: {}", reader_.line_number(), problem));
  }

  void CheckLine(std::span<const std::string_view> tokens) {
    constexpr size_t kFields = 8;
    if (tokens.size() != kFields) {
      Complain(fmt::format("expected name qw qx qy qz tx ty tz, found {} fields", tokens.size()));
      return;
    }
    CheckName(std::string(tokens[0]));
    std::array<double, kFields - 1> numbers{};
    for (size_t i = 0; i < numbers.size(); ++i) {
      const auto number = ParseDouble(tokens[i + 1]);
      if (!number || !std::isfinite(*number)) {
        Complain(fmt::format("expected a finite number, found \"{}\"", tokens[i + 1]));
        return;
      }
      numbers[i] = *number;
    }
    const Eigen::Quaterniond q(numbers[0], numbers[1], numbers[2], numbers[3]);
    if (std::abs(q.norm() - 1) > kMaxNormError) {
      Complain(fmt::format("the quaternion has length {:.4g}, not 1", q.norm()));
      return;
    }
    poses_.push_back({q.normalized(), {numbers[4], numbers[5], numbers[6]}});
  }

  void CheckName(const std::string& name) {
    const auto found = index_.find(name);
    if (found == index_.end()) {
      Complain(fmt::format("{} is no query", name));
    } else if (!found->second) {
      Complain(fmt::format("{} is the end of several queries' names", name));
    } else if (line_of_query_[*found->second]) {
      Complain(
          fmt::format("{} stands twice (also in line {})", name, *line_of_query_[*found->second]));
    } else {
      line_of_query_[*found->second] = reader_.line_number();
      ++report_.num_poses;
    }
  }

  void CheckDirection(std::span<const Eigen::Vector3d> reference_centers) {
    if (poses_.empty()) return;
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& center : reference_centers) box.extend(center);
    const Eigen::Vector3d margin =
        Eigen::Vector3d::Constant(kBoxMargin * std::max(box.diagonal().norm(), 1e-9));
    box = Eigen::AlignedBox3d(box.min() - margin, box.max() + margin);
    size_t as_written = 0, inverted = 0;
    for (const Rigid3& pose : poses_) {
      as_written += box.contains(pose.OriginInSource());
      inverted += box.contains(pose.translation);
    }
    const auto percent = [&](size_t count) { return 100 * count / poses_.size(); };
    if (percent(as_written) >= 50) return;
    const std::string found =
        fmt::format("{} % of the camera centers are in the scene", percent(as_written));
    if (percent(inverted) >= 80) {
      report_.problems.push_back(fmt::format("{}, {} % were the poses camera to world: invert them",
                                             found, percent(inverted)));
    } else {
      report_.remarks.push_back(found);
    }
  }

  std::span<const std::string> names_;
  std::map<std::string, std::optional<size_t>> index_;
  std::vector<std::optional<int>> line_of_query_;
  LineReader reader_;
  std::vector<Rigid3> poses_;
  SubmissionReport report_;
};

}  // namespace

SubmissionReport CheckSubmission(const std::filesystem::path& file,
                                 std::span<const std::string> query_names,
                                 std::span<const Eigen::Vector3d> reference_centers) {
  return Checker(file, query_names).Run(reference_centers);
}

}  // namespace raylift
