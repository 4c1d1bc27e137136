#include "views/vertex_coloring.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "base/statistics.h"
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/io/image_file.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

// The color of a point in a photograph.
struct PointColor {
  size_t photograph;
  double weight;
  Eigen::Vector3d log_rgb;
};

constexpr int kRounds = 5;
// The weight of factor 1 beside the many points that tell a photograph's factors.
constexpr double kPrior = 1e-3;

using Levels = Eigen::MatrixX3d;  // of the logarithms, added

double TotalWeight(std::span<const PointColor> point) {
  double total = 0;
  for (const PointColor& color : point) total += color.weight;
  return total;
}

Eigen::RowVector3d Mean(std::span<const PointColor> point, const Levels& levels) {
  Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
  for (const PointColor& color : point) {
    sum += color.weight * (color.log_rgb.transpose() + levels.row(color.photograph));
  }
  return sum / TotalWeight(point);
}

// Sets each weight by how far the color is from the others of its point.
void Reweigh(std::span<const std::vector<PointColor>> points, const Levels& levels,
             std::vector<std::vector<PointColor>>& weighed) {
  std::vector<double> distances;
  for (const auto& point : weighed) {
    const Eigen::RowVector3d mean = Mean(point, levels);
    for (const PointColor& color : point) {
      distances.push_back((color.log_rgb.transpose() + levels.row(color.photograph) - mean).norm());
    }
  }
  std::vector<double> sorted = distances;
  const double usual = sorted.empty() ? 0 : UpperMedianInPlace(std::span(sorted));
  if (!(usual > 0)) return;
  size_t next = 0;
  for (size_t p = 0; p < points.size(); ++p) {
    for (size_t i = 0; i < points[p].size(); ++i) {
      const double ratio = distances[next++] / usual;
      weighed[p][i].weight = points[p][i].weight / (1 + ratio * ratio);
    }
  }
}

Levels Solve(size_t count, std::span<const std::vector<PointColor>> points) {
  const auto n = static_cast<Eigen::Index>(count);
  std::vector<Eigen::Triplet<double>> entries;
  for (Eigen::Index i = 0; i < n; ++i) entries.emplace_back(i, i, kPrior);
  Levels right = Levels::Zero(n, 3);
  const Levels none = Levels::Zero(n, 3);
  for (const auto& point : points) {
    const double total = TotalWeight(point);
    const Eigen::RowVector3d mean = Mean(point, none);
    for (const PointColor& a : point) {
      const auto row = static_cast<Eigen::Index>(a.photograph);
      entries.emplace_back(row, row, a.weight);
      for (const PointColor& b : point) {
        entries.emplace_back(row, static_cast<Eigen::Index>(b.photograph),
                             -a.weight * b.weight / total);
      }
      right.row(row) -= a.weight * (a.log_rgb.transpose() - mean);
    }
  }
  Eigen::SparseMatrix<double> normal(n, n);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factors(normal);
  Levels levels = factors.solve(right);
  return levels.allFinite() ? levels : none;
}

// Returns factors for each channel of each photograph, of geometric mean 1, that make the
// logarithms at each point agree, by weighted least squares with Cauchy's weights where photographs
// disagree by more than they usually do. Photographs that share no point with others keep 1.
std::vector<Eigen::Vector3d> LevelExposures(size_t num_photographs,
                                            std::span<const std::vector<PointColor>> points) {
  std::vector<std::vector<PointColor>> weighed(points.begin(), points.end());
  Levels levels = Levels::Zero(static_cast<Eigen::Index>(num_photographs), 3);
  for (int round = 0; round < kRounds; ++round) {
    levels = Solve(num_photographs, weighed);
    Reweigh(points, levels, weighed);
  }
  if (num_photographs > 0) levels.rowwise() -= levels.colwise().mean().eval();
  std::vector<Eigen::Vector3d> factors;
  factors.reserve(num_photographs);
  for (Eigen::Index i = 0; i < levels.rows(); ++i) {
    factors.emplace_back(levels.row(i).array().exp().transpose());
  }
  return factors;
}

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

