#include "service/scene_walks.h"

#include <array>
#include <chrono>
#include <span>
#include <utility>

#include "base/hash.h"
#include "base/json_text.h"
#include "geometry/pose_json.h"
#include "service/problem.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/text.h"

namespace raylift {
namespace {

// Of the scene's name and its references'.
uint64_t WorldOf(const ServedScene& scene) {
  uint64_t hash = HashBytes64(scene.name);
  for (const PosedImage& image : scene.localizer->scene().references.images) {
    const auto [q, t] = std::pair(image.cam_from_world.rotation, image.cam_from_world.translation);
    const std::array pose = {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
    hash = HashBytes64(image.name, hash);
    hash = HashBytes64(AsBytes(std::span<const double>(pose)), hash);
  }
  return hash;
}

}  // namespace

SceneWalks::SceneWalks(const WalkTokens& tokens, const ServedScene& scene, int threads)
    : tokens_(tokens), world_(WorldOf(scene)), distances_(scene.localizer->scene(), threads) {}

ServedWalk SceneWalks::Before(const WalkStep& step) const {
  if (step.token.empty()) return {.scale = step.scale.value_or(OdometryScale::kKnown)};
  ServedWalk walk = tokens_.Open(step.token, world_, std::chrono::system_clock::now());
  if (step.scale && *step.scale != walk.scale) {
    throw Problem(400, "session.scale", "session: scale: is another than before");
  }
  if (!(step.time_s > walk.state.last_time_s)) {
    throw Problem(400, "session.time_s",
                  fmt::format("session: time_s: expected more than {}, that of the one before",
                              FormatDouble(*walk.state.last_time_s)));
  }
  return walk;
}

SceneWalks::Walked SceneWalks::GoOn(ServedWalk walk, const WalkedPhotograph& photograph) const {
  TrackedPose tracked = Track(photograph, distances_, {.scale = walk.scale}, walk.state);
  nlohmann::ordered_json session = {
      {"token", tokens_.Seal(std::move(walk), world_, std::chrono::system_clock::now())},
      {"world_from_odometry", nullptr},
      {"scale", tracked.scale}};
  if (tracked.world_from_odometry) {
    session["world_from_odometry"] = ToJson(*tracked.world_from_odometry);
  }
  return {std::move(tracked.query), JsonText(session)};
}

}  // namespace raylift
