#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/rng.h"
#include "evaluation/fields.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr int kGridColumns = 5;
constexpr int kGridRows = 4;

struct Ellipse {
  double x, y, radius_x, radius_y;

  // Returns the squared distance of a pixel from the middle, in radii: below 1 inside.
  double SquaredDistance(int pixel_x, int pixel_y) const {
    const double dx = (pixel_x - x) / radius_x, dy = (pixel_y - y) / radius_y;
    return dx * dx + dy * dy;
  }
};

class Perturber {
 public:
  Perturber(DepthMap map, const DepthPerturbation& options, std::string_view image_name)
      : map_(std::move(map)), options_(options), image_name_(image_name) {}

  DepthMap Run() {
    Scale();
    Add();
    Warp();
    Bubbles();
    Floaters();
    FlyingPixels();
    if (options_.smoothing_px > 0) map_ = SmoothDepth(map_, options_.smoothing_px);
    Noise();
    Clamp();
    Quantize();
    Holes();
    return std::move(map_);
  }

 private:
  Rng Stream(std::string_view purpose) const {
    return Rng(StreamSeed(options_.seed, image_name_, purpose));
  }

  // Replaces the depth z of every pixel that has one by new_depth(x, y, z). What is no longer
  // positive becomes a hole.
  template <typename Function>
  void ForEachDepth(Function new_depth) {
    for (int y = 0; y < map_.height_px; ++y) {
      for (int x = 0; x < map_.width_px; ++x) {
        float& z = Pixel(x, y);
        if (!(z > 0)) continue;
        const double changed = new_depth(x, y, static_cast<double>(z));
        z = changed > 0 && std::isfinite(changed) ? static_cast<float>(changed) : 0.0F;
      }
    }
  }

