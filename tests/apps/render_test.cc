// raylift render: what a user sees of it, and what is left of it when it is killed.

#include <cmath>
#include <cstdlib>

#include "apps/program.h"
#include "support/matchers.h"
#include "support/splat_files.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

// But for what is another one in each run.
std::map<std::string, std::string> Contents(const fs::path& folder) {
  std::map<std::string, std::string> contents;
  for (const std::string& file : FilesBelow(folder)) contents[file] = ReadFile(folder / file);
  contents.erase("timing.jsonl");
  return contents;
}

class Render : public ::testing::Test {
 protected:
  Arguments Command(const fs::path& out) const {
    return {"render", "--geometry", "mesh:" + scene_.mesh().string(), "--model", scene_.truth(),
            "--out",  out};
  }

  // Cameras that turn around in the room, to keep the program busy.
  fs::path WriteCameras(int count, const std::string& size) const {
    std::string text;
    const Rigid3 start = scene_.references.front().cam_from_world;
    for (int i = 0; i < count; ++i) {
      const double angle = 0.37 * i;
      const Eigen::Quaterniond q =
          Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()) * start.rotation;
      const Eigen::Vector3d t = -(q * start.OriginInSource());
      text += fmt::format("seq{}/{:04}.jpg {} {} {} {} {} {} {} SIMPLE_RADIAL {} 60 40 30 -0.1\n",
                          i % 3, i, FormatDouble(q.w()), FormatDouble(q.x()), FormatDouble(q.y()),
                          FormatDouble(q.z()), FormatDouble(t.x()), FormatDouble(t.y()),
                          FormatDouble(t.z()), size);
    }
    fs::path file = scene_.folder / "cameras.txt";
    WriteFile(file, text);
    return file;
  }

  Arguments ManyImages(const fs::path& cameras, const fs::path& out) const {
    return {"render",
            "--geometry",
            "mesh:" + scene_.mesh().string(),
            "--cameras",
            cameras,
            "--products",
            "depth,normals,color",
            "--format",
            "normals=npy",
            "--preview",
            "--out",
            out};
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false});
  fs::path out_ = scene_.folder / "out";
};

// Until the manifest lists more than `count` images, or the program has ended.
void WaitForImages(pid_t process, const fs::path& manifest, size_t count) {
  while (ReadManifest(manifest).size() <= count && !HasEnded(process)) usleep(2000);
}

TEST_F(Render, WritesDepthAndSaysWhat) {
  const CommandResult result = RunRaylift(Command(out_) + Arguments{"--preview"});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("coverage: "), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("to trace"), std::string::npos) << result.out;
  const size_t images = scene_.queries.size();
  EXPECT_EQ(ReadManifest(out_ / "manifest.jsonl").size(), images);
  EXPECT_EQ(FilesBelow(out_ / "depth").size(), images);
  const StoredDepth depth =
      ReadDepthFile(out_ / "depth" / fs::path(scene_.queries[0].name).replace_extension(".npy"));
  EXPECT_EQ(depth.width_px, scene_.queries[0].camera.width_px());
  EXPECT_GT(ReadImage(out_ / "preview.png", ImageChannels::kRgb).width_px, 240);
}

TEST_F(Render, TheCommandAndItsTimesHaveAFileOfTheirOwn) {
  ASSERT_TRUE(Succeeds(
      RunRaylift(Command(out_) + Arguments{"--format", "npy", "--glob", "*.*", "--deflate-npz"})));
  const auto run = nlohmann::json::parse(ReadFile(out_ / "timing.jsonl"));
  const std::string command = run.at("command");
  EXPECT_TRUE(command.starts_with("raylift render --geometry mesh:")) << command;
  for (const std::string& part : {std::string(" --format npy"), std::string(" --glob '*.*'"),
                                  std::string(" --deflate-npz"), " --out " + out_.string()}) {
    EXPECT_NE(command.find(part), std::string::npos) << command << " lacks " << part;
  }
  EXPECT_EQ(std::string(run.at("started")).size(), std::string("2026-01-31T23:59:59Z").size());
  EXPECT_GT(run.at("seconds"), 0);
  EXPECT_EQ(run.at("rendered"), scene_.queries.size());
}

