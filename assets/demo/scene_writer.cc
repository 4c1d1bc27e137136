#include "scene_writer.h"

#include <array>
#include <charconv>
#include <string>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"

namespace raylift::demo {

namespace {

constexpr int kTextureJpegQuality = 78;

// Positions and texture coordinates are rounded by MeshBuilder already; their shortest form is
// short.
void AppendNumber(std::string& text, double value) {
  std::array<char, 32> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  text += ' ';
  text.append(buffer.data(), end);
}

std::string FormatObj(const Courtyard& yard) {
  std::string text =
      "# A courtyard, in metres, z up. Made by raylift_make_demo.\nmtllib scene.mtl\n";
  for (const Eigen::Vector3d& p : yard.scene.positions()) {
    text += 'v';
    for (double value : p) AppendNumber(text, value);
    text += '\n';
  }
  for (const Eigen::Vector2d& uv : yard.scene.texture_coordinates()) {
    text += "vt";
    for (double value : uv) AppendNumber(text, value);
    text += '\n';
  }
  for (size_t texture = 0; texture < yard.textures.size(); ++texture) {
    text += "usemtl " + yard.texture_names[texture] + "\n";
    for (const MeshBuilder::Face& face : yard.scene.faces()) {
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

void WriteScene(const std::filesystem::path& folder, const Courtyard& yard) {
  std::string materials;
  for (size_t i = 0; i < yard.textures.size(); ++i) {
    const std::string& name = yard.texture_names[i];
    WriteImage(folder / (name + ".jpg"), yard.textures[i], kTextureJpegQuality);
    materials.append("newmtl ").append(name).append("\nKd 1 1 1\nmap_Kd ").append(name);
    materials.append(".jpg\n");
  }
  WriteFile(folder / "scene.mtl", materials);
  WriteFile(folder / "scene.obj", FormatObj(yard));
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
