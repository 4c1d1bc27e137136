// Reads splats from PLY files: as they are trained, and compressed.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include "surfaces/input_files.h"
#include "surfaces/ply_file.h"
#include "surfaces/raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/surfaces/splats.h"

namespace raylift {
namespace {

using std::filesystem::path;
using Column = PlyColumns::Column;

// This is the color of a harmonic of degree 0 with the coefficient 1.
const double kHarmonic0 = 0.5 / std::sqrt(std::numbers::pi);

// The third axis of a disc has this share of its smaller one: it is negligible except for rays
// along the disc.
constexpr double kDiscThickness = 1e-6;

// Scales are kept above this, so that their inverses are finite in float.
constexpr double kLeastScale = 1e-20;

// One Gaussian as files have it, decoded.
struct RawSplat {
  Eigen::Vector3d mean;
  Eigen::Vector4d rotation_wxyz;  // of any length
  Eigen::Vector3d scale;
  double opacity;
};

bool IsUsable(const RawSplat& splat) {
  return IsUsablePosition(splat.mean) && splat.rotation_wxyz.allFinite() &&
         splat.rotation_wxyz.squaredNorm() > 0 && splat.scale.allFinite() &&
         std::isfinite(splat.opacity);
}

// Collects those that are there and can be seen.
class SplatCollector {
 public:
  SplatCollector(const path& file, size_t count, int degree, bool has_colors)
      : file_(file), count_(count) {
    splats_.degree = degree;
    splats_.means.reserve(count);
    splats_.rotations.reserve(count);
    splats_.scales.reserve(count);
    splats_.opacities.reserve(count);
    if (has_colors) splats_.harmonics.reserve(count * splats_.NumCoefficients());
  }

  // Adds a Gaussian, and its harmonics where there are colors; one that is not finite is only
  // counted, and one that is too transparent is left out.
  void Add(const RawSplat& splat, std::span<const Eigen::Vector3f> harmonics) {
    const bool is_finite = std::all_of(harmonics.begin(), harmonics.end(),
                                       [](const auto& rgb) { return rgb.allFinite(); });
    if (!is_finite || !IsUsable(splat)) {
      ++not_finite_;
      return;
    }
    if (splat.opacity < kLeastAlpha) return;
    const Eigen::Vector4d q = splat.rotation_wxyz.normalized();
    splats_.means.emplace_back(splat.mean.cast<float>());
    splats_.rotations.emplace_back(Eigen::Quaterniond(q[0], q[1], q[2], q[3]).cast<float>());
    splats_.scales.emplace_back(splat.scale.cwiseMax(kLeastScale).cast<float>());
    splats_.opacities.push_back(static_cast<float>(splat.opacity));
    splats_.harmonics.insert(splats_.harmonics.end(), harmonics.begin(), harmonics.end());
  }

  Splats Finish() && {
    if (not_finite_ > 0) {
      splats_.warnings.push_back(fmt::format("{}: {} of {} Gaussians left out: not finite",
                                             file_.string(), not_finite_, count_));
    }
    if (splats_.means.empty()) {
      throw InputError(
          file_, fmt::format("expected Gaussians, found {}, none of which can be seen", count_));
    }
    return std::move(splats_);
  }

 private:
  path file_;
  size_t count_;
  size_t not_finite_ = 0;
  Splats splats_;
};

template <size_t N>
std::array<Column, N> GetAll(const PlyColumns& columns, const char* prefix) {
  std::array<Column, N> all;
  for (size_t i = 0; i < N; ++i) all[i] = columns.Get(fmt::format("{}{}", prefix, i));
  return all;
}

template <int N>
Eigen::Matrix<double, N, 1> RowAt(const PlyColumns& columns, size_t row,
                                  const std::array<Column, static_cast<size_t>(N)>& of) {
  Eigen::Matrix<double, N, 1> values;
  for (int i = 0; i < N; ++i) values[i] = columns.At(row, of[static_cast<size_t>(i)]);
  return values;
}

// Finds f_rest_0, f_rest_1, ..., and returns how many coefficients each channel has in them.
size_t RestPerChannel(const path& file, const PlyColumns& columns, std::vector<Column>& rest) {
  while (const auto column = columns.Find(fmt::format("f_rest_{}", rest.size()))) {
    rest.push_back(*column);
  }
  for (const size_t per_channel : {0u, 3u, 8u, 15u}) {
    if (rest.size() == 3 * per_channel) return per_channel;
  }
  throw InputError(file, "f_rest_*",
                   fmt::format("expected 0, 9, 24 or 45 of them, found {}", rest.size()));
}

int DegreeOf(size_t rest_per_channel) {
  return static_cast<int>(std::lround(std::sqrt(static_cast<double>(rest_per_channel + 1)))) - 1;
}

// Reads the colors of rows: harmonics, or red, green and blue.
class TrainedColors {
 public:
  TrainedColors(const path& file, const PlyColumns& columns) : columns_(columns) {
    if (columns.Find("f_dc_0")) {
      first_ = GetAll<3>(columns, "f_dc_");
      per_channel_ = RestPerChannel(file, columns, rest_);
    } else if (columns.Find("red") && columns.Find("green") && columns.Find("blue")) {
      first_ = {columns.Get("red"), columns.Get("green"), columns.Get("blue")};
      are_rgb_ = true;
    }
    if (first_) values_.resize(1 + per_channel_);
  }