// A vertex takes the photographs that see it best: further ones add little.
constexpr size_t kMaxSamples = 8;
constexpr size_t kVerticesPerItem = 4096;
// A vertex lies on the surface that the ray hits: what is nearer by more than that, in edges and in
// distances, hides it.
constexpr double kOwnSurface = 0.1;
constexpr double kOwnDistance = 1e-4;
// Surfaces that are seen more obliquely than this cosine are not resolved.
constexpr double kLeastCosine = 0.1;
// Values beyond are clipped, or noise: they tell nothing of the exposure.
constexpr float kDarkest = 8, kBrightest = 247;
// Points that tell exposures, per photograph; more change nothing.
constexpr size_t kPointsPerPhotograph = 200;
constexpr size_t kLeastPoints = 20000;
// The farthest color from the median, in medians of absolute deviations: three standard deviations
// of normal noise.
constexpr double kFarDeviations = 3 * kSigmaPerMad;
constexpr double kLeastDeviation = 2;  // levels of 255
constexpr std::array<uint8_t, 3> kUnseen = {128, 128, 128};

struct Sample {
  float weight = 0;
  float spacing_px = 0;
  uint32_t photograph = 0;
  bool is_front = true;
  Vector3f rgb = Vector3f::Zero();
};

// The shape of the surface about each vertex.
struct VertexShapes {
  std::vector<Vector3f> normals;    // unit; zero where there is none
  std::vector<float> spacings;      // mean length of its edges
  std::vector<uint32_t> begins;     // of each vertex's neighbors, and the end
  std::vector<uint32_t> neighbors;  // each as often as triangles have the edge
};

VertexShapes ShapesOf(const TriangleMesh& mesh) {
  const size_t count = mesh.vertices.size();
  VertexShapes shapes;
  shapes.normals.assign(count, Vector3f::Zero());
  shapes.spacings.assign(count, 0);
  shapes.begins.assign(count + 1, 0);
  for (const auto& triangle : mesh.triangles) {
    const Vector3f& corner = mesh.vertices[triangle[0]];
    const Vector3f area =
        (mesh.vertices[triangle[1]] - corner).cross(mesh.vertices[triangle[2]] - corner);
    for (const uint32_t vertex : triangle) {
      shapes.normals[vertex] += area;
      shapes.begins[vertex + 1] += 2;
    }
  }
  for (size_t v = 0; v < count; ++v) shapes.begins[v + 1] += shapes.begins[v];
  shapes.neighbors.resize(shapes.begins[count]);
  std::vector<uint32_t> next(shapes.begins.begin(), shapes.begins.end() - 1);
  for (const auto& triangle : mesh.triangles) {
    for (size_t k = 0; k < 3; ++k) {
      shapes.neighbors[next[triangle[k]]++] = triangle[(k + 1) % 3];
      shapes.neighbors[next[triangle[k]]++] = triangle[(k + 2) % 3];
    }
  }
  for (size_t v = 0; v < count; ++v) {
    shapes.normals[v].stableNormalize();
    float sum = 0;
    for (uint32_t i = shapes.begins[v]; i < shapes.begins[v + 1]; ++i) {
      sum += (mesh.vertices[shapes.neighbors[i]] - mesh.vertices[v]).norm();
    }
    const uint32_t edges = shapes.begins[v + 1] - shapes.begins[v];
    if (edges > 0) shapes.spacings[v] = sum / static_cast<float>(edges);
  }
  return shapes;
}

