#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using nlohmann::json;

// The list that the numbers of a member are indices into, wherever the member stands.
constexpr auto kListOfMember = std::to_array<std::pair<std::string_view, std::string_view>>(
    {{"buffer", "buffers"},
     {"bufferView", "bufferViews"},
     {"mesh", "meshes"},
     {"material", "materials"},
     {"indices", "accessors"},
     {"input", "accessors"},
     {"output", "accessors"},
     {"inverseBindMatrices", "accessors"},
     {"skin", "skins"},
     {"camera", "cameras"},
     {"scene", "scenes"},
     {"source", "images"},
     {"index", "textures"},
     {"nodes", "nodes"},
     {"children", "nodes"},
     {"joints", "nodes"},
     {"skeleton", "nodes"},
     {"node", "nodes"}});

// The JSON of a glTF file, whose members are looked at with messages that name their place.
class GltfDocument {
 public:
  GltfDocument(const std::filesystem::path& path, std::string_view contents)
      : path_(path), contents_(contents) {
    root_ = Parse(contents_.starts_with("glTF") ? TakeJsonOfBinary() : contents_);
    CheckVersion();
  }

  [[noreturn]] void Fail(std::string_view place, std::string_view message) const {
    throw InputError(path_, place, message);
  }

  const json& root() const { return root_; }
  size_t size_bytes() const { return contents_.size(); }

  // Returns a list of objects; an empty one where there is none.
  const json& List(const std::string& name) const {
    static const json kNone = json::array();
    const auto found = root_.find(name);
    const json& list = found == root_.end() ? kNone : *found;
    const bool good =
        list.is_array() &&
        std::all_of(list.begin(), list.end(), [](const json& item) { return item.is_object(); });
    if (!good) Fail(name, "expected a list of objects");
    return list;
  }

  void CheckIndex(const std::string& place, const json& index, std::string_view list) const {
    const size_t count = List(std::string(list)).size();
    if (!index.is_number_unsigned() || index.get<uint64_t>() >= count) {
      Fail(place, fmt::format("expected an index of one of {} {}", count, list));
    }
  }

  // Returns a number of bytes or items; `missing` where there is none.
  uint64_t Count(const std::string& place, const json& object, const char* member,
                 uint64_t missing) const {
    constexpr uint64_t kMost = UINT32_MAX;
    const auto value = object.find(member);
    if (value == object.end()) return missing;
    if (!value->is_number_unsigned() || value->get<uint64_t>() > kMost) {
      Fail(fmt::format("{}.{}", place, member), "expected a number up to 4294967295");
    }
    return value->get<uint64_t>();
  }

  // Returns how many bytes a buffer can have.
  uint64_t RoomOf(const json& buffer) const {
    if (!buffer.contains("uri")) return data_.size();
    const std::string uri = buffer["uri"].is_string() ? buffer["uri"].get<std::string>() : "";
    if (uri.starts_with("data:")) return uri.size();
    std::error_code error;
    const auto size = std::filesystem::file_size(path_.parent_path() / uri, error);
    return error ? contents_.size() : size;  // a missing file is assimp's to tell
  }

 private:
  void CheckVersion() const {
    const auto asset = root_.find("asset");
    const bool is_object = asset != root_.end() && asset->is_object();
    const json version = is_object ? asset->value("version", json()) : json();
    if (!version.is_string() || !version.get<std::string>().starts_with("2.")) {
      Fail("asset.version", "expected glTF 2");
    }
  }

  // A header of the magic word, the version and the file's size, then a chunk of JSON and one of
  // data, each of a length, a name and its bytes.
  std::string_view TakeJsonOfBinary() {
    constexpr size_t kHeader = 12;
    uint32_t version = 0;
    if (contents_.size() >= kHeader) std::memcpy(&version, contents_.data() + 4, sizeof(version));
    if (version == 1) Fail("version", "expected glTF 2, found 1");
    std::string_view rest = contents_.substr(std::min(kHeader, contents_.size()));
    const std::string_view text = TakeChunk(rest, "JSON");
    if (!rest.empty()) data_ = TakeChunk(rest, std::string_view("BIN\0", 4));
    return text;
  }

  std::string_view TakeChunk(std::string_view& rest, std::string_view name) const {
    uint32_t size = 0;
    if (rest.size() >= 8) std::memcpy(&size, rest.data(), sizeof(size));
    if (rest.size() < 8 || rest.substr(4, 4) != name || size > rest.size() - 8) {
      Fail(
          fmt::format("chunk {}", name.substr(0, name.find('\0'))),
          fmt::format("expected it with all its {} bytes, the file is damaged or truncated", size));
    }
    const std::string_view chunk = rest.substr(8, size);
    rest.remove_prefix(8 + size);
    return chunk;
  }

