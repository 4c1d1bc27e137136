#include "raylift/views/render_job.h"

#include <cmath>
#include <fstream>

#include "jobs/manifest_file.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

constexpr size_t kNumImages = 18;

std::shared_ptr<const RayCaster> Scene() {
  return std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 0}, 3, 30, 60)));
}

// Views from inside the sphere, through every camera model.
std::vector<RenderTask> Tasks() {
  std::vector<RenderTask> tasks;
  const std::vector<Camera> cameras = CamerasOfEveryModel();
  for (size_t i = 0; i < kNumImages; ++i) {
    const double angle = 0.3 * static_cast<double>(i);
    const Rigid3 pose = LookAt({0.2, 0.1, 0}, {std::cos(angle), 0.2, std::sin(angle)});
    const std::string stem = fmt::format("camera{}/{:02}", i % 2, i);
    tasks.push_back({{stem + ".jpg", cameras[i % cameras.size()], pose}, stem});
  }
  tasks.back().view.camera = Camera::Panorama(40, 20);
  return tasks;
}

RenderJobOptions Options(const fs::path& out) {
  RenderJobOptions options{
      .out = out,
      .products = {{Product::kDepth, "exr"}, {Product::kNormals, "npy"}, {Product::kColor, "png"}}};
  options.threads = 2;
  options.preview = true;
  return options;
}

// All files below a folder with their bytes.
std::map<std::string, std::string> Contents(const fs::path& folder) {
  std::map<std::string, std::string> contents;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      contents[fs::relative(entry.path(), folder).string()] = ReadFile(entry.path());
    }
  }
  return contents;
}

class RenderJob : public ::testing::Test {
 protected:
  RenderSummary Run(const RenderJobOptions& options, const RenderHooks& hooks = {}) const {
    return RunRenderJob(scene_, Tasks(), options, hooks);
  }

  // What an uninterrupted run leaves.
  std::map<std::string, std::string> Reference() const {
    Run(Options(folder_ / "reference"));
    return Contents(folder_ / "reference");
  }

  std::shared_ptr<const RayCaster> scene_ = Scene();
  fs::path folder_ = TestFolder();
  fs::path out_ = folder_ / "out";
};

TEST_F(RenderJob, WritesEveryProductOfEveryImage) {
  const RenderSummary summary = Run(Options(out_));
  EXPECT_EQ(summary.images, kNumImages);
  EXPECT_EQ(summary.rendered, kNumImages);
  EXPECT_TRUE(summary.complete);
  EXPECT_EQ(summary.totals.Coverage(), 1);
  ASSERT_TRUE(summary.totals.depth_range);
  EXPECT_LT(summary.totals.depth_range->second, 3.3f);
  const auto contents = Contents(out_);
  EXPECT_EQ(contents.size(), 3 * kNumImages + 4);
  for (const std::string file :
       {"depth/camera0/00.exr", "normals/camera1/17.npy", "color/camera1/17.png", "manifest.jsonl",
        "preview.png", "README.txt"}) {
    EXPECT_TRUE(contents.contains(file)) << file;
  }
  const auto json = nlohmann::json::parse(contents.at("summary.json"));
  EXPECT_EQ(json.at("images"), kNumImages);
  EXPECT_EQ(json.at("coverage"), 1.0);
  EXPECT_TRUE(json.at("images_without_surface").empty());
}

TEST_F(RenderJob, ThreadsDoNotChangeAByte) {
  const auto expected = Reference();
  RenderJobOptions options = Options(out_);
  for (const int threads : {1, 5}) {
    options.threads = threads;
    Run(options);
    EXPECT_EQ(Contents(out_), expected) << threads;
    fs::remove_all(out_);
  }
}

TEST_F(RenderJob, ShardsTogetherAreOneRun) {
  const auto expected = Reference();
  RenderJobOptions options = Options(out_);
  size_t images = 0;
  for (int i = 0; i < 3; ++i) {
    options.shard = {i, 3};
    const RenderSummary summary = Run(options);
    images += summary.images;
    EXPECT_EQ(summary.complete, i == 2);
  }
  EXPECT_EQ(images, kNumImages);
  EXPECT_EQ(Contents(out_), expected);
}

