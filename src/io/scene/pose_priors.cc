// Reads and writes the file of pose priors.

#include "raylift/io/pose_priors.h"

#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <string_view>
#include <utility>

#include "base/input_paths.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

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

// Takes the lines of a file one after the other.
class PriorReader {
 public:
  explicit PriorReader(std::optional<WorldFrame> world) : world_(std::move(world)) {}

  void ReadLine(LineTokens& tokens);
  // Returns what the lines said, directions of the world filled in.
  std::map<std::string, PosePriors> Finish();
  // Says which transformations are rough.
  std::set<std::string> Warnings() const;

 private:
  // Returns down and north in the world where a query is.
  std::pair<Vector3d, Vector3d> DirectionsOf(const std::string& name,
                                             const PosePriors& priors) const;
  // Returns how many units of the world a meter has where a query is; 1 where that is not known.
  double UnitsPerMeter(const PosePriors& priors) const;
  PositionPrior InWorld(const Eigen::Vector3d& point, const Eigen::Vector3d& sigma_m,
                        const std::string& crs);
  void ReadPosition(LineTokens& tokens, PosePriors& priors);
  void ReadHeading(LineTokens& tokens, const std::string& name, PosePriors& priors);
  void ReadWorld(LineTokens& tokens, std::string_view kind);

  std::optional<WorldFrame> world_;
  bool says_world_ = false;                                         // a line does
  std::map<std::string, std::pair<Crs, CrsTransform>> transforms_;  // into the world's system
  std::map<std::string, PosePriors> priors_;
  std::map<std::string, double> heading_deg_;
  std::set<std::string> ranges_in_meters_;
  std::optional<Eigen::Vector3d> down_, north_;
};

// Returns what `work` does; the messages of its InputErrors get the line.
template <typename Work>
auto AtLine(const LineTokens& tokens, const Work& work) {
  try {
    return work();
  } catch (const InputError& error) {
    tokens.Fail(error.what());
  }
}

// Returns the prior of a point in another system, in the world, with standard deviations along the
// world's axes.
PositionPrior PriorReader::InWorld(const Vector3d& point, const Vector3d& sigma_m,
                                   const std::string& crs) {
  if (!world_)
    throw InputError(
        "crs: the world's own system, which it is to be led to, is not known (* world_crs above "
        "this)");
  auto known = transforms_.find(crs);
  if (known == transforms_.end()) {
    const Crs from(crs);
    known = transforms_.emplace(crs, std::pair(from, CrsTransform(from, world_->crs))).first;
  }
  const auto& [from, transform] = known->second;
  const auto led = [&](const Vector3d& to_lead) {
    from.Check(to_lead);
    const Vector3d there = transform(to_lead);
    world_->crs.Check(there);
    return there;
  };
  const auto is_place = [&](const Vector3d& to_lead) {
    try {
      led(to_lead);
      return true;
    } catch (const InputError&) {
      return false;
    }
  };
  const Vector3d in_crs = [&] {
    try {
      return led(point);
    } catch (const InputError&) {
      const bool is_swapped =
          from.kind() == CrsKind::kGeographic && is_place({point.y(), point.x(), point.z()});
      if (!is_swapped) throw;
      throw InputError(
          "position: its first two numbers seem to be swapped, expected longitude, latitude");
    }
  }();
  const LocalFrame frame = LocalFrameAt(world_->crs, in_crs);
  return {.position = in_crs - world_->origin,
          .sigma = (frame.crs_from_enu * sigma_m.asDiagonal()).rowwise().norm()};
}

