// ReadMesh on what glTF has for large scenes: compressed and quantized meshes, instances, the forms
// of triangles and of buffers.

#include <cmath>
#include <cstring>
#include <numbers>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include "surfaces/gltf_file.h"
#include "tileset_files.h"
#include <Eigen/Geometry>
#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Corner = Eigen::Vector3d;

// A document with one mesh, put together from its parts.
class Gltf {
 public:
  // Returns the index of a view of these bytes.
  int AddView(const std::string& bytes, const std::string& members = "") {
    views_ += fmt::format(R"({}{{"buffer":0,"byteOffset":{},"byteLength":{}{}}})",
                          num_views_ == 0 ? "" : ",", bin_.size(), bytes.size(), members);
    bin_ += bytes;
    bin_.resize((bin_.size() + 3) / 4 * 4);
    return num_views_++;
  }

  template <typename T>
  int AddAccessor(const std::vector<T>& numbers, int component_type, const std::string& type,
                  size_t count, const std::string& members = "") {
    std::string bytes;
    for (const T number : numbers) AppendBytes(bytes, number);
    return AddAccessorOf(AddView(bytes), component_type, type, count, members);
  }
  int AddAccessorOf(int view, int component_type, const std::string& type, size_t count,
                    const std::string& members = "") {
    accessors_ += fmt::format(R"({}{{{}"componentType":{},"type":"{}","count":{}{}}})",
                              num_accessors_ == 0 ? "" : ",",
                              view < 0 ? "" : fmt::format(R"("bufferView":{},)", view),
                              component_type, type, count, members);
    return num_accessors_++;
  }

  int AddFloats(const std::vector<float>& numbers, const std::string& type, size_t components) {
    return AddAccessor(numbers, 5126, type, numbers.size() / components);
  }

  // `primitive`, `node` and `root` have members.
  std::string Write(const std::string& primitive, const std::string& node = "",
                    const std::string& root = "") const {
    return GlbOf(Document(primitive, node, root, ""), bin_);
  }
  std::string Text(const std::string& primitive) const {
    return Document(
        primitive, "", "",
        fmt::format(R"("uri":"data:application/octet-stream;base64,{}",)", EncodeBase64(bin_)));
  }

 private:
  std::string Document(const std::string& primitive, const std::string& node,
                       const std::string& root, const std::string& uri) const {
    return fmt::format(
        R"({{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0{}}}],
"meshes":[{{"primitives":[{{{}}}]}}],"buffers":[{{{}"byteLength":{}}}],"bufferViews":[{}],
"accessors":[{}]{}}})",
        node, primitive, uri, bin_.size(), views_, accessors_, root);
  }

  std::string bin_, views_, accessors_;
  int num_views_ = 0, num_accessors_ = 0;
};

TriangleMesh ReadBytes(const std::string& contents, const std::string& name = "mesh.glb") {
  const auto path = TestFolder() / name;
  WriteFile(path, contents);
  return ReadMesh(path);
}

bool Fails(const std::string& contents, const std::string& message) {
  return static_cast<bool>(FailsWithInputError([&] { ReadBytes(contents); }, {message}));
}

// Two triangles that share an edge.
const std::vector<float> kQuad = {0, 0, 0, 1, 0, 0, 1, 2, 0, 0, 2, 0};
const std::vector<Corner> kQuadCorners = {{0, 0, 0}, {1, 0, 0}, {1, 2, 0},
                                          {0, 0, 0}, {1, 2, 0}, {0, 2, 0}};

std::string DracoBytes(const TilePatch& patch) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(static_cast<int>(patch.triangles.size()));
  const int position =
      builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  for (size_t i = 0; i < patch.triangles.size(); ++i) {
    const auto& [a, b, c] = patch.triangles[i];
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(static_cast<uint32_t>(i)),
                                      patch.vertices[a].data(), patch.vertices[b].data(),
                                      patch.vertices[c].data());
  }
  const auto mesh = builder.Finalize();
  draco::Encoder encoder;
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, 16);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
  return {buffer.data(), buffer.size()};
}

