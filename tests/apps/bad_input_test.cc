// Bad input: one clear line that names the file and the place, exit code 3, no output left.

#include <fstream>

#include "apps/program.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"
#include "raylift/surfaces/mesh_files.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class BadInput : public ::testing::Test {
 protected:
  // Localizes with hloc's files, which must fail so.
  ::testing::AssertionResult Fails(const std::vector<std::string>& parts,
                                   const Arguments& more = {}) const {
    const auto failed = FailsWith(3, parts, RunRaylift(LocalizeWithHloc(scene_, out_) + more));
    if (failed && fs::exists(out_) && !FilesBelow(out_).empty()) {
      return ::testing::AssertionFailure() << "output: " << FilesBelow(out_).front();
    }
    return failed;
  }

  // The same with a geometry of its own.
  CommandResult RunWithMesh(const fs::path& mesh) const {
    Arguments arguments = LocalizeWithHloc(scene_, out_);
    for (std::string& argument : arguments) {
      if (argument.starts_with("mesh:")) argument = "mesh:" + mesh.string();
    }
    return RunRaylift(arguments);
  }

  // The query's diagnostics.
  nlohmann::json Query(const std::string& name) const {
    return nlohmann::json::parse(Diagnostics(out_ / "queries.jsonl").at(name));
  }

  RoomScene scene_ = WriteRoomScene(TestFolder());
  fs::path out_ = scene_.folder / "out";
};

// assimp ends the process that reads this file.
TEST_F(BadInput, MeshThatEndsAssimpIsNamed) {
  const fs::path mesh = scene_.folder / "damaged.dae";
  fs::copy_file(DemoFolder() / "../../tests/fuzz/findings/mesh_dae/reference_to_nothing", mesh);
  EXPECT_TRUE(FailsWith(3, {"damaged.dae", "cannot be read as a mesh: the file is damaged"},
                        RunWithMesh(mesh)));
}

TEST_F(BadInput, MissingFilesAreNamed) {
  for (const fs::path& file :
       {scene_.model() / "images.txt", scene_.model() / "cameras.txt", scene_.mesh(),
        scene_.query_list(), scene_.features(), scene_.matches(), scene_.pairs()}) {
    const fs::path hidden = file.string() + ".hidden";
    fs::rename(file, hidden);
    EXPECT_TRUE(Fails({file.parent_path().string()})) << file;
    fs::rename(hidden, file);
  }
  fs::remove_all(scene_.model());
  EXPECT_TRUE(Fails({scene_.model().string()}));
}

TEST_F(BadInput, TruncatedBinaryModelsAreNamed) {
  const ColmapModel model = ReadColmapModel(scene_.model());
  fs::remove_all(scene_.model());
  WriteColmapModel(scene_.model(), model, ColmapForm::kBinary);
  for (const std::string name : {"images.bin", "cameras.bin"}) {
    const fs::path file = scene_.model() / name;
    const std::string whole = ReadFile(file);
    for (const size_t size : {whole.size() - 3, whole.size() / 2, size_t{5}, size_t{0}}) {
      WriteFile(file, whole.substr(0, size));
      EXPECT_TRUE(Fails({file.string()})) << name << " cut to " << size;
    }
    WriteFile(file, whole);
  }
  EXPECT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene_, out_))));
}

TEST_F(BadInput, TokensThatAreNoNumbersAreNamedWithTheirLine) {
  const auto breaks = [&](const fs::path& file, const std::string& from, const std::string& to) {
    const std::string whole = ReadFile(file);
    Replace(file, from, to);
    const auto failed = Fails({file.string(), "line ", to});
    WriteFile(file, whole);
    return failed;
  };
  EXPECT_TRUE(breaks(scene_.model() / "cameras.txt", "161.2", "161.2x"));
  EXPECT_TRUE(breaks(scene_.query_list(), "161.2", "16l.2"));
  EXPECT_TRUE(breaks(scene_.query_list(), "320", "wide"));
  const fs::path images = scene_.model() / "images.txt";
  const std::string whole = ReadFile(images);
  WriteFile(images, "1 one 0 0 0 0 0 0 1 ref/00.png\n\n");
  EXPECT_TRUE(Fails({images.string(), "line 1", "one"}));
  WriteFile(images, whole);
}