TEST_F(Render, ScaledImagesHaveAModelOfTheirOwn) {
  ASSERT_TRUE(Succeeds(RunRaylift(Command(out_))));
  EXPECT_FALSE(fs::exists(out_ / "model"));
  const fs::path scaled = scene_.folder / "scaled";
  ASSERT_TRUE(Succeeds(RunRaylift(
      Command(scaled) + Arguments{"--scale", "0.5", "--products", "depth,points,inverse_depth",
                                  "--format", "points=npz", "--format", "inverse_depth=npy"})));
  const ColmapModel model = ReadColmapModel(scaled / "model");
  ASSERT_EQ(model.images.size(), scene_.queries.size());
  for (const auto& [id, image] : model.images) {
    const auto of = std::find_if(scene_.queries.begin(), scene_.queries.end(),
                                 [&](const auto& query) { return query.name == image.name; });
    ASSERT_NE(of, scene_.queries.end()) << image.name;
    EXPECT_LT((image.CamFromWorld().translation - of->cam_from_world.translation).norm(), 1e-9);
    const StoredDepth depth =
        ReadDepthFile(scaled / "depth" / fs::path(image.name).replace_extension(".npy"));
    EXPECT_EQ(model.cameras.at(image.camera_id).width_px(), depth.width_px);
    const fs::path points = scaled / "points" / fs::path(image.name).replace_extension(".npz");
    EXPECT_NE(ReadFile(points).find("points.npy"), std::string::npos);
  }
}

TEST_F(Render, TakesTheCamerasOfATransformsFile) {
  std::string list, frames;
  for (const auto& query : scene_.queries) {
    const Rigid3& pose = query.cam_from_world;
    const Eigen::Quaterniond& q = pose.rotation;
    const Eigen::Vector3d& t = pose.translation;
    list += fmt::format("{} {} {} {} {} {} {} {} PINHOLE 80 60 70 72 41 29\n", query.name,
                        FormatDouble(q.w()), FormatDouble(q.x()), FormatDouble(q.y()),
                        FormatDouble(q.z()), FormatDouble(t.x()), FormatDouble(t.y()),
                        FormatDouble(t.z()));
    // OpenGL's axes: y up, z back.
    const Eigen::Matrix3d r =
        q.toRotationMatrix().transpose() * Eigen::Vector3d(1, -1, -1).asDiagonal();
    const Eigen::Vector3d c = pose.OriginInSource();
    std::string rows;
    for (int i = 0; i < 3; ++i) {
      rows += fmt::format("[{},{},{},{}],", r(i, 0), r(i, 1), r(i, 2), c(i));
    }
    frames += fmt::format(R"({}{{"file_path":"./{}","transform_matrix":[{}[0,0,0,1]]}})",
                          frames.empty() ? "" : ",", query.name, rows);
  }
  const fs::path cameras = scene_.folder / "cameras.txt", json = scene_.folder / "transforms.json";
  WriteFile(cameras, list);
  WriteFile(json, fmt::format(R"({{"w":80,"h":60,"fl_x":70,"fl_y":72,"cx":41,"cy":29,)"
                              R"("frames":[{}]}})",
                              frames));
  const std::string mesh = "mesh:" + scene_.mesh().string();
  const fs::path from_list = scene_.folder / "list", from_json = scene_.folder / "json";
  ASSERT_TRUE(Succeeds(
      RunRaylift({"render", "--geometry", mesh, "--cameras", cameras, "--out", from_list})));
  ASSERT_TRUE(
      Succeeds(RunRaylift({"render", "--geometry", mesh, "--cameras", json, "--out", from_json})));
  const auto files = FilesBelow(from_list / "depth");
  ASSERT_EQ(files, FilesBelow(from_json / "depth"));
  for (const std::string& file : files) {
    const std::vector<float> a = ReadDepthFile(from_list / "depth" / file).values;
    const std::vector<float> b = ReadDepthFile(from_json / "depth" / file).values;
    ASSERT_EQ(a.size(), b.size());
    // All but rays that graze an edge.
    size_t equal = 0;
    for (size_t i = 0; i < a.size(); ++i) equal += std::abs(a[i] - b[i]) <= 1e-4f * a[i] ? 1 : 0;
    EXPECT_GE(equal, a.size() - 3);
  }
}

