// The options of `raylift render`, and what they mean. Split from the command for its length.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "options.h"
#include <CLI/CLI.hpp>

#include "raylift/scene/thinning.h"
#include "raylift/views/render_job.h"
#include "raylift/views/task_list.h"

namespace raylift {

struct RenderFlags {
  std::vector<std::string> geometry;
  std::filesystem::path model, cameras;
  std::filesystem::path list_images;
  std::string glob;
  Thinning thinning;
  std::string scale, size, panorama;
  std::string products = "depth";
  std::vector<std::string> formats;
  std::string exr_compression = "pxr24";
  std::string sample = "float";
  double png_step = 0.001;
  std::string out_of_range = "refuse";
  bool deflate_npz = false;
  int jpeg_quality = 92;
  std::string normals_in = "world";
  std::string shading = "auto";
  int supersampling = 1;
  std::string background = "0,0,0";
  std::filesystem::path out;
  std::string pattern = "{dir}/{stem}";
  bool resume = false;
  std::string shard = "0/1";
  bool preview = false;
  bool log_json = false;
  RunFlags run;
};

void AddRenderOptions(CLI::App& command, RenderFlags& flags);

// All of these throw OptionError.
void CheckSources(const RenderFlags& flags);
TaskSelection ResolveSelection(const RenderFlags& flags);
RenderJobOptions ResolveJob(const RenderFlags& flags);

// What `--shading` means for this mesh: one without colours needs light to show its shape.
ColorOptions::Shading ResolveShading(const RenderFlags& flags, const TriangleMesh& mesh);

}  // namespace raylift
