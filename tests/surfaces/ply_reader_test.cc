// ReadMesh on PLY files.

#include <array>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

// Five faces, of which the second and the fourth have no area.
TEST(PlyReader, TrianglesKnowTheFileFacesTheyAreOf) {
  const auto folder = TestFolder();
  const std::array<std::array<int32_t, 3>, 5> faces = {
      {{0, 1, 2}, {0, 0, 1}, {1, 3, 2}, {2, 2, 2}, {0, 2, 3}}};
  const std::string elements =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 5\nproperty list uchar int vertex_indices\nend_header\n";
  std::string text = "ply\nformat ascii 1.0\n" + elements + "0 0 0\n1 0 0\n0 1 0\n1 1 1\n";
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + elements;
  const auto append = [&binary](const auto& value) {
    binary.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  append(std::array<float, 12>{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1});
  for (const auto& face : faces) {
    text += fmt::format("3 {} {} {}\n", face[0], face[1], face[2]);
    append(uint8_t{3});
    append(face);
  }
  for (const std::string& bytes : {text, binary}) {
    WriteFile(folder / "a.ply", bytes);
    const TriangleMesh mesh = ReadMesh(folder / "a.ply");
    ASSERT_EQ(mesh.triangles.size(), 3u);
    EXPECT_EQ(mesh.FaceOf(0), 0u);
    EXPECT_EQ(mesh.FaceOf(1), 2u);
    EXPECT_EQ(mesh.FaceOf(2), 4u);
  }
}

enum class Encoding { kAscii, kLittleEndian, kBigEndian };
constexpr Encoding kEncodings[] = {Encoding::kAscii, Encoding::kLittleEndian, Encoding::kBigEndian};

// Writes numbers as PLY does.
class PlyBody {
 public:
  explicit PlyBody(Encoding encoding) : encoding_(encoding) {}

  template <typename T>
  PlyBody& Add(T value) {
    if (encoding_ == Encoding::kAscii) {
      bytes_ += FormatDouble(static_cast<double>(value)) + " ";
    } else {
      AppendBytes(bytes_, value, encoding_ == Encoding::kBigEndian);
    }
    return *this;
  }
  void EndLine() {
    if (encoding_ == Encoding::kAscii) bytes_ += "\n";
  }
  const std::string& bytes() const { return bytes_; }

  static std::string Format(Encoding encoding) {
    switch (encoding) {
      case Encoding::kAscii:
        return "ply\nformat ascii 1.0\n";
      case Encoding::kLittleEndian:
        return "ply\nformat binary_little_endian 1.0\n";
      case Encoding::kBigEndian:
        return "ply\nformat binary_big_endian 1.0\n";
    }
    return "";
  }

 private:
  Encoding encoding_;
  std::string bytes_;
};

const std::vector<Eigen::Vector3d> kTetrahedron = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

// A tetrahedron whose base is followed by a quadrilateral's two halves, with colors, properties
// and elements that no one asked for, list lengths and indices of unusual types.
template <typename Real>
std::string RichPly(Encoding encoding, const Eigen::Vector3d& offset) {
  const std::string real = sizeof(Real) == 8 ? "double" : "float";
  const std::string header = PlyBody::Format(encoding) +
                             "comment made by a test\nobj_info nothing\n"
                             "element camera 2\nproperty list uchar float pose\nproperty int id\n"
                             "element vertex 4\n"
                             "property uchar flag\n"
                             "property " +
                             real + " x\nproperty " + real + " y\nproperty " + real +
                             " z\nproperty list ushort short tags\n"
                             "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                             "element face 3\n"
                             "property float quality\n"
                             "property list ushort uint vertex_index\n"
                             "property list uchar uchar more\n"
                             "element edge 1\nproperty int vertex1\n"
                             "end_header\n";
  PlyBody body(encoding);
  for (int camera = 0; camera < 2; ++camera) {
    body.Add(uint8_t{3}).Add(1.5f).Add(2.5f).Add(-1e9f).Add(int32_t{7}).EndLine();
  }
  for (size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d p = kTetrahedron[i] + offset;
    body.Add(uint8_t{200}).Add(static_cast<Real>(p.x())).Add(static_cast<Real>(p.y()));
    body.Add(static_cast<Real>(p.z())).Add(static_cast<uint16_t>(i));
    for (size_t k = 0; k < i; ++k) body.Add(int16_t{-5});
    const auto level = static_cast<uint8_t>(50 * i);
    body.Add(level)
        .Add(static_cast<uint8_t>(level + 1))
        .Add(static_cast<uint8_t>(level + 2))
        .EndLine();
  }
  const auto face = [&](const std::vector<uint32_t>& corners) {
    body.Add(0.5f).Add(static_cast<uint16_t>(corners.size()));
    for (const uint32_t corner : corners) body.Add(corner);
    body.Add(uint8_t{1}).Add(uint8_t{9}).EndLine();
  };
  face({0, 2, 1});
  face({0, 1, 2, 3});
  face({1, 2, 3});
  body.Add(int32_t{1}).EndLine();
  return header + body.bytes();
}

TEST(ReadPly, IsTheSameInEveryEncoding) {
  for (const Encoding encoding : kEncodings) {
    const auto path = TestFolder() / "rich.ply";
    WriteFile(path, RichPly<float>(encoding, {0, 0, 0}));
    const TriangleMesh mesh = ReadMesh(path);
    ASSERT_EQ(mesh.triangles.size(), 4u);  // the quadrilateral is two
    ASSERT_EQ(mesh.vertices.size(), 4u);
    ASSERT_EQ(mesh.vertex_colors_rgb.size(), 4u);
    EXPECT_TRUE(mesh.texture_coordinates.empty());
    EXPECT_TRUE(mesh.warnings.empty());
    const std::vector<Eigen::Vector3d> base = {kTetrahedron[0], kTetrahedron[2], kTetrahedron[1]};
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t index = mesh.triangles[0][k];
      EXPECT_EQ(mesh.VertexInWorld(index), base[k]);
      const int level = std::array{0, 100, 50}[k];
      EXPECT_EQ(mesh.vertex_colors_rgb[index][0], level);
      EXPECT_EQ(mesh.vertex_colors_rgb[index][1], level + 1);
      EXPECT_EQ(mesh.vertex_colors_rgb[index][2], level + 2);
    }
  }
}

