#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

#include "base/json_text.h"
#include "localization/results/exports.h"
#include "pictures/picture_codec.h"
#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

static_assert(std::endian::native == std::endian::little, "glTF holds numbers as they are here");

// glTF's numbers for what a buffer holds.
constexpr int kUint16 = 5123, kUint32 = 5125, kFloat = 5126;
constexpr int kVertexBuffer = 34962, kIndexBuffer = 34963;
constexpr int kLines = 1;

constexpr int kJpegQuality = 92;

Json ToJson(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }
Json ToJson(const Eigen::Quaterniond& q) { return Json::array({q.x(), q.y(), q.z(), q.w()}); }

// Converts vertex colors, which glTF states in linear light.
uint16_t LinearFromSrgb(uint8_t value) {
  const double c = value / 255.0;
  const double linear = c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  return static_cast<uint16_t>(std::lround(linear * 65535));
}

std::string EncodeTexture(const path& file, const Image& texture) {
  try {
    return EncodeJpeg(texture, kJpegQuality);
  } catch (const InputError& error) {
    throw InputError(file, error.what());
  }
}

// Returns linear red, green and blue.
std::array<double, 3> ColorOf(GlbCameraKind kind) {
  switch (kind) {
    case GlbCameraKind::kReference:
      return {0.1, 0.25, 0.8};
    case GlbCameraKind::kLocalized:
      return {0.05, 0.6, 0.1};
    case GlbCameraKind::kDoubtful:
      return {1.0, 0.3, 0.0};
  }
  return {};
}

// The JSON of a GLB and its binary data.
class GlbFile {
 public:
  Json json = {{"asset", {{"version", "2.0"}, {"generator", "Raylift"}}}};

  // Appends to a list of the JSON; its place there.
  size_t Add(const char* list, Json entry) {
    AppendTo(json, list, std::move(entry));
    return json[list].size() - 1;
  }

  template <typename T>
  size_t AddView(std::span<const T> values) {
    buffer_.resize((buffer_.size() + 3) / 4 * 4, '\0');
    const size_t begin = buffer_.size();
    buffer_.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
    return Add("bufferViews",
               {{"buffer", 0}, {"byteOffset", begin}, {"byteLength", values.size_bytes()}});
  }

  template <typename T>
  size_t AddAccessor(std::span<const T> values, int component, const char* type, Json more = {}) {
    const size_t view = AddView(values);
    json["bufferViews"][view]["target"] = component == kUint32 ? kIndexBuffer : kVertexBuffer;
    Json accessor = {{"bufferView", view},
                     {"componentType", component},
                     {"count", values.size()},
                     {"type", type}};
    if (!more.is_null()) accessor.update(more);
    return Add("accessors", std::move(accessor));
  }

  size_t AddPositions(std::span<const Eigen::Vector3f> positions) {
    Eigen::AlignedBox3f box;
    for (const Eigen::Vector3f& position : positions) box.extend(position);
    return AddAccessor(positions, kFloat, "VEC3",
                       {{"min", ToJson(Eigen::Vector3d(box.min().cast<double>()))},
                        {"max", ToJson(Eigen::Vector3d(box.max().cast<double>()))}});
  }

  size_t AddUnlit(Json appearance) {
    json["extensionsUsed"] = Json::array({"KHR_materials_unlit"});
    return Add("materials", {{"pbrMetallicRoughness", std::move(appearance)},
                             {"extensions", {{"KHR_materials_unlit", Json::object()}}},
                             {"doubleSided", true}});
  }

  void Write(const path& file) {
    buffer_.resize((buffer_.size() + 3) / 4 * 4, '\0');
    json["buffers"] = Json::array({Json{{"byteLength", buffer_.size()}}});
    std::string text = JsonText(json);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const size_t total = 12 + 8 + text.size() + 8 + buffer_.size();
    if (total > std::numeric_limits<uint32_t>::max()) {
      throw InputError(file, "a GLB cannot be larger than 4 GiB");
    }
    const auto bytes_of = [](std::initializer_list<size_t> words) {
      std::string bytes;
      for (const size_t word : words) {
        const auto value = static_cast<uint32_t>(word);
        bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
      }
      return bytes;
    };
    constexpr uint32_t kMagic = 0x46546C67, kVersion = 2, kJson = 0x4E4F534A, kBin = 0x004E4942;
    const std::string head = bytes_of({kMagic, kVersion, total, text.size(), kJson});
    const std::string between = bytes_of({buffer_.size(), kBin});
    const std::string_view parts[] = {head, text, between, buffer_};
    WriteFile(file, parts);
  }

 private:
  std::string buffer_;
};

