#include "apps/job_options.h"

#include "apps/interrupt.h"
#include "base/hash.h"
#include "base/json_text.h"
#include "jobs/fingerprint.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

std::string NumbersText(std::span<const double> numbers) {
  std::string text;
  for (const double number : numbers) text += ' ' + FormatDouble(number);
  return text;
}

std::string NumbersText(const Eigen::Vector3d& v) { return NumbersText(std::span(v.data(), 3)); }

std::string HashOf(size_t count, const std::string& text) {
  return fmt::format("{} {}", count, HexText(HashBytes64(text)));
}

std::string PriorsText(const PosePriors& priors) {
  std::string text;
  if (const auto& known = priors.position) {
    text += " position" + NumbersText(known->position) + NumbersText(known->sigma);
  }
  if (const auto& known = priors.gravity) {
    text += " gravity" + NumbersText(known->down_in_cam) + NumbersText(known->down_in_world) +
            NumbersText(std::span(&known->sigma_deg, 1));
  }
  if (const auto& known = priors.heading) {
    text += " heading" + NumbersText(known->right_in_cam) + NumbersText(known->right_in_world) +
            NumbersText(known->down_in_world) + NumbersText(std::span(&known->sigma_deg, 1));
  }
  if (const auto& known = priors.orientation) {
    text += " orientation" + NumbersText(std::span(known->cam_from_world.coeffs().data(), 4)) +
            NumbersText(std::span(&known->sigma_deg, 1));
  }
  if (const auto& known = priors.range) {
    const double numbers[] = {known->range, known->sigma};
    text += " range" + NumbersText(numbers);
  }
  if (priors.focal_range != 1) text += " focal_range " + FormatDouble(priors.focal_range);
  if (priors.focal_sigma) text += " focal_sigma " + FormatDouble(*priors.focal_sigma);
  return text;
}

std::string RigText(const RigMount& mount) {
  const Eigen::Quaterniond& q = mount.cam_from_rig.rotation;
  const double wxyz[] = {q.w(), q.x(), q.y(), q.z()};
  return fmt::format(" rig {} {}", mount.sensor, mount.frame) + NumbersText(wxyz) +
         NumbersText(mount.cam_from_rig.translation);
}

std::string ReferencesFingerprint(const ReferenceSet& references) {
  std::string text;
  for (const PosedImage& image : references.images) {
    const Eigen::Quaterniond& q = image.cam_from_world.rotation;
    const double wxyz[] = {q.w(), q.x(), q.y(), q.z()};
    text += image.name + ' ' + image.camera.ToString() + NumbersText(wxyz) +
            NumbersText(image.cam_from_world.translation) + '\n';
  }
  return HashOf(references.images.size(), text);
}

std::string ModelFingerprint(const path& folder) {
  std::string text;
  for (const char* name : {"cameras", "images", "points3D", "rigs", "frames"}) {
    for (const char* extension : {".bin", ".txt"}) {
      text += FileFingerprint(folder / name += extension) + '\n';
    }
  }
  return HexText(HashBytes64(text));
}

// Returns PATH of "KIND:PATH,key=value".
path PathOfSpec(const std::string& spec) {
  const size_t begin = std::min(spec.find(':'), spec.size() - 1) + 1;
  return spec.substr(begin, spec.find(',', begin) - begin);
}

std::string GeometryFingerprint(const SceneSource& source, const SceneInputs& inputs) {
  const path folder = PathOfSpec(source.spec);
  switch (source.geometry.kind) {
    case GeometryKind::kMesh:
    case GeometryKind::kCloud:
    case GeometryKind::kSplats:
      return HexText(SurfaceHash(*source.geometry.Surface(), inputs.threads));
    case GeometryKind::kDepth:
      return FolderFingerprint(folder, inputs.out);
    case GeometryKind::kSfm:
      return ModelFingerprint(source.spec.starts_with("sfm:") ? folder : inputs.model);
  }
  return {};
}

}  // namespace

std::string QueriesFingerprint(std::span<const Query> queries) {
  std::string text;
  for (const Query& query : queries) {
    text += query.name + ' ' + query.camera.ToString() + PriorsText(query.priors);
    if (query.rig) text += RigText(*query.rig);
    text += '\n';
  }
  return HashOf(queries.size(), text);
}