TEST(ReadPly, DoubleCoordinatesKeepTheirPrecision) {
  const Eigen::Vector3d offset(400000.0123, 5000000.0456, 300.0789);
  for (const Encoding encoding : kEncodings) {
    const auto path = TestFolder() / "far.ply";
    WriteFile(path, RichPly<double>(encoding, offset));
    const TriangleMesh mesh = ReadMesh(path);
    const auto corners = Corners(mesh);
    ASSERT_EQ(corners.size(), 12u);
    EXPECT_LT((corners[0] - offset).norm(), 1e-7);
    EXPECT_LT((corners[1] - offset - kTetrahedron[2]).norm(), 1e-7);
  }
}

TEST(ReadPly, CarriageReturnsAndUnusualWhiteSpaceAreRead) {
  const auto path = TestFolder() / "dos.ply";
  WriteFile(
      path,
      "ply\r\nformat ascii 1.0\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\n"
      "property float z\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\n"
      "end_header\r\n0 0 0\r\n1 0 0 \t 0\r\n+1 0\r\n\r\n3 0 1 2");
  EXPECT_LT(MaxCornerDistance(ReadMesh(path), {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}), 1e-9);
}

constexpr char kTextured[] =
    "ply\nformat ascii 1.0\ncomment TextureFile my picture.png\nelement vertex 4\n"
    "property float x\nproperty float y\nproperty float z\nelement face 2\n"
    "property list uchar int vertex_indices\nproperty list uchar float texcoord\n{}end_header\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    "3 0 1 2 6 0 0 1 0 1 1{}\n3 0 2 3 6 0.5 0.5 1 1 0 1{}\n";