// A photograph at full size, half of it, and so on.
class Pyramid {
 public:
  Pyramid(const PosedImage& photograph, const std::filesystem::path& folder) {
    const std::filesystem::path file = folder / photograph.name;
    Image image = ReadImage(file, ImageChannels::kRgb);
    RequireSizeOf(photograph.camera, photograph.name, {image.width_px, image.height_px}, file);
    levels_.push_back(cv::Mat(image.height_px, image.width_px, CV_8UC3, image.data.data()).clone());
    while (std::min(levels_.back().cols, levels_.back().rows) >= 4) {
      cv::Mat half;
      cv::resize(levels_.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
      levels_.push_back(half);
    }
  }

  // Returns the mean of a patch of about that width, bilinear between pixels.
  Vector3f At(const Vector2d& pixel, double width_px) const {
    const double octave = std::clamp(std::round(std::log2(std::max(width_px, 1.0))), 0.0,
                                     static_cast<double>(levels_.size() - 1));
    const cv::Mat& level = levels_[static_cast<size_t>(octave)];
    const double x = pixel.x() * level.cols / levels_[0].cols - 0.5;
    const double y = pixel.y() * level.rows / levels_[0].rows - 0.5;
    const int left = std::clamp(static_cast<int>(std::floor(x)), 0, std::max(0, level.cols - 2));
    const int top = std::clamp(static_cast<int>(std::floor(y)), 0, std::max(0, level.rows - 2));
    const auto right_share = static_cast<float>(std::clamp(x - left, 0.0, 1.0));
    const auto lower_share = static_cast<float>(std::clamp(y - top, 0.0, 1.0));
    const auto value = [&](int row, int column) {
      const auto& rgb =
          level.at<cv::Vec3b>(std::min(row, level.rows - 1), std::min(column, level.cols - 1));
      return Vector3f(rgb[0], rgb[1], rgb[2]);
    };
    return (1 - lower_share) *
               ((1 - right_share) * value(top, left) + right_share * value(top, left + 1)) +
           lower_share *
               ((1 - right_share) * value(top + 1, left) + right_share * value(top + 1, left + 1));
  }

 private:
  std::vector<cv::Mat> levels_;  // RGB
};

std::vector<Sample>::const_iterator Worst(const std::vector<Sample>& kept) {
  return std::min_element(kept.begin(), kept.end(),
                          [](const Sample& a, const Sample& b) { return a.weight < b.weight; });
}

bool IsWanted(const Sample& sample, const std::vector<Sample>& kept) {
  return sample.weight > 0 && (kept.size() < kMaxSamples || sample.weight > Worst(kept)->weight);
}

void Keep(const Sample& sample, std::vector<Sample>& kept) {
  if (kept.size() == kMaxSamples) kept.erase(Worst(kept));
  kept.push_back(sample);
}

// Returns the mean of the colors that agree with the median.
std::array<uint8_t, 3> Blended(std::span<const Sample> samples, std::span<const Vector3d> factors) {
  std::array<uint8_t, 3> color;
  for (int c = 0; c < 3; ++c) {
    std::vector<WeightedValue> values, deviations;
    for (const Sample& sample : samples) {
      values.push_back({sample.rgb[c] * factors[sample.photograph][c], sample.weight});
    }
    const double median = WeightedMedian(values);
    for (const WeightedValue& value : values) {
      deviations.push_back({std::abs(value.value - median), value.weight});
    }
    const double far = kFarDeviations * std::max(kLeastDeviation, WeightedMedian(deviations));
    double sum = 0, total = 0;
    for (const WeightedValue& value : values) {
      if (std::abs(value.value - median) > far) continue;
      sum += value.weight * value.value;
      total += value.weight;
    }
    color[static_cast<size_t>(c)] = NearestByte(sum / total);
  }
  return color;
}

class Coloring {
 public:
  Coloring(const TriangleMesh& mesh, const RayCaster& surface,
           std::span<const PosedImage> photographs)
      : mesh_(mesh),
        surface_(surface),
        photographs_(photographs),
        shapes_(ShapesOf(mesh)),
        samples_(mesh.vertices.size()) {}

  void LookThrough(uint32_t photograph, const Pyramid& pyramid, int threads) {
    ParallelForParts(mesh_.vertices.size(), kVerticesPerItem, threads,
                     [&](size_t begin, size_t end) { LookAt(photograph, pyramid, begin, end); });
  }

  void ChooseSides() {
    for (std::vector<Sample>& samples : samples_) {
      float balance = 0;
      for (const Sample& sample : samples)
        balance += sample.is_front ? sample.weight : -sample.weight;
      std::erase_if(samples, [&](const Sample& s) { return s.is_front != (balance >= 0); });
    }
  }