  bool any() const { return first_.has_value(); }
  int degree() const { return DegreeOf(per_channel_); }

  std::span<const Eigen::Vector3f> At(size_t row) {
    if (!first_) return {};
    const Eigen::Vector3d first = RowAt<3>(columns_, row, *first_);
    values_[0] = are_rgb_ ? HarmonicOf(first) : Eigen::Vector3f(first.cast<float>());
    for (size_t i = 0; i < rest_.size(); ++i) {
      values_[1 + i % per_channel_][static_cast<int>(i / per_channel_)] =
          static_cast<float>(columns_.At(row, rest_[i]));
    }
    return values_;
  }

 private:
  // Reads bytes, or shares where the column holds real numbers.
  Eigen::Vector3f HarmonicOf(const Eigen::Vector3d& rgb) const {
    const PlyType type = (*first_)[0].type;
    const bool is_real = type == PlyType::kFloat || type == PlyType::kDouble;
    const Eigen::Vector3d share = is_real ? rgb : Eigen::Vector3d(rgb / 255);
    return ((share.array() - 0.5) / kHarmonic0).matrix().cast<float>();
  }

  const PlyColumns& columns_;
  std::optional<std::array<Column, 3>> first_;
  std::vector<Column> rest_;
  size_t per_channel_ = 0;
  bool are_rgb_ = false;
  std::vector<Eigen::Vector3f> values_;
};

double Sigmoid(double logit) { return 1 / (1 + std::exp(-logit)); }

Splats ReadTrained(const path& file, const PlyHeader& header, std::string_view contents) {
  const PlyColumns columns(file, header, contents, "vertex");
  const std::array<Column, 3> mean = {columns.Get("x"), columns.Get("y"), columns.Get("z")};
  if (!columns.Find("opacity") || !columns.Find("scale_0")) {
    throw InputError(
        file, "element vertex",
        "expected Gaussians, with the properties opacity, scale_0, ... and rot_0, ...; "
        "found points without them");
  }
  const Column opacity = columns.Get("opacity");
  const std::array<Column, 2> sides = GetAll<2>(columns, "scale_");
  const std::optional<Column> third = columns.Find("scale_2");
  const std::array<Column, 4> rotation = GetAll<4>(columns, "rot_");
  TrainedColors colors(file, columns);
  SplatCollector collector(file, columns.num_rows(), colors.degree(), colors.any());
  for (size_t row = 0; row < columns.num_rows(); ++row) {
    RawSplat splat;
    splat.mean = RowAt<3>(columns, row, mean);
    splat.rotation_wxyz = RowAt<4>(columns, row, rotation);
    const Eigen::Vector2d side = RowAt<2>(columns, row, sides).array().exp();
    const double thickness =
        third ? std::exp(columns.At(row, *third)) : kDiscThickness * side.minCoeff();
    splat.scale = {side.x(), side.y(), thickness};
    splat.opacity = Sigmoid(columns.At(row, opacity));
    collector.Add(splat, colors.At(row));
  }
  return std::move(collector).Finish();
}

// ---- compressed ----

// Returns bits of a packed number as a share of their largest value.
double Share(uint32_t packed, int shift, int bits) {
  const uint32_t most = (1u << bits) - 1;
  return (packed >> shift & most) / static_cast<double>(most);
}

Eigen::Vector3d Unpack111011(uint32_t packed) {
  return {Share(packed, 21, 11), Share(packed, 11, 10), Share(packed, 0, 11)};
}

// Unpacks a rotation. The largest of w, x, y, z, which the first two bits name, is left out.
Eigen::Vector4d UnpackRotation(uint32_t packed) {
  Eigen::Vector4d wxyz;
  const auto largest = static_cast<int>(packed >> 30);
  double squares = 0;
  for (int i = 0, shift = 20; i < 4; ++i) {
    if (i == largest) continue;
    wxyz[i] = (Share(packed, shift, 10) - 0.5) * std::numbers::sqrt2;
    squares += wxyz[i] * wxyz[i];
    shift -= 10;
  }
  wxyz[largest] = std::sqrt(std::max(0.0, 1 - squares));
  return wxyz;
}

// A range that a chunk of Gaussians has in common.
struct ChunkRange {
  std::array<Column, 3> low;
  std::array<Column, 3> high;

  static ChunkRange Of(const PlyColumns& chunks, const std::array<std::string, 3>& names) {
    ChunkRange range;
    for (size_t i = 0; i < 3; ++i) {
      range.low[i] = chunks.Get("min_" + names[i]);
      range.high[i] = chunks.Get("max_" + names[i]);
    }
    return range;
  }