TEST_F(Render, SaysWhatItsFilesHold) {
  const CommandResult help = RunRaylift({"render", "--help-files"});
  ASSERT_TRUE(Succeeds(help));
  EXPECT_NE(help.out.find("depth: z along the camera's optical axis"), std::string::npos);
  EXPECT_EQ(help.out.find("raylift render"), std::string::npos) << "not the options' help";
  ASSERT_TRUE(Succeeds(RunRaylift(Command(out_) + Arguments{"--format", "exr"})));
  EXPECT_NE(ReadFile(out_ / "README.txt").find("channel Y"), std::string::npos);
}

TEST_F(Render, LogJsonIsALinePerImage) {
  const CommandResult result = RunRaylift(Command(out_) + Arguments{"--log-json"});
  ASSERT_TRUE(Succeeds(result));
  const auto lines = Lines(result.out);
  ASSERT_EQ(lines.size(), scene_.queries.size());
  for (const std::string& line : lines) {
    const auto json = nlohmann::json::parse(line);
    EXPECT_GT(json.at("coverage"), 0.5);
    EXPECT_GT(json.at("rays"), 0);
    EXPECT_GE(json.at("write_ms"), 0);
    EXPECT_EQ(json.at("files").size(), 1u);
  }
}

TEST_F(Render, WrongOptionsAreNamed) {
  const auto fails = [&](const Arguments& more, const std::vector<std::string>& parts) {
    return FailsWith(2, parts, RunRaylift(Command(out_) + more));
  };
  EXPECT_TRUE(fails({"--products", "depth,colour"}, {"--products", "colour", "normals"}));
  EXPECT_TRUE(fails({"--products", "depth,depth"}, {"--products", "twice"}));
  EXPECT_TRUE(fails({"--format", "jpg"}, {"--format", "jpg"}));
  EXPECT_TRUE(fails({"--format", "depth=jpg"}, {"--format", "npy|exr"}));
  EXPECT_TRUE(fails({"--scale", "0"}, {"--scale"}));
  EXPECT_TRUE(fails({"--scale", "2", "--size", "4x4"}, {"--scale, --size"}));
  EXPECT_TRUE(fails({"--size", "640"}, {"--size", "WIDTHxHEIGHT"}));
  EXPECT_TRUE(fails({"--every", "0"}, {"--every"}));
  EXPECT_TRUE(fails({"--shard", "7/3"}, {"--shard", "7/3"}));
  EXPECT_TRUE(fails({"--shading", "moon"}, {"--shading"}));
  EXPECT_TRUE(fails({"--png-step", "-1"}, {"--png-step"}));
  EXPECT_TRUE(fails({"--background", "1,2"}, {"--background"}));
  EXPECT_TRUE(fails({"--exr-compression", "zap"}, {"--exr-compression", "pxr24"}));
  EXPECT_TRUE(fails({"--cameras", "x"}, {"either --model or --cameras"}));
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(Render, AFinishedFolderIsNotWipedByForgettingToResume) {
  ASSERT_TRUE(Succeeds(RunRaylift(Command(out_))));
  const auto before = Contents(out_);
  EXPECT_TRUE(FailsWith(2, {"--overwrite", "--resume", out_.string(), "former run"},
                        RunRaylift(Command(out_))));
  EXPECT_EQ(Contents(out_), before);
  EXPECT_TRUE(FailsWith(2, {"--overwrite", "--resume"},
                        RunRaylift(Command(out_) + Arguments{"--resume", "--overwrite"})));
  const CommandResult fewer = RunRaylift(Command(out_) + Arguments{"--overwrite", "--every", "2"});
  EXPECT_EQ(fewer.exit_code, 0);
  EXPECT_NE(fewer.err.find("files of a former run stay"), std::string::npos) << fewer.err;
}

TEST_F(Render, CamerasThatAllMissTheMeshAreAWarning) {
  Arguments command = Command(out_);
  command[2] += ",shift=0/0/90000";
  const CommandResult result = RunRaylift(command);
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.err.find("sees the mesh"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("shift="), std::string::npos) << result.err;
}

TEST_F(Render, PointCloudsAreRefused) {
  const fs::path cloud = scene_.folder / "cloud.ply";
  WriteFile(cloud,
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
            "property float z\nend_header\n0 0 1\n1 0 1\n");
  EXPECT_TRUE(FailsWith(3, {cloud.string(), "expected a mesh, found a point cloud"},
                        RunRaylift({"render", "--geometry", "mesh:" + cloud.string(), "--model",
                                    scene_.truth(), "--out", out_})));
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(Render, APointCloudHasDepthNormalsAndColors) {
  const fs::path cloud = scene_.folder / "wall.xyz";  // across the whole room, two units ahead
  const Eigen::Vector3d eye = scene_.references.front().cam_from_world.OriginInSource();
  std::string text = "//X Y Z R G B\n";
  for (int y = -40; y <= 40; ++y) {
    for (int x = -40; x <= 40; ++x) {
      const Eigen::Vector3d in_cam(0.1 * x, 0.1 * y, 2);
      const Eigen::Vector3d p =
          eye + scene_.references.front().cam_from_world.rotation.conjugate() * in_cam;
      text += fmt::format("{} {} {} 10 200 30\n", p.x(), p.y(), p.z());
    }
  }
  WriteFile(cloud, text);
  const Arguments command = {
      "render", "--geometry", "cloud:" + cloud.string(), "--model", scene_.truth(), "--out", out_};
  const CommandResult result = RunRaylift(command + Arguments{"--products", "depth,normals,color"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("point cloud: 6561 points"), std::string::npos) << result.out;
  EXPECT_TRUE(FailsWith(2, {"cloud:", "no map of triangles"},
                        RunRaylift(command + Arguments{"--products", "triangle", "--overwrite"})));
  EXPECT_TRUE(FailsWith(
      2, {"cloud:", "alone"},
      RunRaylift(command +
                 Arguments{"--geometry", "mesh:" + scene_.mesh().string(), "--overwrite"})));
}

TEST_F(Render, SplatsHaveDepthNormalsAndColors) {
  const fs::path splats = scene_.folder / "wall.ply";  // one large disc, two units ahead
  const Rigid3& cam_from_world = scene_.references.front().cam_from_world;
  const Eigen::Quaterniond world_from_cam = cam_from_world.rotation.conjugate();
  WriteFile(splats, SplatPly({{TestSplat{.mean = cam_from_world.OriginInSource() +
                                                 world_from_cam * Eigen::Vector3d(0, 0, 2),
                                         .rotation = world_from_cam,
                                         .scale = {20, 20, 1e-3},
                                         .harmonics = {HarmonicOf({0, 1, 0})}}}},
                             SplatLayout::kEllipsoids));
  const Arguments command = {
      "render", "--geometry", "splat:" + splats.string(), "--model", scene_.truth(), "--out", out_};
  const CommandResult result = RunRaylift(command + Arguments{"--products", "depth,normals,color"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("splats: 1 Gaussian;"), std::string::npos) << result.out;
  EXPECT_TRUE(FailsWith(2, {"splat:", "a scene of splats has no map of triangles"},
                        RunRaylift(command + Arguments{"--products", "triangle", "--overwrite"})));
  EXPECT_TRUE(FailsWith(
      2, {"splat:", "alone"},
      RunRaylift(command +
                 Arguments{"--geometry", "mesh:" + scene_.mesh().string(), "--overwrite"})));
  WriteFile(splats,
            "ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\n"
            "property float y\nproperty float z\nend_header\n");
  EXPECT_TRUE(FailsWith(3, {splats.string(), "expected Gaussians"},
                        RunRaylift(command + Arguments{"--overwrite"})));
}

TEST_F(Render, DepthBeyondAPngIsRefusedUnlessAllowed) {
  const Arguments png = Command(out_) + Arguments{"--format", "png", "--png-step", "1e-5"};
  EXPECT_TRUE(FailsWith(3, {out_.string(), "65535 steps"}, RunRaylift(png)));
  const CommandResult dropped = RunRaylift(png + Arguments{"--out-of-range", "drop"});
  EXPECT_EQ(dropped.exit_code, 0);
  EXPECT_NE(dropped.err.find("values are stored as \"none\""), std::string::npos) << dropped.err;
}

TEST_F(Render, PanoramasSeeAllAround) {
  ASSERT_TRUE(
      Succeeds(RunRaylift(Command(out_) + Arguments{"--panorama", "64x32", "--format", "npy"})));
  const std::string file = FilesBelow(out_ / "depth").front();
  const StoredDepth depth = ReadDepthFile(out_ / "depth" / file);
  EXPECT_EQ(depth.width_px, 64);
  EXPECT_EQ(depth.height_px, 32);
}

TEST_F(Render, CubemapsHaveTheirCamerasAndClouds) {
  ASSERT_TRUE(Succeeds(RunRaylift(
      Command(out_) + Arguments{"--cubemap", "16", "--products", "points", "--format", "ply"})));
  const ColmapModel model = ReadColmapModel(out_ / "model");
  EXPECT_EQ(model.images.size(), 6 * ReadColmapModel(scene_.truth()).images.size());
  // The room is closed: each pixel has a point.
  for (const PosedImage& image : model.PosedImages()) {
    const fs::path stem = fs::path(image.name).replace_extension(".ply");
    EXPECT_NE(ReadFile(out_ / "points" / stem).find("element vertex 256\n"), std::string::npos);
  }
  EXPECT_TRUE(FailsWith(2, {"at most one of"},
                        RunRaylift(Command(out_) + Arguments{"--cubemap", "16", "--scale", "2"})));
  EXPECT_TRUE(FailsWith(2, {"--cubemap", "pixels"},
                        RunRaylift(Command(out_) + Arguments{"--cubemap", "0"})));
}

TEST_F(Render, WorksWithoutDisplayAndWithAHomeThatIsReadOnly) {
  const fs::path home = scene_.folder / "home";
  fs::create_directories(home);
  fs::permissions(home, fs::perms::owner_read | fs::perms::owner_exec);
  const Arguments command =
      Arguments{"/usr/bin/env",          "-u",           "DISPLAY", "-u", "WAYLAND_DISPLAY",
                "HOME=" + home.string(), RAYLIFT_PROGRAM} +
      Command(out_);
  EXPECT_TRUE(Succeeds(RunProcess(command)));
  EXPECT_TRUE(fs::is_empty(home));
}

TEST_F(Render, ASignalFinishesTheImageInHandAndResumeGoesOn) {
  constexpr size_t kNumImages = 300;  // still at work where this test must wait for a processor
  const fs::path cameras = WriteCameras(kNumImages, "320 240");
  ASSERT_TRUE(Succeeds(
      RunRaylift(ManyImages(cameras, scene_.folder / "whole") + Arguments{"--threads", "1"})));
  for (const int signal : {SIGINT, SIGTERM}) {
    fs::remove_all(out_);
    const pid_t process = StartRaylift(ManyImages(cameras, out_));
    WaitForImages(process, out_ / "manifest.jsonl", 2);
    kill(process, signal);
    EXPECT_EQ(WaitFor(process), 4);
    const size_t done = ReadManifest(out_ / "manifest.jsonl").size();
    EXPECT_GT(done, 2u);
    EXPECT_LT(done, kNumImages);
    // All that is there is listed.
    EXPECT_EQ(FilesBelow(out_).size(), 3 * done + 1);
    ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, out_) + Arguments{"--resume"})));
    EXPECT_EQ(Contents(out_), Contents(scene_.folder / "whole"));
  }
}

