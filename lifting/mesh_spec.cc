#include "lifting/mesh_spec.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <system_error>
#include <utility>

#include "base/input_paths.h"
#include "io/text/json_document.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {

SpecKeys::SpecKeys(std::string spec, std::string_view rest) : spec_(std::move(spec)) {
  const auto parts = SplitBy(rest, ',');
  path_ = parts.front();
  for (size_t i = 1; i < parts.size(); ++i) {
    const size_t equals = parts[i].find('=');
    if (equals == std::string_view::npos) {
      Fail(fmt::format("expected key=value, found \"{}\"", parts[i]));
    }
    const std::string key(parts[i].substr(0, equals));
    if (!values_.emplace(key, parts[i].substr(equals + 1)).second) {
      Fail(fmt::format("the key {} stands twice", key));
    }
  }
}

std::optional<std::string> SpecKeys::Take(const std::string& key) {
  const auto found = values_.find(key);
  if (found == values_.end()) return std::nullopt;
  std::string value = std::move(found->second);
  values_.erase(found);
  return value;
}

std::optional<double> SpecKeys::TakeNumber(const std::string& key, double minimum) {
  const auto text = Take(key);
  if (!text) return std::nullopt;
  const auto value = ParseDouble(*text);
  if (!value || std::isnan(*value) || *value < minimum) {
    Fail(fmt::format("expected {}=NUMBER of at least {}, found \"{}\"", key, minimum, *text));
  }
  return value;
}

std::vector<double> SpecKeys::TakeNumbers(const std::string& key) {
  std::vector<double> values;
  const auto text = Take(key);
  if (!text) return values;
  for (const std::string_view part : SplitBy(*text, '/')) {
    const auto value = ParseDouble(part);
    if (!value) Fail(fmt::format("expected {}=NUMBER[/NUMBER...], found \"{}\"", key, *text));
    values.push_back(*value);
  }
  return values;
}

void SpecKeys::TakeLimits(SurfaceLimits& limits) {
  limits.near_z = TakeNumber("near", 0).value_or(limits.near_z);
  limits.far_z = TakeNumber("far", 0).value_or(limits.far_z);
  limits.max_incidence_deg = TakeNumber("max_incidence_deg", 0).value_or(limits.max_incidence_deg);
  limits.max_depth_jump = TakeNumber("max_depth_jump", 0).value_or(limits.max_depth_jump);
}

void SpecKeys::ExpectAllTaken(std::string_view known) const {
  if (!values_.empty()) {
    Fail(fmt::format("unknown key \"{}\"; there are {}", values_.begin()->first, known));
  }
}

void SpecKeys::Fail(std::string_view constraint) const {
  throw OptionError("geometry", spec_, constraint);
}