TEST_F(BadInput, PairsOfOneNameAreNamedWithTheirLine) {
  WriteFile(scene_.pairs(), "query/a.png ref/00.png\nquery/a.png\n");
  EXPECT_TRUE(Fails({scene_.pairs().string(), "line 2"}));
}

TEST_F(BadInput, PosesThatAreNotFiniteAreNamed) {
  const fs::path images = scene_.model() / "images.txt";
  for (const std::string number : {"nan", "inf", "1e999"}) {
    WriteFile(images, "1 1 0 0 0 0 " + number + " 0 1 ref/00.png\n\n");
    EXPECT_TRUE(Fails({images.string(), "line 1"})) << number;
  }
  WriteFile(images, "1 0 0 0 0 0 0 0 1 ref/00.png\n\n");
  EXPECT_TRUE(Fails({images.string(), "line 1", "qvec"}));
}

TEST_F(BadInput, UnknownCameraModelsAreNamed) {
  const fs::path cameras = scene_.model() / "cameras.txt";
  const std::string whole = ReadFile(cameras);
  Replace(cameras, "SIMPLE_RADIAL", "SIMPLE_RADICAL");
  EXPECT_TRUE(Fails({cameras.string(), "line ", "SIMPLE_RADICAL"}));
  WriteFile(cameras, whole);
  Replace(scene_.query_list(), "SIMPLE_RADIAL", "FISHEYE_7");
  EXPECT_TRUE(Fails({scene_.query_list().string(), "line 1", "FISHEYE_7"}));
}

TEST_F(BadInput, ARetrievedReferenceWithoutAPoseIsNamed) {
  WriteFile(scene_.pairs(), "query/a.png ref/00.png\nquery/a.png ref/unknown.png\n");
  EXPECT_TRUE(
      Fails({scene_.pairs().string(), "query/a.png", "ref/unknown.png", scene_.model().string()}));
}

TEST_F(BadInput, AModelWithoutImagesIsNamed) {
  WriteFile(scene_.model() / "images.txt", "# no images\n");
  EXPECT_TRUE(Fails({scene_.model().string(), "no images"}));
}

TEST_F(BadInput, FilesThatAreNoHdf5AreNamed) {
  for (const fs::path& file : {scene_.features(), scene_.matches()}) {
    const std::string whole = ReadFile(file);
    WriteFile(file, "hello");
    EXPECT_TRUE(Fails({file.string()}));
    WriteFile(file, whole.substr(0, whole.size() / 2));
    EXPECT_TRUE(Fails({file.string()}));
    WriteFile(file, whole);
  }
}

TEST_F(BadInput, AQueryWithoutRetrievedReferencesIsListed) {
  std::string pairs;
  for (const std::string& line : Lines(ReadFile(scene_.pairs()))) {
    if (line.starts_with("query/a.png")) pairs += line + "\n";
  }
  WriteFile(scene_.pairs(), pairs);
  const CommandResult result = RunRaylift(LocalizeWithHloc(scene_, out_));
  EXPECT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("query/b.png: no retrieved references\n"), std::string::npos)
      << result.out;
  EXPECT_EQ(PoseLines(out_ / "poses.txt").size(), 1u);
  EXPECT_EQ(Query("query/b.png")["status"], "not localized");
  EXPECT_EQ(Query("query/b.png")["reason"], "no retrieved references");
  EXPECT_FALSE(Query("query/b.png").contains("cam_from_world"));
  EXPECT_EQ(Query("query/a.png")["reason"], "");
}

TEST_F(BadInput, AQueryWithoutMatchesIsListedAndThePairsWarnedAbout) {
  // A query in features.h5 with no pair in matches.h5.
  Replace(scene_.query_list(), "query/b.png", "ref/05.png");
  Replace(scene_.pairs(), "query/b.png ref/00.png", "ref/05.png ref/00.png");
  for (int i = 1; i < 6; ++i) {
    Replace(scene_.pairs(), fmt::format("query/b.png ref/{:02}.png", i), "");
  }
  const CommandResult result = RunRaylift(LocalizeWithHloc(scene_, out_));
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(Lines(result.err).size(), 1u) << result.err;
  EXPECT_NE(result.err.find("warning"), std::string::npos);
  EXPECT_NE(result.err.find("ref/05.png"), std::string::npos);
  EXPECT_EQ(Query("ref/05.png")["status"], "not localized");
  EXPECT_EQ(Query("ref/05.png")["reason"], "no matches with the retrieved references");
  EXPECT_EQ(Query("query/a.png")["status"], "ok");
}

