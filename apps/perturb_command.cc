// raylift perturb: makes worse depth maps from depth maps, or odometry from a trajectory.

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <map>
#include <memory>
#include <vector>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "apps/pose_files.h"
#include "base/progress.h"
#include "diagnosis/depth_explanation.h"
#include "evaluation/fields.h"
#include "io/scene/trajectory_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/evaluation/perturbation.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/scene.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct PerturbFlags {
  ReferenceFlags references;
  std::string geometry;
  std::string format = "npy";
  path out;
  std::vector<double> rotation_deg = {0, 0, 0}, shift_px = {0, 0};
  DepthMisalignment misalignment;  // all but these two
  int frames = 0;
  DepthPerturbation perturbation;
  MadeConfidence confidences = MadeConfidence::kNone;
  bool walk = false;
  path times;
  OdometryPerturbation odometry;
  RunFlags run;

  DepthMisalignment Misalignment() const {
    DepthMisalignment all = misalignment;
    all.rotation_deg = Eigen::Vector3d(rotation_deg.at(0), rotation_deg.at(1), rotation_deg.at(2));
    all.shift_px = Eigen::Vector2d(shift_px.at(0), shift_px.at(1));
    return all;
  }
};

// Images in the order of their names, as of a video.
class Frames {
 public:
  explicit Frames(const std::vector<PosedImage>& images) : places_(images.size()) {
    for (const PosedImage& image : images) by_name_.push_back(&image);
    std::stable_sort(by_name_.begin(), by_name_.end(),
                     [](const auto* a, const auto* b) { return a->name < b->name; });
    for (size_t place = 0; place < by_name_.size(); ++place) {
      places_[static_cast<size_t>(by_name_[place] - images.data())] = place;
    }
  }
  // Returns the image `offset` frames away; null before the first one and after the last.
  const PosedImage* At(size_t image, int offset) const {
    const auto place = static_cast<std::ptrdiff_t>(places_[image]) + offset;
    if (place < 0 || place >= static_cast<std::ptrdiff_t>(by_name_.size())) return nullptr;
    return by_name_[static_cast<size_t>(place)];
  }

 private:
  std::vector<const PosedImage*> by_name_;
  std::vector<size_t> places_;
};

// Returns the file where `--geometry depth:OUT` finds the image's map without being told.
path FileOfImage(const path& folder, const std::string& image, const std::string& format) {
  return PathBelow(folder, image).replace_extension(format);
}

// Returns how depth is written: PNG holds millimeters, all others scene units.
DepthWriteOptions WriteOptionsOf(const PerturbFlags& flags) {
  DepthWriteOptions options;
  options.out_of_range = DepthWriteOptions::OutOfRange::kDrop;
  if (!DepthFileFormatFromName(path("map." + flags.format)) || flags.format == "pgm" ||
      flags.format == "npy.gz" || flags.format == "depth") {
    throw OptionError("--format", flags.format,
                      fmt::format("expected {}", fmt::join(FormatsOf(Product::kDepth), "|")));
  }
  return options;
}

// Writes the images as a walk: odometry.txt and times.txt.
void MakeOdometry(const PerturbFlags& flags, const std::string& options_json) {
  flags.odometry.Validate();
  const LoadedReferences loaded = flags.references.Load();
  PrintWarnings(loaded.warnings);
  const PosesByName poses = PosesOf(loaded.references);
  const std::vector<TimedName> order = InOrderOfTime(poses, flags.times);
  std::vector<Rigid3> trajectory;
  std::map<std::string, double> times;
  for (const auto& [time_s, name] : order) {
    trajectory.push_back(poses.at(name));
    times[name] = time_s;
  }
  std::vector<TimedPose> odometry;
  for (const auto& [index, pose] :
       PerturbOdometry(trajectory, flags.odometry, flags.perturbation.seed)) {
    odometry.push_back({order[index].time_s, pose});
  }
  WriteTumTrajectory(flags.out / "odometry.txt", odometry);
  WriteTimes(flags.out / "times.txt", times);
  WriteFile(flags.out / "perturbation.json", options_json);
  if (!flags.run.quiet) {
    fmt::print("wrote odometry of {} of {} images: {}\n", odometry.size(), order.size(),
               (flags.out / "odometry.txt").string());
  }
}