namespace {

constexpr std::string_view kPrefix = "mesh:";
constexpr std::string_view kHeightFieldPrefix = "dsm:";
constexpr std::string_view kCloudPrefix = "cloud:";
constexpr std::string_view kSplatPrefix = "splat:";

using BuildQuality = RayCasterOptions::BuildQuality;
using BackFaces = SurfaceLimits::BackFaces;

std::string BuildKey() { return "build=" + NameList<BuildQuality>(); }

std::string PlaceKeys() {
  return "scale, axes (as in x/-z/y), shift=X/Y/Z, matrix (3 x 4 or 4 x 4), " + BuildKey();
}

std::string FormOf(MeshUse use) {
  if (use == MeshUse::kLift) return "expected mesh:PATH[,key=value...] or dsm:FILE[,key=value...]";
  return "expected mesh:PATH[,key=value...], dsm:FILE[,key=value...], cloud:PATH[,key=value...] or "
         "splat:FILE[,key=value...]; nothing else is rendered";
}

std::string KeysOf(MeshUse use) {
  if (use == MeshUse::kRender) return PlaceKeys();
  return fmt::format(
      "near, far, max_incidence_deg, max_depth_jump, jump_radius_px, back_faces={}, {}",
      NameList<BackFaces>(), PlaceKeys());
}

// Returns the keys of surfaces without front and back: their own, and those that they share with
// meshes.
std::string KeysWithoutFaces(std::string_view own, MeshUse use) {
  if (use == MeshUse::kRender) return fmt::format("{}, {}", own, PlaceKeys());
  return fmt::format("{}, near, far, max_incidence_deg, max_depth_jump, jump_radius_px, {}", own,
                     PlaceKeys());
}

std::string CloudKeysOf(MeshUse use) {
  return KeysWithoutFaces("radius=auto|NUMBER, neighbors", use);
}

std::string SplatKeysOf(MeshUse use) {
  return KeysWithoutFaces(fmt::format("depth={}, transform=FILE|none", NameList<SplatDepth>()),
                          use);
}

MeshPlacement TakePlacement(SpecKeys& keys) {
  MeshPlacement placement;
  if (keys.Has("matrix")) {
    const std::vector<double> numbers = keys.TakeNumbers("matrix");
    if (numbers.size() != 12 && numbers.size() != 16) {
      keys.Fail(fmt::format("expected matrix= 12 or 16 numbers, found {}", numbers.size()));
    }
    const auto similarity = PlacementFromMatrix(numbers);
    if (!similarity) {
      keys.Fail(
          "expected matrix=R11/R12/R13/T1/R21/.../T3[/0/0/0/1], a similarity; its rows are not "
          "orthogonal and of one length, or the last one is not 0/0/0/1");
    }
    if (keys.Has("scale") || keys.Has("axes") || keys.Has("shift")) {
      keys.Fail("matrix stands for scale, axes and shift");
    }
    return *similarity;
  }
  placement.scale = keys.TakeNumber("scale", 0).value_or(placement.scale);
  if (!(placement.scale > 0) || !std::isfinite(placement.scale)) {
    keys.Fail(fmt::format("expected a positive scale, found {}", placement.scale));
  }
  if (const auto name = keys.Take("axes")) {
    const auto axes = AxesFromName(*name);
    if (!axes) {
      keys.Fail(
          fmt::format("expected axes=A/B/C: what the world's x, y, z are in the mesh (x/-z/y), "
                      "found \"{}\"",
                      *name));
    }
    placement.axes = *axes;
  }
  if (keys.Has("shift")) {
    const std::vector<double> shift = keys.TakeNumbers("shift");
    if (shift.size() != 3 || !std::all_of(shift.begin(), shift.end(),
                                          [](double value) { return std::isfinite(value); })) {
      keys.Fail(fmt::format("expected shift=X/Y/Z, found {}", fmt::join(shift, "/")));
    }
    placement.shift = {shift[0], shift[1], shift[2]};
  }
  return placement;
}

void RefuseKeysOfLifting(const SpecKeys& keys, std::string_view known) {
  for (const std::string key :
       {"near", "far", "max_incidence_deg", "max_depth_jump", "jump_radius_px", "back_faces"}) {
    if (!keys.Has(key)) continue;
    keys.Fail(fmt::format(
        "the key {} says which points are lifted, but here all there is is rendered; there is {}",
        key, known));
  }
}

// Splits a specification that begins with the prefix and has a path.
SpecKeys OpenKeys(const std::string& spec, std::string_view prefix, std::string_view form,
                  MeshUse use, std::string_view known) {
  if (!spec.starts_with(prefix)) throw OptionError("geometry", spec, form);
  SpecKeys keys(spec, std::string_view(spec).substr(prefix.size()));
  if (keys.path().empty()) keys.Fail(form);
  if (use == MeshUse::kRender) RefuseKeysOfLifting(keys, known);
  return keys;
}

// Reads the keys that all of them have.
void TakeSurfaceKeys(SpecKeys& keys, MeshSpec& spec) {
  spec.files = keys.path();
  spec.placement = TakePlacement(keys);
  spec.build = keys.TakeNamed<BuildQuality>("build");
  keys.TakeLimits(spec.options.limits);
  spec.options.jump_radius_px =
      keys.TakeNumber("jump_radius_px", 0).value_or(spec.options.jump_radius_px);
}

SurfelOptions TakeSurfelOptions(SpecKeys& keys) {
  SurfelOptions options;
  if (const auto radius = keys.Take("radius"); radius && *radius != "auto") {
    options.radius = ParseDouble(*radius);
    if (!options.radius || !std::isfinite(*options.radius) || !(*options.radius > 0)) {
      keys.Fail("expected radius=auto or a positive number of scene units");
    }
  }
  constexpr double kFewest = 8;
  constexpr double kMost = 1000;
  const double neighbors = keys.TakeNumber("neighbors", 0).value_or(options.neighbors);
  if (!(neighbors >= kFewest && neighbors <= kMost) || neighbors != std::floor(neighbors)) {
    keys.Fail(fmt::format("expected neighbors={} to {}, a whole number", kFewest, kMost));
  }
  options.neighbors = static_cast<int>(neighbors);
  return options;
}

// Commas separate keys, so that slashes are those of the origin here.
TileOptions TakeTileOptions(SpecKeys& keys) {
  TileOptions options;
  options.max_error = keys.TakeNumber("error", 0).value_or(options.max_error);
  auto crs = keys.Take("crs");
  if (!crs) return options;
  const size_t origin = crs->find('@');
  if (origin != std::string::npos) {
    std::replace(crs->begin() + static_cast<std::ptrdiff_t>(origin), crs->end(), '/', ',');
  }
  try {
    options.world = WorldFrame::Parse(*crs);
  } catch (const InputError& error) {
    keys.Fail(error.what());
  }
  return options;
}

// Nerfstudio exports in a frame of its own; the way from the data set's is in this file:
// point_in_model = scale * (transform * point_in_world).
constexpr const char* kNerfstudioTransforms = "dataparser_transforms.json";

// Returns the inverse of what the file holds. Throws InputError naming the file and field.
MeshPlacement ReadNerfstudioPlacement(const std::filesystem::path& path) {
  const JsonDocument document(ReadFile(path), path);
  const JsonPlace root = document.Root();
  const JsonPlace transform = root.Member("transform");
  transform.ExpectArraySize(3);
  std::vector<double> numbers;
  for (size_t row = 0; row < 3; ++row) {
    const JsonPlace values = transform.At(row);
    values.ExpectArraySize(4);
    for (size_t column = 0; column < 4; ++column) numbers.push_back(values.At(column).Number());
  }
  const auto moved = PlacementFromMatrix(numbers);
  if (!moved) transform.Fail("expected a rotation and a translation");
  const JsonPlace scale = root.Member("scale");
  if (!(scale.Number() > 0)) scale.Fail("expected a positive number");
  return Inverse(MeshPlacement{.scale = scale.Number()} * *moved);
}

// Throws InputError where a key is for a kind of which there is no file.
void RequireKind(std::span<const std::filesystem::path> files, MeshKind kind, std::string_view key,
                 std::string_view kind_name) {
  const auto is_one = [kind](const auto& file) { return MeshKindOf(file) == kind; };
  if (std::ranges::any_of(files, is_one)) return;
  throw InputError(files.front(), key,
                   fmt::format("is a key of {}, which this file is not", kind_name));
}

MeshReadOptions ReadOptionsOf(const MeshSpec& spec, int threads) {
  return {.threads = threads, .tiles = spec.tiles, .level_of_detail = spec.level_of_detail};
}

}  // namespace

