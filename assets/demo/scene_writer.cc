#include "scene_writer.h"

#include <array>
#include <charconv>
#include <cmath>
#include <iostream>
#include <string>

#include "base/rng.h"
#include "photograph.h"

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"

namespace raylift::demo {

namespace {

constexpr int kTextureJpegQuality = 78, kPhotographJpegQuality = 82;

void TakeAndWrite(const std::filesystem::path& images, const RayCaster& caster,
                  const PosedImage& view, const Daylight& light, const Sensor& sensor,
                  uint64_t seed) {
  const Image image = TakePhotograph(caster, GridOf(view.camera, view.cam_from_world), light,
                                     sensor, StreamSeed(seed, view.name, "sensor"), 0);
  WriteImage(images / view.name, image, kPhotographJpegQuality);
  std::cout << view.name << std::endl;
}

// Positions and texture coordinates are rounded by MeshBuilder already; their shortest form is
// short.
void AppendNumber(std::string& text, double value) {
  std::array<char, 32> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  text += ' ';
  text.append(buffer.data(), end);
}

std::string FormatObj(const TexturedScene& scene, const std::string& title,
                      const Eigen::Vector3d& origin) {
  std::string text = "# " + title + ". Made by raylift_make_demo.\nmtllib scene.mtl\n";
  for (const Eigen::Vector3d& p : scene.mesh.positions()) {
    text += 'v';
    for (double value : p + origin) AppendNumber(text, std::round(1000 * value) / 1000);
    text += '\n';
  }
  for (const Eigen::Vector2d& uv : scene.mesh.texture_coordinates()) {
    text += "vt";
    for (double value : uv) AppendNumber(text, value);
    text += '\n';
  }
  for (size_t texture = 0; texture < scene.textures.size(); ++texture) {
    text += "usemtl " + scene.texture_names[texture] + "\n";
    for (const MeshBuilder::Face& face : scene.mesh.faces()) {
      if (face.texture != static_cast<int>(texture)) continue;
      text += 'f';
      for (const auto& [position, uv] : face.corners) {
        text += ' ' + std::to_string(position + 1) + '/' + std::to_string(uv + 1);
      }
      text += '\n';
    }
  }
  return text;
}

}  // namespace

void WriteScene(const std::filesystem::path& folder, const TexturedScene& scene,
                const std::string& title, const Eigen::Vector3d& origin) {
  std::string materials;
  for (size_t i = 0; i < scene.textures.size(); ++i) {
    const std::string& name = scene.texture_names[i];
    WriteImage(folder / (name + ".jpg"), scene.textures[i], kTextureJpegQuality);
    materials.append("newmtl ").append(name).append("\nKd 1 1 1\nmap_Kd ").append(name);
    materials.append(".jpg\n");
  }
  WriteFile(folder / "scene.mtl", materials);
  WriteFile(folder / "scene.obj", FormatObj(scene, title, origin));
}

void TakeReferences(const std::filesystem::path& images, const RayCaster& caster,
                    const std::vector<PosedImage>& views, uint64_t seed, int samples_per_side) {
  const Sensor sensor{.blur_px = 0.35,
                      .vignetting = 0.1,
                      .shot_noise = 1.5,
                      .read_noise = 0.5,
                      .samples_per_side = samples_per_side};
  for (const PosedImage& view : views) TakeAndWrite(images, caster, view, kMorning, sensor, seed);
}

void TakeQueries(const std::filesystem::path& images, const RayCaster& caster,
                 const std::vector<PosedImage>& views, uint64_t seed, int samples_per_side) {
  for (size_t i = 0; i < views.size(); ++i) {
    Daylight light = kAfternoon;
    light.exposure *= i % 3 == 1 ? 0.7 : i % 3 == 2 ? 1.35 : 1;
    const bool is_hard = i + 2 >= views.size();
    if (is_hard) light.exposure *= 0.38;
    const Sensor sensor{.blur_px = is_hard ? 1.6 : 0.65,
                        .vignetting = 0.35,
                        .shot_noise = is_hard ? 9.0 : 4.5,
                        .read_noise = is_hard ? 4.0 : 2.0,
                        .samples_per_side = samples_per_side};
    TakeAndWrite(images, caster, views[i], light, sensor, seed);
  }
}

void WriteQueries(const std::filesystem::path& list, const std::vector<PosedImage>& views) {
  std::vector<Query> queries;
  queries.reserve(views.size());
  for (const PosedImage& view : views) queries.push_back({view.name, view.camera});
  WriteQueryList(list, queries);
}

void WriteViews(const std::filesystem::path& folder, const std::vector<PosedImage>& views) {
  ColmapModel model;
  for (const PosedImage& view : views) {
    uint32_t camera_id = 0;
    for (const auto& [id, camera] : model.cameras) {
      if (camera == view.camera) camera_id = id;
    }
    if (camera_id == 0) {
      camera_id = static_cast<uint32_t>(model.cameras.size() + 1);
      model.cameras.emplace(camera_id, view.camera);
    }
    ColmapImage image;
    image.name = view.name;
    image.camera_id = camera_id;
    image.SetCamFromWorld(view.cam_from_world);
    model.images.emplace(static_cast<uint32_t>(model.images.size() + 1), std::move(image));
  }
  WriteColmapModel(folder, model, ColmapForm::kText);
}

}  // namespace raylift::demo
