// The field's data sets: the files that say where their photographs were taken. The photographs are
// one small picture.

#include <array>

#include "fuzz/fuzz_targets.h"
#include <fmt/format.h>

#include "raylift/datasets/dataset.h"
#include "raylift/io/image_file.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

void PutPicture(const std::filesystem::path& name) {
  const auto file = ScratchFolder() / name;
  if (!std::filesystem::exists(file)) {
    WriteImage(file, Image{8, 6, 1, std::vector<uint8_t>(48, 100)});
  }
}

void Import(std::string_view dataset, std::string_view bytes, const std::filesystem::path& folder,
            std::span<const std::string_view> files,
            std::initializer_list<std::string_view> pictures) {
  const auto root = SplitFiles(bytes, folder, files);
  for (const std::string_view picture : pictures) PutPicture(folder / picture);
  for (const ImportedScene& scene : ImportDataset(dataset, root, {.query_every = 2})) {
    WriteImportedScene(ScratchFolder() / "imported", scene, dataset);
  }
}

std::vector<std::string> Joined(std::initializer_list<std::string_view> texts) {
  return {fmt::format("{}", fmt::join(texts, "\n=FILE=\n"))};
}

constexpr std::string_view kPose = "1 0 0 0.5\n0 1 0 1\n0 0 1 2\n0 0 0 1\n";

constexpr auto kKaptureFiles = std::to_array<std::string_view>(
    {"mapping/sensors/sensors.txt", "mapping/sensors/rigs.txt", "mapping/sensors/trajectories.txt",
     "mapping/sensors/records_camera.txt", "validation/sensors/sensors.txt",
     "validation/sensors/records_camera.txt"});
constexpr auto kCambridgeFiles = std::to_array<std::string_view>(
    {"dataset_train.txt", "dataset_test.txt", "reconstruction.nvm"});
constexpr auto kNerfstudioFiles = std::to_array<std::string_view>({"transforms.json"});
constexpr auto kTumFiles = std::to_array<std::string_view>({"rgb.txt", "groundtruth.txt"});
constexpr auto kScanNetFiles = std::to_array<std::string_view>(
    {"intrinsic/intrinsic_color.txt", "pose/0.txt", "pose/1.txt", "pose/2.txt"});
constexpr auto kScanNetPpFiles = std::to_array<std::string_view>(
    {"dslr/train_test_lists.json", "dslr/colmap/cameras.txt", "dslr/colmap/images.txt"});
constexpr auto kLamarFiles = std::to_array<std::string_view>(
    {"sessions/map/sensors.txt", "sessions/map/rigs.txt", "sessions/map/trajectories.txt",
     "sessions/map/images.txt", "sessions/query/sensors.txt", "sessions/query/images.txt",
     "sessions/query/queries.txt"});
constexpr auto kSevenScenesFiles = std::to_array<std::string_view>(
    {"TrainSplit.txt", "TestSplit.txt", "seq-01/frame-000000.pose.txt",
     "seq-02/frame-000000.pose.txt"});
constexpr auto kTwelveScenesFiles = std::to_array<std::string_view>(
    {"info.txt", "split.txt", "data/frame-000000.pose.txt", "data/frame-000001.pose.txt"});

}  // namespace