// A quad in Draco whose colors are 8 bits and are not said to be normalized, as its encoder for web
// pages writes them; texture coordinates lie beside it.
std::string ColoredDracoGlb() {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2);
  const int position =
      builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int color = builder.AddAttribute(draco::GeometryAttribute::COLOR, 3, draco::DT_UINT8);
  const std::array<uint8_t, 3> rgb = {255, 55, 0};
  for (uint32_t face = 0; face < 2; ++face) {
    std::array<Eigen::Vector3f, 3> corners;
    for (uint32_t k = 0; k < 3; ++k) corners[k] = kQuadCorners[3 * face + k].cast<float>();
    builder.SetAttributeValuesForFace(position, draco::FaceIndex(face), corners[0].data(),
                                      corners[1].data(), corners[2].data());
    builder.SetAttributeValuesForFace(color, draco::FaceIndex(face), rgb.data(), rgb.data(),
                                      rgb.data());
  }
  const auto mesh = builder.Finalize();
  draco::Encoder encoder;
  encoder.SetEncodingMethod(draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer buffer;
  EXPECT_TRUE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
  Gltf gltf;
  const int view = gltf.AddView({buffer.data(), buffer.size()});
  const int positions = gltf.AddAccessorOf(-1, 5126, "VEC3", 4);
  const int colors = gltf.AddAccessorOf(-1, 5121, "VEC3", 4, R"(,"normalized":true)");
  const int uvs = gltf.AddFloats(std::vector<float>(8, 0.25f), "VEC2", 2);
  return gltf.Write(fmt::format(
      R"("attributes":{{"POSITION":{},"COLOR_0":{},"TEXCOORD_0":{}}},"extensions":
{{"KHR_draco_mesh_compression":{{"bufferView":{},"attributes":{{"POSITION":0,"COLOR_0":1}}}}}})",
      positions, colors, uvs, view));
}

TEST(ReadGltfCompressed, ColorsOfDracoAndWhatLiesBesideItAreRead) {
  const TriangleMesh mesh = ReadBytes(ColoredDracoGlb());
  EXPECT_EQ(mesh.triangles.size(), 2u);
  ASSERT_EQ(mesh.vertices.size(), 4u);
  ASSERT_EQ(mesh.vertex_colors_rgb.size(), 4u);
  // 55 of 255 in linear light.
  EXPECT_EQ(mesh.vertex_colors_rgb[0], (std::array<uint8_t, 3>{255, 128, 0}));
  ASSERT_EQ(mesh.texture_coordinates.size(), 4u);
  EXPECT_EQ(mesh.texture_coordinates[0], Eigen::Vector2f(0.25f, 0.75f));
}

std::string DracoGlb(const std::string& bytes) {
  Gltf gltf;
  const int view = gltf.AddView(bytes);
  const int position = gltf.AddAccessorOf(-1, 5126, "VEC3", 6561);
  return gltf.Write(
      fmt::format(R"("attributes":{{"POSITION":{}}},"extensions":{{"KHR_draco_mesh_compression":
{{"bufferView":{},"attributes":{{"POSITION":0}}}}}})",
                  position, view),
      "", R"(,"extensionsRequired":["KHR_draco_mesh_compression"])");
}

// Draco orders triangles anew: the surface is compared by its area and by the nearest vertices.
TEST(ReadGltfCompressed, DracoGivesTheSurfaceWithinItsQuantization) {
  const TilePatch hills = HillPatch({3, 4});
  const TriangleMesh mesh = ReadBytes(DracoGlb(DracoBytes(hills)));
  ASSERT_EQ(mesh.triangles.size(), hills.triangles.size());
  const double step = 40.0 / 65535;
  double area = 0;
  for (const auto& [a, b, c] : hills.triangles) {
    area +=
        0.5 *
        (hills.vertices[b] - hills.vertices[a]).cross(hills.vertices[c] - hills.vertices[a]).norm();
  }
  EXPECT_NEAR(SurfaceArea(mesh), area, 1e-3 * area);
  for (uint32_t i = 0; i < mesh.vertices.size(); i += 97) {
    double nearest = 1e9;
    for (const auto& vertex : hills.vertices) {
      nearest = std::min(nearest, (vertex.cast<double>() - mesh.VertexInWorld(i)).norm());
    }
    EXPECT_LT(nearest, 2 * step);
  }
}

