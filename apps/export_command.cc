// raylift export: writes the poses of a run of localize in the formats of other programs.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "apps/pose_files.h"
#include "io/scene/trajectory_file.h"
#include "lifting/mesh_spec.h"
#include "localization/results/earth_exports.h"
#include "localization/results/exports.h"
#include "surfaces/resampled_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

enum class ExportFormat { kColmap, kGeojson, kGeopose, kGlb, kHloc, kKapture, kKitti, kTum, kUtm };
template <>
inline constexpr auto kEnumNames<ExportFormat> = std::to_array<EnumName<ExportFormat>>({
    {ExportFormat::kColmap, "colmap", "", "model of references and queries (OUT is a folder)"},
    {ExportFormat::kGeojson, "geojson", "",
     "positions on the earth with 95 % error ellipses, for QGIS"},
    {ExportFormat::kGeopose, "geopose", "", "OGC GeoPose, a file per query (OUT is a folder)"},
    {ExportFormat::kGlb, "glb", "",
     "mesh and cameras: blue references, green and (doubtful) orange"},
    {ExportFormat::kHloc, "hloc", "", "list for hloc and visuallocalization.net"},
    {ExportFormat::kKapture, "kapture", "", "kapture data set of the queries (OUT is a folder)"},
    {ExportFormat::kKitti, "kitti", "", "camera to world, 3 x 4; OUT_images.txt has the names"},
    {ExportFormat::kTum, "tum", "", "time and camera to world, in the order of time"},
    {ExportFormat::kUtm, "utm", "",
     "lines `name qw qx qy qz E N H`, camera (x right, y up, z back, as Pix4D's) to map"},
});

enum class NameForm { kFull, kFile, kCamera };
template <>
inline constexpr auto kEnumNames<NameForm> = std::to_array<EnumName<NameForm>>({
    {NameForm::kFull, "full"},
    {NameForm::kFile, "file"},
    {NameForm::kCamera, "camera"},
});

namespace {

using std::filesystem::path;

struct ExportFlags {
  ExportFormat format = ExportFormat::kColmap;
  path run, out, queries, query_images, model, times;
  std::string geometry;
  std::optional<Eigen::Vector3d> up;
  std::optional<NameForm> names;
  std::optional<double> frustum_size;
  int max_triangles = 0;  // 0: all
  double min_confidence = 0;
  std::optional<WorldFrame> world;
  std::optional<Crs> to_crs;
  bool angles = false;
  RunFlags running;
};

void Check(const ExportFlags& flags) {
  using enum ExportFormat;
  flags.running.Check();
  const auto only_for = [&](const char* option, bool is_given, std::vector<ExportFormat> formats) {
    if (!is_given || std::find(formats.begin(), formats.end(), flags.format) != formats.end()) {
      return;
    }
    throw OptionError(
        fmt::format("{} does not go with the format {}", option, ToString(flags.format)));
  };
  only_for("--names", flags.names.has_value(), {kHloc});
  only_for("--times", !flags.times.empty(), {kTum, kKitti});
  only_for("--model", !flags.model.empty(), {kColmap, kGlb});
  only_for("--queries", !flags.queries.empty(), {kColmap, kGlb, kKapture});
  only_for("--query-images", !flags.query_images.empty(), {kColmap, kGlb, kKapture});
  only_for("--crs", flags.world.has_value(), {kGeojson, kGeopose, kUtm});
  only_for("--to-crs", flags.to_crs.has_value(), {kUtm});
  only_for("--angles", flags.angles, {kGeopose});
  only_for("--geometry", !flags.geometry.empty(), {kGlb});
  only_for("--up", flags.up.has_value(), {kGlb});
  RequireAtLeast("--max-triangles", flags.max_triangles, 0);
  only_for("--max-triangles", flags.max_triangles > 0, {kGlb});
  only_for("--frustum-size", flags.frustum_size.has_value(), {kGlb});
  if (!(flags.min_confidence >= 0 && flags.min_confidence <= 1)) {
    throw OptionError("--min-confidence", fmt::format("{}", flags.min_confidence),
                      "must lie between 0 and 1");
  }
}

std::string NameIn(NameForm form, const std::string& name) {
  const size_t file = name.rfind('/');
  if (form == NameForm::kFull || file == std::string::npos) return name;
  if (form == NameForm::kFile) return name.substr(file + 1);
  const size_t folder = file == 0 ? std::string::npos : name.rfind('/', file - 1);
  return folder == std::string::npos ? name : name.substr(folder + 1);
}

// Returns the world's own coordinate system where that is projected, else the UTM zone of the
// position.
Crs UtmZoneOf(const WorldFrame& world, const EarthFrame& earth, const Eigen::Vector3d& position) {
  if (world.crs.kind() == CrsKind::kProjected) return world.crs;
  const Eigen::Vector3d at = earth.At(position).geographic;
  const int zone = std::clamp(static_cast<int>(std::floor((at.x() + 180) / 6)) + 1, 1, 60);
  return Crs(fmt::format("EPSG:{}", (at.y() < 0 ? 32700 : 32600) + zone));
}

class Export {
 public:
  explicit Export(const ExportFlags& flags) : flags_(flags), run_(ReadFinishedRun(flags.run)) {
    if (!flags.model.empty()) run_.references = {.model = flags.model};
    if (!flags.queries.empty()) run_.query_list = flags.queries;
    if (!flags.query_images.empty()) run_.query_images = flags.query_images;
    if (!flags.geometry.empty()) run_.geometry = {flags.geometry};
    if (flags.world) run_.world = flags.world;
    num_queries_ = run_.queries.size();
    std::erase_if(run_.queries, [&](const LocalizedQuery& query) {
      return !query.localized() || query.confidence() < flags.min_confidence;
    });
    if (run_.queries.empty()) throw InputError(flags.run, "holds no pose to export");
  }