bool IsMeshSpec(std::string_view spec) {
  return spec.starts_with(kPrefix) || spec.starts_with(kHeightFieldPrefix);
}

MeshSpec ParseMeshSpec(const std::string& spec, MeshUse use) {
  MeshSpec mesh;
  mesh.is_height_field = spec.starts_with(kHeightFieldPrefix);
  const std::string known =
      mesh.is_height_field
          ? "ortho=FILE, " + KeysOf(use)
          : KeysOf(use) + "; of city models lod; of 3D Tiles error=METERS, crs=EPSG:N[@X/Y/Z]";
  SpecKeys keys =
      OpenKeys(spec, mesh.is_height_field ? kHeightFieldPrefix : kPrefix, FormOf(use), use, known);
  TakeSurfaceKeys(keys, mesh);
  if (mesh.is_height_field) {
    mesh.orthophotos = keys.Take("ortho");
  } else {
    mesh.level_of_detail = keys.TakeNumber("lod", 0);
    mesh.tiles = TakeTileOptions(keys);
  }
  const auto back_faces = keys.TakeNamed<BackFaces>("back_faces");
  mesh.options.limits.back_faces = back_faces.value_or(mesh.options.limits.back_faces);
  keys.ExpectAllTaken(known);
  return mesh;
}

bool MayNameSystem(const std::string& spec) {
  if (spec.starts_with(kHeightFieldPrefix)) return true;
  if (!spec.starts_with(kPrefix)) return false;
  const SpecKeys keys(spec, std::string_view(spec).substr(kPrefix.size()));
  const auto is_city_model = [](const std::filesystem::path& file) {
    return MeshKindOf(file) == MeshKind::kCityModel;
  };
  return keys.Has("crs") || std::ranges::any_of(ListMeshFiles(keys.path()), is_city_model);
}

