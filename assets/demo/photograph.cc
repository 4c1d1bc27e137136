#include "photograph.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "base/rng.h"
#include "noise.h"
#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include "raylift/base/parallel.h"

namespace raylift::demo {

namespace {

constexpr int kSkyRaysPerSample = 4;
constexpr double kSkyReach = 5;  // meters: what is farther away hides no sky
constexpr double kOffset = 1e-4;

const std::array<float, 256>& LinearFromSrgb() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (size_t i = 0; i < values.size(); ++i) {
      const double s = static_cast<double>(i) / 255;
      values[i] = static_cast<float>(s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4));
    }
    return values;
  }();
  return table;
}

float SrgbFromLinear(float value) {
  const double v = std::clamp(static_cast<double>(value), 0.0, 1.0);
  return static_cast<float>(v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055);
}

Eigen::Vector3f Albedo(const TriangleMesh& mesh, const RayHit& hit) {
  const auto& corners = mesh.triangles[hit.triangle];
  const auto& uvs = mesh.texture_coordinates;
  const Eigen::Vector2f uv = (1 - hit.barycentric.sum()) * uvs[corners[0]] +
                             hit.barycentric.x() * uvs[corners[1]] +
                             hit.barycentric.y() * uvs[corners[2]];
  const Image& texture = mesh.textures[mesh.triangle_textures[hit.triangle]];
  const float x = std::clamp(uv.x() * texture.width_px - 0.5f, 0.0f, texture.width_px - 1.001f);
  const float y =
      std::clamp((1 - uv.y()) * texture.height_px - 0.5f, 0.0f, texture.height_px - 1.001f);
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const float s = x - ix, t = y - iy;
  const auto at = [&](int px, int py) {
    const uint8_t* rgb = texture.Pixel(px, py);
    const auto& linear = LinearFromSrgb();
    return Eigen::Vector3f(linear[rgb[0]], linear[rgb[1]], linear[rgb[2]]);
  };
  return (1 - t) * ((1 - s) * at(ix, iy) + s * at(ix + 1, iy)) +
         t * ((1 - s) * at(ix, iy + 1) + s * at(ix + 1, iy + 1));
}

Eigen::Vector3f SkyColor(const Daylight& light, const Eigen::Vector3d& direction) {
  const double up = std::clamp(direction.z() / direction.norm(), 0.0, 1.0);
  const double cloud =
      FractalNoise(3 * std::atan2(direction.y(), direction.x()) + 20, 5 * up + 3, 5, 900);
  const auto blend = static_cast<float>(std::sqrt(up));
  Eigen::Vector3f srgb = (1 - blend) * light.horizon + blend * light.zenith;
  const auto cover = static_cast<float>(std::clamp(3.5 * (cloud - 0.5), 0.0, 0.75));
  srgb = (1 - cover) * srgb + cover * Eigen::Vector3f(0.96f, 0.95f, 0.94f);
  return srgb.unaryExpr([](float v) { return LinearFromSrgb()[static_cast<size_t>(255 * v)]; });
}

// One row of pixels, some samples each, in batches of one kind of ray.
class RowRenderer {
 public:
  RowRenderer(const RayCaster& caster, const PixelGrid& grid, const Daylight& light, int side)
      : caster_(caster),
        grid_(grid),
        light_(light),
        to_sun_(light.to_sun.normalized()),
        side_(side),
        samples_(side * side) {}

  // Linear RGB of each pixel, before exposure; the sky is put in with `exposure` taken out.
  std::vector<Eigen::Vector3f> Render(int row) const {
    const std::vector<Ray> rays = ViewRays(row);
    const auto hits = caster_.Cast(rays);
    std::vector<Eigen::Vector3f> light = DirectAndSkyLight(rays, hits, row);
    std::vector<Eigen::Vector3f> pixels(grid_.width_px, Eigen::Vector3f::Zero());
    for (size_t i = 0; i < rays.size(); ++i) {
      const Eigen::Vector3f color =
          hits[i] ? Expose(Albedo(caster_.mesh(), *hits[i]).cwiseProduct(light[i]))
                  : SkyColor(light_, rays[i].direction_in_world);
      pixels[i / samples_] += color / static_cast<float>(samples_);
    }
    return pixels;
  }

 private:
  Eigen::Vector3f Expose(const Eigen::Vector3f& linear) const {
    // A soft shoulder, so that sunlit plaster keeps its texture.
    return linear.unaryExpr([&](float v) {
      return static_cast<float>(1 - std::exp(-light_.exposure * static_cast<double>(v)));
    });
  }

  std::vector<Ray> ViewRays(int row) const {
    std::vector<Ray> rays;
    rays.reserve(static_cast<size_t>(grid_.width_px) * samples_);
    for (int column = 0; column < grid_.width_px; ++column) {
      for (int k = 0; k < samples_; ++k) {
        const int right = k % side_;
        const int down = k / side_;
        const Eigen::Vector2d pixel(column + (right + 0.5) / side_, row + (down + 0.5) / side_);
        rays.push_back(grid_.ray(pixel));
      }
    }
    return rays;
  }

