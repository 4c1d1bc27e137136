// Reads surface models: heights on a grid, from a GeoTIFF file or several that lie on one grid.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include "pictures/codecs.h"
#include "surfaces/input_files.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Eigen::Affine2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using std::filesystem::path;

// These are keys and codes of the GeoTIFF standard.
constexpr uint16_t kModelType = 1024, kGeographic = 2, kGeocentric = 3;
constexpr uint16_t kRasterType = 1025, kPixelIsPoint = 2;
constexpr uint16_t kProjectedSystem = 3072, kUserDefined = 32767;
constexpr uint16_t kProjectedUnit = 3076, kVerticalUnit = 4099, kMeters = 9001;
constexpr uint16_t kVerticalSystem = 4096;

std::optional<uint16_t> KeyOf(const GeoTiffTags& tags, uint16_t key) {
  constexpr size_t kEntry = 4;  // key, where its value is (0: here), count, value; a header as long
  for (size_t i = kEntry; i + kEntry <= tags.keys.size(); i += kEntry) {
    if (tags.keys[i] == key && tags.keys[i + 1] == 0) return tags.keys[i + 3];
  }
  return std::nullopt;
}

Affine2d Affine(double xx, double xy, double yx, double yy, const Vector2d& origin) {
  Affine2d affine = Affine2d::Identity();
  affine.linear() << xx, xy, yx, yy;
  affine.translation() = origin;
  return affine;
}

// Returns what a world file beside the picture (.tfw) says, of pixel centers; nullopt where there
// is none.
std::optional<Affine2d> ReadWorldFile(const path& file) {
  path beside = file;
  if (!Exists(beside.replace_extension(".tfw"))) return std::nullopt;
  std::vector<double> numbers;
  std::string text = ReadFile(beside);
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  for (const std::string_view word : SplitTokens(text)) {
    const auto number = ParseDouble(word);
    if (!number || !std::isfinite(*number)) {
      throw InputError(beside, fmt::format("expected six numbers, found \"{}\"", word));
    }
    numbers.push_back(*number);
  }
  if (numbers.size() != 6) {
    throw InputError(beside, fmt::format("expected six numbers, found {}", numbers.size()));
  }
  return Affine(numbers[0], numbers[2], numbers[1], numbers[3], {numbers[4], numbers[5]});
}

// Returns the way from the picture's pixels (the first one's center at (0.5, 0.5)) to the plane of
// the coordinate system.
Affine2d WorldFromImage(const path& file, const GeoTiffTags& tags) {
  bool of_centers = KeyOf(tags, kRasterType) == kPixelIsPoint;
  Affine2d place;
  if (tags.transformation.size() == 16) {
    const std::vector<double>& m = tags.transformation;
    place = Affine(m[0], m[1], m[4], m[5], {m[3], m[7]});
  } else if (tags.pixel_scale.size() >= 2 && tags.tie_points.size() >= 6) {
    const std::vector<double>& tie = tags.tie_points;
    place = Affine(tags.pixel_scale[0], 0, 0, -tags.pixel_scale[1], Vector2d::Zero());
    place.translation() = Vector2d(tie[3], tie[4]) - place.linear() * Vector2d(tie[0], tie[1]);
  } else if (const auto by_world_file = ReadWorldFile(file)) {
    place = *by_world_file;
    of_centers = true;
  } else {
    throw InputError(file,
                     "does not say where its pixels lie: expected a GeoTIFF or a world file (.tfw) "
                     "beside it");
  }
  if (!place.matrix().allFinite() || !(std::abs(place.linear().determinant()) > 0)) {
    throw InputError(file, "its pixels have no area where they lie");
  }
  if (of_centers) place.translation() -= place.linear() * Vector2d(0.5, 0.5);
  return place;
}

// Throws where a system is in degrees or feet: only lengths make a surface, and heights are meters.
void RequireMeters(const path& file, const GeoTiffTags& tags) {
  const auto fail = [&file](std::string_view found) {
    throw InputError(file,
                     fmt::format("its coordinates are {}: expected a projected system in meters; "
                                 "`gdalwarp -t_srs EPSG:CODE {} projected.tif` makes it one",
                                 found, file.filename().string()));
  };
  const auto model = KeyOf(tags, kModelType);
  if (model == kGeographic) fail("degrees");
  if (model == kGeocentric) fail("geocentric");
  for (const uint16_t key : {kProjectedUnit, kVerticalUnit}) {
    const uint16_t unit = KeyOf(tags, key).value_or(kMeters);
    if (unit != kMeters && unit != kUserDefined) fail(fmt::format("of unit EPSG:{}", unit));
  }
}