std::vector<std::string> InWorld(std::vector<std::string> specs,
                                 const std::optional<WorldFrame>& world) {
  if (!world) return specs;
  for (std::string& spec : specs) {
    if (!spec.starts_with(kPrefix)) continue;
    SpecKeys keys(spec, std::string_view(spec).substr(kPrefix.size()));
    if (keys.Has("crs") || std::ranges::none_of(ListMeshFiles(keys.path()), IsEarthCentered)) {
      continue;
    }
    std::string crs = world->text;
    const size_t origin = std::min(crs.find('@'), crs.size());
    if (crs.find(',') < origin) {
      keys.Fail("expected crs=EPSG:N[@X/Y/Z], as the world's system is not given by such a name");
    }
    std::replace(crs.begin() + static_cast<std::ptrdiff_t>(origin), crs.end(), ',', '/');
    spec += ",crs=" + crs;
  }
  return specs;
}

std::vector<std::filesystem::path> FilesOf(const MeshSpec& spec) {
  if (spec.is_height_field) return {spec.files};
  std::vector<std::filesystem::path> files = ListMeshFiles(spec.files);
  const TileOptions& tiles = spec.tiles;
  if (spec.level_of_detail) RequireKind(files, MeshKind::kCityModel, "lod", "city models");
  if (tiles.world) RequireKind(files, MeshKind::kTileset, "crs", "3D Tiles");
  if (tiles.max_error > 0) RequireKind(files, MeshKind::kTileset, "error", "3D Tiles");
  return files;
}

TriangleMesh OpenMesh(const MeshSpec& spec, const std::filesystem::path& file, int threads) {
  return Placed(spec.is_height_field ? ReadHeightField(file.string(), spec.orthophotos)
                                     : ReadMesh(file, ReadOptionsOf(spec, threads)),
                spec.placement);
}

TriangleMesh OpenMesh(const MeshSpec& spec, int threads) {
  const std::vector<std::filesystem::path> files = FilesOf(spec);
  if (files.size() == 1) return OpenMesh(spec, files.front(), threads);
  return Placed(ReadMeshes(files, ReadOptionsOf(spec, threads)), spec.placement);
}

CloudSpec ParseCloudSpec(const std::string& spec, MeshUse use) {
  constexpr std::string_view kForm = "expected cloud:PATH[,key=value...]";
  SpecKeys keys = OpenKeys(spec, kCloudPrefix, kForm, use, CloudKeysOf(use));
  CloudSpec cloud;
  TakeSurfaceKeys(keys, cloud);
  cloud.surfels = TakeSurfelOptions(keys);
  keys.ExpectAllTaken(CloudKeysOf(use));
  return cloud;
}

SplatSpec ParseSplatSpec(const std::string& spec, MeshUse use) {
  constexpr std::string_view kForm = "expected splat:FILE[,key=value...]";
  SpecKeys keys = OpenKeys(spec, kSplatPrefix, kForm, use, SplatKeysOf(use));
  SplatSpec splats;
  TakeSurfaceKeys(keys, splats);
  splats.depth = keys.TakeNamed<SplatDepth>("depth").value_or(splats.depth);
  splats.transform = keys.Take("transform").value_or("");
  keys.ExpectAllTaken(SplatKeysOf(use));
  return splats;
}

SurfaceKind SurfaceKindOf(std::string_view spec) {
  if (spec.starts_with(kCloudPrefix)) return SurfaceKind::kCloud;
  return spec.starts_with(kSplatPrefix) ? SurfaceKind::kSplats : SurfaceKind::kMesh;
}

std::shared_ptr<const RayCaster> OpenCloud(const CloudSpec& spec, int threads,
                                           const RayCasterOptions& options) {
  SurfelOptions surfels = spec.surfels;
  surfels.threads = threads;
  PointCloud cloud = Placed(ReadPointClouds(ListCloudFiles(spec.files)), spec.placement);
  return std::make_shared<const RayCaster>(
      std::make_shared<const Surfels>(MakeSurfels(std::move(cloud), surfels)), options);
}

OpenedSplats OpenSplats(const SplatSpec& spec, const RayCasterOptions& options) {
  OpenedSplats opened;
  const std::filesystem::path file = spec.files;
  if (spec.transform.empty()) {
    const std::filesystem::path beside = file.parent_path() / kNerfstudioTransforms;
    if (IsFile(beside)) opened.transform = beside;
  } else if (spec.transform != "none") {
    opened.transform = spec.transform;
  }
  MeshPlacement placement = spec.placement;
  if (opened.transform) placement = placement * ReadNerfstudioPlacement(*opened.transform);
  auto splats = std::make_shared<const Splats>(Placed(ReadSplats(file), placement));
  opened.caster = std::make_shared<const RayCaster>(std::move(splats), spec.depth, options);
  return opened;
}

}  // namespace raylift
