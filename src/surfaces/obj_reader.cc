#include <map>

#include "surfaces/file_readers.h"
#include "surfaces/raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

Rgb RgbFromUnit(double red, double green, double blue) {
  return {NearestByte(red * 255), NearestByte(green * 255), NearestByte(blue * 255)};
}

// Returns the text behind the keyword, as written: file names may hold blanks.
std::string_view Rest(std::string_view line, std::string_view keyword) {
  return Trim(line.substr(static_cast<size_t>(keyword.data() - line.data()) + keyword.size()));
}

// Returns the file name of a texture statement; options (-s 1 1 1, -bm 0.5, ...) stand before it.
std::string_view TextureName(std::string_view line, const std::vector<std::string_view>& tokens) {
  return tokens.size() > 1 && !tokens[1].starts_with('-') ? Rest(line, tokens[0]) : tokens.back();
}

class ObjParser {
 public:
  explicit ObjParser(const std::filesystem::path& path) : path_(path), reader_(path) {}

  RawMesh Parse() {
    while (const auto line = reader_.NextContent()) ParseLine(*line);
    if (mesh_.uvs.empty()) mesh_.triangle_uvs.clear();
    if (too_small_ > 0) {
      mesh_.warnings.push_back(fmt::format("{}: {} faces skipped: fewer than three corners",
                                           path_.string(), too_small_));
    }
    return std::move(mesh_);
  }

 private:
  void ParseLine(std::string_view line) {
    const auto tokens = SplitTokens(line);
    if (tokens.empty()) return;
    if (tokens[0] == "v") {
      ParseVertex(tokens);
    } else if (tokens[0] == "vt") {
      ParseTextureCoordinate(tokens);
    } else if (tokens[0] == "f") {
      ParseFace(tokens);
    } else if (tokens[0] == "usemtl") {
      // One that no file tells of still has a name.
      material_ = MaterialOf(Rest(line, tokens[0]), material_by_name_, mesh_);
    } else if (tokens[0] == "o" || tokens[0] == "g") {
      (tokens[0] == "o" ? object_ : group_) = Rest(line, tokens[0]);
      part_ = PartOf(object_, group_);
    } else if (tokens[0] == "mtllib") {
      ReadMaterials(std::string(Rest(line, tokens[0])));
    }
  }

  // Returns the part that faces of this object and group are; a name that comes again is the same.
  uint32_t PartOf(const std::string& object, const std::string& group) {
    std::string name = PartName(object, group);
    if (name.empty()) return RawMesh::kNone;
    const auto next = static_cast<uint32_t>(mesh_.parts.size());
    const auto [entry, is_new] = part_by_name_.try_emplace(name, next);
    if (is_new) mesh_.parts.push_back(std::move(name));
    return entry->second;
  }

  // "nan" is a number here: such vertices are counted and dropped later, with their triangles.
  double Number(std::string_view token, std::string_view field) const {
    const auto value = ParseDouble(token);
    if (!value) {
      reader_.Fail(fmt::format("{}: expected a number, found \"{}\"", field, token));
    }
    return *value;
  }

  void ParseVertex(const std::vector<std::string_view>& tokens) {
    if (tokens.size() < 4) {
      reader_.Fail(fmt::format("expected \"v X Y Z\", found {} numbers", tokens.size() - 1));
    }
    mesh_.positions.emplace_back(Number(tokens[1], "x"), Number(tokens[2], "y"),
                                 Number(tokens[3], "z"));
    if (tokens.size() >= 7) {
      mesh_.position_colors.resize(mesh_.positions.size() - 1, Rgb{204, 204, 204});
      mesh_.position_colors.push_back(RgbFromUnit(
          Number(tokens[4], "red"), Number(tokens[5], "green"), Number(tokens[6], "blue")));
    } else if (!mesh_.position_colors.empty()) {
      mesh_.position_colors.push_back({204, 204, 204});
    }
    if (mesh_.positions.size() >= RawMesh::kNone) reader_.Fail("too many vertices");
  }

  void ParseTextureCoordinate(const std::vector<std::string_view>& tokens) {
    if (tokens.size() < 2) reader_.Fail("expected \"vt U V\", found no numbers");
    const double v = tokens.size() > 2 ? Number(tokens[2], "v") : 0;
    mesh_.uvs.emplace_back(static_cast<float>(Number(tokens[1], "u")), static_cast<float>(v));
  }