  // Assimp's parser has a limit to nesting in the stack, and takes the first of equal members.
  json Parse(std::string_view text) const {
    std::vector<std::set<std::string>> members;
    const auto check = [&](int depth, json::parse_event_t event, json& value) {
      if (depth > kMaxJsonNesting) Fail("JSON", "lists and objects are nested too deep");
      if (event == json::parse_event_t::object_start) members.emplace_back();
      if (event == json::parse_event_t::object_end) members.pop_back();
      if (event == json::parse_event_t::key &&
          !members.back().insert(value.get<std::string>()).second) {
        Fail("JSON", "a member stands twice in an object");
      }
      return true;
    };
    json root = json::parse(text, check, /*allow_exceptions=*/false);
    if (!root.is_object()) Fail("JSON", "expected an object, the file is damaged or truncated");
    return root;
  }

  const std::filesystem::path& path_;
  std::string_view contents_;
  std::string_view data_;  // the second chunk of a binary file
  json root_;
};

class GltfCheck {
 public:
  GltfCheck(const GltfDocument& document, GltfPlace place) : document_(document), place_(place) {}

  void Run() {
    CheckExtensions();
    for (const auto& [member, value] : document_.root().items()) {
      CheckReferences(member, member, value);
    }
    CheckPlaces("buffers");
    CheckPlaces("images");
    CheckBuffers();
    CheckAccessors();
    CheckNodes();
  }

 private:
  // Extensions that the geometry and its base color need nothing of are left to assimp.
  void CheckExtensions() const {
    const auto required = document_.root().find("extensionsRequired");
    if (required == document_.root().end()) return;
    if (!required->is_array()) document_.Fail("extensionsRequired", "expected a list of names");
    for (const json& extension : *required) {
      const std::string name = extension.is_string() ? extension.get<std::string>() : "";
      const bool known = name == "CESIUM_RTC" || name == "KHR_texture_transform" ||
                         name == "KHR_lights_punctual" || name.starts_with("KHR_materials_");
      if (!known) {
        document_.Fail("extensionsRequired",
                       fmt::format("the file requires {}, which is not read; write it without",
                                   name.empty() ? "an extension without a name" : name));
      }
    }
  }

  void CheckReferences(const std::string& place, std::string_view member, const json& value) const {
    if (member == "extras") return;
    const auto known = std::find_if(kListOfMember.begin(), kListOfMember.end(),
                                    [&](const auto& entry) { return entry.first == member; });
    if (value.is_structured()) {
      const bool is_attributes = member == "attributes" || member == "targets";
      for (const auto& [key, inner] : value.items()) {
        const std::string inner_place = place + "." + key;
        if (inner.is_number() && is_attributes) {
          document_.CheckIndex(inner_place, inner, "accessors");
        } else if (inner.is_number() && value.is_array() && known != kListOfMember.end()) {
          document_.CheckIndex(inner_place, inner, known->second);
        } else {
          CheckReferences(inner_place, value.is_array() ? member : std::string_view(key), inner);
        }
      }
    } else if (known != kListOfMember.end()) {
      document_.CheckIndex(place, value, known->second);
    }
  }

  // What is shown as a picture or written as a mesh may not be any file of this machine.
  void CheckPlaces(const std::string& list) const {
    const json& objects = document_.List(list);
    for (size_t i = 0; i < objects.size(); ++i) {
      const auto uri = objects[i].find("uri");
      if (uri == objects[i].end() || !uri->is_string()) continue;
      const auto& stated = uri->get_ref<const std::string&>();
      if (stated.empty() || stated.starts_with("data:")) continue;
      if (list == "buffers" && place_ == GltfPlace::kPartOfFile) {
        document_.Fail(fmt::format("{}.{}.uri", list, i), "expected the bytes in the file itself");
      }
      const std::string text = DecodedUri(stated);
      if (MayBeRead(text)) continue;
      document_.Fail(fmt::format("{}.{}.uri", list, i),
                     fmt::format("expected a file below the scene's folder, found {}; "
                                 "RAYLIFT_FILES_ANYWHERE=1 in the environment allows it",
                                 Shown(text)));
    }
  }

  void CheckBuffers() const {
    const json &buffers = document_.List("buffers"), &views = document_.List("bufferViews");
    for (size_t i = 0; i < buffers.size(); ++i) {
      const std::string place = fmt::format("buffers.{}", i);
      const uint64_t size = document_.Count(place, buffers[i], "byteLength", 0);
      if (const uint64_t room = document_.RoomOf(buffers[i]); size > room) {
        document_.Fail(place, fmt::format("it claims {} bytes, there are {}", size, room));
      }
    }
    for (size_t i = 0; i < views.size(); ++i) {
      const std::string place = fmt::format("bufferViews.{}", i);
      const auto buffer = views[i].find("buffer");
      if (buffer == views[i].end()) document_.Fail(place, "expected the member buffer");
      const uint64_t end = document_.Count(place, views[i], "byteOffset", 0) +
                           document_.Count(place, views[i], "byteLength", 0);
      const uint64_t room = document_.Count(place, buffers[buffer->get<size_t>()], "byteLength", 0);
      if (end > room)
        document_.Fail(place, fmt::format("it ends at {}, its buffer at {}", end, room));
    }
  }