// Adds a mesh: one material per texture, one for triangles without.
size_t AddMesh(const path& file, const TriangleMesh& mesh, GlbFile& glb) {
  Json attributes = {{"POSITION", glb.AddPositions(mesh.vertices)}};
  const bool textured = !mesh.textures.empty() && !mesh.texture_coordinates.empty();
  if (textured) {
    std::vector<Eigen::Vector2f> uvs;
    uvs.reserve(mesh.texture_coordinates.size());
    for (const Eigen::Vector2f& uv : mesh.texture_coordinates) {
      uvs.emplace_back(uv.x(), 1 - uv.y());  // glTF's v is 0 at the picture's first row
    }
    attributes["TEXCOORD_0"] =
        glb.AddAccessor(std::span<const Eigen::Vector2f>(uvs), kFloat, "VEC2");
  }
  if (!mesh.vertex_colors_rgb.empty()) {
    std::vector<std::array<uint16_t, 4>> colors;
    colors.reserve(mesh.vertex_colors_rgb.size());
    for (const auto& [r, g, b] : mesh.vertex_colors_rgb) {
      colors.push_back({LinearFromSrgb(r), LinearFromSrgb(g), LinearFromSrgb(b), 65535});
    }
    attributes["COLOR_0"] = glb.AddAccessor(std::span<const std::array<uint16_t, 4>>(colors),
                                            kUint16, "VEC4", {{"normalized", true}});
  }
  std::map<int32_t, std::vector<uint32_t>> corners_of_texture;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    std::vector<uint32_t>& corners = corners_of_texture[textured ? mesh.triangle_textures[i] : -1];
    corners.insert(corners.end(), mesh.triangles[i].begin(), mesh.triangles[i].end());
  }
  Json primitives = Json::array();
  for (const auto& [texture, corners] : corners_of_texture) {
    size_t material = 0;
    if (texture >= 0) {
      const std::string jpeg = EncodeTexture(file, mesh.textures[static_cast<size_t>(texture)]);
      const size_t image = glb.Add(
          "images",
          {{"bufferView", glb.AddView(std::span<const char>(jpeg))}, {"mimeType", "image/jpeg"}});
      const size_t source = glb.Add("textures", {{"source", image}});
      material = glb.AddUnlit({{"baseColorTexture", {{"index", source}}}});
    } else if (!mesh.vertex_colors_rgb.empty()) {
      material = glb.AddUnlit({{"baseColorFactor", {1, 1, 1, 1}}});
    } else {
      material = glb.Add("materials", {{"pbrMetallicRoughness",
                                        {{"baseColorFactor", {0.5, 0.5, 0.5, 1}},
                                         {"metallicFactor", 0},
                                         {"roughnessFactor", 1}}},
                                       {"doubleSided", true}});
    }
    primitives.push_back(
        {{"attributes", attributes},
         {"indices", glb.AddAccessor(std::span<const uint32_t>(corners), kUint32, "SCALAR")},
         {"material", material}});
  }
  return glb.Add("meshes", {{"primitives", primitives}});
}

// Returns what a corner of the image sees at the depth z = 1. Where the lens looks too far to the
// side for that, something nearer to the middle.
Eigen::Vector3d RayThroughCorner(const Camera& camera, const Eigen::Vector2d& corner_px) {
  constexpr double kMinZ = 0.1;
  const Eigen::Vector2d middle(0.5 * camera.width_px(), 0.5 * camera.height_px());
  for (const double share : {1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1}) {
    const auto ray = camera.RayInCam(middle + share * (corner_px - middle));
    if (ray && ray->z() > kMinZ) return *ray / ray->z();
  }
  return Eigen::Vector3d::UnitZ();
}

// Returns a point in the axes of glTF's cameras, which look along -z, y up.
Eigen::Vector3f InGlAxes(const Eigen::Vector3d& point_in_cam) {
  return {static_cast<float>(point_in_cam.x()), static_cast<float>(-point_in_cam.y()),
          static_cast<float>(-point_in_cam.z())};
}

// Adds a frustum, with a triangle above it that shows where up is in the image.
size_t AddFrustum(const Camera& camera, double size, size_t material, GlbFile& glb) {
  const double w = camera.width_px(), h = camera.height_px();
  std::vector<Eigen::Vector3f> points = {Eigen::Vector3f::Zero()};
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(0, 0), Eigen::Vector2d(w, 0),
                                        Eigen::Vector2d(w, h), Eigen::Vector2d(0, h)}) {
    points.push_back(InGlAxes(size * RayThroughCorner(camera, corner)));
  }
  points.push_back(0.5f * (points[1] + points[2]) + 0.25f * (points[1] - points[4]));
  const std::vector<uint32_t> lines = {0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1, 1, 5, 5, 2};
  Json primitive = {{"attributes", {{"POSITION", glb.AddPositions(points)}}},
                    {"indices", glb.AddAccessor(std::span(lines), kUint32, "SCALAR")},
                    {"material", material},
                    {"mode", kLines}};
  return glb.Add("meshes", {{"primitives", Json::array({std::move(primitive)})}});
}

