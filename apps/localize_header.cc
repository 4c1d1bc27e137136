#include "localize_header.h"

#include "job_header.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/hash.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/jobs/fingerprint.h"
#include "raylift/renderers/surface_hash.h"

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
  if (priors.focal_range != 1) text += " focal_range " + FormatDouble(priors.focal_range);
  return text;
}

std::string QueriesFingerprint(std::span<const Query> queries) {
  std::string text;
  for (const Query& query : queries) {
    text += query.name + ' ' + query.camera.ToString() + PriorsText(query.priors) + '\n';
  }
  return HashOf(queries.size(), text);
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

// "KIND:PATH,key=value"
path PathOfSpec(const std::string& spec) {
  const size_t begin = std::min(spec.find(':'), spec.size() - 1) + 1;
  return spec.substr(begin, spec.find(',', begin) - begin);
}

std::string GeometryFingerprint(const SceneSource& source, const LocalizeFlags& flags) {
  const path folder = PathOfSpec(source.spec);
  switch (source.geometry.kind) {
    case GeometryKind::kMesh:
    case GeometryKind::kCloud:
      return HexText(SurfaceHash(*source.geometry.Surface(), flags.run.threads));
    case GeometryKind::kDepth:
      return FolderFingerprint(folder, flags.out);
    case GeometryKind::kSfm:
      return ModelFingerprint(source.spec.starts_with("sfm:") ? folder : flags.references.model);
  }
  return {};
}

template <typename T>
std::vector<std::string> NamesOf(std::span<const T> images) {
  std::vector<std::string> names;
  names.reserve(images.size());
  for (const T& image : images) names.push_back(image.name);
  return names;
}

Json InputsJson(const LocalizeFlags& flags, const Scene& scene, std::span<const Query> queries) {
  Json inputs = {{"queries", QueriesFingerprint(queries)},
                 {"references", ReferencesFingerprint(scene.references)}};
  if (!flags.RendersReferences()) inputs["model"] = ModelFingerprint(flags.references.model);
  for (size_t i = 0; i < scene.sources.size(); ++i) {
    inputs[fmt::format("geometry {}", i + 1)] = GeometryFingerprint(scene.sources[i], flags);
  }
  const auto add_file = [&inputs](const char* name, const path& file) {
    if (file.empty()) return;
    std::error_code ignored;
    inputs[name] = std::filesystem::is_directory(file, ignored) ? ModelFingerprint(file)
                                                                : FileFingerprint(file);
  };
  const HlocFiles& hloc = flags.matching.hloc.files;
  add_file("features", hloc.features);
  if (std::filesystem::is_directory(hloc.matches)) {
    inputs["matches"] = FolderFingerprint(hloc.matches, flags.out);
  } else {
    add_file("matches", hloc.matches);
  }
  add_file("pairs", hloc.pairs);
  const RetrievalFlags& retrieval = flags.matching.retrieval;
  add_file("global-features", retrieval.global_features.references);
  add_file("query-global-features", retrieval.global_features.queries);
  add_file("prior-poses", retrieval.prior_poses);
  if (!flags.images.empty()) {
    inputs["images"] = SizesFingerprint(
        flags.images, NamesOf(std::span<const PosedImage>(scene.references.images)));
  }
  if (!flags.QueryImages().empty()) {
    inputs["query-images"] = SizesFingerprint(flags.QueryImages(), NamesOf(queries));
  }
  return inputs;
}

}  // namespace

std::string LocalizeHeader(const LocalizeFlags& flags, const std::string& options_json,
                           const Scene& scene, std::span<const Query> queries) {
  Json options = Json::parse(options_json);
  // Where problems are written changes nothing, but that they are must hold for all queries.
  options["write-problems"] = !flags.write_problems.empty();
  return JobHeader(std::move(options), queries.size(),
                   {"scene", "model", "images", "queries", "priors", "query-images", "features",
                    "matches", "pairs", "cache", "prior-poses", "global-features", "report",
                    "query-global-features", "write-model"},
                   InputsJson(flags, scene, queries));
}

}  // namespace raylift
