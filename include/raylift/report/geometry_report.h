// Makes the pages of the commands that look at geometry without localizing: the images of `raylift
// render`, and the diagnosis of `raylift doctor`.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "raylift/lifting/geometry_source.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct RenderedView {
  PosedImage view;
  double coverage = 0;  // share of the pixels that see the scene
  std::optional<std::pair<float, float>> depth_range = std::nullopt;
  size_t bytes = 0;  // of all its files
};

struct RenderReport {
  std::string title, subtitle;
  std::shared_ptr<const RayCaster> scene;
  ColorOptions colors = {};  // of the small pictures
  std::span<const RenderedView> images;
  std::span<const std::string> warnings = {};
  int threads = 0;
};

// Returns a page with every image in a table, some of them (evenly spread) as small pictures of
// color and depth, and scene and cameras in 3D.
std::string FormatRenderReport(const RenderReport& report);

struct DoctorReport {
  std::string title, subtitle;
  std::string_view diagnosis;                          // the JSON of `doctor --json`
  const GeometrySource& source;                        // as it is read
  std::shared_ptr<const RayCaster> surface = nullptr;  // of a mesh: shown in 3D
  std::span<const PosedImage> references;
  std::filesystem::path images = {};  // photographs of the references; empty: none are shown
  std::span<const std::string> warnings = {};
  int threads = 0;
};

// Returns a page with the verdict and the repair of the input, the readings that were tried,
// photographs beside the depth as it is read, and the lifted points with the references in 3D.
std::string FormatDoctorReport(const DoctorReport& report);

}  // namespace raylift
