// Writes the files that a rendering job keeps beside the pictures: its manifest, summary.json,
// README.txt, preview.png; and its warnings.

#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "raylift/jobs/task_job.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"
#include "raylift/surfaces/triangle_mesh.h"
#include "raylift/views/render_job.h"

namespace raylift {

// Returns JSON of all that the bytes of the files depend on, except the views.
std::string JobHeader(const RayCaster& scene, const RenderJobOptions& options);

// Returns the first line of its manifest: the job's header and its number of images.
std::string ManifestHeader(const std::string& header, size_t images);

// Returns the hash of everything that a view's files depend on.
std::string TaskKey(const std::string& header, const RenderTask& task);

// Return "PRODUCT/stem.FORMAT" for one product, and for each.
std::string TaskFile(const RenderTask& task, const ProductOutput& output);
std::vector<std::string> TaskFiles(const RenderTask& task, std::span<const ProductOutput> products);

// Removes what a killed run has left of these files: half-written ones under temporary names.
void RemoveLeftovers(const std::filesystem::path& out, std::span<const std::string> files);

JobTotals TotalsOf(const ManifestEntries& entries);

// The run that has completed a job.
struct RunRecord {
  std::string command;
  std::chrono::system_clock::time_point started;
  double seconds = 0;
  size_t rendered = 0;
  size_t kept = 0;
};

// Returns summary.json of a complete job.
std::string SummaryJson(const std::string& header, const ManifestEntries& entries,
                        const std::vector<std::string>& warnings);
// Returns timing.jsonl.
std::string TimingJson(const RunRecord& run);

// The name of the file that a job leaves beside its products, and how its text starts.
inline constexpr std::string_view kFileGuideName = "README.txt";
inline constexpr std::string_view kFileGuideTitle = "What these files hold";

// Returns the guide of a job that writes these products in these formats.
std::string FileGuide(std::span<const ProductOutput> outputs, const StorageOptions& storage,
                      FrameOptions::NormalsIn normals_in);

// Returns the guide to all products and formats.
std::string FileGuide();

inline constexpr int kMaxTiles = 48;

// Returns an RGB picture of at most kMaxTiles of the views, evenly chosen, each with its name, its
// coverage and the range of its depth. Near is red, far is blue, on a logarithmic scale that all
// tiles share; no surface is black. The same bytes for any number of threads.
Image MakeContactSheet(const std::shared_ptr<const RayCaster>& scene,
                       const std::vector<PosedImage>& views, int threads);

// Returns one sentence: where mesh and cameras are, and what may be wrong with unit, origin or
// axes. Takes at least one camera.
std::string WhyTheMeshIsUnseen(const RayCaster& scene,
                               const std::vector<Eigen::Vector3d>& camera_centers);

// Returns a question for the unit where ten cameras or more stand within a hundredth of how far a
// quarter of them sees. `farthest` is the largest depth of each camera that sees some. nullopt
// where there is nothing to ask.
std::optional<std::string> AskForUnit(const std::vector<Eigen::Vector3d>& camera_centers,
                                      std::vector<double> farthest);

// Writes the cameras of what is rendered in files that makers of data sets feed to other tools:
// nerfstudio's transforms.json and MVSNet's cams/ and pair.txt.

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
                                            const RayCaster& scene,
                                            std::span<const PosedImage> views, int threads);

}  // namespace raylift