TEST_F(RenderJob, AStoppedRunGoesOnWhereItWas) {
  const auto expected = Reference();
  RenderJobOptions options = Options(out_);
  options.resume = true;
  size_t runs = 0;
  for (RenderSummary summary; !summary.complete; ++runs) {
    ASSERT_LE(runs, kNumImages);
    std::atomic<bool> stop{false};
    size_t rendered = 0;
    summary = Run(options, {.on_image = [&](const RenderedImage&) { stop = ++rendered >= 4; },
                            .stop = &stop});
    EXPECT_EQ(summary.rendered + summary.kept + summary.left, kNumImages);
  }
  EXPECT_GE(runs, 3u);
  EXPECT_EQ(Contents(out_), expected);
}

TEST_F(RenderJob, ResumeRedoesWhatIsMissingOrStaleOnly) {
  const auto expected = Reference();
  RenderJobOptions options = Options(folder_ / "reference");
  options.resume = true;
  EXPECT_EQ(Run(options).rendered, 0u);
  fs::remove(options.out / "normals/camera0/02.npy");
  WriteFile(options.out / "depth/camera1/03.exr", "half a file");
  EXPECT_EQ(Run(options).rendered, 2u);
  EXPECT_EQ(Contents(options.out), expected);

  options.products[0].format = "npy";  // another job
  EXPECT_EQ(Run(options).rendered, kNumImages);
  std::vector<RenderTask> tasks = Tasks();
  tasks[4].view.cam_from_world.translation.x() += 1e-9;
  EXPECT_EQ(RunRenderJob(scene_, tasks, options, {}).rendered, 1u);
  const auto other_mesh = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 1e-6}, 3, 30, 60)));
  EXPECT_EQ(RunRenderJob(other_mesh, tasks, options, {}).rendered, kNumImages);
}

TEST_F(RenderJob, AFormerRunIsReplacedOnlyWhereThatIsAskedFor) {
  const auto expected = Reference();
  RenderJobOptions options = Options(folder_ / "reference");
  EXPECT_THROW(Run(options), OptionError);
  EXPECT_EQ(Contents(options.out), expected);
  options.shard = {1, 3};
  EXPECT_THROW(Run(options), OptionError);
  EXPECT_EQ(Contents(options.out), expected);
  options.shard = {};
  options.overwrite = true;
  EXPECT_EQ(Run(options).rendered, kNumImages);
  EXPECT_EQ(Contents(options.out), expected);
}

TEST_F(RenderJob, OtherShardsAreNoFormerRunButThoseOfAnotherJobAre) {
  RenderJobOptions options = Options(out_);
  options.shard = {0, 3};
  Run(options);
  EXPECT_THROW(Run(options), OptionError);  // the same once more
  options.shard = {1, 3};
  Run(options);
  options.shard = {1, 2};  // divided otherwise
  EXPECT_THROW(Run(options), OptionError);
  options.shard = {2, 3};
  options.products[0].format = "npy";
  EXPECT_THROW(Run(options), OptionError);
}

TEST_F(RenderJob, ShardsAreOfEqualSize) {
  RenderJobOptions options = Options(out_);
  for (int i = 0; i < 4; ++i) {
    options.shard = {i, 4};
    EXPECT_EQ(Run(options).rendered, i < 2 ? 5u : 4u) << i;
  }
}

TEST_F(RenderJob, CamerasThatAllMissTheMeshAreToldOf) {
  const auto far = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 3000}, 1, 10, 20)));
  const RenderSummary summary = RunRenderJob(far, Tasks(), Options(out_), {});
  ASSERT_EQ(summary.warnings.size(), 1u);
  const auto json = nlohmann::json::parse(ReadFile(out_ / "summary.json"));
  EXPECT_EQ(json.at("warnings"), nlohmann::json(summary.warnings));
  EXPECT_TRUE(Run(Options(folder_ / "seen")).warnings.empty());
}