size_t AddPinhole(const Camera& camera, double size, GlbFile& glb) {
  const double up = 0.5 * camera.height_px() / camera.focal_y_px();
  const double aside = 0.5 * camera.width_px() / camera.focal_x_px();
  return glb.Add(
      "cameras",
      {{"type", "perspective"},
       {"perspective",
        {{"yfov", 2 * std::atan(up)}, {"aspectRatio", aside / up}, {"znear", 0.01 * size}}}});
}

double FrustumSize(const TriangleMesh* mesh, std::span<const GlbCamera> cameras) {
  Eigen::AlignedBox3d box;
  for (const GlbCamera& camera : cameras) box.extend(camera.image.cam_from_world.OriginInSource());
  double extent = cameras.empty() ? 0 : box.diagonal().norm();
  if (!(extent > 0) && mesh != nullptr) {
    Eigen::AlignedBox3f of_mesh;
    for (const Eigen::Vector3f& vertex : mesh->vertices) of_mesh.extend(vertex);
    if (!of_mesh.isEmpty()) extent = of_mesh.diagonal().norm();
  }
  return extent > 0 ? 0.05 * extent : 1;
}

Eigen::Vector3d OriginOf(const TriangleMesh* mesh, std::span<const GlbCamera> cameras) {
  if (mesh != nullptr) return mesh->origin_in_world;
  if (cameras.empty()) return Eigen::Vector3d::Zero();
  return cameras.front().image.cam_from_world.OriginInSource();
}

// Adds the nodes of all cameras of a kind; those of equal lenses share their meshes.
Json AddCameras(std::span<const GlbCamera> cameras, GlbCameraKind kind,
                const Eigen::Vector3d& origin, double size, GlbFile& glb) {
  const Eigen::Quaterniond cam_from_gl(0, 1, 0, 0);  // half a turn about x
  Json nodes = Json::array();
  std::optional<size_t> material;
  struct Shown {
    size_t frustum, pinhole;
  };
  std::map<std::string, Shown> shown_of_lens;
  for (const GlbCamera& camera : cameras) {
    if (camera.kind != kind) continue;
    if (!material) {
      const auto [r, g, b] = ColorOf(kind);
      material = glb.AddUnlit({{"baseColorFactor", {r, g, b, 1}}});
    }
    const Camera& lens = camera.image.camera;
    const auto [shown, is_new] = shown_of_lens.try_emplace(lens.ToString());
    if (is_new) {
      shown->second = {AddFrustum(lens, size, *material, glb), AddPinhole(lens, size, glb)};
    }
    const Rigid3 world_from_cam = camera.image.cam_from_world.Inverse();
    nodes.push_back(glb.Add("nodes", {{"name", camera.image.name},
                                      {"translation", ToJson(world_from_cam.translation - origin)},
                                      {"rotation", ToJson(world_from_cam.rotation * cam_from_gl)},
                                      {"mesh", shown->second.frustum},
                                      {"camera", shown->second.pinhole}}));
  }
  return nodes;
}

}  // namespace

void WriteGlb(const path& file, const TriangleMesh* mesh, std::span<const GlbCamera> cameras,
              const GlbOptions& options) {
  if (mesh != nullptr && mesh->triangles.empty()) mesh = nullptr;
  if (mesh == nullptr && cameras.empty()) throw InputError(file, "there is nothing to write");
  GlbFile glb;
  const Eigen::Vector3d origin = OriginOf(mesh, cameras);
  const double size = options.frustum_size.value_or(FrustumSize(mesh, cameras));
  Json children = Json::array();
  if (mesh != nullptr) {
    children.push_back(
        glb.Add("nodes", {{"name", "geometry"}, {"mesh", AddMesh(file, *mesh, glb)}}));
  }
  for (const EnumName<GlbCameraKind>& kind : kEnumNames<GlbCameraKind>) {
    Json nodes = AddCameras(cameras, kind.value, origin, size, glb);
    if (nodes.empty()) continue;
    children.push_back(glb.Add("nodes", {{"name", kind.name}, {"children", std::move(nodes)}}));
  }
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  if (options.up_in_world) {
    turn.setFromTwoVectors(*options.up_in_world, Eigen::Vector3d::UnitY());
  }
  const size_t root = glb.Add("nodes", {{"name", "scene"},
                                        {"translation", ToJson(turn * origin)},
                                        {"rotation", ToJson(turn)},
                                        {"children", std::move(children)}});
  glb.json["scenes"] = Json::array({Json{{"nodes", Json::array({root})}}});
  glb.json["scene"] = 0;
  glb.Write(file);
}

}  // namespace raylift