TEST(ReadGltfCompressed, DamagedDracoIsNamedOrRead) {
  const std::string good = DracoBytes(HillPatch({0, 0}));
  EXPECT_TRUE(Fails(DracoGlb(good.substr(0, good.size() / 2)), "KHR_draco_mesh_compression"));
  // The header, a traversal, and 2^31 - 1 vertices and faces.
  const std::string claim = "\xff\xff\xff\xff\x07";
  EXPECT_TRUE(Fails(DracoGlb(good.substr(0, 11) + '\0' + claim + claim), "claims 2147483647"));
  EXPECT_TRUE(Fails(DracoGlb(good.substr(0, 11) + '\0' + '\2' + claim), "claims 2147483647"));
  std::string old = good;
  old[6] = 1;  // the minor version
  EXPECT_TRUE(Fails(DracoGlb(old), "expected Draco's bitstream 2.2, as glTF has it, found 2.1"));
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    std::string bytes = good;
    for (int k = 0; k < 3; ++k) {
      bytes[rng.UniformIndex(k == 0 ? 60 : bytes.size())] =
          static_cast<char>(rng.UniformIndex(256));
    }
    try {
      ReadBytes(DracoGlb(bytes));
    } catch (const InputError&) {
    }
  }
}

struct MeshoptGlb {
  std::string vertices;
  std::string indices;
  size_t num_vertices = 4;
  std::string vertex_filter = "NONE";
  std::string index_filter = "NONE";

  std::string Write() const {
    Gltf gltf;
    const auto compressed = [](size_t size, size_t offset, size_t stride, size_t count,
                               const std::string& mode, const std::string& filter) {
      return fmt::format(R"(,"extensions":{{"EXT_meshopt_compression":{{"buffer":0,"byteOffset":{},
"byteLength":{},"byteStride":{},"count":{},"mode":"{}","filter":"{}"}}}})",
                         offset, size, stride, count, mode, filter);
    };
    const size_t second = (vertices.size() + 3) / 4 * 4;
    const int first_view = gltf.AddView(
        vertices, compressed(vertices.size(), 0, 12, num_vertices, "ATTRIBUTES", vertex_filter));
    const int second_view =
        gltf.AddView(indices, compressed(indices.size(), second, 2, 6, "TRIANGLES", index_filter));
    const int positions = gltf.AddAccessorOf(first_view, 5126, "VEC3", num_vertices);
    const int corners = gltf.AddAccessorOf(second_view, 5123, "SCALAR", 6);
    return gltf.Write(
        fmt::format(R"("attributes":{{"POSITION":{}}},"indices":{})", positions, corners), "",
        R"(,"extensionsRequired":["EXT_meshopt_compression"])");
  }
};

MeshoptGlb CompressedQuad(const void* vertices = kQuad.data()) {
  MeshoptGlb quad;
  std::vector<unsigned char> bytes(meshopt_encodeVertexBufferBound(4, 12));
  bytes.resize(meshopt_encodeVertexBuffer(bytes.data(), bytes.size(), vertices, 4, 12));
  quad.vertices.assign(bytes.begin(), bytes.end());
  const std::vector<unsigned int> indices = {0, 1, 2, 0, 2, 3};
  bytes.resize(meshopt_encodeIndexBufferBound(6, 4));
  bytes.resize(meshopt_encodeIndexBuffer(bytes.data(), bytes.size(), indices.data(), 6));
  quad.indices.assign(bytes.begin(), bytes.end());
  return quad;
}