TEST(ReadPly, CornersHaveTheirOwnTextureCoordinates) {
  const auto folder = TestFolder();
  WriteFile(folder / "my picture.png", TestPicturePng());
  WriteFile(folder / "mesh.ply", fmt::format(kTextured, "", "", ""));
  const TriangleMesh mesh = ReadMesh(folder / "mesh.ply");
  ASSERT_EQ(mesh.textures.size(), 1u);
  EXPECT_EQ(mesh.textures[0].data, TestPicture().data);
  EXPECT_EQ(mesh.triangle_textures, (std::vector<int32_t>{0, 0}));
  EXPECT_EQ(mesh.vertices.size(), 5u);  // the first corner has two texture coordinates
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[0][0]], Eigen::Vector2f(0, 0));
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[1][0]], Eigen::Vector2f(0.5f, 0.5f));
  EXPECT_EQ(mesh.VertexInWorld(mesh.triangles[0][0]), mesh.VertexInWorld(mesh.triangles[1][0]));
  EXPECT_EQ(mesh.triangles[0][2], mesh.triangles[1][1]);
}

TEST(ReadPly, FacesSayWhichTextureTheyHave) {
  const auto folder = TestFolder();
  WriteFile(folder / "my picture.png", TestPicturePng());
  WriteFile(folder / "mesh.ply", fmt::format(kTextured, "property int texnumber\n", " 0", " -1"));
  EXPECT_EQ(ReadMesh(folder / "mesh.ply").triangle_textures, (std::vector<int32_t>{0, -1}));
}

TEST(ReadPly, AMissingTextureIsAWarning) {
  const auto folder = TestFolder();
  WriteFile(folder / "mesh.ply", fmt::format(kTextured, "", "", ""));
  const TriangleMesh mesh = ReadMesh(folder / "mesh.ply");
  EXPECT_TRUE(mesh.triangle_textures.empty());
  EXPECT_EQ(mesh.triangles.size(), 2u);
  ASSERT_EQ(mesh.warnings.size(), 1u);
  EXPECT_NE(mesh.warnings[0].find("my picture.png"), std::string::npos);
}

TEST(ReadPly, VerticesHaveTextureCoordinatesAndFloatColors) {
  const auto folder = TestFolder();
  WriteFile(folder / "t.png", TestPicturePng());
  WriteFile(folder / "mesh.ply",
            "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 3\nproperty float x\n"
            "property float y\nproperty float z\nproperty float s\nproperty float t\n"
            "property float red\nproperty float green\nproperty float blue\nelement face 1\n"
            "property list uchar int vertex_indices\nend_header\n"
            "0 0 0 0.25 0.75 0 0.5 1\n1 0 0 1 0 2 -1 nan\n0 1 0 0 1 0 0 0\n3 0 1 2\n");
  const TriangleMesh mesh = ReadMesh(folder / "mesh.ply");
  EXPECT_EQ(mesh.texture_coordinates[0], Eigen::Vector2f(0.25f, 0.75f));
  EXPECT_EQ(mesh.triangle_textures, std::vector<int32_t>{0});
  EXPECT_EQ(mesh.vertex_colors_rgb[0], (std::array<uint8_t, 3>{0, 128, 255}));
  EXPECT_EQ(mesh.vertex_colors_rgb[1], (std::array<uint8_t, 3>{255, 0, 0}));
}

std::string TrianglePly(const std::string& vertices, int num_vertices, const std::string& faces,
                        int num_faces) {
  return fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n{}{}",
      num_vertices, num_faces, vertices, faces);
}

TEST(ReadPly, TrianglesThatCannotBeHitAreRemovedAndCounted) {
  const auto path = TestFolder() / "dirty.ply";
  WriteFile(path,
            TrianglePly("0 0 0\n1 0 0\n0 1 0\nnan 0 0\n0 inf 0\n2 0 0\n1e30 0 0\n", 7,
                        "3 0 1 2\n3 0 1 3\n3 4 1 2\n3 0 1 5\n3 1 1 2\n3 0 1 6\n2 0 1\n0\n", 8));
  const TriangleMesh mesh = ReadMesh(path);
  EXPECT_EQ(mesh.triangles.size(), 1u);
  EXPECT_EQ(mesh.vertices.size(), 3u);
  ASSERT_EQ(mesh.warnings.size(), 3u);
  EXPECT_NE(mesh.warnings[0].find("2 of 8 faces skipped: fewer than three"), std::string::npos);
  EXPECT_NE(mesh.warnings[1].find("3 of 6 triangles removed: a vertex is not finite"),
            std::string::npos);
  EXPECT_NE(mesh.warnings[2].find("2 of 6 triangles removed: they have no area"),
            std::string::npos);
}