std::vector<FuzzTarget> DatasetFuzzTargets() {
  return {
      {"dataset_kapture",
       [](std::string_view bytes) { Import("gangnam", bytes, "kapture", kKaptureFiles, {}); },
       [] {
         constexpr std::string_view kSensors =
             "# kapture format: 1.1\nc, , camera, PINHOLE, 8, 6, 5, 5, 4, 3\n";
         return Joined({kSensors, "# kapture format: 1.1\nrig, c, 1, 0, 0, 0, 0, 0, 0\n",
                        "# kapture format: 1.1\n10, rig, 1, 0, 0, 0, 1, 2, 3\n",
                        "# kapture format: 1.1\n10, c, a.jpg\n", kSensors,
                        "# kapture format: 1.1\n18446744073709551615, c, b.jpg\n"});
       },
       "=FILE= # kapture format: 1. camera UNKNOWN_CAMERA OPENCV , nan 1e308"},
      {"dataset_nvm",
       [](std::string_view bytes) {
         Import("cambridge", bytes, "cambridge", kCambridgeFiles, {"seq1/a.png", "seq1/b.png"});
       },
       [] {
         constexpr std::string_view kHeader =
             "Visual Landmark Dataset V1\nImageFile, Camera Position [X Y Z W P Q R]\n\n";
         return Joined({std::string(kHeader) + "seq1/a.png 0 0 0 1 0 0 0\n",
                        std::string(kHeader) + "seq1/b.png 1 0 0 1 0 0 0\n",
                        "NVM_V3\n\n2\nseq1/a.jpg\t8 1 0 0 0 0 0 0 0 0\nseq1/b.jpg\t8 1 0 0 0 1 0 0 "
                        "0.01 0\n"});
       },
       "=FILE= NVM_V3 18446744073709551615 nan 1e308 1e-320"},
      {"dataset_transforms",
       [](std::string_view bytes) {
         Import("nerfstudio", bytes, "nerfstudio", kNerfstudioFiles, {"a.png", "b.png"});
       },
       [] {
         return std::vector<std::string>{
             R"({"w":8,"h":6,"fl_x":9,"fl_y":9,"cx":4,"cy":3,"k1":0.01,"camera_model":"OPENCV",)"
             R"("applied_transform":[[1,0,0,0],[0,0,1,0],[0,-1,0,0]],"applied_scale":2,)"
             R"("frames":[{"file_path":"a.png","transform_matrix":)"
             R"([[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},{"file_path":"b","fl_x":8,)"
             R"("transform_matrix":[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]})"};
       },
       "\"camera_angle_x\" \"camera_angle_y\" \"OPENCV_FISHEYE\" \"EQUIRECTANGULAR\" "
       "\"train_filenames\" \"test_filenames\" \"depth_file_path\" \"is_fisheye\" \"k2\" \"p1\" "
       "\"aabb_scale\" \"ply_file_path\" 1e308 1e-320 -1 null [[[[ 3.141592653589793"},
      {"dataset_tum",
       [](std::string_view bytes) {
         Import("tum", bytes, "tum", kTumFiles, {"rgb/1.png", "rgb/2.png"});
       },
       [] {
         return Joined({"# c\n1.0 rgb/1.png\n1.05 rgb/2.png\n",
                        "0.99 0 0 0 0 0 0 1\n1.04 1 0 0 0 0 0 1\n1.06 1 1 0 0 0 1 0\n"});
       },
       "=FILE= nan inf 1e308 1e-320"},
      {"dataset_scannet",
       [](std::string_view bytes) {
         Import("scannet", bytes, "scannet", kScanNetFiles,
                {"color/0.jpg", "color/1.jpg", "color/2.jpg"});
       },
       [] {
         return Joined({"9 0 4 0\n0 9 3 0\n0 0 1 0\n0 0 0 1\n", kPose, kPose,
                        "-inf 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"});
       },
       "=FILE= nan -inf 1e308 1e-320"},
      {"dataset_scannetpp",
       [](std::string_view bytes) {
         Import("scannetpp", bytes, "scannetpp", kScanNetPpFiles,
                {"dslr/resized_images/a.JPG", "dslr/resized_images/b.JPG"});
       },
       [] {
         return Joined({R"({"train": ["a.JPG"], "test": ["b.JPG"], "has_masks": true})",
                        "1 OPENCV_FISHEYE 8 6 5 5 4 3 0.01 0 0 0\n",
                        "1 1 0 0 0 1 2 3 1 a.JPG\n\n2 0 1 0 0 1 2 3 1 b.JPG\n\n"});
       },
       "=FILE= \"train\" \"test\" OPENCV_FISHEYE null [[ nan 1e308 4294967297"},
      {"dataset_lamar",
       [](std::string_view bytes) {
         Import("lamar", bytes, "lamar", kLamarFiles,
                {"sessions/map/raw_data/a.jpg", "sessions/query/raw_data/b.jpg"});
       },
       [] {
         constexpr std::string_view kSensors = "c, n, camera, PINHOLE, 8, 6, 5, 5, 4, 3\n";
         return Joined({kSensors, "rig, c, 1, 0, 0, 0, 0, 0, 0\n",
                        "10, rig, 1, 0, 0, 0, 1, 2, 3, 0.1\n", "10, c, a.jpg\n", kSensors,
                        "12, c, b.jpg\n", "12, c\n"});
       },
       "=FILE= camera depth OPENCV , # nan 1e308 18446744073709551615"},
      {"dataset_7scenes",
       [](std::string_view bytes) {
         Import("7scenes", bytes, "7scenes", kSevenScenesFiles,
                {"seq-01/frame-000000.color.png", "seq-02/frame-000000.color.png"});
       },
       [] {
         return Joined({"sequence1\n", "sequence2\n", kPose, kPose});
       },
       "=FILE= sequence nan 1e308 4294967297"},
      {"dataset_12scenes",
       [](std::string_view bytes) {
         Import("12scenes", bytes, "12scenes", kTwelveScenesFiles,
                {"data/frame-000000.color.jpg", "data/frame-000001.color.jpg"});
       },
       [] {
         return Joined(
             {"m_colorWidth = 8\nm_colorHeight = 6\nm_calibrationColorIntrinsic = 9 0 4 0 "
              "0 9 3 0 0 0 1 0 0 0 0 1\n",
              "sequence0 [frames=1] [start=0 ; end=0]\nsequence1 [frames=1] [start=1 ; "
              "end=1]\n",
              kPose, kPose});
       },
       "=FILE= m_colorWidth sequence [frames= [start= end= 2147483648 18446744073709551615 -1 nan"},
  };
}

}  // namespace raylift