  std::vector<Vector3d> Exposures() const {
    const size_t wanted = std::max(kLeastPoints, kPointsPerPhotograph * photographs_.size());
    const size_t stride = std::max<size_t>(1, samples_.size() / wanted);
    std::vector<std::vector<PointColor>> points;
    for (size_t v = 0; v < samples_.size(); v += stride) {
      std::vector<PointColor> point;
      for (const Sample& sample : samples_[v]) {
        if (sample.rgb.minCoeff() < kDarkest || sample.rgb.maxCoeff() > kBrightest) continue;
        point.push_back(
            {sample.photograph, sample.weight, sample.rgb.cast<double>().array().log().matrix()});
      }
      if (point.size() >= 2) points.push_back(std::move(point));
    }
    return LevelExposures(photographs_.size(), points);
  }

  void Blend(std::span<const Vector3d> factors, int threads, VertexColoring& coloring) const {
    coloring.colors_rgb.assign(samples_.size(), kUnseen);
    ParallelForParts(samples_.size(), kVerticesPerItem, threads, [&](size_t begin, size_t end) {
      for (size_t v = begin; v < end; ++v) {
        if (!samples_[v].empty()) coloring.colors_rgb[v] = Blended(samples_[v], factors);
      }
    });
    std::vector<double> spacings, pixels;
    for (size_t v = 0; v < samples_.size(); ++v) {
      if (samples_[v].empty()) continue;
      ++coloring.num_seen;
      float best = 0;
      for (const Sample& sample : samples_[v]) best = std::max(best, sample.spacing_px);
      spacings.push_back(best);
      pixels.push_back(shapes_.spacings[v] / best);
    }
    if (spacings.empty()) return;
    coloring.median_spacing_px = UpperMedianInPlace(std::span(spacings));
    coloring.median_pixel_width = UpperMedianInPlace(std::span(pixels));
  }

  // Gives the vertices that are not seen the mean color of those around them, ring by ring from
  // what is seen.
  void Spread(VertexColoring& coloring) const {
    std::vector<bool> known(samples_.size());
    std::vector<uint32_t> ring;
    for (size_t v = 0; v < samples_.size(); ++v) known[v] = !samples_[v].empty();
    const auto add_around = [&](uint32_t vertex, std::vector<uint32_t>& next) {
      for (uint32_t i = shapes_.begins[vertex]; i < shapes_.begins[vertex + 1]; ++i) {
        if (!known[shapes_.neighbors[i]]) next.push_back(shapes_.neighbors[i]);
      }
    };
    for (uint32_t v = 0; v < samples_.size(); ++v) {
      if (known[v]) add_around(v, ring);
    }
    while (!ring.empty()) {
      std::sort(ring.begin(), ring.end());
      ring.erase(std::unique(ring.begin(), ring.end()), ring.end());
      std::vector<std::array<uint8_t, 3>> colors;
      for (const uint32_t v : ring) colors.push_back(MeanAround(v, known, coloring.colors_rgb));
      for (size_t i = 0; i < ring.size(); ++i) coloring.colors_rgb[ring[i]] = colors[i];
      for (const uint32_t v : ring) known[v] = true;
      std::vector<uint32_t> next;
      for (const uint32_t v : ring) add_around(v, next);
      ring = std::move(next);
    }
  }

 private:
  struct Candidate {
    size_t vertex;
    Vector2d pixel;
    double distance;
    Sample sample;
  };

  // Returns what the photograph would show of a vertex if nothing hid it.
  std::optional<Candidate> Project(uint32_t photograph, size_t vertex) const {
    const Camera& camera = photographs_[photograph].camera;
    const Rigid3& cam_from_world = photographs_[photograph].cam_from_world;
    const Vector3d point = cam_from_world * mesh_.VertexInWorld(static_cast<uint32_t>(vertex));
    const auto projection = camera.ImgFromCamWithJacobian(point);
    if (!projection || !camera.Contains(projection->pixel)) return std::nullopt;
    const Vector3d normal = cam_from_world.rotation * shapes_.normals[vertex].cast<double>();
    const double distance = point.norm();
    const double cosine = -normal.dot(point) / distance;
    if (!(std::abs(cosine) > kLeastCosine)) return std::nullopt;
    // A square of the tangent plane, as wide as the edges are long, covers so many pixels.
    const Vector3d first = normal.unitOrthogonal();
    Eigen::Matrix<double, 3, 2> tangents;
    tangents << first, normal.cross(first);
    const double spacing = shapes_.spacings[vertex];
    const double spacing_px =
        spacing * std::sqrt(std::abs((projection->jacobian * tangents).determinant()));
    const double resolved = std::min(1.0, spacing_px);
    return Candidate{
        .vertex = vertex,
        .pixel = projection->pixel,
        .distance = distance,
        .sample = {.weight = static_cast<float>(std::abs(cosine) * resolved * resolved),
                   .spacing_px = static_cast<float>(spacing_px),
                   .photograph = photograph,
                   .is_front = cosine > 0}};
  }