TEST_F(Render, KilledTwentyTimesAtRandomItLeavesTheSameFiles) {
  const fs::path cameras = WriteCameras(400, "96 72");
  ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, scene_.folder / "whole"))));
  Rng rng = TestRng();
  int kills = 0;
  for (int i = 0; i < 20; ++i) {
    const pid_t process = StartRaylift(ManyImages(cameras, out_) + Arguments{"--resume"});
    // In the middle of the work, wherever that is: after some more images, plus a little.
    WaitForImages(process, out_ / "manifest.jsonl",
                  ReadManifest(out_ / "manifest.jsonl").size() + rng.UniformIndex(16));
    usleep(rng.UniformIndex(4000));
    kill(process, SIGKILL);
    kills += WaitFor(process) == 128 + SIGKILL ? 1 : 0;
  }
  EXPECT_GT(kills, 15);
  ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, out_) + Arguments{"--resume"})));
  EXPECT_EQ(Contents(out_), Contents(scene_.folder / "whole"));
}

TEST_F(Render, AFullDiskNamesTheFileAndTheRestIsResumed) {
  // No file may be larger than 64 kB: the small images fit, the large one, which is the last, not.
  const fs::path cameras = WriteCameras(6, "96 72");
  const std::string small = ReadFile(cameras);
  WriteFile(cameras, small + "large.jpg 1 0 0 0 0 0 0 SIMPLE_RADIAL 960 720 600 480 360 -0.1\n");
  const Arguments command = Arguments{"render",    "--geometry", "mesh:" + scene_.mesh().string(),
                                      "--cameras", cameras,      "--format",
                                      "npy",       "--threads",  "1",
                                      "--out"};
  ASSERT_TRUE(Succeeds(RunRaylift(command + Arguments{scene_.folder / "whole"})));
  const CommandResult full =
      RunProcess(Arguments{"/bin/sh", "-c", "trap '' XFSZ; ulimit -f 128; exec \"$@\"", "sh",
                           RAYLIFT_PROGRAM} +
                 command + Arguments{out_});
  EXPECT_TRUE(FailsWith(5, {(out_ / "depth" / "large.npy").string(), "cannot be written"}, full));
  EXPECT_EQ(ReadManifest(out_ / "manifest.jsonl").size(), 6u);
  EXPECT_EQ(FilesBelow(out_).size(), 7u) << "the small images and the manifest";
  const CommandResult resumed = RunRaylift(command + Arguments{out_, "--resume"});
  ASSERT_TRUE(Succeeds(resumed));
  EXPECT_NE(resumed.out.find("6 kept"), std::string::npos) << resumed.out;
  EXPECT_EQ(Contents(out_), Contents(scene_.folder / "whole"));
}