  void Write() {
    switch (flags_.format) {
      case ExportFormat::kColmap:
        return WriteModel();
      case ExportFormat::kGeojson:
      case ExportFormat::kGeopose:
      case ExportFormat::kUtm:
        return WriteOnEarth();
      case ExportFormat::kGlb:
        return WriteScene();
      case ExportFormat::kHloc:
        return WriteList();
      case ExportFormat::kKapture:
        return WriteKapture(flags_.out, PosedQueries());
      case ExportFormat::kKitti:
      case ExportFormat::kTum:
        return WriteTrajectory();
    }
  }

  void Print() const {
    fmt::print("{} of {} queries as {}{}: {}\n", run_.queries.size(), num_queries_,
               ToString(flags_.format), note_, flags_.out.string());
  }

 private:
  ReferenceSet References() {
    if (run_.references.model.empty())
      throw OptionError("--model is required where RUN is a pose file");
    LoadedReferences loaded = run_.references.Load();
    PrintWarnings(loaded.warnings);
    note_ = fmt::format(" beside {} references", loaded.references.images.size());
    return loaded.references;
  }

  std::vector<PosedImage> PosedQueries() const {
    const std::vector<Query> queries = run_.PosedQueries();
    std::vector<PosedImage> images;
    for (size_t i = 0; i < queries.size(); ++i) {
      const PoseEstimate& estimate = run_.queries[i].estimate;
      images.push_back({queries[i].name, estimate.refined_camera.value_or(queries[i].camera),
                        *estimate.cam_from_world});
    }
    return images;
  }

  void WriteOnEarth() {
    if (!run_.world) {
      throw OptionError(
          fmt::format("--crs is required by the format {}: what the world's "
                      "coordinates are (localize --crs)",
                      ToString(flags_.format)));
    }
    const EarthFrame earth(*run_.world);
    if (flags_.format == ExportFormat::kGeojson) {
      WriteGeoJson(flags_.out, earth, run_.queries);
    } else if (flags_.format == ExportFormat::kGeopose) {
      WriteGeoPoses(flags_.out, earth, run_.queries,
                    flags_.angles ? GeoPoseForm::kYawPitchRoll : GeoPoseForm::kQuaternion);
    } else {
      const Crs target =
          flags_.to_crs ? *flags_.to_crs
                        : UtmZoneOf(*run_.world, earth,
                                    run_.queries.front().estimate.cam_from_world->OriginInSource());
      WriteMapPoses(flags_.out, earth, target, run_.queries);
      note_ = fmt::format(" in {} ({})", target.definition(), target.name());
    }
    if (const auto warning = earth.Warning()) PrintWarning(*warning);
    const auto of_heights = earth.HeightsWarning();
    if (of_heights && flags_.format != ExportFormat::kUtm) PrintWarning(*of_heights);
  }