  // Returns the bytes of one component; 0 for an unknown type.
  static uint64_t BytesOf(uint64_t component_type) {
    constexpr uint64_t kFirst = 5120;
    constexpr std::array<uint64_t, 7> kBytes = {1, 1, 2, 2, 0, 4, 4};
    const uint64_t index = component_type - kFirst;
    return index < kBytes.size() ? kBytes[index] : 0;
  }

  static uint64_t NumComponents(const json& accessor) {
    static constexpr std::pair<std::string_view, uint64_t> kTypes[] = {
        {"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4},
        {"MAT2", 4},   {"MAT3", 9}, {"MAT4", 16}};
    for (const auto& [name, count] : kTypes) {
      if (accessor.value("type", json()) == name) return count;
    }
    return 0;
  }

  // Checks that `count` items of some bytes each are in the view that `object` names.
  void CheckRoom(const std::string& place, const json& object, uint64_t count,
                 uint64_t item_bytes) const {
    const auto view = object.find("bufferView");
    uint64_t room = document_.size_bytes(), offset = 0, stride = item_bytes;
    if (view != object.end()) {
      const json& views = document_.List("bufferViews");
      const json& of_object = views[view->get<size_t>()];
      room = document_.Count(place, of_object, "byteLength", 0);
      offset = document_.Count(place, object, "byteOffset", 0);
      stride = document_.Count(place, of_object, "byteStride", item_bytes);
    }
    const uint64_t end = offset + (count - 1) * stride + item_bytes;
    if (stride < item_bytes || end > room) {
      document_.Fail(place, fmt::format("its {} items end at {} bytes of {}", count, end, room));
    }
  }

  void CheckAccessors() const {
    const json& accessors = document_.List("accessors");
    for (size_t i = 0; i < accessors.size(); ++i) {
      const std::string place = fmt::format("accessors.{}", i);
      const json& accessor = accessors[i];
      const uint64_t item_bytes =
          BytesOf(document_.Count(place, accessor, "componentType", 0)) * NumComponents(accessor);
      if (item_bytes == 0) document_.Fail(place, "expected a known componentType and type");
      const uint64_t count = document_.Count(place, accessor, "count", 0);
      if (count == 0) document_.Fail(place, "expected a count of 1 or more");
      CheckRoom(place, accessor, count, item_bytes);
      if (accessor.contains("sparse"))
        CheckSparse(place + ".sparse", accessor["sparse"], count, item_bytes);
    }
  }

  void CheckSparse(const std::string& place, const json& sparse, uint64_t count,
                   uint64_t item_bytes) const {
    const json indices = sparse.is_object() ? sparse.value("indices", json()) : json();
    const json values = sparse.is_object() ? sparse.value("values", json()) : json();
    if (!indices.is_object() || !values.is_object() || !indices.contains("bufferView") ||
        !values.contains("bufferView")) {
      document_.Fail(place, "expected indices and values in buffer views");
    }
    const uint64_t num_changed = document_.Count(place, sparse, "count", 0);
    const uint64_t index_bytes = BytesOf(document_.Count(place, indices, "componentType", 0));
    if (num_changed == 0 || num_changed > count || index_bytes == 0) {
      document_.Fail(place, "expected a count and a known componentType");
    }
    CheckRoom(place + ".indices", indices, num_changed, index_bytes);
    CheckRoom(place + ".values", values, num_changed, item_bytes);
  }

  void CheckNodes() const {
    const json &nodes = document_.List("nodes"), &scenes = document_.List("scenes");
    std::vector<bool> has_parent(nodes.size());
    for (const json& node : nodes) {
      for (const json& child : node.value("children", json::array())) {
        if (has_parent[child.get<size_t>()]) document_.Fail("nodes", "a node is the child of two");
        has_parent[child.get<size_t>()] = true;
      }
    }
    std::vector<std::pair<size_t, size_t>> open;  // nodes and their depths
    for (const json& scene : scenes) {
      for (const json& node : scene.value("nodes", json::array())) {
        if (has_parent[node.get<size_t>()])
          document_.Fail("scenes", "a node of a scene is a child of another");
        open.emplace_back(node.get<size_t>(), 0);
      }
    }
    while (!open.empty()) {
      const auto [node, depth] = open.back();
      open.pop_back();
      if (depth > kMaxGltfNodeNesting)
        document_.Fail("nodes",
                       fmt::format("they are nested more than {} deep", kMaxGltfNodeNesting));
      for (const json& child : nodes[node].value("children", json::array())) {
        open.emplace_back(child.get<size_t>(), depth + 1);
      }
    }
  }

  const GltfDocument& document_;
  GltfPlace place_;
};

// Returns the numbers of a member, as many as `missing` has, which it returns where there is none.
std::vector<double> Numbers(const GltfDocument& document, const std::string& place,
                            const json& object, const char* member,
                            const std::vector<double>& missing) {
  const auto found = object.find(member);
  if (found == object.end()) return missing;
  std::vector<double> numbers;
  if (found->is_array()) {
    for (const json& number : *found) {
      if (number.is_number()) numbers.push_back(number.get<double>());
    }
  }
  if (numbers.size() != missing.size() || numbers.size() != found->size()) {
    document.Fail(fmt::format("{}.{}", place, member),
                  fmt::format("expected {} numbers", missing.size()));
  }
  return numbers;
}

// A matrix in column order, or translation * rotation (x, y, z, w) * scale.
Eigen::Affine3d PlaceOf(const GltfDocument& document, const std::string& place, const json& node) {
  Eigen::Affine3d transform = Eigen::Affine3d::Identity();
  if (node.contains("matrix")) {
    const auto m = Numbers(document, place, node, "matrix", std::vector<double>(16));
    transform.matrix() = Eigen::Map<const Eigen::Matrix4d>(m.data());
    return transform;
  }
  const auto t = Numbers(document, place, node, "translation", {0, 0, 0});
  const auto r = Numbers(document, place, node, "rotation", {0, 0, 0, 1});
  const auto s = Numbers(document, place, node, "scale", {1, 1, 1});
  return transform.translate(Eigen::Vector3d(t[0], t[1], t[2]))
      .rotate(Eigen::Quaterniond(r[3], r[0], r[1], r[2]).normalized())
      .scale(Eigen::Vector3d(s[0], s[1], s[2]));
}

// translation * rotation * scale, where the rotation is counter-clockwise as a picture is looked
// at.
Eigen::Affine2d UvTransformOf(const GltfDocument& document, const std::string& place,
                              const json& material) {
  const json none = json::object();
  const json* part = &material;
  for (const char* member :
       {"pbrMetallicRoughness", "baseColorTexture", "extensions", "KHR_texture_transform"}) {
    const auto found = part->find(member);
    part = found != part->end() && found->is_object() ? &*found : &none;
  }
  const auto offset = Numbers(document, place, *part, "offset", {0, 0});
  const auto scale = Numbers(document, place, *part, "scale", {1, 1});
  const json rotation = part->value("rotation", json(0.0));
  if (!rotation.is_number()) document.Fail(place + ".rotation", "expected a number");
  return Eigen::Translation2d(offset[0], offset[1]) * Eigen::Rotation2Dd(-rotation.get<double>()) *
         Eigen::Scaling(scale[0], scale[1]);
}

std::vector<size_t> Indices(const json& object, const char* member) {
  std::vector<size_t> indices;
  for (const json& index : object.value(member, json::array())) {
    indices.push_back(index.get<size_t>());
  }
  return indices;
}

GltfScene SceneOf(const GltfDocument& document) {
  GltfScene scene;
  const json &nodes = document.List("nodes"), &scenes = document.List("scenes");
  for (size_t i = 0; i < nodes.size(); ++i) {
    const std::string place = fmt::format("nodes.{}", i);
    scene.nodes.push_back({PlaceOf(document, place, nodes[i]), Indices(nodes[i], "children")});
    if (nodes[i].value("extensions", json()).contains("EXT_mesh_gpu_instancing")) {
      scene.warnings.push_back(
          place +
          ": its instances (EXT_mesh_gpu_instancing) are not read, its mesh stands there once");
    }
  }
  if (!scenes.empty()) {
    const json shown = document.root().value("scene", json(0u));
    scene.roots = Indices(scenes[shown.is_number_unsigned() ? shown.get<size_t>() : 0], "nodes");
  }
  const json extensions = document.root().value("extensions", json());
  const json center = extensions.is_object() ? extensions.value("CESIUM_RTC", json()) : json();
  const auto numbers = Numbers(document, "extensions.CESIUM_RTC", center, "center", {0, 0, 0});
  scene.center = {numbers[0], numbers[1], numbers[2]};
  const json& materials = document.List("materials");
  for (size_t i = 0; i < materials.size(); ++i) {
    scene.uv_transforms.push_back(
        UvTransformOf(document, fmt::format("materials.{}", i), materials[i]));
  }
  return scene;
}

}  // namespace

GltfScene ReadGltfScene(const std::filesystem::path& path, std::string_view contents,
                        GltfPlace place) {
  const GltfDocument document(path, contents);
  GltfCheck(document, place).Run();
  return SceneOf(document);
}

}  // namespace raylift