TEST(ReadGltfCompressed, MeshoptimizerGivesTheSameNumbers) {
  EXPECT_EQ(ReadBytes(CompressedQuad().Write()).triangles.size(), 2u);
  EXPECT_EQ(MaxCornerDistance(ReadBytes(CompressedQuad().Write()), kQuadCorners), 0);
  // Numbers as 24 bits of mantissa and 8 of an exponent: 1 is 2 * 2^-1.
  std::vector<uint32_t> filtered;
  for (const float number : kQuad) {
    filtered.push_back(0xff000000u | static_cast<uint32_t>(2 * number));
  }
  MeshoptGlb quad = CompressedQuad(filtered.data());
  quad.vertex_filter = "EXPONENTIAL";
  EXPECT_EQ(MaxCornerDistance(ReadBytes(quad.Write()), kQuadCorners), 0);
}

// Vectors of four numbers, filtered and compressed, as they come back in integers of `T`.
template <typename T>
std::vector<T> FilteredAndBack(const std::string& filter, const std::vector<float>& numbers) {
  const size_t count = numbers.size() / 4, stride = 4 * sizeof(T);
  std::string filtered(count * stride, '\0');
  if (filter == "OCTAHEDRAL") {
    meshopt_encodeFilterOct(filtered.data(), count, stride, 8 * sizeof(T), numbers.data());
  } else {
    meshopt_encodeFilterQuat(filtered.data(), count, stride, 16, numbers.data());
  }
  std::string bytes(meshopt_encodeVertexBufferBound(count, stride), '\0');
  bytes.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(bytes.data()),
                                          bytes.size(), filtered.data(), count, stride));
  const std::string back = DecodeMeshopt(bytes, {"ATTRIBUTES", filter, count, stride});
  std::vector<T> read(numbers.size());
  std::memcpy(read.data(), back.data(), back.size());
  return read;
}

TEST(DecodeMeshopt, FiltersOfNormalsAndRotationsAreTakenBack) {
  const std::vector<float> unit = {0.6f, 0, -0.8f, 0, 0.48f, 0.6f, 0.64f, 0};
  const auto normals8 = FilteredAndBack<int8_t>("OCTAHEDRAL", unit);
  const auto normals16 = FilteredAndBack<int16_t>("OCTAHEDRAL", unit);
  for (size_t i = 0; i < unit.size(); ++i) {
    // Half a step of the octahedron's plane and one of the sphere's.
    EXPECT_NEAR(normals8[i] / 127.0, unit[i], 3 / 127.0) << i;
    EXPECT_NEAR(normals16[i] / 32767.0, unit[i], 3 / 32767.0) << i;
  }
  const std::vector<float> rotations = {0.1f, 0.7f, 0.1f, 0.7f, -0.5f, 0.5f, 0.5f, 0.5f};
  const auto back = FilteredAndBack<int16_t>("QUATERNION", rotations);
  for (size_t q = 0; q < rotations.size(); q += 4) {
    double dot = 0;  // q and -q are one rotation
    for (size_t i = q; i < q + 4; ++i) dot += back[i] / 32767.0 * double{rotations[i]};
    EXPECT_NEAR(std::abs(dot), 1, 1e-3) << q;
  }
}

TEST(ReadGltfCompressed, DamagedMeshoptimizerIsNamed) {
  MeshoptGlb quad = CompressedQuad();
  quad.num_vertices = 1u << 30;
  EXPECT_TRUE(Fails(quad.Write(), "bufferViews[0].extensions.EXT_meshopt_compression: it claims"));
  quad = CompressedQuad();
  quad.vertices.resize(quad.vertices.size() - 8);
  EXPECT_TRUE(Fails(quad.Write(), "the compressed bytes are damaged"));
  quad = CompressedQuad();
  quad.index_filter = "EXPONENTIAL";
  EXPECT_TRUE(Fails(quad.Write(), "only ATTRIBUTES have a filter"));
  quad = CompressedQuad();
  quad.vertex_filter = "QUATERNION";
  EXPECT_TRUE(Fails(quad.Write(), "expected the filter"));
}

