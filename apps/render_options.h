// The options of `raylift render`, and what they mean. Split from the command for its length.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "job_options.h"
#include "options.h"
#include <CLI/App.hpp>

#include "raylift/scene/photographs.h"
#include "raylift/views/render_job.h"
#include "raylift/views/task_list.h"

namespace raylift {

struct RenderFlags {
  std::vector<std::string> geometry;
  std::filesystem::path model, cameras;
  TaskSelection selection;
  RenderJobOptions job;  // all but what follows
  std::vector<Product> products = {Product::kDepth};
  std::vector<std::string> formats;
  std::optional<ColorOptions::Shading> shading;  // none: by whether the mesh has colors
  JobFlags running;
  bool log_json = false;
  std::filesystem::path report;
  RunFlags run;
};

void AddRenderOptions(CLI::App& command, RenderFlags& flags);

// Both throw OptionError.
void CheckRenderFlags(const RenderFlags& flags);
RenderJobOptions ResolveJob(const RenderFlags& flags);

// What `--shading` means for this scene: one without colors needs light to show its shape.
ColorOptions::Shading ResolveShading(const RenderFlags& flags, const RayCaster& scene);

}  // namespace raylift