  template <typename Function>
  void ForEachDepthIn(const Ellipse& ellipse, Function new_depth) {
    const int x0 = std::max(0, static_cast<int>(std::floor(ellipse.x - ellipse.radius_x)));
    const int y0 = std::max(0, static_cast<int>(std::floor(ellipse.y - ellipse.radius_y)));
    const int x1 = std::min(map_.width_px - 1, static_cast<int>(ellipse.x + ellipse.radius_x) + 1);
    const int y1 = std::min(map_.height_px - 1, static_cast<int>(ellipse.y + ellipse.radius_y) + 1);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const double squared = ellipse.SquaredDistance(x, y);
        float& z = Pixel(x, y);
        if (z > 0 && squared < 1)
          z = static_cast<float>(new_depth(squared, static_cast<double>(z)));
      }
    }
  }

  // Radii are shares of the image's width.
  Ellipse DrawEllipse(Rng& rng, double min_radius, double max_radius) const {
    Ellipse ellipse{};
    ellipse.x = rng.Uniform(0, map_.width_px);
    ellipse.y = rng.Uniform(0, map_.height_px);
    ellipse.radius_x = std::max(1.5, rng.Uniform(min_radius, max_radius) * map_.width_px);
    ellipse.radius_y = std::max(1.5, rng.Uniform(0.6, 1.4) * ellipse.radius_x);
    return ellipse;
  }

  float& Pixel(int x, int y) {
    return map_
        .z[static_cast<size_t>(y) * static_cast<size_t>(map_.width_px) + static_cast<size_t>(x)];
  }

  void Scale() {
    if (options_.scale == 1 && options_.scale_sigma == 0) return;
    Rng rng = Stream("scale");
    const double factor = options_.scale * std::exp(options_.scale_sigma * rng.Normal());
    ForEachDepth([factor](int, int, double z) { return factor * z; });
  }

  void Add() {
    if (options_.offset == 0) return;
    ForEachDepth([this](int, int, double z) { return z + options_.offset; });
  }

  // Multiplies the depth by factors that are smoothed between the nodes by cubics, so that no edge
  // appears.
  void Warp() {
    if (options_.warp_sigma == 0) return;
    Rng rng = Stream("warp");
    std::array<double, static_cast<size_t>(kGridColumns) * kGridRows> nodes{};
    for (double& node : nodes) node = options_.warp_sigma * rng.Normal();
    const auto smooth = [](double t) { return t * t * (3 - 2 * t); };
    const auto place = [&](int pixel, int count_px, int nodes_along) {
      const double u = (pixel + 0.5) / count_px * (nodes_along - 1);
      const int cell = std::min(static_cast<int>(u), nodes_along - 2);
      return std::pair(static_cast<size_t>(cell), smooth(u - cell));
    };
    ForEachDepth([&](int x, int y, double z) {
      const auto [column, u] = place(x, map_.width_px, kGridColumns);
      const auto [row, v] = place(y, map_.height_px, kGridRows);
      const double* corner = &nodes[row * kGridColumns + column];
      const double log_factor = (1 - v) * ((1 - u) * corner[0] + u * corner[1]) +
                                v * ((1 - u) * corner[kGridColumns] + u * corner[kGridColumns + 1]);
      return z * std::exp(log_factor);
    });
  }

  void Bubbles() {
    Rng rng = Stream("bubbles");
    for (int i = 0; i < options_.bubbles; ++i) {
      const Ellipse ellipse = DrawEllipse(rng, 0.06, 0.14);
      const double height = options_.bubble_height * rng.Uniform(0.6, 1.2);
      ForEachDepthIn(ellipse, [height](double squared, double z) {
        return z * (1 - std::min(0.95, height) * (1 - squared) * (1 - squared));
      });
    }
  }

  void Floaters() {
    Rng rng = Stream("floaters");
    for (int i = 0; i < options_.floaters; ++i) {
      const Ellipse ellipse = DrawEllipse(rng, 0.004, 0.02);
      const double share = rng.Uniform(0.3, 0.8);
      const double behind =
          static_cast<double>(Pixel(std::min(static_cast<int>(ellipse.x), map_.width_px - 1),
                                    std::min(static_cast<int>(ellipse.y), map_.height_px - 1)));
      if (!(behind > 0)) continue;
      ForEachDepthIn(ellipse, [&](double, double z) { return std::min(z, share * behind); });
    }
  }

  // A pixel whose 3 x 3 neighborhood holds a jump lands anywhere between its two surfaces.
  void FlyingPixels() {
    if (options_.flying_share == 0) return;
    Rng rng = Stream("flying");
    const DepthMap before = map_;
    ForEachDepth([&](int x, int y, double z) {
      double nearest = z, farthest = z;
      for (int v = std::max(0, y - 1); v <= std::min(map_.height_px - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(map_.width_px - 1, x + 1); ++u) {
          const auto other = static_cast<double>(before.At(u, v));
          if (!(other > 0)) continue;
          nearest = std::min(nearest, other);
          farthest = std::max(farthest, other);
        }
      }
      constexpr double kMinJump = 0.05;
      if (farthest < (1 + kMinJump) * nearest || rng.Uniform() >= options_.flying_share) return z;
      return rng.Uniform(nearest, farthest);
    });
  }

  void Noise() {
    if (options_.noise_sigma == 0 && options_.relative_noise_sigma == 0) return;
    Rng additive = Stream("noise");
    Rng relative = Stream("relative noise");
    ForEachDepth([&](int, int, double z) {
      return z * (1 + options_.relative_noise_sigma * relative.Normal()) +
             options_.noise_sigma * additive.Normal();
    });
  }

  void Quantize() {
    RoundTo(options_.quantization_step);
    if (options_.quantization_bits == 0 || map_.z.empty()) return;
    const auto largest = static_cast<double>(*std::max_element(map_.z.begin(), map_.z.end()));
    RoundTo(largest / (std::exp2(options_.quantization_bits) - 1));
  }
  void RoundTo(double step) {
    if (step == 0) return;
    ForEachDepth([step](int, int, double z) { return step * std::round(z / step); });
  }

  void Clamp() {
    if (options_.clamp == 0) return;
    ForEachDepth([this](int, int, double z) { return std::min(z, options_.clamp); });
  }

  void Holes() {
    if (options_.hole_share == 0) return;
    Rng rng = Stream("holes");
    const auto wanted =
        static_cast<size_t>(options_.hole_share * static_cast<double>(map_.z.size()));
    // Blobs may overlap each other and holes that are there; the share is of all pixels.
    constexpr int kMaxBlobs = 100000;
    size_t removed = 0;
    for (int i = 0; i < kMaxBlobs && removed < wanted; ++i) {
      ForEachDepthIn(DrawEllipse(rng, 0.005, 0.04), [&](double, double z) {
        if (removed == wanted) return z;
        ++removed;
        return 0.0;
      });
    }
  }

  DepthMap map_;
  const DepthPerturbation& options_;
  std::string_view image_name_;
};

}  // namespace

