#include "raylift/lifting/geometry_spec.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>
#include <utility>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include "base/statistics.h"
#include "lifting/depth_convention.h"
#include "lifting/mesh_spec.h"
#include "lifting/sfm_source.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/mesh_files.h"
#include "raylift/surfaces/point_cloud.h"

namespace raylift {
namespace {

constexpr std::string_view kForms =
    "expected mesh:PATH[,key=value...], dsm:FILE[,key=value...], cloud:PATH[,key=value...], "
    "splat:FILE[,key=value...], depth:PATH[,key=value...] or sfm[:DIR][,key=value...]";
constexpr std::string_view kSfmKeys = "radius (px), min_track, max_error (px), near, far";

using BackFaces = SurfaceLimits::BackFaces;
using BuildQuality = RayCasterOptions::BuildQuality;

std::string DepthKeys() {
  return fmt::format(
      "preset, pattern, names=FILE, fit={}, points={}, poses, poses_are={}, kind={}, "
      "unit=m|cm|mm|NUMBER, scale, invalid, "
      "max_depth, layer, size=WxH, orientation, first_sample_px, confidence, confidence_threshold, "
      "interpolation={}, max_jump, "
      "near, far, max_incidence_deg, max_depth_jump",
      NameList<MapFit>(), NameList<PointFrame>(), NameList<PoseConvention>(), NameList<DepthKind>(),
      NameList<DepthInterpolation>());
}

// Looks at a few thousand discs, evenly spaced.
double MedianRadius(const Surfels& surfels) {
  constexpr size_t kSamples = 4096;
  std::vector<double> radii;
  for (size_t i = 0; i < surfels.discs.size(); i += 1 + surfels.discs.size() / kSamples) {
    radii.push_back(double{surfels.discs[i].w()});
  }
  return UpperMedianOr(std::move(radii), 0);
}

NamedGeometry MakeMesh(const MeshSpec& spec, int threads) {
  RayCasterOptions caster;
  caster.build_quality = spec.build.value_or(RayCasterOptions::BuildQuality::kLow);
  auto mesh = std::make_shared<const TriangleMesh>(OpenMesh(spec, threads));
  NamedGeometry geometry;
  geometry.kind = GeometryKind::kMesh;
  geometry.placement = spec.placement;
  geometry.interpretation = fmt::format("{} triangles", mesh->triangles.size());
  geometry.warnings = mesh->warnings;
  geometry.mesh = std::make_shared<const RayCaster>(std::move(mesh), caster);
  geometry.source = std::make_shared<const MeshSource>(
      fmt::format("{}:{}", spec.is_height_field ? "dsm" : "mesh", spec.files), geometry.mesh,
      spec.options);
  return geometry;
}

NamedGeometry MakeCloud(const CloudSpec& spec, int threads) {
  RayCasterOptions caster;
  caster.build_quality = spec.build.value_or(RayCasterOptions::BuildQuality::kLow);
  NamedGeometry geometry;
  geometry.kind = GeometryKind::kCloud;
  geometry.placement = spec.placement;
  geometry.cloud = OpenCloud(spec, threads, caster);
  const Surfels& surfels = *geometry.cloud->surfels();
  geometry.interpretation = fmt::format("{} points, as discs of radius {:.3g}",
                                        surfels.discs.size(), MedianRadius(surfels));
  geometry.warnings = surfels.warnings;
  geometry.source = std::make_shared<const MeshSource>(fmt::format("cloud:{}", spec.files),
                                                       geometry.cloud, spec.options);
  return geometry;
}

NamedGeometry MakeSplats(const SplatSpec& spec) {
  RayCasterOptions caster;
  caster.build_quality = spec.build.value_or(RayCasterOptions::BuildQuality::kLow);
  const OpenedSplats opened = OpenSplats(spec, caster);
  NamedGeometry geometry;
  geometry.kind = GeometryKind::kSplats;
  geometry.placement = spec.placement;
  geometry.cloud = opened.caster;
  const Splats& splats = *geometry.cloud->splats();
  geometry.interpretation =
      fmt::format("{} Gaussians, {} depth", splats.means.size(), ToString(spec.depth));
  if (opened.transform) {
    geometry.interpretation +=
        fmt::format(", put in the world by {}", opened.transform->filename().string());
  }
  geometry.warnings = splats.warnings;
  geometry.source = std::make_shared<const MeshSource>(fmt::format("splat:{}", spec.files),
                                                       geometry.cloud, spec.options);
  return geometry;
}

double ParseUnit(const SpecKeys& keys, const std::string& text) {
  constexpr std::array<std::pair<std::string_view, double>, 3> kUnits = {
      {{"m", 1}, {"cm", 0.01}, {"mm", 0.001}}};
  for (const auto& [name, value] : kUnits) {
    if (name == text) return value;
  }
  const auto number = ParseDouble(text);
  if (!number || !(*number > 0) || !std::isfinite(*number)) {
    keys.Fail("expected unit=m|cm|mm or a positive number of scene units");
  }
  return *number;
}

PlaneSize ParseSize(const SpecKeys& keys, const std::string& text) {
  const auto sides = SplitBy(text, 'x');
  const auto width = ParseInt(sides.front());
  const auto height = ParseInt(sides.back());
  if (sides.size() != 2 || !width || !height || *width < 1 || *height < 1 ||
      *width > kMaxImageSidePx || *height > kMaxImageSidePx) {
    keys.Fail("expected size=WIDTHxHEIGHT");
  }
  return {static_cast<int>(*width), static_cast<int>(*height)};
}

// Returns the lines of a list of images, which are to be different.
std::vector<std::string> ReadNames(const std::filesystem::path& file) {
  LineReader lines(file);
  std::vector<std::string> names;
  std::unordered_set<std::string> seen;
  while (const auto line = lines.NextContent()) {
    names.emplace_back(Trim(*line));
    if (!seen.insert(names.back()).second) lines.Fail(fmt::format("{} stands twice", names.back()));
  }
  if (names.empty()) throw InputError(file, "expected names of images, one a line, found none");
  return names;
}

std::vector<std::string> SortedNames(const GeometryContext& context) {
  std::vector<std::string> names(context.thinned_out.begin(), context.thinned_out.end());
  for (const PosedImage& reference : context.references) names.push_back(reference.name);
  std::ranges::sort(names);
  return names;
}

DepthConvention TakeConvention(SpecKeys& keys, const GeometryContext& context) {
  DepthConvention convention;
  if (const auto name = keys.Take("preset")) {
    const auto preset = DepthPreset(*name);
    if (!preset) keys.Fail(fmt::format("expected preset={}", DepthPresetNames()));
    convention = *preset;
  }
  convention.kind = keys.TakeNamed<DepthKind>("kind").value_or(convention.kind);
  convention.orientation =
      keys.TakeNamed<MapOrientation>("orientation").value_or(convention.orientation);
  if (const auto unit = keys.Take("unit")) convention.unit = ParseUnit(keys, *unit);
  convention.scale = keys.TakeNumber("scale", 0).value_or(convention.scale);
  if (!(convention.scale > 0)) keys.Fail("expected a positive scale");
  if (auto invalid = keys.TakeNumbers("invalid"); !invalid.empty()) {
    convention.invalid_values = std::move(invalid);
  }
  convention.max_depth = keys.TakeNumber("max_depth", 0).value_or(convention.max_depth);
  if (const auto pattern = keys.Take("pattern")) convention.patterns = {*pattern};
  convention.layer = keys.Take("layer").value_or(convention.layer);
  if (const auto size = keys.Take("size")) {
    convention.raw_size = ParseSize(keys, *size);
    convention.headerless = true;
  }
  convention.fit = keys.TakeNamed<MapFit>("fit").value_or(convention.fit);
  convention.bundle.names_file = keys.Take("names").value_or("");
  convention.bundle.names = convention.bundle.names_file.empty()
                                ? SortedNames(context)
                                : ReadNames(convention.bundle.names_file);
  if (const auto points = keys.TakeNamed<PointFrame>("points")) convention.bundle.points = points;
  if (convention.bundle.points && convention.kind != DepthKind::kZ) {
    keys.Fail("points tell z: expected kind=z");
  }
  convention.bundle.poses = keys.Take("poses").value_or(convention.bundle.poses);
  convention.bundle.pose_convention =
      keys.TakeNamed<PoseConvention>("poses_are").value_or(convention.bundle.pose_convention);
  // The meaning of the confidences that a preset knows is learned.
  if (!convention.confidence_pattern.empty()) convention.confidence_threshold.reset();
  if (auto pattern = keys.Take("confidence")) {
    convention.confidence_pattern = std::move(*pattern);
    convention.confidence_threshold = DepthConvention().confidence_threshold;
  }
  if (const auto threshold = keys.TakeNumber("confidence_threshold", 0)) {
    convention.confidence_threshold = threshold;
  }
  return convention;
}

NamedGeometry MakeDepth(SpecKeys keys, const GeometryContext& context) {
  if (keys.path().empty()) keys.Fail(kForms);
  DepthConvention convention = TakeConvention(keys, context);
  DepthSamplingOptions sampling;
  sampling.interpolation =
      keys.TakeNamed<DepthInterpolation>("interpolation").value_or(sampling.interpolation);
  sampling.max_jump = keys.TakeNumber("max_jump", 0).value_or(sampling.max_jump);
  sampling.first_sample_px =
      keys.TakeNumber("first_sample_px", 0).value_or(sampling.first_sample_px);
  SurfaceLimits limits;
  keys.TakeLimits(limits);
  keys.ExpectAllTaken(DepthKeys());

  auto maps = std::make_shared<const DepthFolder>(keys.path(), convention, context.references,
                                                  context.max_cache_bytes);
  NamedGeometry geometry;
  geometry.kind = GeometryKind::kDepth;
  geometry.depth_convention = DataConvention{.kind = convention.kind,
                                             .orientation = convention.orientation,
                                             .first_sample_px = sampling.first_sample_px,
                                             .scale = convention.scale};
  geometry.interpretation = maps->interpretation();
  geometry.warnings = maps->warnings();
  geometry.maps = maps;
  geometry.source = std::make_shared<const DepthSource>(fmt::format("depth:{}", keys.path()),
                                                        std::move(maps), sampling, limits);
  return geometry;
}

NamedGeometry MakeSfm(SpecKeys keys, const GeometryContext& context) {
  const std::filesystem::path folder =
      keys.path().empty() ? context.model : std::filesystem::path(keys.path());
  if (folder.empty()) keys.Fail("expected sfm:DIR, the folder of a COLMAP model");
  SfmOptions options;
  options.radius_px = keys.TakeNumber("radius", 0).value_or(options.radius_px);
  constexpr double kMaxTrack = 1e9;
  options.min_track_length =
      static_cast<size_t>(std::min(keys.TakeNumber("min_track", 0).value_or(0), kMaxTrack));
  options.max_error_px = keys.TakeNumber("max_error", 0).value_or(options.max_error_px);
  options.limits.near_z = keys.TakeNumber("near", 0).value_or(options.limits.near_z);
  options.limits.far_z = keys.TakeNumber("far", 0).value_or(options.limits.far_z);
  keys.ExpectAllTaken(kSfmKeys);

  ColmapModel model = ReadColmapModel(folder);
  if (model.points3d.empty()) throw InputError(folder, "the model has no 3D points");
  const size_t num_points = model.points3d.size();
  RemoveImages(model, context.thinned_out);
  if (model.points3d.empty()) {
    throw InputError(folder, "no 3D point is seen by two of the images that thinning has left");
  }
  SfmFit fit = CheckSfmModel(model, context.references);
  NamedGeometry geometry;
  geometry.kind = GeometryKind::kSfm;
  geometry.interpretation = std::move(fit.interpretation);
  if (model.points3d.size() < num_points) {
    geometry.interpretation += fmt::format(", of {} before thinning", num_points);
  }
  for (const std::string& warning : fit.warnings) {
    geometry.warnings.push_back(fmt::format("{}: {}", folder.string(), warning));
  }
  geometry.source =
      std::make_shared<const SfmSource>(fmt::format("sfm:{}", folder.string()), model, options);
  return geometry;
}

}  // namespace

std::optional<DepthMap> NamedGeometry::MapOf(const PosedImage& image) const {
  if (const auto surface = Surface()) {
    return RenderDepth(*surface, image.camera, image.cam_from_world, 1);
  }
  const auto map = maps->Load(image);
  return map != nullptr ? std::optional(*map) : std::nullopt;
}

std::string GeometrySpecOf(const std::string& text) {
  const std::string path = text.substr(0, text.find(','));
  if (path.find_first_of(":=") != std::string::npos) return text;
  // A PLY may hold anything; a mesh is the most usual.
  if (IsMeshFileName(path)) return "mesh:" + text;
  const std::string extension = LowerExtension(path);
  if (extension == ".json") return "mesh:" + text;
  if (extension == ".tif" || extension == ".tiff") return "dsm:" + text;
  return IsCloudFileName(path) ? "cloud:" + text : text;
}

NamedGeometry MakeGeometrySource(const std::string& text, const GeometryContext& context) {
  const std::string spec = GeometrySpecOf(text);
  const size_t end = std::min(spec.find_first_of(":,"), spec.size());
  const std::string kind = spec.substr(0, end);
  const bool has_path = end < spec.size() && spec[end] == ':';
  const std::string_view rest = std::string_view(spec).substr(end + (has_path ? 1 : 0));
  if (IsMeshSpec(spec) && !rest.empty()) {
    return MakeMesh(ParseMeshSpec(spec, MeshUse::kLift), context.threads);
  }
  if (kind == "cloud" && has_path && !rest.empty()) {
    return MakeCloud(ParseCloudSpec(spec, MeshUse::kLift), context.threads);
  }
  if (kind == "splat" && has_path && !rest.empty()) {
    return MakeSplats(ParseSplatSpec(spec, MeshUse::kLift));
  }
  if (kind == "depth" && has_path) return MakeDepth(SpecKeys(spec, rest), context);
  if (kind == "sfm") return MakeSfm(SpecKeys(spec, rest), context);
  throw OptionError("geometry", spec, kForms);
}

std::string GeometryHelp() {
  return fmt::format(
      "Where 3D points come from; several sources are asked in order (scene.obj alone is\n"
      "mesh:scene.obj):\n"
      "mesh:PATH[,key=value...]: a mesh; a.ply+b.ply, tiles/*.ply or a folder\n"
      "  are one scene; DIR/tileset.json: 3D Tiles; FILE.city.json, FILE.gml: a city model.\n"
      "  Keys: lod (of a city model; default: the finest up to 3), near, far (depths),\n"
      "  max_incidence_deg, max_depth_jump (relative, near silhouettes), jump_radius_px,\n"
      "  scale, axes (what the world's x/y/z are in the mesh: x/-z/y), shift=X/Y/Z,\n"
      "  matrix (in their place: 3 x 4 or 4 x 4 numbers, separated by /),\n"
      "  back_faces={}, build={} (low: few rays are cast); of 3D Tiles:\n"
      "  error=METERS (geometric; default: the finest), crs=EPSG:N[@X/Y/Z] (default:\n"
      "  meters east, north and up of the root's center)\n"
      "dsm:FILE[,key=value...]: a surface model, a GeoTIFF of heights in a projected system\n"
      "  (meters), or a folder, A.tif+B.tif or *.tif of one grid. Keys: ortho=FILE (an\n"
      "  orthophoto, as its color; likewise), and those of a mesh\n"
      "cloud:PATH[,key=value...]: a point cloud, as discs: PLY, LAS (not LAZ), PCD\n"
      "  (ascii, binary) or text (.xyz, .txt, .asc, .pts, .csv). Keys:\n"
      "  radius=auto|NUMBER (auto: by the density), neighbors (points that a disc is\n"
      "  made of: 16; more against noise), and those of a mesh but for back_faces\n"
      "splat:FILE[,key=value...]: Gaussian splats (3DGS, 2DGS; PLY as trained, or compressed).\n"
      "  Keys: depth={} (of a ray), transform=FILE|none (nerfstudio's\n"
      "  dataparser_transforms.json; by default the one beside FILE), and those of a\n"
      "  mesh but for back_faces\n"
      "depth:PATH[,key=value...]: depth maps, in a folder, or all in one NPZ, HDF5 or NPY.\n"
      "  Keys: preset={}\n"
      "  pattern (file of an image: {{name}}, {{dir}}, {{stem}}, {{base}}),\n"
      "  fit={} (the image's part that a map has),\n"
      "  of maps in one file: names=FILE (of whose images; by default the\n"
      "  references', by name), layer, confidence and poses (names of its arrays),\n"
      "  poses_are={},\n"
      "  points={} (it holds points in this frame),\n"
      "  kind={}, unit=m|cm|mm|NUMBER, scale, invalid=V[/V...],\n"
      "  max_depth, layer, size=WxH (of headerless files), confidence=PATTERN,\n"
      "  confidence_threshold, interpolation={}, max_jump, near, far,\n"
      "  max_incidence_deg, max_depth_jump, first_sample_px (0.5),\n"
      "  orientation={}\n"
      "sfm[:DIR][,key=value...]: the points of a COLMAP model (default: the references').\n"
      "  Keys: radius (px, of features that are not the model's), min_track,\n"
      "  max_error (px), near, far",
      NameList<BackFaces>(), NameList<BuildQuality>(), NameList<SplatDepth>(), DepthPresetNames(),
      NameList<MapFit>(), NameList<PoseConvention>(), NameList<PointFrame>(), NameList<DepthKind>(),
      NameList<DepthInterpolation>(), NameList<MapOrientation>());
}

}  // namespace raylift