TEST_F(RenderJob, AsksForTheUnitOfAMeshThatIsVeryLargeAroundTheCameras) {
  const auto large = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 0}, 5000, 10, 20)));
  std::vector<RenderTask> tasks;
  for (int i = 0; i < 10; ++i) {
    tasks.push_back(Tasks().front());
    tasks.back().view.name = fmt::format("{}.png", i);
    tasks.back().stem = std::to_string(i);
    tasks.back().view.cam_from_world.translation.x() = 0.1 * i;
  }
  const auto warnings = [&](std::shared_ptr<const RayCaster> scene) {
    RenderJobOptions options = Options(out_);
    options.overwrite = true;
    return RunRenderJob(std::move(scene), tasks, options, {}).warnings;
  };
  EXPECT_THAT(warnings(large), testing::ElementsAre(testing::HasSubstr("in another unit")));
  tasks.resize(9);
  EXPECT_THAT(warnings(large), testing::IsEmpty());
}

TEST_F(RenderJob, AReadmeOfSomebodyElseStays) {
  WriteFile(out_ / "README.txt", "mine");
  Run(Options(out_));
  EXPECT_EQ(ReadFile(out_ / "README.txt"), "mine");
}

TEST_F(RenderJob, FilesOfAFormerRunThatStayAreNamed) {
  RenderJobOptions options = Options(out_);
  EXPECT_TRUE(Run(options).foreign_files.empty());
  options.overwrite = true;
  std::vector<RenderTask> tasks = Tasks();
  tasks.erase(tasks.begin());
  const std::vector<std::string> gone = {"color/camera0/00.png", "depth/camera0/00.exr",
                                         "normals/camera0/00.npy"};
  EXPECT_EQ(RunRenderJob(scene_, tasks, options, {}).foreign_files, gone);
  EXPECT_TRUE(Run(options).foreign_files.empty());
}

TEST_F(RenderJob, HalfFilesOfAKilledRunAreRemoved) {
  const auto expected = Reference();
  RenderJobOptions options = Options(out_);
  options.resume = true;
  WriteFile(out_ / "depth/camera0/.00.0a1b2c3d-4711-3.tmp.exr", "half");
  WriteFile(out_ / ".manifest.0a1b2c3d-4711-4.tmp.jsonl", "half");
  WriteFile(out_ / ".summary.0a1b2c3d-4711-5.tmp.json", "half");
  WriteFile(out_ / "manifest.jsonl", "{\"half");
  Run(options);
  EXPECT_EQ(Contents(out_), expected);
}

TEST_F(RenderJob, AFileThatCannotBeWrittenIsNamedAndTheRestResumes) {
  const auto expected = Reference();
  const fs::path obstacle = out_ / "normals/camera0/08.npy";
  fs::create_directories(obstacle / "in the way");
  RenderJobOptions options = Options(out_);
  options.resume = true;
  EXPECT_TRUE(FailsWithInputError([&] { Run(options); }, {obstacle.string()}));
  const size_t done = ReadManifest(out_ / "manifest.jsonl").size();
  EXPECT_LT(done, kNumImages);
  fs::remove_all(obstacle);
  const RenderSummary summary = Run(options);
  EXPECT_EQ(summary.kept, done);
  EXPECT_EQ(Contents(out_), expected);
}

TEST_F(RenderJob, AFullDiskIsAnErrorThatNamesAFile) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "there is no /dev/full";
  fs::create_directories(out_);
  fs::create_symlink("/dev/full", out_ / "manifest.jsonl");
  std::ofstream probe(out_ / "manifest.jsonl");
  ASSERT_TRUE(probe);
  ManifestAppender appender(out_ / "manifest.jsonl");
  appender.Append("a line");
  EXPECT_THROW(appender.Flush(), OutputError);
  EXPECT_THROW(appender.Append("another"), OutputError);
}

TEST_F(RenderJob, TwoRunsDoNotWriteToOneFolder) {
  bool refused = false;
  std::atomic<bool> stop{false};
  Run(Options(out_), {.on_image =
                          [&](const RenderedImage&) {
                            if (refused) return;
                            refused = bool(FailsWithInputError([&] { Run(Options(out_)); },
                                                               {out_.string(), "another run"}));
                          },
                      .stop = &stop});
  EXPECT_TRUE(refused);
}

}  // namespace
}  // namespace raylift