std::vector<Field> FieldsOf(DepthPerturbation& values) {
  return {
      {"scale", values.scale, "One factor for all images", kPositive},
      {"scale_sigma", values.scale_sigma, "A factor per image: standard deviation of its ln",
       kAtLeastZero},
      {"offset", values.offset, "Added to the depth, scene units"},
      {"warp", values.warp_sigma, "A smooth field of factors per image: deviation of their ln",
       kAtLeastZero},
      {"bubbles", values.bubbles, "Smooth domes per image", kAtLeastZero},
      {"bubble_height", values.bubble_height, "Of the domes, as a share of the depth", kShare},
      {"floaters", values.floaters, "Small blobs per image in front of the surface", kAtLeastZero},
      {"flying", values.flying_share, "Share of the pixels at depth edges that fly between",
       kShare},
      {"smooth", values.smoothing_px, "Gaussian over all surfaces: its deviation in pixels",
       kAtLeastZero},
      {"noise", values.noise_sigma, "Gaussian noise, scene units", kAtLeastZero},
      {"relative_noise", values.relative_noise_sigma, "Gaussian noise, as a share of the depth",
       kAtLeastZero},
      {"clamp", values.clamp, "Put what is farther than this there, scene units; 0: nothing",
       kAtLeastZero},
      {"quantize", values.quantization_step, "Round to multiples of this, scene units",
       kAtLeastZero},
      {"quantize_bits", values.quantization_bits,
       "Keep an integer of so many bits, its largest value for the map's; 0: no",
       Range{.says = "must be between 1 and 16, or 0 for none", .least = 0, .most = 16}},
      {"holes", values.hole_share, "Share of the pixels to remove, in blobs", kShare},
      {"seed", values.seed, "Seed of all random choices"},
  };
}

void DepthPerturbation::Validate() const { CheckRanges(ConstFieldsOf(*this)); }

DepthMap SmoothDepth(const DepthMap& map, double sigma_px) {
  RAYLIFT_CHECK(sigma_px > 0);
  const int reach = static_cast<int>(std::ceil(3 * sigma_px));
  std::vector<double> weights;
  for (int d = -reach; d <= reach; ++d)
    weights.push_back(std::exp(-0.5 * d * d / sigma_px / sigma_px));
  const int width = map.width_px, height = map.height_px;
  const auto index = [width](int x, int y) {
    return static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x);
  };
  // Sums of weighted depths and of weights, along rows and then along columns.
  std::vector<double> sums(map.z.size(), 0.0), totals(map.z.size(), 0.0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) {
        const auto z = static_cast<double>(map.At(u, y));
        if (!(z > 0)) continue;
        const double weight = weights[static_cast<size_t>(u - x + reach)];
        sums[index(x, y)] += weight * z;
        totals[index(x, y)] += weight;
      }
    }
  }
  DepthMap smooth = map;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (!(map.At(x, y) > 0)) continue;
      double sum = 0, total = 0;
      for (int v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v) {
        const double weight = weights[static_cast<size_t>(v - y + reach)];
        sum += weight * sums[index(x, v)];
        total += weight * totals[index(x, v)];
      }
      smooth.z[index(x, y)] = static_cast<float>(sum / total);
    }
  }
  return smooth;
}

DepthMap PerturbDepth(const DepthMap& map, const DepthPerturbation& perturbation,
                      std::string_view image_name) {
  return Perturber(map, perturbation, image_name).Run();
}

DepthMap ConfidenceOfPerturbed(const DepthMap& map, const DepthPerturbation& perturbation,
                               MadeConfidence kind, std::string_view image_name) {
  RAYLIFT_CHECK(kind != MadeConfidence::kNone);
  DepthMap confidence = map;
  if (kind == MadeConfidence::kRandom) {
    constexpr double kSpread = 0.5;
    std::fill(confidence.z.begin(), confidence.z.end(), 1.0F);
    const DepthPerturbation field = {.warp_sigma = kSpread, .seed = ~perturbation.seed};
    confidence = PerturbDepth(confidence, field, image_name);
    for (float& value : confidence.z) value += 1;
    return confidence;
  }
  constexpr double kBestError = 0.01, kReachPx = 2;
  // Kinds draw from streams of their own: what these do to the depth is the same without the rest.
  const DepthPerturbation unseen = {.scale = perturbation.scale,
                                    .scale_sigma = perturbation.scale_sigma,
                                    .offset = perturbation.offset,
                                    .warp_sigma = perturbation.warp_sigma,
                                    .seed = perturbation.seed};
  const DepthMap right = PerturbDepth(map, unseen, image_name);
  const DepthMap worse = PerturbDepth(map, perturbation, image_name);
  for (size_t i = 0; i < map.z.size(); ++i) {
    const bool is_known = right.z[i] > 0 && worse.z[i] > 0;
    const double error = is_known ? std::log(static_cast<double>(worse.z[i] / right.z[i])) : 0;
    confidence.z[i] = is_known ? static_cast<float>(error * error + kBestError * kBestError) : 0;
  }
  confidence = SmoothDepth(confidence, kReachPx);
  for (float& value : confidence.z) {
    if (value > 0) value = static_cast<float>(1 + kBestError / std::sqrt(double{value}));
  }
  return confidence;
}

}  // namespace raylift