TEST(ReadGltf, QuantizedPositionsAreMeasuredByTheirNode) {
  Gltf gltf;
  const int positions =
      gltf.AddAccessor<int16_t>({0, 0, 0, 32767, 0, 0, 32767, 32767, 0, 0, 32767, 0}, 5122, "VEC3",
                                4, R"(,"normalized":true)");
  const int corners = gltf.AddAccessor<uint8_t>({0, 1, 2, 0, 2, 3}, 5121, "SCALAR", 6);
  const std::string contents =
      gltf.Write(fmt::format(R"("attributes":{{"POSITION":{}}},"indices":{})", positions, corners),
                 R"(,"scale":[1,2,1])", R"(,"extensionsRequired":["KHR_mesh_quantization"])");
  EXPECT_LT(MaxCornerDistance(ReadBytes(contents), kQuadCorners), 1e-7);
}

TEST(ReadGltf, InstancesStandWhereTheirAttributesSay) {
  Gltf gltf;
  const int positions = gltf.AddFloats(kQuad, "VEC3", 3);
  const int places = gltf.AddFloats({5, 0, 0, 0, 7, 0}, "VEC3", 3);
  const float half = std::numbers::sqrt2_v<float> / 2;
  const int turns = gltf.AddFloats({0, 0, 0, 1, 0, 0, half, half}, "VEC4", 4);
  const int scales = gltf.AddFloats({2, 2, 2, 1, 1, 1}, "VEC3", 3);
  const std::string attributes = fmt::format(
      R"(,"translation":[100,0,0],"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":
{{"TRANSLATION":{},"ROTATION":{},"SCALE":{}}}}}}})",
      places, turns, scales);
  const std::string fan = fmt::format(R"("attributes":{{"POSITION":{}}},"mode":6)", positions);
  const TriangleMesh mesh = ReadBytes(gltf.Write(fan, attributes));
  std::vector<Corner> expected;
  for (const Corner& corner : kQuadCorners) expected.push_back(2 * corner + Corner(105, 0, 0));
  for (const Corner& c : kQuadCorners)
    expected.push_back(Corner(-c.y(), c.x(), 0) + Corner(100, 7, 0));
  EXPECT_LT(MaxCornerDistance(mesh, expected), 1e-5);

  Gltf uneven;
  uneven.AddFloats(kQuad, "VEC3", 3);
  uneven.AddFloats({5, 0, 0, 0, 7, 0}, "VEC3", 3);
  uneven.AddFloats({0, 0, 0, 1}, "VEC4", 4);
  EXPECT_TRUE(Fails(uneven.Write(R"("attributes":{"POSITION":0},"mode":6)",
                                 R"(,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":
{"TRANSLATION":1,"ROTATION":2}}})"),
                    "expected as many of each"));
}

// 0-1-3-2 is the quad as a strip, whose second triangle is wound the other way in the file.
TEST(ReadGltf, StripsFansAndTrianglesWithoutIndicesAreOneSurface) {
  Gltf strip;
  strip.AddFloats(kQuad, "VEC3", 3);
  strip.AddAccessor<uint16_t>({0, 1, 3, 2}, 5123, "SCALAR", 4);
  const TriangleMesh of_strip =
      ReadBytes(strip.Write(R"("attributes":{"POSITION":0},"indices":1,"mode":5)"));
  const std::vector<Corner> expected = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0},
                                        {0, 2, 0}, {1, 0, 0}, {1, 2, 0}};
  EXPECT_EQ(MaxCornerDistance(of_strip, expected), 0);

  std::vector<float> corners;
  for (const Corner& corner : kQuadCorners) {
    for (const double c : corner) corners.push_back(static_cast<float>(c));
  }
  Gltf soup;
  soup.AddFloats(corners, "VEC3", 3);
  EXPECT_EQ(
      MaxCornerDistance(ReadBytes(soup.Write(R"("attributes":{"POSITION":0})")), kQuadCorners), 0);
  EXPECT_EQ(MaxCornerDistance(ReadBytes(soup.Text(R"("attributes":{"POSITION":0})"), "mesh.gltf"),
                              kQuadCorners),
            0);
}