void PriorReader::ReadPosition(LineTokens& tokens, PosePriors& priors) {
  const Vector3d point = tokens.Vector<3>("position");
  Vector3d sigma = Vector3d::Constant(ReadSigma(tokens, "sigma"));
  constexpr std::string_view kCrs = "crs=";
  if (!tokens.AtEnd() && !tokens.NextStartsWith(kCrs)) {
    sigma.y() = ReadSigma(tokens, "sigma_y");
    sigma.z() = ReadSigma(tokens, "sigma_z");
  }
  priors.position = {.position = point, .sigma = sigma};
  if (tokens.AtEnd()) return;
  const std::string_view crs = tokens.Token("crs");
  if (!crs.starts_with(kCrs)) {
    tokens.Fail(fmt::format("expected crs=NAME or the end of the line, found \"{}\"", crs));
  }
  priors.position =
      AtLine(tokens, [&] { return InWorld(point, sigma, std::string(crs.substr(kCrs.size()))); });
}

void PriorReader::ReadHeading(LineTokens& tokens, const std::string& name, PosePriors& priors) {
  const double heading_deg = tokens.Double("heading");
  priors.heading = {.right_in_world = Vector3d::UnitX(),
                    .down_in_world = -Vector3d::UnitZ(),
                    .sigma_deg = ReadSigma(tokens, "sigma_deg")};
  if (!tokens.AtEnd()) priors.heading->right_in_cam = ReadDirection(tokens, "right");
  heading_deg_[name] = heading_deg;
}

void PriorReader::ReadWorld(LineTokens& tokens, std::string_view kind) {
  if (kind == "world_crs") {
    const std::string text(tokens.Rest());  // WKT has blanks
    if (says_world_) tokens.Fail("world_crs of \"*\" stands twice");
    says_world_ = true;
    const WorldFrame frame = AtLine(tokens, [&] { return WorldFrame::Parse(text); });
    if (world_ && !world_->is_of_file && world_->text != frame.text) {
      tokens.Fail(
          fmt::format("world_crs: expected {}, as elsewhere, found {}", world_->text, frame.text));
    }
    world_ = frame;
    return;
  }
  std::optional<Vector3d>& direction = kind == "world_down" ? down_ : north_;
  if (direction) tokens.Fail(fmt::format("{} of \"*\" stands twice", kind));
  direction = ReadDirection(tokens, kind);
}

void PriorReader::ReadLine(LineTokens& tokens) {
  const std::string name(tokens.Name());
  const std::string kind(tokens.Token("kind"));
  if (name == "*" && (kind == "world_down" || kind == "world_north" || kind == "world_crs")) {
    ReadWorld(tokens, kind);
    return tokens.ExpectEnd();
  }
  PosePriors& priors = priors_[name];
  const std::array<std::pair<std::string_view, bool>, 8> kinds = {
      {{"position", priors.position.has_value()},
       {"gravity", priors.gravity.has_value()},
       {"heading", priors.heading.has_value()},
       {"orientation", priors.orientation.has_value()},
       {"pose", priors.position.has_value() || priors.orientation.has_value()},
       {"range", priors.range.has_value()},
       {"focal_range", priors.focal_range != 1},
       {"focal_sigma", priors.focal_sigma.has_value()}}};
  for (const auto& [known, is_said] : kinds) {
    if (kind == known && is_said) {
      tokens.Fail(fmt::format("{} of \"{}\" stands twice", kind, name));
    }
  }
  if (kind == "position") {
    ReadPosition(tokens, priors);
  } else if (kind == "gravity") {
    const Vector3d down = ReadDirection(tokens, kind);
    priors.gravity = {.down_in_cam = down,
                      .down_in_world = -Vector3d::UnitZ(),
                      .sigma_deg = ReadSigma(tokens, "sigma_deg")};
  } else if (kind == "heading") {
    ReadHeading(tokens, name, priors);
  } else if (kind == "orientation") {
    const auto rotation = UnitQuaternion(tokens.Quaternion(kind));
    if (!rotation) tokens.Fail("orientation: expected a quaternion of length 1");
    priors.orientation = {.cam_from_world = *rotation, .sigma_deg = ReadSigma(tokens, "sigma_deg")};
  } else if (kind == "pose") {
    const Rigid3 cam_from_world = tokens.Pose();
    priors.position = {.position = cam_from_world.OriginInSource(),
                       .sigma = Vector3d::Constant(ReadSigma(tokens, "sigma"))};
    priors.orientation = {.cam_from_world = cam_from_world.rotation,
                          .sigma_deg = ReadSigma(tokens, "sigma_deg")};
  } else if (kind == "range") {
    const double range = tokens.Double(kind);
    if (!(range > 0)) tokens.Fail(fmt::format("range: expected a positive one, found {}", range));
    priors.range = {.range = range, .sigma = ReadSigma(tokens, "sigma")};
    if (!tokens.AtEnd()) {
      if (const auto unit = tokens.Token("unit"); unit != "m") {
        tokens.Fail(fmt::format("range: expected m or the end of the line, found \"{}\"", unit));
      }
      ranges_in_meters_.insert(name);
    }
  } else if (kind == "focal_range") {
    priors.focal_range = tokens.Double(kind);
    if (!(priors.focal_range > 1 && priors.focal_range <= kMaxFocalRange)) {
      tokens.Fail(fmt::format("focal_range: expected a factor above 1, up to {}", kMaxFocalRange));
    }
  } else if (kind == "focal_sigma") {
    priors.focal_sigma = tokens.FocalSigma();
  } else {
    tokens.Fail(fmt::format(
        "expected \"position\", \"pose\", \"gravity\", \"heading\", \"orientation\", \"range\", "
        "\"focal_range\" or \"focal_sigma\", or \"* world_crs\", \"* world_down\" or \"* "
        "world_north\", found \"{} "
        "{}\"",
        name, kind));
  }
  tokens.ExpectEnd();
}