TEST_F(BadInput, AQueryWithoutFeaturesIsNamed) {
  Replace(scene_.query_list(), "query/b.png", "query/c.png");
  Replace(scene_.pairs(), "query/b.png ref/00.png", "query/c.png ref/00.png");
  EXPECT_TRUE(Fails({scene_.features().string(), "query/c.png"}));
}

std::string AsciiPly(const TriangleMesh& mesh, const std::string& more_vertices,
                     const std::string& more_faces, size_t num_more_vertices,
                     size_t num_more_faces) {
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\n"
      "property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices.size() + num_more_vertices, mesh.triangles.size() + num_more_faces);
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d v = mesh.VertexInWorld(i);
    text += fmt::format("{} {} {}\n", v.x(), v.y(), v.z());
  }
  text += more_vertices;
  for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return text + more_faces;
}

TEST_F(BadInput, EmptyMeshesAndPointCloudsAreNamed) {
  const fs::path file = scene_.folder / "other.ply";
  WriteFile(file, AsciiPly({}, "", "", 0, 0));
  EXPECT_TRUE(FailsWith(3, {file.string(), "no "}, RunWithMesh(file)));
  WriteFile(file,
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
            "property float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n");
  EXPECT_TRUE(FailsWith(3, {file.string(), "point cloud"}, RunWithMesh(file)));
  WriteFile(file, "");
  EXPECT_TRUE(FailsWith(3, {file.string()}, RunWithMesh(file)));
  EXPECT_TRUE(FailsWith(3, {scene_.folder.string()}, RunWithMesh(scene_.folder)));
}

TEST_F(BadInput, AMeshWithNanVerticesAndDegenerateTrianglesLocalizesWithAWarning) {
  const TriangleMesh mesh = ReadMesh(scene_.mesh());
  const size_t n = mesh.vertices.size();
  const fs::path file = scene_.folder / "other.ply";
  WriteFile(file, AsciiPly(mesh, "nan 0 0\n", fmt::format("3 0 1 {}\n3 0 0 1\n", n), 1, 2));
  const CommandResult result = RunWithMesh(file);
  EXPECT_EQ(result.exit_code, 0);
  for (const std::string& line : Lines(result.err)) {
    EXPECT_TRUE(line.starts_with("raylift: warning: ")) << line;
    EXPECT_NE(line.find(file.string()), std::string::npos) << line;
  }
  EXPECT_NE(result.err, "");
  EXPECT_TRUE(HoldsTruePoses(out_ / "poses.txt", scene_.queries, 1e-3, 1e-4));
  const auto summary = nlohmann::json::parse(ReadFile(out_ / "summary.json"));
  EXPECT_FALSE(summary["warnings"].empty());
}

TEST_F(BadInput, ADamagedTiffIsNamedOnOneLine) {
  const DepthMap wall{32, 24, std::vector<float>(size_t{32} * 24, 2.5f)};
  const fs::path file = scene_.folder / "a.tiff";
  WriteDepthFile(file, wall);
  const std::string whole = ReadFile(file);
  const auto is_refused = [&](const std::string& bytes) {
    try {
      ParseDepthFile(file, bytes);
    } catch (const InputError&) {
      return true;
    }
    return false;
  };
  // In the picture itself, behind which the directory stands: OpenCV notices it.
  std::string damaged = whole;
  for (size_t i = 8; i < whole.size() && !is_refused(damaged); ++i) {
    damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ 0xff);
  }
  ASSERT_TRUE(is_refused(damaged));
  const fs::path depth = scene_.folder / "depth";
  for (const PosedImage& reference : scene_.references) {
    WriteFile(depth / (reference.name + ".tiff"), damaged);
  }
  EXPECT_TRUE(
      Fails({depth.string(), "damaged or truncated"}, {"--geometry", "depth:" + depth.string()}));
}