TEST(ReadPly, AMeshWithoutAnyUsableTriangleIsAnError) {
  const auto path = TestFolder() / "bad.ply";
  const auto fails = [&](const std::string& contents, const std::vector<std::string>& parts) {
    WriteFile(path, contents);
    return FailsWithInputError([&] { ReadMesh(path); }, parts);
  };
  EXPECT_TRUE(fails(TrianglePly("0 0 0\n1 0 0\n", 2, "", 0),
                    {"bad.ply", "found a point cloud: 2 vertices, no faces"}));
  EXPECT_TRUE(fails(TrianglePly("", 0, "", 0), {"bad.ply", "no vertices and no faces"}));
  EXPECT_TRUE(
      fails(TrianglePly("0 0 0\n1 0 0\n2 0 0\n", 3, "3 0 1 2\n", 1),
            {"bad.ply", "found 1 triangles, none of which has finite vertices and an area"}));
  EXPECT_TRUE(
      fails("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
            "property float z\nend_header\n1 2 3\n",
            {"point cloud: 1 vertices"}));
}

TEST(ReadPly, WrongValuesAreNamedWithTheirPlace) {
  const auto path = TestFolder() / "bad.ply";
  const auto fails = [&](const std::string& contents, const std::vector<std::string>& parts) {
    WriteFile(path, contents);
    return FailsWithInputError([&] { ReadMesh(path); }, parts);
  };
  const std::string good = "0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_TRUE(fails(TrianglePly(good, 3, "3 0 1 3\n", 1),
                    {"bad.ply", "face 0 of 1", "expected a vertex index below 3, found 3"}));
  EXPECT_TRUE(fails(TrianglePly(good, 3, "3 0 1 2\n3 0 1 -1\n", 2), {"face 1 of 2", "found -1"}));
  EXPECT_TRUE(fails(TrianglePly(good, 3, "3 0 1 1.5\n", 1), {"face 0 of 1", "found 1.5"}));
  EXPECT_TRUE(fails(TrianglePly(good, 3, "-3 0 1 2\n", 1), {"face 0 of 1", "length of list"}));
  EXPECT_TRUE(fails(TrianglePly("0 0 0\n1 x0 0\n0 1 0\n", 3, "3 0 1 2\n", 1),
                    {"vertex 1 of 3", "expected a number, found \"x0\""}));
  EXPECT_TRUE(
      fails(TrianglePly(good, 3, "200 0 1 2\n", 1), {"face 0 of 1", "the file ends early"}));
}

TEST(ReadPly, WrongHeadersAreNamedWithTheirLine) {
  const auto path = TestFolder() / "bad.ply";
  const auto fails = [&](const std::string& contents, const std::vector<std::string>& parts) {
    WriteFile(path, contents);
    return FailsWithInputError([&] { ReadMesh(path); }, parts);
  };
  const std::string start = "ply\nformat ascii 1.0\n";
  EXPECT_TRUE(fails("", {"bad.ply", "header"}));
  EXPECT_TRUE(fails("OFF\n1 2 3\n", {"expected a PLY file"}));
  EXPECT_TRUE(fails("ply\nend_header\n", {"format"}));
  EXPECT_TRUE(fails("ply\nformat utf8 1.0\nend_header\n", {"line 2", "utf8"}));
  EXPECT_TRUE(fails(start + "element vertex many\nend_header\n", {"line 3", "element NAME COUNT"}));
  EXPECT_TRUE(fails(start + "element vertex -1\nend_header\n", {"line 3", "element NAME COUNT"}));
  EXPECT_TRUE(
      fails(start + "property float x\nend_header\n", {"line 3", "before the first element"}));
  EXPECT_TRUE(fails(start + "element vertex 1\nproperty real x\nend_header\n", {"line 4", "real"}));
  EXPECT_TRUE(
      fails(start + "element vertex 1\nproperty list float int a\nend_header\n", {"line 4"}));
  EXPECT_TRUE(
      fails(start + "element vertex 1\nelement vertex 1\nend_header\n", {"line 4", "second"}));
  EXPECT_TRUE(fails(start + "nonsense\nend_header\n", {"line 3", "nonsense"}));
  EXPECT_TRUE(fails(start + "element vertex 1\nproperty float x\nend_header\n1\n", {"x, y and z"}));
  EXPECT_TRUE(fails(start + "element vertex 1\nproperty float x", {"before \"end_header\""}));
  EXPECT_TRUE(fails(start +
                        "element face 0\nproperty list uchar int vertex_indices\nelement vertex 0\n"
                        "property float x\nproperty float y\nproperty float z\nend_header\n",
                    {"vertex before the element face"}));
}