TEST(ReadGltf, SparseAccessorsReplaceSomeItems) {
  Gltf gltf;
  std::vector<float> wrong = kQuad;
  wrong[7] = 9;
  const int view = gltf.AddView({reinterpret_cast<const char*>(wrong.data()), 48});
  std::string index, value;
  AppendBytes(index, uint16_t{2});
  for (const float number : {1.0f, 2.0f, 0.0f}) AppendBytes(value, number);
  const int indices = gltf.AddView(index);
  const int values = gltf.AddView(value);
  const auto sparse = [&](int count) {
    Gltf with = gltf;
    with.AddAccessorOf(view, 5126, "VEC3", 4,
                       fmt::format(R"(,"sparse":{{"count":{},"indices":{{"bufferView":{},
"componentType":5123}},"values":{{"bufferView":{}}}}})",
                                   count, indices, values));
    return with.Write(R"("attributes":{"POSITION":0},"mode":6)");
  };
  EXPECT_EQ(MaxCornerDistance(ReadBytes(sparse(1)), kQuadCorners), 0);
  EXPECT_TRUE(Fails(sparse(2), "accessors[0].sparse.indices: it ends at"));
}

TEST(ReadGltf, WhatTheMeshDoesNotHaveIsNamedByItsPlace) {
  Gltf gltf;
  gltf.AddFloats(kQuad, "VEC3", 3);
  gltf.AddAccessor<uint16_t>({0, 1, 4}, 5123, "SCALAR", 3);
  gltf.AddAccessorOf(0, 5126, "VEC3", 5);
  gltf.AddAccessorOf(0, 5127, "VEC3", 4);
  gltf.AddAccessorOf(-1, 5126, "VEC3", 1u << 30);
  gltf.AddFloats({0, 1, 2}, "SCALAR", 1);
  for (const auto& [primitive, message] : std::vector<std::pair<std::string, std::string>>{
           {R"("attributes":{"POSITION":0},"indices":1)",
            "primitives[0]: expected a vertex index below 4, found 4"},
           {R"("attributes":{"POSITION":0},"indices":9)", "indices: expected an index of one of 6"},
           {R"("attributes":{"POSITION":1})",
            "accessors[1]: expected items of 3 numbers, found SCALAR"},
           {R"("attributes":{"POSITION":0},"indices":5)",
            "accessors[5]: expected the componentType of unsigned integers"},
           {R"("attributes":{"POSITION":0},"mode":0)", "found a point cloud: 4 vertices"},
           {R"("attributes":{},"indices":1)", "found no vertices and no faces"},
           {R"("attributes":{"POSITION":2})", "accessors[2]: it ends at 60 bytes of 48"},
           {R"("attributes":{"POSITION":3})", "accessors[3]: expected a known componentType"},
           {R"("attributes":{"POSITION":4})", "accessors[4]: it ends at"},
           {R"("indices":1)", "the member \"attributes\" is missing"}}) {
    EXPECT_TRUE(Fails(gltf.Write(primitive), message)) << message;
  }
  const std::string quad = R"("attributes":{"POSITION":0},"mode":6)";
  EXPECT_TRUE(Fails(gltf.Write(quad, R"(,"children":[0])"), "a node is the child of two"));
  EXPECT_TRUE(Fails(gltf.Write(quad, R"(,"children":[7])"), "expected an index of one of 1 nodes"));
}

// A mesh that two nodes show, one of them mirrored; a second set of texture coordinates; a picture
// in WebP alone, and none that can be read.
TEST(ReadGltf, MaterialsSayWhichTextureCoordinatesAndPicture) {
  Gltf gltf;
  gltf.AddFloats(kQuad, "VEC3", 3);
  gltf.AddFloats(std::vector<float>(8, 0.5f), "VEC2", 2);
  gltf.AddFloats({0.25, 0.5, 0.25, 0.5, 0.25, 0.5, 0.25, 0.5}, "VEC2", 2);
  const auto write = [&](const std::string& texture) {
    return gltf.Write(
        R"("attributes":{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":2},"mode":6,"material":0)",
        R"(,"children":[1]},{"mesh":0,"scale":[-1,1,1])",
        R"(,"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"texCoord":1}}}],
