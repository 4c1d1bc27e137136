// raylift export: the poses of a run of localize in the formats of others.

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "io/scene/trajectory_file.h"
#include "lifting/mesh_spec.h"
#include "localization/results/exports.h"
#include "surfaces/resampled_mesh.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

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

enum class ExportFormat { kColmap, kGlb, kHloc, kKapture, kKitti, kTum };
template <>
inline constexpr auto kEnumNames<ExportFormat> = std::to_array<EnumName<ExportFormat>>({
    {ExportFormat::kColmap, "colmap", "", "model of references and queries (OUT is a folder)"},
    {ExportFormat::kGlb, "glb", "",
     "mesh and cameras: blue references, green and (doubtful) orange"},
    {ExportFormat::kHloc, "hloc", "", "list for hloc and visuallocalization.net"},
    {ExportFormat::kKapture, "kapture", "", "kapture data set of the queries (OUT is a folder)"},
    {ExportFormat::kKitti, "kitti", "", "camera to world, 3 x 4; OUT_images.txt has the names"},
    {ExportFormat::kTum, "tum", "", "time and camera to world, in the order of time"},
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

// What a run of localize has left behind.
struct FinishedRun {
  std::vector<LocalizedQuery> queries;  // in the order of the list, with and without poses
  // As its options.json has them: relative paths start where it ran. Empty where it has none.
  std::filesystem::path query_list, query_images, model;
  bool leave_one_out = false;  // the queries are the model's images, and there is no list
  PoseConvention model_poses = PoseConvention::kCamFromWorld;
  Subsampling subsampling;
  std::vector<std::string> geometry;
};

using Json = nlohmann::json;

// Empty where the option has no value.
path PathOption(const Json& options, const char* name) {
  const Json& value = options.at(name);
  return value.is_null() ? path() : path(value.get<std::string>());
}

void TakeOptions(const path& folder, FinishedRun& run) {
  const path file = folder / "options.json";
  try {
    const Json options = Json::parse(ReadFile(file));
    run.query_list = PathOption(options, "queries");
    run.leave_one_out = options.value("leave-one-out", false);
    run.query_images = PathOption(options, "query-images");
    if (run.query_images.empty()) run.query_images = PathOption(options, "images");
    run.model = PathOption(options, "model");
    if (run.model.empty()) run.model = folder / "references" / "model";  // rendered
    const auto poses = FromName<PoseConvention>(options.at("model-poses").get<std::string>());
    if (!poses) throw InputError(file, "model-poses", "expected " + NameList<PoseConvention>());
    run.model_poses = *poses;
    run.subsampling = {.every = options.at("every").get<int>(),
                       .offset = options.at("every-offset").get<int>(),
                       .per_camera = options.at("every-per-camera").get<bool>()};
    run.geometry = options.at("geometry").get<std::vector<std::string>>();
  } catch (const Json::exception& error) {
    throw InputError(file, "is not what localize writes: " + std::string(error.what()));
  }
}

// From the folder of a run, or from a pose file alone, whose poses all count as localized. Throws
// InputError where it is neither.
FinishedRun ReadFinishedRun(const path& folder_or_pose_file) {
  FinishedRun run;
  if (std::filesystem::is_directory(folder_or_pose_file)) {
    run.queries = ReadQueryDiagnostics(folder_or_pose_file / "queries.jsonl");
    TakeOptions(folder_or_pose_file, run);
    return run;
  }
  for (const NamedPose& pose : ReadPoseFile(folder_or_pose_file)) {
    LocalizedQuery& query = run.queries.emplace_back();
    query.name = pose.name;
    query.estimate.cam_from_world = pose.cam_from_world;
    query.estimate.verdict = PoseVerdict::kLocalized;
    query.estimate.confidence = 1;
  }
  return run;
}

struct ExportFlags {
  ExportFormat format = ExportFormat::kColmap;
  path run, out, queries, query_images, model, times;
  std::string geometry, up;
  std::optional<NameForm> names;
  std::optional<double> frustum_size;
  int max_triangles = 0;  // 0: all
  double min_confidence = 0;
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
  only_for("--geometry", !flags.geometry.empty(), {kGlb});
  only_for("--up", !flags.up.empty(), {kGlb});
  RequireAtLeast("--max-triangles", flags.max_triangles, 0);
  only_for("--max-triangles", flags.max_triangles > 0, {kGlb});
  only_for("--frustum-size", flags.frustum_size.has_value(), {kGlb});
  if (!(flags.min_confidence >= 0 && flags.min_confidence <= 1)) {
    throw OptionError("--min-confidence", fmt::format("{}", flags.min_confidence),
                      "must lie between 0 and 1");
  }
}

std::optional<Eigen::Vector3d> ParseUp(const std::string& text) {
  if (text.empty()) return std::nullopt;
  const std::string axis = text.starts_with('-') ? text.substr(1) : text;
  const size_t place = std::string_view("xyz").find(axis);
  if (axis.size() != 1 || place == std::string_view::npos) {
    throw OptionError("--up", text, "expected x|y|z|-x|-y|-z");
  }
  const double sign = text.starts_with('-') ? -1 : 1;
  return sign * Eigen::Vector3d::Unit(static_cast<Eigen::Index>(place));
}

std::string NameIn(NameForm form, const std::string& name) {
  const size_t file = name.rfind('/');
  if (form == NameForm::kFull || file == std::string::npos) return name;
  if (form == NameForm::kFile) return name.substr(file + 1);
  const size_t folder = file == 0 ? std::string::npos : name.rfind('/', file - 1);
  return folder == std::string::npos ? name : name.substr(folder + 1);
}

class Export {
 public:
  explicit Export(const ExportFlags& flags) : flags_(flags), run_(ReadFinishedRun(flags.run)) {
    if (!flags.model.empty()) {
      run_.model = flags.model;
      run_.model_poses = PoseConvention::kCamFromWorld;
      run_.subsampling = {};
    }
    if (!flags.queries.empty()) run_.query_list = flags.queries;
    if (!flags.query_images.empty()) run_.query_images = flags.query_images;
    if (!flags.geometry.empty()) run_.geometry = {flags.geometry};
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
    if (run_.model.empty()) throw OptionError("--model is required where RUN is a pose file");
    LoadedReferences loaded = LoadReferences(run_.model, run_.subsampling, run_.model_poses);
    PrintWarnings(loaded.warnings);
    note_ = fmt::format(" beside {} references", loaded.references.images.size());
    return loaded.references;
  }

  std::vector<Query> ListedQueries() const {
    if (!run_.query_list.empty()) return ReadQueryList(run_.query_list, run_.query_images);
    if (!run_.leave_one_out) {
      throw OptionError("--queries is required where RUN is a pose file");
    }
    return QueriesOf(LoadReferences(run_.model, run_.subsampling, run_.model_poses).references);
  }

  // Those that have a pose, in the order of the run's.
  std::vector<Query> Queries() const {
    std::unordered_map<std::string, Query> listed;
    for (Query& query : ListedQueries()) {
      const std::string name = query.name;
      listed.emplace(name, std::move(query));
    }
    std::vector<Query> queries;
    for (const LocalizedQuery& query : run_.queries) {
      const auto found = listed.find(query.name);
      if (found == listed.end()) {
        throw InputError(run_.query_list.empty() ? run_.model : run_.query_list,
                         fmt::format("{} has a pose, but is missing here", query.name));
      }
      queries.push_back(found->second);
    }
    return queries;
  }

  std::vector<PosedImage> PosedQueries() const {
    const std::vector<Query> queries = Queries();
    std::vector<PosedImage> images;
    for (size_t i = 0; i < queries.size(); ++i) {
      const PoseEstimate& estimate = run_.queries[i].estimate;
      images.push_back({queries[i].name, estimate.refined_camera.value_or(queries[i].camera),
                        *estimate.cam_from_world});
    }
    return images;
  }

  void WriteModel() {
    std::error_code none;
    if (std::filesystem::equivalent(flags_.out, run_.model, none)) {
      throw OptionError("--out", flags_.out.string(), "is the folder of the references' model");
    }
    WriteColmapModel(flags_.out, LocalizedModel(References(), Queries(), run_.queries),
                     ColmapForm::kBinary);
  }

  void WriteScene() {
    const std::optional<Eigen::Vector3d> up = ParseUp(flags_.up);
    std::vector<GlbCamera> cameras;
    if (!run_.model.empty()) {
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
    const GlbOptions options{.frustum_size = flags_.frustum_size, .up_in_world = up};
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

  // The first of the geometries that is one; null where there is none.
  std::shared_ptr<const RayCaster> Mesh() const {
    for (const std::string& spec : run_.geometry) {
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

  // By --times, else as the names say, else counted.
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
  options.Add("--names", flags->names,
              "Of hloc: {}; full as in the list, file the last part\n"
              "(hloc, Aachen, CMU), camera the last folder with it (RobotCar); by default file");
  options.Add("--times", flags->times,
              "Of tum and kitti: lines `name seconds` (default: names that are numbers,\n"
              "as TUM's, else the places in the list)");
  options.Add("--max-triangles", flags->max_triangles,
              "Of glb: make the mesh coarser until it has no more, in colors without\n"
              "textures; 0: as it is");
  options.Add("--up", flags->up,
              "Of glb: the world's axis that points up, x|y|z|-x|-y|-z, is turned to\n"
              "glTF's y (default: the world's own axes)");
  options.AddParsed("--frustum-size", flags->frustum_size, &ParsePositive,
                    "Of glb: how far a camera reaches, scene units");
  AddRunOptions(command, flags->running);
  SetFooter(command,
            "Examples:\n"
            "  raylift export colmap result --out result/model\n"
            "  raylift export glb result --out result/scene.glb --up z\n"
            "  raylift export hloc result --names camera --out robotcar.txt");
  return {&command, [flags] { UntilSignal([&] { Run(*flags); }, &BeginsAnew); }};
}

}  // namespace raylift