  // Returns the index, from 0, that a token counts from 1, or from the end where it is negative.
  uint32_t Index(std::string_view token, size_t count, std::string_view what) const {
    const auto value = ParseInt(token);
    const auto limit = static_cast<int64_t>(count);
    if (!value || *value == 0 || *value > limit || *value < -limit) {
      reader_.Fail(fmt::format("face {}: expected a {} index in 1..{}, found \"{}\"", num_faces_,
                               what, count, token));
    }
    return static_cast<uint32_t>(*value > 0 ? *value - 1 : limit + *value);
  }

  void ParseFace(const std::vector<std::string_view>& tokens) {
    ++num_faces_;
    corners_.clear();
    corner_uvs_.clear();
    for (size_t k = 1; k < tokens.size(); ++k) {
      const std::string_view token = tokens[k];
      const size_t slash = token.find('/');
      corners_.push_back(Index(token.substr(0, slash), mesh_.positions.size(), "vertex"));
      std::string_view uv;
      if (slash != std::string_view::npos) {
        uv = token.substr(slash + 1);
        uv = uv.substr(0, uv.find('/'));
      }
      corner_uvs_.push_back(uv.empty() ? RawMesh::kNone
                                       : Index(uv, mesh_.uvs.size(), "texture coordinate"));
    }
    if (corners_.size() < 3) {
      ++too_small_;
      return;
    }
    const size_t added = AddFace(num_faces_ - 1, corners_, corner_uvs_, mesh_);
    mesh_.triangle_materials.insert(mesh_.triangle_materials.end(), added, material_);
    if (mesh_.parts.empty()) return;  // the first named part is still to come
    mesh_.triangle_parts.resize(mesh_.triangles.size() - added, RawMesh::kNone);
    mesh_.triangle_parts.insert(mesh_.triangle_parts.end(), added, part_);
  }

  // A name with blanks is one file where that exists, else several files.
  void ReadMaterials(const std::string& names) {
    if (Exists(path_.parent_path() / names)) {
      ReadMaterialFile(names);
      return;
    }
    for (const std::string_view name : SplitTokens(names)) ReadMaterialFile(std::string(name));
  }

  void ReadMaterialFile(const std::string& name) {
    if (!IsBelow(path_, "material file", name, mesh_)) return;
    const std::filesystem::path path = path_.parent_path() / name;
    if (!IsFile(path)) {
      mesh_.warnings.push_back(
          fmt::format("{}: material file {}: no such file", path_.string(), path.string()));
      return;
    }
    LineReader reader(path);
    RawMesh::Material* material = nullptr;
    while (const auto line = reader.NextContent()) {
      const auto tokens = SplitTokens(*line);
      if (tokens.size() < 2) continue;
      if (tokens[0] == "newmtl") {
        const auto next = static_cast<uint32_t>(mesh_.materials.size());
        material = &mesh_.materials.emplace_back();
        material->name = Rest(*line, tokens[0]);
        material_by_name_[material->name] = next;
      } else if (material != nullptr && tokens[0] == "Kd" && tokens.size() >= 4) {
        material->color_rgb =
            RgbFromUnit(reader.Double(tokens[1], "Kd"), reader.Double(tokens[2], "Kd"),
                        reader.Double(tokens[3], "Kd"));
      } else if (material != nullptr && tokens[0] == "map_Kd") {
        material->texture = Texture(std::string(TextureName(*line, tokens)));
      }
    }
  }

  int32_t Texture(const std::string& name) {
    const auto [entry, is_new] = texture_by_name_.try_emplace(name, -1);
    if (is_new) entry->second = AddTextureFile(path_, name, mesh_);
    return entry->second;
  }

  const std::filesystem::path& path_;
  LineReader reader_;
  RawMesh mesh_;
  uint32_t material_ = RawMesh::kNone, part_ = RawMesh::kNone;
  std::string object_, group_;
  std::map<std::string, uint32_t> part_by_name_;
  std::map<std::string, uint32_t, std::less<>> material_by_name_;
  std::map<std::string, int32_t> texture_by_name_;
  size_t num_faces_ = 0;
  size_t too_small_ = 0;
  std::vector<uint32_t> corners_;
  std::vector<uint32_t> corner_uvs_;
};

}  // namespace

RawMesh ReadObj(const std::filesystem::path& path) { return ObjParser(path).Parse(); }

}  // namespace raylift