"images":[{"uri":"data:image/png;base64,)" +
            EncodeBase64(TestPicturePng()) + R"("}],"textures":[{)" + texture + "}]");
  };
  const TriangleMesh mesh = ReadBytes(write(R"("extensions":{"EXT_texture_webp":{"source":0}})"));
  std::vector<Corner> expected = kQuadCorners;
  for (const size_t i : {0, 2, 1, 3, 5, 4}) {
    expected.push_back(kQuadCorners[i].cwiseProduct(Corner(-1, 1, 1)));
  }
  EXPECT_EQ(MaxCornerDistance(mesh, expected), 0);
  ASSERT_EQ(mesh.textures.size(), 1u) << testing::PrintToString(mesh.warnings);
  EXPECT_EQ(mesh.texture_coordinates[0], Eigen::Vector2f(0.25f, 0.5f));
  const TriangleMesh plain = ReadBytes(write(R"("sampler":0)"));
  ASSERT_EQ(plain.warnings.size(), 1u);
  EXPECT_NE(plain.warnings[0].find("textures[0]: names no picture"), std::string::npos);
}

// White, where other primitives have a material; nothing in a file without any.
TEST(ReadGltf, PrimitivesWithoutMaterialAreWhiteBesideOthers) {
  Gltf gltf;
  gltf.AddFloats(kQuad, "VEC3", 3);
  const std::string two =
      R"("attributes":{"POSITION":0},"mode":6},{"attributes":{"POSITION":0},"mode":6)";
  const TriangleMesh mesh = ReadBytes(
      gltf.Write(two + R"(,"material":0)", "",
                 R"(,"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0,0,1,1]}}])"));
  EXPECT_EQ(mesh.vertex_colors_rgb[mesh.triangles[0][0]], (std::array<uint8_t, 3>{255, 255, 255}));
  EXPECT_EQ(mesh.vertex_colors_rgb[mesh.triangles[2][0]], (std::array<uint8_t, 3>{0, 0, 255}));
  EXPECT_TRUE(ReadBytes(gltf.Write(two)).vertex_colors_rgb.empty());
}

TEST(ReadGltf, InstancesOfInstancesHaveAnEnd) {
  Gltf gltf;
  gltf.AddFloats(kQuad, "VEC3", 3);
  gltf.AddFloats(std::vector<float>(3000000, 0), "VEC3", 3);
  const std::string instances =
      R"("extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1}}})";
  std::string nodes = R"(,"children":[1,2,3,4])";
  for (int i = 0; i < 4; ++i) nodes += R"(},{"mesh":0,)" + instances;
  nodes.insert(0, "," + instances);
  EXPECT_TRUE(Fails(gltf.Write(R"("attributes":{"POSITION":0},"mode":6)", nodes),
                    "place more than 4194304 meshes"));
}

TEST(ReadGltf, NodesMayBeNestedButNotWithoutEnd) {
  const auto nested = [](int depth) {
    std::string nodes;
    for (int i = 0; i < depth; ++i) nodes += fmt::format(R"({{"children":[{}]}},)", i + 1);
    std::string bin;
    for (const float number : kQuad) AppendBytes(bin, number);
    return GlbOf(
        fmt::format(
            R"({{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{}{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":6}}]}}],
"buffers":[{{"byteLength":48}}],"bufferViews":[{{"buffer":0,"byteLength":48}}],
"accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":4}}]}})",
            nodes),
        bin);
  };
  EXPECT_EQ(ReadBytes(nested(400)).triangles.size(), 2u);
  EXPECT_TRUE(Fails(nested(100000), "nested more than 500 deep"));
}

}  // namespace
}  // namespace raylift