struct OpenedTiff {
  path file;
  TiffHeader header;
  Affine2d world_from_image;
  // Its first pixel is at this column and row of the mosaic.
  size_t column = 0, row = 0;
};

OpenedTiff OpenTiff(const path& file) {
  OpenedTiff tiff{.file = file, .header = {}, .world_from_image = {}};
  try {
    tiff.header = ReadTiffHeader(MappedFile(file).contents());
  } catch (const std::runtime_error& error) {
    throw InputError(file, error.what());
  }
  RequireMeters(file, tiff.header.place);
  tiff.world_from_image = WorldFromImage(file, tiff.header.place);
  return tiff;
}

void RequireSameSystem(const OpenedTiff& a, const OpenedTiff& b) {
  const auto of_a = KeyOf(a.header.place, kProjectedSystem);
  const auto of_b = KeyOf(b.header.place, kProjectedSystem);
  if (!of_a || !of_b || of_a == kUserDefined || of_b == kUserDefined || *of_a == *of_b) return;
  throw InputError(
      b.file, fmt::format("is in EPSG:{}, but {} is in EPSG:{}", *of_b, a.file.string(), *of_a));
}

// Returns the system that the file names, with that of its heights where it names one that PROJ
// knows; empty where it names none, or one that is not meant for where it lies.
std::string SystemOf(const OpenedTiff& tiff, const Vector3d& vertex,
                     std::vector<std::string>& warnings) {
  const auto code_of = [&tiff](uint16_t key) {
    const auto code = KeyOf(tiff.header.place, key);
    return code == kUserDefined ? std::nullopt : code;
  };
  const auto map = code_of(kProjectedSystem), heights = code_of(kVerticalSystem);
  if (!map) return {};
  try {
    const Crs of_map(fmt::format("EPSG:{}", *map));
    of_map.Check(vertex);
    try {
      return heights ? Crs(fmt::format("{}+{}", of_map.definition(), *heights)).definition()
                     : of_map.definition();
    } catch (const InputError&) {
      return of_map.definition();
    }
  } catch (const InputError& error) {
    warnings.push_back(fmt::format("{}: {}", tiff.file.string(), error.what()));
    return {};
  }
}

// Files whose pixels lie on one grid.
struct Mosaic {
  std::vector<OpenedTiff> parts;  // in the order of their names
  size_t width = 0, height = 0;
  Affine2d world_from_image;

  // Returns whether a place in its pixels lies in one of the parts.
  bool Covers(const Eigen::Array2d& pixel) const {
    return std::any_of(parts.begin(), parts.end(), [&](const OpenedTiff& part) {
      const Eigen::Array2d in_part =
          pixel - Eigen::Array2d(static_cast<double>(part.column), static_cast<double>(part.row));
      const Eigen::Array2d size(part.header.size.width_px, part.header.size.height_px);
      return (in_part >= 0).all() && (in_part <= size).all();
    });
  }

  // Copies what the parts have to where it lies in the mosaic, `numbers` of them for each pixel.
  // Where several parts have a pixel, the first one for which `is_there` holds is taken.
  template <typename T, typename Read, typename IsThere>
  std::vector<T> Put(size_t numbers, const T& missing, const Read& read,
                     const IsThere& is_there) const {
    if (parts.size() == 1) return read(parts.front());
    std::vector<T> whole(numbers * width * height, missing);
    for (auto part = parts.rbegin(); part != parts.rend(); ++part) {
      const std::vector<T> pixels = read(*part);
      const auto columns = static_cast<size_t>(part->header.size.width_px);
      for (size_t i = 0; i < pixels.size(); i += numbers) {
        if (!is_there(pixels[i])) continue;
        const size_t pixel = i / numbers;
        const size_t to = (part->row + pixel / columns) * width + part->column + pixel % columns;
        std::copy_n(&pixels[i], numbers, &whole[numbers * to]);
      }
    }
    return whole;
  }
};