  void WriteModel() {
    std::error_code none;
    if (std::filesystem::equivalent(flags_.out, run_.references.model, none)) {
      throw OptionError("--out", flags_.out.string(), "is the folder of the references' model");
    }
    WriteColmapModel(flags_.out, LocalizedModel(References(), run_.PosedQueries(), run_.queries),
                     ColmapForm::kBinary);
  }

  void WriteScene() {
    std::vector<GlbCamera> cameras;
    if (!run_.references.model.empty()) {
      for (PosedImage& image : References().images) {
        cameras.push_back({std::move(image), GlbCameraKind::kReference});
      }
    }
    std::vector<PosedImage> queries = PosedQueries();
    for (size_t i = 0; i < queries.size(); ++i) {
      const bool sure = run_.queries[i].verdict() == PoseVerdict::kLocalized;
      cameras.push_back(
          {std::move(queries[i]), sure ? GlbCameraKind::kLocalized : GlbCameraKind::kDoubtful});
    }
    const GlbOptions options{.frustum_size = flags_.frustum_size, .up_in_world = flags_.up};
    const std::shared_ptr<const RayCaster> mesh = Mesh();
    if (mesh == nullptr) {
      WriteGlb(flags_.out, nullptr, cameras, options);
    } else if (flags_.max_triangles == 0) {
      WriteGlb(flags_.out, &mesh->mesh(), cameras, options);
    } else {
      const auto most = static_cast<size_t>(flags_.max_triangles);
      const TriangleMesh coarse = DecimatedMesh(mesh->mesh(), most);
      WriteGlb(flags_.out, &coarse, cameras, options);
    }
  }

  // Returns the first geometry that is a mesh; null where there is none.
  std::shared_ptr<const RayCaster> Mesh() const {
    for (const std::string& spec : InWorld(run_.geometry, run_.world)) {
      if (!IsMeshSpec(spec)) continue;
      NamedGeometry geometry = MakeGeometrySource(spec, {.threads = flags_.running.threads});
      PrintWarnings(geometry.warnings);
      return geometry.mesh;
    }
    if (!flags_.geometry.empty()) {
      throw OptionError("--geometry", flags_.geometry, "expected mesh:PATH or dsm:FILE");
    }
    return nullptr;
  }

  void WriteList() const {
    const NameForm form = flags_.names.value_or(NameForm::kFile);
    std::vector<NamedPose> poses;
    std::set<std::string> names;
    for (const LocalizedQuery& query : run_.queries) {
      const std::string name = NameIn(form, query.name);
      if (!names.insert(name).second) {
        throw OptionError("--names", std::string(ToString(form)),
                          fmt::format("{} would stand twice", name));
      }
      poses.push_back({name, *query.estimate.cam_from_world});
    }
    WritePoseFile(flags_.out, poses);
  }

  // Returns the times of --times, else those that the names say, else counts.
  std::vector<double> Times() {
    std::vector<double> times;
    if (!flags_.times.empty()) {
      const auto listed = ReadTimes(flags_.times);
      for (const LocalizedQuery& query : run_.queries) {
        const auto time = listed.find(query.name);
        if (time == listed.end()) {
          throw InputError(flags_.times, fmt::format("the time of {} is missing", query.name));
        }
        times.push_back(time->second);
      }
      note_ = ", times of " + flags_.times.string();
      return times;
    }
    for (const LocalizedQuery& query : run_.queries) {
      if (const auto time = TimeInName(query.name)) times.push_back(*time);
    }
    note_ = ", times by their names";
    if (times.size() == run_.queries.size()) return times;
    note_ = ", their numbers as times";
    times.clear();
    for (size_t i = 0; i < run_.queries.size(); ++i) times.push_back(static_cast<double>(i));
    return times;
  }