std::set<std::string> PriorReader::Warnings() const {
  std::set<std::string> warnings;
  for (const auto& [name, way] : transforms_) {
    if (auto warning = way.second.Warning()) warnings.insert(std::move(*warning));
  }
  return warnings;
}

std::pair<Vector3d, Vector3d> PriorReader::DirectionsOf(const std::string& name,
                                                        const PosePriors& priors) const {
  const std::pair of_map(down_.value_or(-Vector3d::UnitZ()), north_.value_or(Vector3d::UnitY()));
  const bool is_said = down_ && (north_ || !priors.heading);
  if (!world_ || is_said || (!priors.gravity && !priors.heading)) return of_map;
  const bool is_centered = world_->crs.kind() == CrsKind::kGeocentric;
  if (!priors.position && !is_centered) return of_map;
  if (!priors.position && world_->origin.isZero(0)) {
    throw InputError(fmt::format(
        "{}: gravity and heading need a position, or * world_down and * world_north", name));
  }
  const Vector3d offset = priors.position ? priors.position->position : Vector3d::Zero();
  try {
    const Eigen::Matrix3d axes = LocalFrameAt(world_->crs, world_->origin + offset).Axes();
    return {down_.value_or(-axes.col(2)), north_.value_or(axes.col(1))};
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", name, error.what()));
  }
}

double PriorReader::UnitsPerMeter(const PosePriors& priors) const {
  if (!world_ || !priors.position) return 1;
  return LocalFrameAt(world_->crs, world_->origin + priors.position->position).Scale();
}

std::map<std::string, PosePriors> PriorReader::Finish() {
  for (auto& [name, priors] : priors_) {
    if (ranges_in_meters_.contains(name)) {
      const double scale = UnitsPerMeter(priors);
      priors.range->range *= scale;
      priors.range->sigma *= scale;
    }
    const auto [down, north] = DirectionsOf(name, priors);
    if (priors.gravity) priors.gravity->down_in_world = down;
    if (!priors.heading) continue;
    const Vector3d east = down.cross(north), ahead = east.cross(down);
    if (!HasDirection(east)) throw InputError("world_north: expected another direction than down");
    // Right is east for a camera that looks north.
    const double angle = heading_deg_[name] * std::numbers::pi / 180;
    priors.heading->down_in_world = down;
    priors.heading->right_in_world =
        std::cos(angle) * east.normalized() - std::sin(angle) * ahead.normalized();
  }
  ranges_in_meters_.clear();
  return std::exchange(priors_, {});
}

