#include "raylift/io/pose_prior_list.h"

#include <optional>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/line_tokens.h"
#include "raylift/io/unit_quaternion.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

Vector3d ReadDirection(LineTokens& tokens, std::string_view field) {
  Vector3d direction = tokens.Vector<3>(field);
  if (!HasDirection(direction)) {
    tokens.Fail(fmt::format("{}: expected a direction, found {}", field,
                            direction.isZero(0) ? "zeros" : "numbers out of range"));
  }
  return direction;
}

double ReadSigma(LineTokens& tokens, std::string_view field) {
  const double sigma = tokens.Double(field);
  if (sigma < 0) tokens.Fail(fmt::format("{}: expected at least 0, found {}", field, sigma));
  return sigma;
}

PositionPrior ReadPosition(LineTokens& tokens) {
  PositionPrior prior;
  prior.position = tokens.Vector<3>("position");
  prior.sigma.setConstant(ReadSigma(tokens, "sigma"));
  if (!tokens.AtEnd()) {
    prior.sigma.y() = ReadSigma(tokens, "sigma_y");
    prior.sigma.z() = ReadSigma(tokens, "sigma_z");
  }
  return prior;
}

void RequireNew(bool is_new, const LineTokens& tokens, std::string_view name,
                std::string_view kind) {
  if (!is_new) tokens.Fail(fmt::format("{} of \"{}\" stands twice", kind, name));
}

}  // namespace

std::map<std::string, PosePriors> ReadPosePriors(const std::filesystem::path& file) {
  std::map<std::string, PosePriors> priors;
  std::optional<Vector3d> world_down;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const std::string name(tokens.Token("name"));
    const std::string kind(tokens.Token("kind"));
    if (name == "*" && kind == "world_down") {
      RequireNew(!world_down, tokens, name, kind);
      world_down = ReadDirection(tokens, kind);
    } else if (kind == "position") {
      RequireNew(!priors[name].position, tokens, name, kind);
      priors[name].position = ReadPosition(tokens);
    } else if (kind == "gravity") {
      RequireNew(!priors[name].gravity, tokens, name, kind);
      const Vector3d down = ReadDirection(tokens, kind);
      priors[name].gravity = {.down_in_cam = down,
                              .down_in_world = -Vector3d::UnitZ(),
                              .sigma_deg = ReadSigma(tokens, "sigma_deg")};
    } else if (kind == "focal_range") {
      RequireNew(priors[name].focal_range == 1, tokens, name, kind);
      priors[name].focal_range = tokens.Double(kind);
      if (!(priors[name].focal_range > 1 && priors[name].focal_range <= kMaxFocalRange)) {
        tokens.Fail(
            fmt::format("focal_range: expected a factor above 1, up to {}", kMaxFocalRange));
      }
    } else {
      tokens.Fail(
          fmt::format("expected \"position\", \"gravity\" or \"focal_range\", or \"* world_down\", "
                      "found \"{} {}\"",
                      name, kind));
    }
    tokens.ExpectEnd();
  }
  if (world_down) {
    for (auto& [name, prior] : priors) {
      if (prior.gravity) prior.gravity->down_in_world = *world_down;
    }
  }
  return priors;
}

void TakePosePriors(const std::filesystem::path& file, std::span<Query> queries) {
  const std::map<std::string, PosePriors> priors = ReadPosePriors(file);
  bool any = false;
  for (Query& query : queries) {
    const auto known = priors.find(query.name);
    if (known == priors.end()) continue;
    const double guessed = query.priors.focal_range;
    query.priors = known->second;
    if (query.priors.focal_range == 1) query.priors.focal_range = guessed;
    any = true;
  }
  if (!any) {
    throw InputError(file, fmt::format("knows none of the {} queries by name", queries.size()));
  }
}

}  // namespace raylift
