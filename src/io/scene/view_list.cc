#include "raylift/io/view_list.h"

#include <unordered_set>

#include "base/read_limits.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

int Side(LineTokens& tokens, std::string_view field) {
  const int side = tokens.Int(field);
  if (side < 1 || side > kMaxImageSidePx) {
    tokens.Fail(fmt::format("{}: expected 1 to {}, found {}", field, kMaxImageSidePx, side));
  }
  return side;
}

ViewCamera CameraToEnd(LineTokens& tokens) {
  LineTokens ahead = tokens;
  if (ahead.Token("camera model") != "EQUIRECTANGULAR") return tokens.CameraToEnd();
  const int width = Side(ahead, "width");
  const int height = Side(ahead, "height");
  if (!ahead.AtEnd()) return tokens.CameraToEnd();  // COLMAP's, which says its size again
  return ViewCamera::Panorama(width, height);
}

}  // namespace

std::vector<View> ReadViewList(const std::filesystem::path& path) {
  std::vector<View> views;
  std::unordered_set<std::string> names;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    View view;
    view.name = tokens.Name();
    if (!names.insert(view.name).second) {
      tokens.Fail(fmt::format("name: \"{}\" stands twice", view.name));
    }
    view.cam_from_world = tokens.Pose();
    view.camera = CameraToEnd(tokens);
    views.push_back(std::move(view));
  }
  return views;
}

Camera ParseCamera(const std::string& what, const std::string& text) {
  const LineReader lines(what, "");
  LineTokens tokens(lines, text);
  return tokens.CameraToEnd();
}

std::vector<Eigen::Vector3d> ReadPointList(const std::filesystem::path& path) {
  std::vector<Eigen::Vector3d> points;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    points.push_back(tokens.Vector<3>("point"));
    tokens.ExpectEnd();
  }
  return points;
}

}  // namespace raylift
