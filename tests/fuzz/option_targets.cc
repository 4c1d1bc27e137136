// What the command line says in texts of a grammar of their own.

#include "fuzz/fuzz_targets.h"
#include "lifting/depth_convention.h"
#include "lifting/mesh_spec.h"

#include "raylift/evaluation/pose_errors.h"
#include "raylift/io/query_list.h"
#include "raylift/jobs/shard.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

std::string Text(std::string_view bytes) { return std::string(bytes); }

// A Slurm job array as it might tell its index.
std::optional<std::string> Slurm(const std::string& name, std::string_view value) {
  return name == "SLURM_ARRAY_TASK_ID" ? std::optional(Text(value)) : std::nullopt;
}

constexpr std::string_view kSpecWords =
    ", = + / build=low near= far= max_incidence_deg= max_depth_jump= back_faces=drop scale= "
    "rotation= translation= world= radius= neighbors= preset=colmap preset=7scenes pattern= "
    "kind=ray kind=inverse unit=mm unit= invalid= max_depth= layer= size=64x48 "
    "orientation=half_turn "
    "first_sample_px= depth=peak transform=none confidence= interpolation= max_jump= min_track= "
    "nan inf 1e308 1e-320 -1";

}  // namespace

std::vector<FuzzTarget> OptionFuzzTargets() {
  return {
      {"mesh_spec",
       [](std::string_view bytes) { ParseMeshSpec("mesh:" + Text(bytes), MeshUse::kLift); },
       [] {
         return std::vector<std::string>{"a.ply,build=low,near=0.1,far=30", "*.obj"};
       },
       kSpecWords},
      {"cloud_spec",
       [](std::string_view bytes) { ParseCloudSpec("cloud:" + Text(bytes), MeshUse::kRender); },
       [] {
         return std::vector<std::string>{"a.las,build=low", "a+b.ply"};
       },
       kSpecWords},
      {"splat_spec",
       [](std::string_view bytes) { ParseSplatSpec("splat:" + Text(bytes), MeshUse::kLift); },
       [] {
         return std::vector<std::string>{"a.ply,depth=median,transform=none", "a.ply,far=3"};
       },
       kSpecWords},
      {"depth_spec",
       [](std::string_view bytes) {
         // No maps are there: the keys are what is read.
         MakeGeometrySource("depth:" + (ScratchFolder() / "none").string() + "," + Text(bytes));
       },
       [] { return std::vector<std::string>{}; }, kSpecWords},
      {"depth_pattern",
       [](std::string_view bytes) {
         const size_t end = std::min(bytes.find('\n'), bytes.size());
         constexpr size_t kLongest = 1000;  // the longer, the more text becomes of it
         ExpandPattern(bytes.substr(0, std::min(end, kLongest)), bytes.substr(end, kLongest));
       },
       [] { return std::vector<std::string>{"{dir}/{stem}_{flat7}.png\nseq-01/a.color.jpg"}; },
       "{name} {dir} {stem} {base} {flat} {flat7} {time} .. / - ."},
      {"shard",
       [](std::string_view bytes) {
         const size_t end = std::min(bytes.find('\n'), bytes.size());
         ParseShard(Text(bytes.substr(0, end)), [&](const std::string& name) {
           return Slurm(name, bytes.substr(std::min(end + 1, bytes.size())));
         });
       },
       [] {
         return std::vector<std::string>{"1/4", "auto/4\n2"};
       },
       "auto auto/ / 2147483648 9223372036854775807 -1"},
      {"camera", [](std::string_view bytes) { ParseCamera("--camera", Text(bytes)); },
       [] { return std::vector<std::string>{"PINHOLE 64 48 50 50 32 24"}; },
       "SIMPLE_PINHOLE RADIAL OPENCV OPENCV_FISHEYE FULL_OPENCV FOV THIN_PRISM_FISHEYE "
       "RAD_TAN_THIN_PRISM_FISHEYE DIVISION EUCM EQUIRECTANGULAR nan 1e308 1e-320 2147483647"},
      {"thresholds", [](std::string_view bytes) { ParseThresholds(bytes); },
       [] {
         return std::vector<std::string>{"0.05,5:0.1,1", "7scenes"};
       },
       ": , aachen nan"},
  };
}

}  // namespace raylift
