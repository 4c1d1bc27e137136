// The cameras of what is rendered in files that makers of data sets feed to other tools:
// nerfstudio's transforms.json and MVSNet's cams/ and pair.txt.

#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "raylift/renderers/ray_caster.h"
#include "raylift/views/render_job.h"

namespace raylift {

// Throws OptionError or InputError where the options or a lens do not go with the files.
void CheckCameraFiles(std::span<const RenderTask> tasks, const RenderJobOptions& options);

// Returns a transforms.json for the job's folder: the photographs in `options.photographs`, or what
// is rendered in color, with depth_file_path where depth is among the products.
std::string TransformsJson(std::span<const RenderTask> tasks, const RenderJobOptions& options);

// Writes cams/00000000_cam.txt, ... and pair.txt, by the order of the views: extrinsic (camera
// from world), intrinsic, and "depth_min depth_interval depth_num depth_max" of 192 planes from
// the 1st to the 99th percentile of the depth that is seen. Pairs have the score of Yao et al.
// 2018 (MVSNet, Sec. 4.1): the sum over points that both see of a function of the angle between
// the rays. Returns warnings: views that see nothing are left out.
std::vector<std::string> WriteMvsnetCameras(const std::filesystem::path& out,
                                            const RayCaster& scene, std::span<const View> views,
                                            int threads);

}  // namespace raylift