// Gives a query what is known of it; what the list says of the focal length stays where that is
// not mentioned.
void Take(const PosePriors& known, Query& query) {
  const PosePriors of_list = query.priors;
  query.priors = known;
  if (query.priors.focal_range == 1) query.priors.focal_range = of_list.focal_range;
  if (!query.priors.focal_sigma) query.priors.focal_sigma = of_list.focal_sigma;
}

}  // namespace

std::map<std::string, PosePriors> ParsePosePriors(std::span<const PriorText> texts,
                                                  const std::optional<WorldFrame>& world,
                                                  std::vector<std::string>* warnings) {
  PriorReader reader(world);
  std::map<std::string, PosePriors> priors;
  std::set<std::string> rough;  // a transform's is that of its last point
  for (const PriorText& text : texts) {
    LineReader lines(text.path_for_messages, text.lines);
    while (const auto line = lines.NextContent()) {
      LineTokens tokens(lines, *line);
      reader.ReadLine(tokens);
    }
    try {
      priors.merge(reader.Finish());
    } catch (const InputError& error) {
      throw InputError(text.path_for_messages, error.what());
    }
    rough.merge(reader.Warnings());
  }
  if (warnings != nullptr) warnings->assign(rough.begin(), rough.end());
  return priors;
}

std::map<std::string, PosePriors> ParsePosePriors(const std::filesystem::path& path_for_messages,
                                                  std::string text,
                                                  const std::optional<WorldFrame>& world,
                                                  std::vector<std::string>* warnings) {
  const PriorText alone{path_for_messages, std::move(text)};
  return ParsePosePriors({&alone, 1}, world, warnings);
}

std::map<std::string, PosePriors> ReadPosePriors(const std::filesystem::path& file,
                                                 const std::optional<WorldFrame>& world,
                                                 std::vector<std::string>* warnings) {
  return ParsePosePriors(file, ReadFile(file), world, warnings);
}

std::vector<std::string> TakePosePriors(const std::filesystem::path& file, std::span<Query> queries,
                                        const std::optional<WorldFrame>& world) {
  std::vector<std::string> warnings;
  TakePosePriors(ReadPosePriors(file, world, &warnings), file, queries);
  return warnings;
}

void TakePosePriors(const std::map<std::string, PosePriors>& priors,
                    const std::filesystem::path& path_for_messages, std::span<Query> queries) {
  bool any = false;
  for (Query& query : queries) {
    const auto known = priors.find(query.name);
    if (known == priors.end()) continue;
    Take(known->second, query);
    any = true;
  }
  if (!any) {
    throw InputError(path_for_messages,
                     fmt::format("knows none of the {} queries by name", queries.size()));
  }
}

std::string FormatFocalRange(const std::string& name, double factor) {
  return fmt::format("{} focal_range {}\n", NameText(name, name), FormatDouble(factor));
}

std::vector<std::string> TakePhotographPriors(const std::filesystem::path& images,
                                              const WorldFrame& world, std::span<Query> queries) {
  std::vector<PriorText> texts;
  for (const Query& query : queries) {
    const std::filesystem::path file = PathBelow(images, query.name);
    texts.push_back({file, FormatPhotographPriors(query.name, ReadPhotographTags(file))});
  }
  std::vector<std::string> warnings;
  const auto priors = ParsePosePriors(texts, world, &warnings);
  if (priors.empty()) {
    throw InputError(images, fmt::format("none of {} photographs says where it was taken (EXIF)",
                                         queries.size()));
  }
  TakePosePriors(priors, images, queries);
  return warnings;
}

}  // namespace raylift