TEST_F(BadInput, EstimateNamesTheProblemAndThePlace) {
  const fs::path file = scene_.folder / "problem.json";
  const auto fails = [&](const std::string& text, const std::string& part) {
    WriteFile(file, text);
    return FailsWith(3, {file.string(), part}, RunRaylift({"estimate", file}));
  };
  EXPECT_TRUE(fails("{", ""));
  EXPECT_TRUE(fails("{}", "format"));
  EXPECT_TRUE(FailsWith(3, {"/nowhere"}, RunRaylift({"estimate", "/nowhere"})));
  EXPECT_TRUE(FailsWith(3, {scene_.model().string()}, RunRaylift({"estimate", scene_.model()})));
}

TEST_F(BadInput, EvaluateNamesTheFileAndTheLine) {
  const fs::path poses = scene_.folder / "poses.txt";
  const auto fails = [&](const std::string& text, const std::string& part) {
    WriteFile(poses, text);
    return FailsWith(3, {poses.string(), part},
                     RunRaylift({"evaluate", "--ground-truth", scene_.truth(), "--poses", poses}));
  };
  EXPECT_TRUE(fails("query/a.png 1 0 0 0 0 0 nan\n", "line 1"));
  EXPECT_TRUE(fails("a 1 0 0 0 0 0 0\nb 1 0 0 0 0 0\n", "line 2"));
  EXPECT_TRUE(fails("a 1 0 0 0 0 0 0\na 1 0 0 0 0 0 0\n", "a"));
  EXPECT_TRUE(fails("a 0.5 0 0 0 0 0 0\n", "line 1"));
  EXPECT_TRUE(FailsWith(3, {"/nowhere"},
                        RunRaylift({"evaluate", "--ground-truth", "/nowhere", "--poses",
                                    scene_.folder / "poses.txt"})));
  EXPECT_TRUE(FailsWith(
      3, {scene_.images().string()},
      RunRaylift({"evaluate", "--ground-truth", scene_.truth(), "--poses", scene_.images()})));
}

TEST(BadImages, MissingOnesAndWrongSizesAreNamed) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const Arguments arguments = LocalizeFromImages(scene, scene.folder / "out");
  const fs::path query = scene.images() / "query/a.png";
  const fs::path reference = scene.images() / "ref/03.png";

  for (const fs::path& image : {query, reference}) {
    const fs::path hidden = image.string() + ".hidden";
    fs::rename(image, hidden);
    EXPECT_TRUE(FailsWith(3, {image.string()}, RunRaylift(arguments)));
    WriteFile(image, "no image");
    EXPECT_TRUE(FailsWith(3, {image.string()}, RunRaylift(arguments)));
    WriteFile(image, ReadFile(hidden).substr(0, 50));
    const CommandResult truncated = RunRaylift(arguments);  // libpng says a word of its own
    EXPECT_EQ(truncated.exit_code, 3);
    EXPECT_TRUE(Lines(truncated.err).back().starts_with("raylift: " + image.string()))
        << truncated.err;
    const Image small{64, 48, 3, std::vector<uint8_t>(size_t{64} * 48 * 3, 100)};
    WriteImage(image, small);
    EXPECT_TRUE(FailsWith(3, {image.string(), "64 x 48", "320 x 240"}, RunRaylift(arguments)));
    fs::rename(hidden, image);
  }
  EXPECT_FALSE(fs::exists(scene.folder / "out" / "poses.txt"));
}

TEST(BadImages, AnEmptyPictureIsListedAsNotLocalized) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  WriteImage(scene.images() / "query/a.png",
             {320, 240, 3, std::vector<uint8_t>(size_t{320} * 240 * 3, 100)});
  const CommandResult result = RunRaylift(LocalizeFromImages(scene, scene.folder / "out"));
  EXPECT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("not localized: query/a.png: "), std::string::npos) << result.out;
  EXPECT_EQ(PoseLines(scene.folder / "out" / "poses.txt").count("query/b.png"), 1u);
}

TEST(BadImages, AQueryThatIsAReferenceIsNamed) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  Replace(scene.query_list(), "query/a.png", "ref/00.png");
  EXPECT_TRUE(
      FailsWith(3, {"ref/00.png"}, RunRaylift(LocalizeFromImages(scene, scene.folder / "out"))));
}

}  // namespace
}  // namespace raylift