  void WriteTrajectory() {
    const std::vector<double> times = Times();
    std::vector<size_t> order(times.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::stable_sort(order.begin(), order.end(),
                     [&](size_t a, size_t b) { return times[a] < times[b]; });
    std::vector<TimedPose> poses;
    std::string names;
    for (const size_t i : order) {
      poses.push_back({times[i], *run_.queries[i].estimate.cam_from_world});
      names += run_.queries[i].name + '\n';
    }
    if (flags_.format == ExportFormat::kTum) return WriteTumTrajectory(flags_.out, poses);
    WriteKittiTrajectory(flags_.out, poses);
    WriteFile(flags_.out.parent_path() / (flags_.out.stem().string() + "_images.txt"), names);
  }

  const ExportFlags& flags_;
  FinishedRun run_;
  size_t num_queries_ = 0;
  std::string note_;
};

void Run(const ExportFlags& flags) {
  Check(flags);
  Export exporting(flags);
  exporting.Write();
  if (!flags.running.quiet) exporting.Print();
}

}  // namespace

Command AddExportCommand(CLI::App& program) {
  auto flags = std::make_shared<ExportFlags>();
  CLI::App& command =
      AddCommand(program, "export", "Poses of localize in the formats of other tools");
  const OptionGroup options(command);
  options.Add("FORMAT", flags->format, Descriptions<ExportFormat>()).Required().Default("");
  options.Add("RUN", flags->run, "Folder of a run of localize, or a pose file").Required();
  options.Add("--out", flags->out, "File or folder to write").Required();
  options.Add("--min-confidence", flags->min_confidence, "Leave out poses that are less sure");
  const OptionGroup group(command, "What the run's options.json says, from another place");
  group.Add("--model", flags->model, "COLMAP model of the references");
  group.Add("--queries", flags->queries, "List of queries: name MODEL width height params...");
  group.Add("--query-images", flags->query_images,
            "Folder of the query photographs, for names that stand alone in the list");
  group.Add("--geometry", flags->geometry, "Of glb: mesh:PATH or dsm:FILE[,key=value...]");
  AddCrsOption(group, flags->world);
  options.AddParsed("--to-crs", flags->to_crs,
                    AsOption([](const std::string& text) { return Crs(text); }),
                    "Of utm: the system of the positions (default: the world's own where it\n"
                    "is a map's, else WGS 84's zone of UTM)");
  options.Flag("--angles", flags->angles,
               "Of geopose: Basic-YPR, yaw, pitch and roll, in place of Basic-Quaternion");
  options.Add("--names", flags->names,
              "Of hloc: {}; full as in the list, file the last part\n"
              "(hloc, Aachen, CMU), camera the last folder with it (RobotCar); by default file");
  options.Add("--times", flags->times,
              "Of tum and kitti: lines `name seconds` (default: names that are numbers,\n"
              "as TUM's, else the places in the list)");
  options.Add("--max-triangles", flags->max_triangles,
              "Of glb: make the mesh coarser until it has no more, in colors without\n"
              "textures; 0: as it is");
  AddUpOption(options, "--up", flags->up,
              "Of glb: the world's direction that points up, x|y|z|-x|-y|-z or X,Y,Z, is\n"
              "turned to glTF's y; auto: the world's own axes are kept");
  options.AddParsed("--frustum-size", flags->frustum_size, &ParsePositive,
                    "Of glb: how far a camera reaches, scene units");
  AddRunOptions(command, flags->running);
  SetFooter(command,
            "Examples:\n"
            "  raylift export colmap result --out result/model\n"
            "  raylift export glb result --out result/scene.glb --up z\n"
            "  raylift export geojson result --crs EPSG:32632 --out result/poses.geojson\n"
            "  raylift export hloc result --names camera --out robotcar.txt");
  return {&command, [flags] { UntilSignal([&] { Run(*flags); }, &BeginsAnew); }};
}

}  // namespace raylift