TEST(ReadPly, ClaimsOfTheHeaderAreCheckedAgainstTheFile) {
  const auto path = TestFolder() / "bad.ply";
  for (const std::string count : {"1000000000000", "18446744073709551615", "4"}) {
    for (const std::string format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
      WriteFile(
          path,
          "ply\nformat " + format + " 1.0\nelement vertex " + count +
              "\nproperty double x\nproperty double y\nproperty double z\nend_header\n0 0 0\n");
      EXPECT_TRUE(
          FailsWithInputError([&] { ReadMesh(path); }, {"element vertex", "claims " + count}));
    }
  }
  WriteFile(path, "ply\nformat ascii 1.0\nelement vertex 1000000000000\nend_header\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(path); }, {"element vertex", "claims"}));
}

TEST(ReadPly, TruncatedFilesNeverCrash) {
  const auto path = TestFolder() / "cut.ply";
  for (const Encoding encoding : kEncodings) {
    std::string contents = RichPly<double>(encoding, {1, 2, 3});
    const int meshes = ReadTruncated(path, contents);
    EXPECT_LE(meshes, encoding == Encoding::kAscii ? 2 : 0);  // but for the last blanks
  }
}

TEST(ReadPly, CorruptedFilesNeverCrash) {
  Rng rng = TestRng();
  const auto path = TestFolder() / "noise.ply";
  for (const Encoding encoding : kEncodings) {
    const std::string contents = RichPly<float>(encoding, {1, 2, 3});
    for (int i = 0; i < 300; ++i) {
      std::string noisy = contents;
      for (int k = 0; k < 3; ++k) {
        noisy[rng.UniformIndex(static_cast<uint32_t>(noisy.size()))] =
            static_cast<char>(rng.UniformIndex(256));
      }
      WriteFile(path, noisy);
      try {
        ReadMesh(path);
      } catch (const std::exception& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      }
    }
  }
}

TEST(ReadPly, RealMeshHasWhatNumpyReadsInIt) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not on this machine";
  const TriangleMesh mesh = ReadMesh(*data / "mesh.ply");
  const std::string script =
      "import numpy as np; b=open('" + (*data / "mesh.ply").string() +
      "','rb').read(); "
      "h=b.index(b'end_header')+11; "
      "v=np.frombuffer(b,np.dtype([('p','<f4',3),('c','u1',3)]),160120,h); "
      "f=np.frombuffer(b,np.dtype([('n','u1'),('i','<i4',3)]),292483,h+160120*15)['i']; "
      "p=v['p'].astype(float)[f]; c=v['c'].astype(float)[f]; "
      "a=np.linalg.norm(np.cross(p[:,1]-p[:,0],p[:,2]-p[:,0]),axis=1); k=a>0; "
      "print(k.sum(), 0.5*a.sum(), *p[k].mean((0,1)), *c[k].mean((0,1)))";
  const auto tokens_text = RunProgram("/usr/bin/python3 -c \"" + script + "\"");
  const auto tokens = SplitTokens(Trim(tokens_text));
  ASSERT_EQ(tokens.size(), 8u) << tokens_text;
  EXPECT_EQ(static_cast<int64_t>(mesh.triangles.size()), ParseInt(tokens[0]));
  EXPECT_NEAR(SurfaceArea(mesh), *ParseDouble(tokens[1]), 1e-6);
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Vector3d color = Eigen::Vector3d::Zero();
  const double corners = 3.0 * static_cast<double>(mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t index : triangle) {
      position += mesh.VertexInWorld(index) / corners;
      for (int c = 0; c < 3; ++c)
        color[c] += mesh.vertex_colors_rgb[index][static_cast<size_t>(c)] / corners;
    }
  }
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(position[c], *ParseDouble(tokens[static_cast<size_t>(2 + c)]), 1e-8);
    EXPECT_NEAR(color[c], *ParseDouble(tokens[static_cast<size_t>(5 + c)]), 1e-8);
  }
}

}  // namespace
}  // namespace raylift