  void LookAt(uint32_t photograph, const Pyramid& pyramid, size_t begin, size_t end) {
    std::vector<Candidate> candidates;
    std::vector<Ray> rays;
    const Vector3d center = photographs_[photograph].cam_from_world.OriginInSource();
    for (size_t v = begin; v < end; ++v) {
      auto candidate = Project(photograph, v);
      if (!candidate || !IsWanted(candidate->sample, samples_[v])) continue;
      rays.push_back({center, mesh_.VertexInWorld(static_cast<uint32_t>(v)) - center});
      candidates.push_back(*candidate);
    }
    const auto hits = surface_.Cast(rays);
    for (size_t i = 0; i < candidates.size(); ++i) {
      Candidate& candidate = candidates[i];
      const double nearer =
          kOwnDistance + kOwnSurface * shapes_.spacings[candidate.vertex] / candidate.distance;
      if (hits[i] && hits[i]->ray_t < 1 - nearer) continue;
      candidate.sample.rgb = pyramid.At(candidate.pixel, candidate.sample.spacing_px);
      Keep(candidate.sample, samples_[candidate.vertex]);
    }
  }

  std::array<uint8_t, 3> MeanAround(uint32_t vertex, const std::vector<bool>& known,
                                    std::span<const std::array<uint8_t, 3>> colors) const {
    Vector3d sum = Vector3d::Zero();
    int count = 0;
    for (uint32_t i = shapes_.begins[vertex]; i < shapes_.begins[vertex + 1]; ++i) {
      const uint32_t neighbor = shapes_.neighbors[i];
      if (!known[neighbor]) continue;
      ++count;
      sum += Vector3d(colors[neighbor][0], colors[neighbor][1], colors[neighbor][2]);
    }
    return {NearestByte(sum[0] / count), NearestByte(sum[1] / count), NearestByte(sum[2] / count)};
  }

  const TriangleMesh& mesh_;
  const RayCaster& surface_;
  std::span<const PosedImage> photographs_;
  const VertexShapes shapes_;
  std::vector<std::vector<Sample>> samples_;  // of each vertex
};

}  // namespace

VertexColoring ColorVertices(const TriangleMesh& mesh, const RayCaster& surface,
                             std::span<const PosedImage> photographs,
                             const std::filesystem::path& folder,
                             const VertexColoringOptions& options) {
  Coloring work(mesh, surface, photographs);
  const auto batch = static_cast<size_t>(ResolveThreads(options.threads));
  for (size_t begin = 0; begin < photographs.size(); begin += batch) {
    const size_t count = std::min(batch, photographs.size() - begin);
    std::vector<std::optional<Pyramid>> pyramids(count);
    ParallelFor(count, options.threads,
                [&](size_t i) { pyramids[i].emplace(photographs[begin + i], folder); });
    for (size_t i = 0; i < count; ++i) {
      work.LookThrough(static_cast<uint32_t>(begin + i), *pyramids[i], options.threads);
      if (options.on_photograph) options.on_photograph();
    }
  }
  work.ChooseSides();
  VertexColoring coloring;
  coloring.factors_rgb.assign(photographs.size(), Vector3d::Ones());
  if (options.level_exposures) coloring.factors_rgb = work.Exposures();
  work.Blend(coloring.factors_rgb, options.threads, coloring);
  work.Spread(coloring);
  return coloring;
}

}  // namespace raylift