void JobFlags::Check() const {
  if (resume && overwrite) throw OptionError("give at most one of --resume and --overwrite");
}

Shard JobFlags::Resolve() const { return ParseShard(shard, &EnvironmentVariable); }

JobFolder JobFlags::In(const std::filesystem::path& out) const {
  return {.out = out, .shard = Resolve(), .resume = resume, .overwrite = overwrite};
}

void AddOverwriteOption(CLI::App& command, bool& overwrite) {
  const OptionGroup running(command, "Running");
  running.Flag("--overwrite", overwrite,
               "Begin anew in a folder where a finished run is; else it is refused");
}

void RequireNoneLeft(size_t left, std::string_view tasks) {
  if (left == 0) return;
  throw Interrupted(
      fmt::format("stopped by a signal with {} {} left; --resume goes on", left, tasks));
}

void RefuseFinished(const std::filesystem::path& file, bool overwrite) {
  if (overwrite || !Exists(file)) return;
  throw OptionError("--overwrite", "false",
                    file.string() + " is of a finished run, which would be lost");
}

void AddJobOptions(CLI::App& command, JobFlags& flags, const std::string& resume,
                   const std::string& overwrite) {
  const OptionGroup group(command, "Running");
  group.Flag("--resume", flags.resume, resume);
  group.Flag("--overwrite", flags.overwrite, overwrite);
  group.Add("--shard", flags.shard,
            "i/n: only the i-th of n equal parts (i from 0 or from 1: n/n is 0/n);\n"
            "auto: what the environment tells of job arrays (Slurm, SGE, AWS Batch), of\n"
            "tasks of srun, MPI or RANK and WORLD_SIZE, or of both at once; auto/N where\n"
            "it does not tell of how many an array's index is one, from 0 (PBS,\n"
            "Kubernetes, uneven arrays, one job submitted again)");
}

std::string JobHeader(Json options, size_t tasks, std::initializer_list<const char*> needless,
                      const Json& inputs) {
  Json header = {{"command", options["command"]},
                 {"raylift_version", options["raylift_version"]},
                 {"tasks", tasks}};
  for (const char* name : {"command", "raylift_version", "threads", "quiet", "config", "resume",
                           "overwrite", "shard", "out"}) {
    options.erase(name);
  }
  for (const char* name : needless) options.erase(name);
  header["options"] = std::move(options);
  header["inputs"] = inputs;
  return JsonText(header);
}

std::string OptionsOfResults(const std::string& options_json) {
  Json options = Json::parse(options_json);
  for (const char* name : {"resume", "overwrite", "shard"}) options.erase(name);
  return JsonText(options, 2) + '\n';
}

std::string FileOrModelFingerprint(const path& file) {
  return IsFolder(file) ? ModelFingerprint(file) : FileFingerprint(file);
}

Json InputsJson(const SceneInputs& inputs, const Scene& scene, std::span<const Query> queries) {
  Json json = {{"queries", QueriesFingerprint(queries)},
               {"references", ReferencesFingerprint(scene.references)}};
  if (!inputs.model.empty()) json["model"] = FileOrModelFingerprint(inputs.model);
  for (size_t i = 0; i < scene.sources.size(); ++i) {
    json[fmt::format("geometry {}", i + 1)] = GeometryFingerprint(scene.sources[i], inputs);
  }
  const auto add_file = [&json](const char* name, const path& file) {
    if (!file.empty()) json[name] = FileOrModelFingerprint(file);
  };
  const HlocFiles& hloc = inputs.matching.hloc.files;
  add_file("features", hloc.features);
  if (std::filesystem::is_directory(hloc.matches)) {
    json["matches"] = FolderFingerprint(hloc.matches, inputs.out);
  } else {
    add_file("matches", hloc.matches);
  }
  add_file("pairs", hloc.pairs);
  const RetrievalFlags& retrieval = inputs.matching.retrieval;
  add_file("global-features", retrieval.global_features.references);
  add_file("query-global-features", retrieval.global_features.queries);
  add_file("prior-poses", retrieval.prior_poses);
  if (!inputs.images.empty()) {
    json["images"] = SizesFingerprint(inputs.images, NamesOf(scene.references.images));
  }
  if (!inputs.query_images.empty()) {
    json["query-images"] = SizesFingerprint(inputs.query_images, NamesOf(queries));
  }
  return json;
}

}  // namespace raylift