  std::vector<Eigen::Vector3f> DirectAndSkyLight(const std::vector<Ray>& rays,
                                                 const std::vector<std::optional<RayHit>>& hits,
                                                 int row) const {
    std::vector<Ray> secondary;
    for (size_t i = 0; i < rays.size(); ++i) {
      if (!hits[i]) continue;
      const Eigen::Vector3d normal = FacingNormal(rays[i], *hits[i]);
      const Eigen::Vector3d point =
          rays[i].origin_in_world + hits[i]->ray_t * rays[i].direction_in_world + kOffset * normal;
      secondary.push_back({point, to_sun_});
      for (int k = 0; k < kSkyRaysPerSample; ++k) {
        secondary.push_back({point, SkyDirection(normal, static_cast<int>(i), row, k)});
      }
    }
    const auto secondary_hits = caster_.Cast(secondary);
    std::vector<Eigen::Vector3f> light(rays.size(), Eigen::Vector3f::Zero());
    size_t next = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      if (!hits[i]) continue;
      const double cosine = FacingNormal(rays[i], *hits[i]).dot(to_sun_);
      if (cosine > 0 && !secondary_hits[next]) light[i] += static_cast<float>(cosine) * light_.sun;
      ++next;
      for (int k = 0; k < kSkyRaysPerSample; ++k, ++next) {
        light[i] += SkyLight(secondary[next], secondary_hits[next]) / kSkyRaysPerSample;
      }
    }
    return light;
  }

  Eigen::Vector3f SkyLight(const Ray& ray, const std::optional<RayHit>& hit) const {
    const auto up = static_cast<float>(0.5 + 0.5 * ray.direction_in_world.z());
    Eigen::Vector3f open = up * light_.sky + (1 - up) * light_.ground;
    if (!hit) return open;
    const auto openness = static_cast<float>(std::min(1.0, hit->ray_t / kSkyReach));
    return openness * open + 0.25f * (1 - openness) * light_.ground;
  }

  static Eigen::Vector3d FacingNormal(const Ray& ray, const RayHit& hit) {
    return hit.normal_in_world.dot(ray.direction_in_world) > 0
               ? Eigen::Vector3d(-hit.normal_in_world)
               : hit.normal_in_world;
  }

  // Spread over the hemisphere by the cosine law; the samples of one pixel share a sequence.
  Eigen::Vector3d SkyDirection(const Eigen::Vector3d& normal, int sample, int row, int k) const {
    const int pixel = sample / samples_;
    const int index = sample % samples_ * kSkyRaysPerSample + k;
    constexpr double kGolden = std::numbers::phi - 1;
    const double u = (index + Hash(pixel, row, 1)) / (samples_ * kSkyRaysPerSample);
    const double angle = 2 * std::numbers::pi * (index * kGolden + Hash(pixel, row, 2));
    const double radius = std::sqrt(u);
    const Eigen::Vector3d x = normal.unitOrthogonal();
    return radius * std::cos(angle) * x + radius * std::sin(angle) * normal.cross(x) +
           std::sqrt(std::max(0.0, 1 - u)) * normal;
  }

  const RayCaster& caster_;
  const PixelGrid& grid_;
  const Daylight& light_;
  Eigen::Vector3d to_sun_;
  int side_;
  int samples_;
};

// Vignetting, blur, tone curve, noise.
Image Develop(cv::Mat linear, const Sensor& sensor, Rng rng) {
  const double corner = std::hypot(0.5 * linear.cols, 0.5 * linear.rows);
  for (int y = 0; y < linear.rows; ++y) {
    for (int x = 0; x < linear.cols; ++x) {
      const double r =
          std::hypot(x + 0.5 - 0.5 * linear.cols, y + 0.5 - 0.5 * linear.rows) / corner;
      linear.at<cv::Vec3f>(y, x) *= 1 - sensor.vignetting * r * r;
    }
  }
  if (sensor.blur_px > 0) {
    cv::GaussianBlur(linear, linear, {0, 0}, sensor.blur_px, sensor.blur_px, cv::BORDER_REPLICATE);
  }
  Image image{linear.cols, linear.rows, 3, std::vector<uint8_t>(linear.total() * 3)};
  const auto* values = linear.ptr<float>();
  for (size_t i = 0; i < image.data.size(); ++i) {
    const double value = 255 * SrgbFromLinear(values[i]);
    const double sigma = std::hypot(sensor.shot_noise * std::sqrt(value / 255), sensor.read_noise);
    const double noise = sigma > 0 ? sigma * rng.Normal() : 0;
    image.data[i] = static_cast<uint8_t>(std::lround(std::clamp(value + noise, 0.0, 255.0)));
  }
  return image;
}

}  // namespace

PixelGrid GridOf(const Camera& camera, const Rigid3& cam_from_world) {
  const Rigid3 world_from_cam = cam_from_world.Inverse();
  return {camera.width_px(), camera.height_px(), [=](const Eigen::Vector2d& pixel) {
            // Every pixel of the demo's lenses has a ray.
            const Eigen::Vector3d direction = camera.RayInCam(pixel).value();
            return Ray{world_from_cam.translation, world_from_cam.rotation * direction};
          }};
}

Image TakePhotograph(const RayCaster& caster, const PixelGrid& grid, const Daylight& light,
                     const Sensor& sensor, uint64_t seed, int threads) {
  const RowRenderer renderer(caster, grid, light, sensor.samples_per_side);
  cv::Mat linear(grid.height_px, grid.width_px, CV_32FC3);
  ParallelFor(static_cast<size_t>(grid.height_px), threads, [&](size_t row) {
    const std::vector<Eigen::Vector3f> pixels = renderer.Render(static_cast<int>(row));
    for (size_t x = 0; x < pixels.size(); ++x) {
      linear.at<cv::Vec3f>(static_cast<int>(row), static_cast<int>(x)) = {
          pixels[x].x(), pixels[x].y(), pixels[x].z()};
    }
  });
  return Develop(linear, sensor, Rng(seed));
}

}  // namespace raylift::demo
