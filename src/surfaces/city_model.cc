#include "surfaces/city_model.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <utility>

#include "surfaces/input_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/geometry/geodesy.h"

namespace raylift {
namespace {

// Returns the number that `text` begins with, up to 99999999.
std::optional<int> LeadingCode(std::string_view text) {
  size_t digits = 0;
  while (digits < text.size() && digits < 8 &&
         std::isdigit(static_cast<unsigned char>(text[digits]))) {
    ++digits;
  }
  const auto code = ParseInt(text.substr(0, digits));
  return code ? std::optional(static_cast<int>(*code)) : std::nullopt;
}

// Returns the EPSG code of the horizontal or compound system that stands first: of "EPSG:25832",
// "urn:ogc:def:crs:EPSG::25832", "urn:ogc:def:crs,crs:EPSG:6.12:25832,crs:EPSG:6.12:5783",
// "https://www.opengis.net/def/crs/EPSG/0/7415", ".../def/crs-compound?1=.../EPSG/0/25832&2=...",
// "urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH".
std::optional<int> EpsgCode(std::string_view system) {
  constexpr std::string_view kAuthority = "EPSG", kUtm = "ETRS89_UTM";
  size_t at = system.find(kAuthority);
  if (at == std::string_view::npos) at = system.find("epsg");
  if (at != std::string_view::npos) {
    std::string_view rest = system.substr(at + kAuthority.size());
    rest = rest.substr(0, rest.find_first_of(",&"));
    const size_t last = rest.find_last_of(":/#");
    return last == std::string_view::npos ? std::nullopt : LeadingCode(rest.substr(last + 1));
  }
  if (at = system.find(kUtm); at != std::string_view::npos) {
    const auto zone = LeadingCode(system.substr(at + kUtm.size()));
    constexpr int kEtrs89Utm = 25800;
    if (zone && *zone >= 28 && *zone <= 38) return kEtrs89Utm + *zone;
  }
  return std::nullopt;
}

std::optional<Crs> CrsOf(const std::string& system) {
  const auto code = EpsgCode(system);
  if (!code) return std::nullopt;
  try {
    return Crs(fmt::format("EPSG:{}", *code));
  } catch (const InputError&) {
    return std::nullopt;
  }
}

// Returns whether `system` means the axes as EPSG orders them: a URN or URL of the OGC does.
bool NamesOrderOfAuthority(std::string_view system) {
  return system.find("ogc:def:crs") != std::string_view::npos ||
         system.find("/def/crs") != std::string_view::npos;
}

bool Fits(const Crs& crs, const Eigen::Vector3d& point) {
  try {
    crs.Check(point);
    return true;
  } catch (const InputError&) {
    return false;
  }
}

}  // namespace

std::optional<size_t> ChooseLevel(std::span<const double> levels, std::optional<double> wanted) {
  constexpr double kFinest = 3;
  const double whole = std::floor(wanted.value_or(kFinest));
  // "2" is all levels that begin so.
  const double most = wanted && *wanted > whole ? *wanted : whole + 0.95;
  std::optional<size_t> chosen;
  for (size_t i = 0; i < levels.size(); ++i) {
    const bool fits = levels[i] <= most, chosen_fits = chosen && levels[*chosen] <= most;
    const bool is_better =
        !chosen || (fits && !chosen_fits) ||
        (fits ? levels[i] > levels[*chosen] : !chosen_fits && levels[i] < levels[*chosen]);
    if (is_better) chosen = i;
  }
  return chosen;
}

CityMesh::CityMesh(const std::filesystem::path& path, size_t file_bytes) : path_(path) {
  constexpr size_t kReadsPerByte = 100;  // of trees that are one and the same
  left_to_read_ = kReadsPerByte * file_bytes;
}

void CityMesh::CountRead(const Locator& locate, size_t count) {
  if (count > left_to_read_) {
    throw InputError(path_, locate(), "the file refers to its surfaces too often");
  }
  left_to_read_ -= count;
}

void CityMesh::AddPolygon(const Locator& locate, std::vector<std::vector<Eigen::Vector3d>> rings,
                          std::string_view kind) {
  std::vector<uint32_t> corners, hole_begins;
  for (size_t i = 0; i < rings.size(); ++i) {
    auto& ring = rings[i];
    // CityGML repeats the first point as the last.
    if (ring.size() > 1 && ring.front() == ring.back()) ring.pop_back();
    if (ring.size() < 3) {
      throw InputError(
          path_, locate(),
          fmt::format("expected a ring of three points or more, found {}", ring.size()));
    }
    if (i > 0) hole_begins.push_back(static_cast<uint32_t>(corners.size()));
    for (const Eigen::Vector3d& p : ring) {
      corners.push_back(static_cast<uint32_t>(mesh_.positions.size()));
      mesh_.positions.push_back(p);
    }
  }
  if (rings.empty()) throw InputError(path_, locate(), "expected a ring of points, found none");
  CountRead(locate, corners.size());
  if (mesh_.positions.size() >= UINT32_MAX) throw InputError(path_, "has more than 2^32 corners");
  if (corners.size() > kMaxPolygonCorners) ++too_large_;
  const size_t added = AddFace(num_polygons_++, corners, {}, mesh_, hole_begins);
  mesh_.triangle_materials.insert(
      mesh_.triangle_materials.end(), added,
      kind.empty() ? RawMesh::kNone : MaterialOf(kind, material_of_kind_, mesh_));
  mesh_.triangle_parts.insert(mesh_.triangle_parts.end(), added,
                              static_cast<uint32_t>(mesh_.parts.size()) - 1);
}

void CityMesh::Warn(const std::string& message) {
  mesh_.warnings.push_back(fmt::format("{}: {}", path_.string(), message));
}

void CityMesh::CheckPlace(const std::string& field, const std::string& system) {
  const auto crs = CrsOf(system);
  if (!crs) {
    Warn(fmt::format("{}: \"{}\" is no known system; its coordinates are taken for meters", field,
                     Shown(system)));
    return;
  }
  if (crs->kind() == CrsKind::kGeographic) {
    throw InputError(
        path_, field,
        fmt::format("coordinates in degrees ({}): expected a projected system", crs->definition()));
  }
  if (mesh_.positions.empty() || !IsUsablePosition(mesh_.positions.front())) return;
  const Eigen::Vector3d& p = mesh_.positions.front();
  try {
    crs->Check(p);
    mesh_.crs = crs->definition();
    if (!NamesOrderOfAuthority(system) || !NorthingsComeFirst(*crs)) return;
    if (!Fits(*crs, {p.y(), p.x(), p.z()})) return;
    Warn(fmt::format(
        "{}: {} orders northing before easting, which most files do not: easting {:.9g}, northing "
        "{:.9g} is taken, but the other order is possible here, too; a place known from a map "
        "tells which it is",
        field, crs->definition(), p.x(), p.y()));
  } catch (const InputError& error) {
    Warn(fmt::format("{}: {}", field, error.what()));
  }
}

RawMesh CityMesh::Finish() && {
  if (num_polygons_ == 0) throw InputError(path_, "has no surfaces of its objects");
  if (too_large_ > 0) {
    Warn(fmt::format("{} polygons of more than {} corners are taken for convex ones without holes",
                     too_large_, kMaxPolygonCorners));
  }
  return std::move(mesh_);
}

}  // namespace raylift