// Opens the files of a mosaic; `most` is the limit of its pixels.
Mosaic OpenMosaic(const std::string& names, std::string_view kind, uint64_t most) {
  constexpr double kMostOffGrid = 0.01;  // of a pixel
  constexpr double kMostEmpty = 16;      // times the pixels that there are
  constexpr auto kTiff = std::to_array<std::string_view>({".tif", ".tiff"});
  Mosaic mosaic;
  for (const path& file : ListFiles(names, kTiff, kind)) mosaic.parts.push_back(OpenTiff(file));
  const OpenedTiff& first = mosaic.parts.front();
  const OpenedTiff* with_system = &first;
  double num_pixels = 0;
  Eigen::AlignedBox2d box;
  std::vector<Vector2d> corners;
  for (const OpenedTiff& part : mosaic.parts) {
    RequireSameSystem(*with_system, part);
    if (!KeyOf(with_system->header.place, kProjectedSystem)) with_system = &part;
    const Affine2d in_first = first.world_from_image.inverse() * part.world_from_image;
    const Vector2d size(part.header.size.width_px, part.header.size.height_px);
    const Vector2d corner = in_first.translation().array().round();
    // Its far corner lies on the grid only if its pixels are as large, too.
    if (!((in_first * size - corner - size).norm() < kMostOffGrid) ||
        !((in_first.translation() - corner).norm() < kMostOffGrid)) {
      throw InputError(part.file, fmt::format("its pixels do not lie on the grid of those of {}; "
                                              "`gdalwarp` with one -tr and -tap for all makes them",
                                              first.file.string()));
    }
    corners.push_back(corner);
    num_pixels += size.prod();
    box.extend(corner).extend(corner + size);
  }
  if (!(box.sizes().prod() <= static_cast<double>(most))) {
    throw InputError(first.file, fmt::format("expected at most {} pixels of all together, found "
                                             "{:.0f} x {:.0f}; `gdal_translate -srcwin` cuts out a "
                                             "part",
                                             most, box.sizes().x(), box.sizes().y()));
  }
  if (box.sizes().prod() > kMostEmpty * num_pixels) {
    throw InputError(first.file,
                     fmt::format("the files lie too far apart: together they span {:.0f} x {:.0f} "
                                 "pixels and have {:.0f}",
                                 box.sizes().x(), box.sizes().y(), num_pixels));
  }
  for (size_t i = 0; i < corners.size(); ++i) {
    mosaic.parts[i].column = static_cast<size_t>(corners[i].x() - box.min().x());
    mosaic.parts[i].row = static_cast<size_t>(corners[i].y() - box.min().y());
  }
  mosaic.width = static_cast<size_t>(box.sizes().x());
  mosaic.height = static_cast<size_t>(box.sizes().y());
  mosaic.world_from_image = first.world_from_image * Eigen::Translation2d(box.min());
  return mosaic;
}

// Returns heights, NaN where there are none.
std::vector<float> ReadHeights(const OpenedTiff& tiff, std::vector<std::string>& warnings) {
  const path& file = tiff.file;
  const auto [width, height] = tiff.header.size;
  if (!tiff.header.sample) {
    throw InputError(file,
                     "expected heights: one channel of 8 or 16 bits, of 32 bits signed or of 32 or "
                     "64 bits float");
  }
  const uint64_t count = static_cast<uint64_t>(width) * static_cast<uint64_t>(height);
  const MappedFile mapped(file);
  if (count > kMaxDeflateRatio * mapped.contents().size()) {
    throw InputError(file, fmt::format("the file is too short for {} x {} heights", width, height));
  }
  std::vector<float> heights;
  try {
    heights = DecodeTiffPlane(mapped.contents(), tiff.header.size, *tiff.header.sample);
  } catch (const std::runtime_error& error) {
    throw InputError(file, error.what());
  }
  std::optional<float> none;
  if (const std::string& text = tiff.header.place.no_data; !text.empty()) {
    const auto number = ParseDouble(Trim(text));
    if (!number) {
      throw InputError(
          file, fmt::format("GDAL_NODATA: expected a number, found \"{}\"", Printable(text)));
    }
    none = static_cast<float>(*number);
  } else {
    // Without GDAL_NODATA a usual value stands for missing heights if it is the lowest.
    float lowest = std::numeric_limits<float>::infinity();
    for (const float value : heights) lowest = std::min(lowest, value);  // of NaN the first
    constexpr std::array<float, 3> kUsual = {-9999, -32768, std::numeric_limits<float>::lowest()};
    if (std::find(kUsual.begin(), kUsual.end(), lowest) != kUsual.end()) {
      none = lowest;
      warnings.push_back(
          fmt::format("{}: heights of {:g} are taken for none, which the file does not say",
                      file.string(), lowest));
    }
  }
  for (float& value : heights) {
    if (none && value == *none) value = std::numeric_limits<float>::quiet_NaN();
  }
  return heights;
}

// Triangulates neighboring heights; the diagonal is the one with the smaller step in height.
class GridMesh {
 public:
  GridMesh(const std::vector<float>& heights, size_t width, const Affine2d& world_from_image,
           RawMesh& mesh)
      : heights_(heights),
        width_(width),
        is_mirrored_(world_from_image.linear().determinant() > 0),
        mesh_(mesh),
        vertices_(heights.size(), RawMesh::kNone) {
    for (size_t i = 0; i < heights.size(); ++i) {
      if (!std::isfinite(heights[i])) continue;
      const size_t row = i / width_;
      const Vector2d pixel(static_cast<double>(i % width_) + 0.5, static_cast<double>(row) + 0.5);
      const Vector2d at = world_from_image * pixel;
      vertices_[i] = static_cast<uint32_t>(mesh.positions.size());
      mesh.positions.emplace_back(at.x(), at.y(), static_cast<double>(heights[i]));
    }
  }