TEST_F(Render, AnOutputThatCannotBeMadeIsNoBadInput) {
  const fs::path file = scene_.folder / "file";
  WriteFile(file, "in the way");
  EXPECT_TRUE(FailsWith(5, {file.string()}, RunRaylift(Command(file / "out"))));
  WriteFile(out_ / "depth", "in the way");
  EXPECT_TRUE(FailsWith(5, {(out_ / "depth").string()}, RunRaylift(Command(out_))));
}

TEST_F(Render, ShardsSideBySideAreOneRun) {
  const fs::path cameras = WriteCameras(40, "96 72");
  ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, scene_.folder / "whole"))));
  const pid_t first = StartRaylift(ManyImages(cameras, out_) + Arguments{"--shard", "1/2"});
  const pid_t second = StartRaylift(ManyImages(cameras, out_) + Arguments{"--shard", "2/2"});
  EXPECT_EQ(WaitFor(first), 0);
  EXPECT_EQ(WaitFor(second), 0);
  EXPECT_EQ(Contents(out_), Contents(scene_.folder / "whole"));
}

TEST_F(Render, FilesThatHaveChangedAreFoundAndRenderedAgain) {
  const fs::path cameras = WriteCameras(6, "96 72");
  const fs::path whole = scene_.folder / "whole";
  ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, whole))));
  ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, out_))));
  const CommandResult good = RunRaylift({"verify", out_});
  ASSERT_TRUE(Succeeds(good));
  EXPECT_TRUE(good.out.starts_with("6 tasks of render, 21 files, ")) << good.out;
  const fs::path flipped = out_ / "normals/seq1/0001.npy";
  std::string bytes = ReadFile(flipped);
  bytes[bytes.size() / 2] ^= 1;
  WriteFile(flipped, bytes);
  fs::remove(out_ / "depth/seq2/0002.npy");
  const CommandResult bad = RunRaylift({"verify", out_});
  EXPECT_EQ(bad.exit_code, 3);
  EXPECT_EQ(bad.out, "normals/seq1/0001.npy has other contents\ndepth/seq2/0002.npy is missing\n");
  EXPECT_NE(bad.err.find("2 of 21 files"), std::string::npos) << bad.err;
  const CommandResult resumed = RunRaylift(ManyImages(cameras, out_) + Arguments{"--resume"});
  ASSERT_TRUE(Succeeds(resumed));
  EXPECT_NE(resumed.out.find("2 rendered, 4 kept"), std::string::npos) << resumed.out;
  EXPECT_EQ(Contents(out_), Contents(whole));
}