  Eigen::Vector3d At(const PlyColumns& chunks, size_t chunk, const Eigen::Vector3d& share) const {
    const Eigen::Vector3d least = RowAt<3>(chunks, chunk, low);
    return least + share.cwiseProduct(RowAt<3>(chunks, chunk, high) - least);
  }
};

// Reads the harmonics above degree 0 in the element sh: bytes for -4 to 4.
class PackedHarmonics {
 public:
  PackedHarmonics(const path& file, const PlyHeader& header, std::string_view contents,
                  size_t count) {
    const bool is_there = std::any_of(header.elements.begin(), header.elements.end(),
                                      [](const PlyElement& e) { return e.name == "sh"; });
    if (!is_there) return;
    columns_.emplace(file, header, contents, "sh");
    if (columns_->num_rows() != count) {
      throw InputError(file, "element sh",
                       fmt::format("expected {} of them, one for each vertex, found {}", count,
                                   columns_->num_rows()));
    }
    per_channel_ = RestPerChannel(file, *columns_, rest_);
    for (size_t i = 0; i < rest_.size(); ++i) {
      columns_->Get(fmt::format("f_rest_{}", i), PlyType::kUint8);
    }
  }

  size_t per_channel() const { return per_channel_; }

  void SetAt(size_t row, std::span<Eigen::Vector3f> above_0) const {
    for (size_t i = 0; i < rest_.size(); ++i) {
      const double byte = columns_->At(row, rest_[i]);
      above_0[i % per_channel_][static_cast<int>(i / per_channel_)] =
          static_cast<float>(byte * 8 / 255 - 4);
    }
  }

 private:
  std::optional<PlyColumns> columns_;
  std::vector<Column> rest_;
  size_t per_channel_ = 0;
};

Splats ReadCompressed(const path& file, const PlyHeader& header, std::string_view contents) {
  constexpr size_t kGaussiansOfRow = 256;  // Gaussians that share a row of the element chunk
  const PlyColumns chunks(file, header, contents, "chunk");
  const PlyColumns columns(file, header, contents, "vertex");
  if (chunks.num_rows() * kGaussiansOfRow < columns.num_rows()) {
    throw InputError(file, "element chunk",
                     fmt::format("expected one for each {} of {} vertices, found {}",
                                 kGaussiansOfRow, columns.num_rows(), chunks.num_rows()));
  }
  const ChunkRange means = ChunkRange::Of(chunks, {"x", "y", "z"});
  const ChunkRange scales = ChunkRange::Of(chunks, {"scale_x", "scale_y", "scale_z"});
  std::optional<ChunkRange> rgb;  // older files have none
  if (chunks.Find("min_r")) rgb = ChunkRange::Of(chunks, {"r", "g", "b"});
  const PackedHarmonics packed_harmonics(file, header, contents, columns.num_rows());
  std::array<Column, 4> packed;
  for (size_t i = 0; i < packed.size(); ++i) {
    constexpr std::array<const char*, 4> kNames = {"packed_position", "packed_rotation",
                                                   "packed_scale", "packed_color"};
    packed[i] = columns.Get(kNames[i], PlyType::kUint32);
  }
  SplatCollector collector(file, columns.num_rows(), DegreeOf(packed_harmonics.per_channel()),
                           true);
  std::vector<Eigen::Vector3f> harmonics(1 + packed_harmonics.per_channel());
  for (size_t row = 0; row < columns.num_rows(); ++row) {
    const size_t chunk = row / kGaussiansOfRow;
    const auto bits = [&](size_t i) { return static_cast<uint32_t>(columns.At(row, packed[i])); };
    RawSplat splat;
    splat.mean = means.At(chunks, chunk, Unpack111011(bits(0)));
    splat.rotation_wxyz = UnpackRotation(bits(1));
    splat.scale = scales.At(chunks, chunk, Unpack111011(bits(2))).array().exp();
    Eigen::Vector3d color(Share(bits(3), 24, 8), Share(bits(3), 16, 8), Share(bits(3), 8, 8));
    splat.opacity = Share(bits(3), 0, 8);
    if (rgb) color = rgb->At(chunks, chunk, color);
    harmonics[0] = ((color.array() - 0.5) / kHarmonic0).matrix().cast<float>();
    packed_harmonics.SetAt(row, std::span(harmonics).subspan(1));
    collector.Add(splat, harmonics);
  }
  return std::move(collector).Finish();
}

}  // namespace

Splats ReadSplats(const path& file) {
  const MappedFile mapped(file);
  const PlyHeader header = ParsePlyHeader(file, mapped.contents());
  for (const PlyElement& element : header.elements) {
    constexpr uint64_t kMost = 0xfffffffeu;  // indices have 32 bits
    if (element.count > kMost) {
      throw InputError(file, fmt::format("element {}", element.name),
                       fmt::format("{} are too many", element.count));
    }
  }
  const bool is_compressed =
      std::any_of(header.elements.begin(), header.elements.end(),
                  [](const PlyElement& element) { return element.name == "chunk"; });
  return is_compressed ? ReadCompressed(file, header, mapped.contents())
                       : ReadTrained(file, header, mapped.contents());
}

}  // namespace raylift
