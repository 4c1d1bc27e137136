#include "raylift/evaluation/pose_errors.h"

#include <algorithm>
#include <string_view>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Which true name each estimate stands for.
class NameMatcher {
 public:
  NameMatcher(const PosesByName& ground_truth, const PosesByName& estimated) {
    for (const auto& [name, pose] : estimated) {
      if (ground_truth.contains(name)) {
        estimate_of_true_name_[name] = name;
      }
    }
    const auto true_names_by_end = CollectNameEnds(ground_truth);
    std::map<std::string, std::vector<std::string>> claims;
    for (const auto& [name, pose] : estimated) {
      const auto found = true_names_by_end.find(name);
      if (!ground_truth.contains(name) && found != true_names_by_end.end() &&
          found->second.size() == 1) {
        claims[found->second.front()].push_back(name);
      }
    }
    for (const auto& [true_name, names] : claims) {
      if (names.size() == 1) {
        estimate_of_true_name_.try_emplace(true_name, names.front());
      }
    }
  }

  const std::map<std::string, std::string>& estimate_of_true_name() const {
    return estimate_of_true_name_;
  }

 private:
  // "a/b/c" is listed under "b/c" and "c".
  static std::map<std::string, std::vector<std::string>> CollectNameEnds(const PosesByName& poses) {
    std::map<std::string, std::vector<std::string>> names_by_end;
    for (const auto& [name, pose] : poses) {
      for (size_t i = 0; i < name.size(); ++i) {
        if (name[i] == '/') {
          names_by_end[name.substr(i + 1)].push_back(name);
        }
      }
    }
    return names_by_end;
  }

  std::map<std::string, std::string> estimate_of_true_name_;
};

}  // namespace

PoseError ComparePoses(const Rigid3& estimated_cam_from_world, const Rigid3& true_cam_from_world) {
  return {
      .position =
          (estimated_cam_from_world.OriginInSource() - true_cam_from_world.OriginInSource()).norm(),
      .rotation_deg =
          AngleBetweenDeg(estimated_cam_from_world.rotation, true_cam_from_world.rotation)};
}

Comparison CompareWithGroundTruth(const PosesByName& ground_truth, const PosesByName& estimated) {
  const NameMatcher matcher(ground_truth, estimated);
  Comparison comparison;
  PosesByName unknown = estimated;
  for (const auto& [name, true_pose] : ground_truth) {
    QueryError query = {name, std::nullopt};
    const auto match = matcher.estimate_of_true_name().find(name);
    if (match != matcher.estimate_of_true_name().end()) {
      const Rigid3& pose = estimated.at(match->second);
      if (pose.IsFinite()) {
        query.error = ComparePoses(pose, true_pose);
      }
      unknown.erase(match->second);
    }
    comparison.queries.push_back(std::move(query));
  }
  for (const auto& [name, pose] : unknown) {
    comparison.unknown_names.push_back(name);
  }
  return comparison;
}

PosesByName MatchNames(const PosesByName& ground_truth, const PosesByName& estimated) {
  const NameMatcher matcher(ground_truth, estimated);
  PosesByName poses;
  for (const auto& [true_name, name] : matcher.estimate_of_true_name()) {
    poses.emplace(true_name, estimated.at(name));
  }
  return poses;
}

std::map<std::string, Comparison> SplitByGroup(
    const Comparison& comparison, const std::map<std::string, std::string>& group_of_query) {
  std::map<std::string, Comparison> groups;
  for (const QueryError& query : comparison.queries) {
    const auto group = group_of_query.find(query.name);
    if (group == group_of_query.end()) continue;
    Comparison& part = groups[group->second];
    part.uses_ground_truth = comparison.uses_ground_truth;
    part.queries.push_back(query);
  }
  return groups;
}

Comparison ChooseByOracle(const Comparison& a, const Comparison& b, double cm_per_scene_unit) {
  RAYLIFT_CHECK_EQ(a.queries.size(), b.queries.size());
  const auto cost = [cm_per_scene_unit](const PoseError& error) {
    return std::max(error.position * cm_per_scene_unit, error.rotation_deg);
  };
  Comparison chosen = {.queries = a.queries, .unknown_names = {}, .uses_ground_truth = true};
  for (size_t i = 0; i < chosen.queries.size(); ++i) {
    RAYLIFT_CHECK(a.queries[i].name == b.queries[i].name);
    auto& error = chosen.queries[i].error;
    const auto& other = b.queries[i].error;
    if (other && (!error || cost(*other) < cost(*error))) {
      error = other;
    }
  }
  return chosen;
}

}  // namespace raylift