TEST_F(Render, StatusTellsWhatIsLeft) {
  const fs::path cameras = WriteCameras(7, "96 72");
  ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, out_) + Arguments{"--shard", "2/3"})));
  const CommandResult part = RunRaylift({"status", out_});
  EXPECT_EQ(part.exit_code, 4);
  EXPECT_NE(part.out.find("shard 2/3: 2 of 2, done"), std::string::npos) << part.out;
  EXPECT_NE(part.out.find("done: 2 of 7"), std::string::npos) << part.out;
  EXPECT_NE(part.out.find("--array=0-1 "), std::string::npos) << part.out;
  for (const std::string shard : {"0/3", "1/3"}) {
    ASSERT_TRUE(Succeeds(RunRaylift(ManyImages(cameras, out_) + Arguments{"--shard", shard})));
  }
  const CommandResult all = RunRaylift({"status", out_});
  ASSERT_TRUE(Succeeds(all));
  EXPECT_EQ(all.out, "render: done\ndone: 7 of 7\n");
  EXPECT_TRUE(FailsWith(3, {"localize, estimate or experiment"}, RunRaylift({"merge", out_})));
}

// Resident memory of a running process in kilobytes, 0 where that cannot be told.
size_t ResidentKb(pid_t process) {
  const fs::path file = fmt::format("/proc/{}/statm", process);
  if (!fs::exists(file)) return 0;
  const std::string statm = ReadFile(file);
  const auto tokens = SplitTokens(statm);
  const auto pages = tokens.size() > 1 ? ParseUint(tokens[1]) : std::nullopt;
  return pages.value_or(0) * static_cast<size_t>(sysconf(_SC_PAGESIZE)) / 1024;
}

TEST_F(Render, MemoryStaysFlat) {
  constexpr size_t kImages = 2000;
  const fs::path cameras = WriteCameras(kImages, "96 72");
  const pid_t process = StartRaylift(ManyImages(cameras, out_));
  WaitForImages(process, out_ / "manifest.jsonl", kImages / 10);
  const size_t early = ResidentKb(process);
  WaitForImages(process, out_ / "manifest.jsonl", kImages * 9 / 10);
  const size_t late = ResidentKb(process);
  EXPECT_EQ(WaitFor(process), 0);
  if (early == 0 || late == 0) GTEST_SKIP() << "no /proc, or the program was too fast";
  // The manifest's entries, under a kilobyte each, and what the allocators keep.
  EXPECT_LT(late, early + size_t{8} * 1024) << early << " kB after a tenth of the images";
}

}  // namespace
}  // namespace raylift