void Run(const PerturbFlags& flags, const std::string& options_json) {
  flags.run.Check();
  flags.references.Check();
  if (flags.walk) return MakeOdometry(flags, options_json);
  if (!flags.times.empty()) throw OptionError("--times", flags.times.string(), "needs --walk");
  if (flags.geometry.empty()) throw OptionError("--geometry is required (or --walk)");
  flags.perturbation.Validate();
  if (flags.rotation_deg.size() != 3) throw OptionError("--rotate: expected three numbers");
  if (flags.shift_px.size() != 2) throw OptionError("--shift: expected two numbers");
  const DepthMisalignment misalignment = flags.Misalignment();
  misalignment.Validate();
  const DepthWriteOptions write_options = WriteOptionsOf(flags);
  const LoadedReferences loaded = flags.references.Load();
  const std::vector<PosedImage>& images = loaded.references.images;
  const NamedGeometry geometry =
      MakeGeometrySource(flags.geometry, {.model = flags.references.model,
                                          .references = images,
                                          .thinned_out = loaded.references.thinned_out,
                                          .threads = flags.run.threads});
  if (geometry.Surface() == nullptr && geometry.maps == nullptr) {
    throw OptionError("--geometry", flags.geometry,
                      "must be a mesh, a point cloud, splats or depth maps");
  }
  PrintWarnings(loaded.warnings);
  PrintWarnings(geometry.warnings);
  RequireWritable(flags.out / "perturbation.json");
  const Frames frames(images);
  std::vector<path> files(images.size()), of_confidence(images.size());
  std::atomic<size_t> dropped{0};
  {
    Progress progress("maps", images.size(), flags.run.Show());
    ParallelFor(images.size(), flags.run.threads, [&](size_t i) {
      const PosedImage* seen = frames.At(i, flags.frames);
      if (const auto map = seen != nullptr ? geometry.MapOf(*seen) : std::nullopt) {
        const DepthMap misaligned = MisalignDepth(*map, images[i].camera, misalignment);
        const CommittedFiles synced_later(CommittedFiles::Sync::kByPromise);
        const auto write = [&](std::vector<path>& written, const path& folder, const DepthMap& of) {
          written[i] = FileOfImage(folder, images[i].name, flags.format);
          dropped += WriteDepthFile(written[i], of, write_options).dropped;
        };
        write(files, flags.out, PerturbDepth(misaligned, flags.perturbation, images[i].name));
        if (flags.confidences != MadeConfidence::kNone) {
          write(of_confidence, flags.out / "confidence",
                ConfidenceOfPerturbed(misaligned, flags.perturbation, flags.confidences,
                                      images[i].name));
        }
      }
      progress.Advance();
    });
  }
  for (std::vector<path>* written : {&files, &of_confidence}) {
    std::erase(*written, path());
    SyncFiles(*written);
  }
  WriteFile(flags.out / "perturbation.json", options_json);
  if (dropped > 0) {
    PrintWarning(fmt::format("{} values that {} cannot hold were stored as holes", dropped.load(),
                             flags.format));
  }
  if (!flags.run.quiet) {
    fmt::print("wrote {} depth maps: {}\n", files.size(), flags.out.string());
  }
}

void AddMisalignmentOptions(CLI::App& command, PerturbFlags& flags) {
  const OptionGroup group(command, "Misalignment, before the perturbation");
  group.Add("--time-offset", flags.frames,
            "Take the map of the image this many places on in the order of names");
  group
      .Add("--rotate", flags.rotation_deg,
           "X,Y,Z: the rotation vector, in degrees, from the camera of the maps to the image's")
      .Commas();
  group.Add("--shift", flags.shift_px, "X,Y: pixels by which maps lie off").Commas();
  group.Add("--zoom", flags.misalignment.zoom, "Factor of the focal length");
  group.Add("--lens", flags.misalignment.lens,
            "k: maps show at p what the image has at c + (p - c) (1 + k (|p - c| / f)^2)");
}

}  // namespace

Command AddPerturbCommand(CLI::App& program) {
  auto flags = std::make_shared<PerturbFlags>();
  CLI::App& command =
      AddCommand(program, "perturb", "Depth maps and odometry made worse on purpose, to test with");
  AddSceneOption(command);
  AddReferenceOptions(command, flags->references);
  const OptionGroup options(command);
  options.Add("--geometry", flags->geometry, GeometryHelp());
  const OptionGroup output(command, "Output");
  output
      .Add("--out", flags->out,
           "Folder for the maps, DIR/STEM.FORMAT of each image, or for the odometry")
      .Required();
  output.Add("--format", flags->format,
             fmt::format("{}; png in millimeters, bin as COLMAP has it",
                         fmt::join(FormatsOf(Product::kDepth), "|")));
  AddMisalignmentOptions(command, *flags);
  const OptionGroup perturbation(command, "Perturbation, in the order of application");
  perturbation.Add(FieldsOf(flags->perturbation));
  perturbation.Add("--confidences", flags->confidences,
                   fmt::format("Those of a network, in OUT/confidence/DIR/STEM.FORMAT: {}",
                               NameList<MadeConfidence>()));
  const OptionGroup walk(command, "Odometry");
  walk.Flag("--walk", flags->walk,
            "The images are a walk: its odometry is made instead of maps, odometry.txt\n"
            "(a TUM trajectory) and times.txt, for localize --odometry");
  walk.Add("--times", flags->times,
           "Their order: lines `name seconds` (default: by name,\n"
           "img_2 before img_10, one a second)");
  walk.Add(FieldsOf(flags->odometry));
  AddRunOptions(command, flags->run);
  SetFooter(command,
            "Example:\n"
            "  raylift perturb --model sfm --geometry mesh:scene.ply --out warped --warp 0.05\n"
            "  raylift compare --model sfm --geometry mesh=mesh:scene.ply \\\n"
            "      --geometry warped=depth:warped --truth mesh\n"
            "  raylift perturb --model truth --walk --out walk --drift 0.01 --turn-drift-deg 0.5");
  return {&command, [flags, &command] {
            UntilSignal([&] { Run(*flags, EffectiveOptionsJson(command)); }, &BeginsAnew);
          }};
}

}  // namespace raylift