  void AddTriangles() {
    for (size_t i = 0; i + width_ < heights_.size(); ++i) {
      if (i % width_ + 1 == width_) continue;
      const size_t right = i + 1, below = i + width_, across = below + 1;
      const auto is_missing = [this](size_t k) { return vertices_[k] == RawMesh::kNone; };
      const float down = std::abs(heights_[i] - heights_[across]);
      const float up = std::abs(heights_[right] - heights_[below]);
      const bool splits_down = !is_missing(i) && !is_missing(across) &&
                               (is_missing(right) || is_missing(below) || down <= up);
      if (splits_down) {
        Add(i, below, across);
        Add(i, across, right);
      } else {
        Add(i, below, right);
        Add(right, below, across);
      }
    }
  }

 private:
  // Adds a triangle of these heights, counterclockwise as seen from above, unless one of them is
  // missing.
  void Add(size_t a, size_t b, size_t c) {
    const std::array<uint32_t, 3> triangle = {vertices_[a], vertices_[b], vertices_[c]};
    if (std::find(triangle.begin(), triangle.end(), RawMesh::kNone) != triangle.end()) return;
    mesh_.triangles.push_back(triangle);
    if (is_mirrored_) std::swap(mesh_.triangles.back()[1], mesh_.triangles.back()[2]);
  }

  const std::vector<float>& heights_;
  const size_t width_;
  const bool is_mirrored_;
  RawMesh& mesh_;
  std::vector<uint32_t> vertices_;  // of each height; kNone where there is none
};

std::vector<uint8_t> ReadColors(const OpenedTiff& tiff) {
  try {
    return DecodePicture(MappedFile(tiff.file).contents(), ImageChannels::kRgb).data;
  } catch (const InputError& error) {
    throw InputError(tiff.file, error.what());
  }
}

// Colors what the orthophoto shows by it.
void AddOrthophoto(const Mosaic& ortho, RawMesh& mesh) {
  mesh.textures.push_back({static_cast<int>(ortho.width), static_cast<int>(ortho.height), 3,
                           ortho.Put<uint8_t>(3, 0, &ReadColors, [](uint8_t) { return true; })});
  mesh.materials.push_back({.texture = 0, .color_rgb = std::nullopt});
  const Affine2d image_from_world = ortho.world_from_image.inverse();
  const Eigen::Array2d size(static_cast<double>(ortho.width), static_cast<double>(ortho.height));
  std::vector<bool> is_covered;
  for (const Vector3d& position : mesh.positions) {
    const Eigen::Array2d pixel = image_from_world * position.head<2>();
    const Eigen::Array2d uv = pixel / size;
    mesh.uvs.emplace_back(Vector2d(uv.x(), 1 - uv.y()).cast<float>());
    is_covered.push_back(ortho.Covers(pixel));
  }
  size_t shown = 0;
  for (const auto& triangle : mesh.triangles) {
    const bool is_shown = std::all_of(triangle.begin(), triangle.end(),
                                      [&](uint32_t vertex) { return is_covered[vertex]; });
    shown += is_shown ? 1 : 0;
    mesh.triangle_materials.push_back(is_shown ? 0 : RawMesh::kNone);
  }
  if (shown == 0) {
    throw InputError(ortho.parts.front().file,
                     "shows nothing of the surface model: it lies elsewhere");
  }
}

}  // namespace

TriangleMesh ReadHeightField(const std::string& files,
                             const std::optional<std::string>& orthophotos) {
  const Mosaic model = OpenMosaic(files, "GeoTIFF", kMaxHeights);
  const path& file = model.parts.front().file;
  RawMesh mesh;
  const std::vector<float> heights = model.Put<float>(
      1, std::numeric_limits<float>::quiet_NaN(),
      [&](const OpenedTiff& part) { return ReadHeights(part, mesh.warnings); },
      [](float height) { return std::isfinite(height); });
  GridMesh(heights, model.width, model.world_from_image, mesh).AddTriangles();
  if (mesh.triangles.empty()) throw InputError(file, "has no neighboring heights");
  if (orthophotos) {
    const Mosaic ortho = OpenMosaic(*orthophotos, "GeoTIFF", kMaxOrthophotoPixels);
    RequireSameSystem(model.parts.front(), ortho.parts.front());
    AddOrthophoto(ortho, mesh);
  }
  mesh.crs = SystemOf(model.parts.front(), mesh.positions.front(), mesh.warnings);
  return FinishMesh(file, std::move(mesh));
}

}  // namespace raylift
