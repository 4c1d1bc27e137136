// Tiny copies of the field's data sets, each in exactly its own layout, with known poses.

#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "raylift/scene/photographs.h"

namespace raylift {

struct LayoutInput {
  int width_px = 64;
  int height_px = 48;
  std::vector<Rigid3> references;  // cam_from_world
  std::vector<Rigid3> queries;     // data sets without queries of their own take the first alone
  // Writes the photograph of a view; by default a gray one.
  std::function<void(const std::filesystem::path& file, const PosedImage& view)> write_picture = {};
};

// What the folder holds, and so what should come out of it.
struct Layout {
  std::filesystem::path folder;  // to be imported
  std::filesystem::path images, query_images;
  std::vector<PosedImage> references = {};  // names, cameras and poses
  std::vector<PosedImage> queries = {};
  int query_every = 8;  // to be imported with, where the data set has no queries of its own
};

// 7-Scenes: seq-01 and seq-02 are for training, seq-03 is the test. The files hold the poses of the
// depth camera.
Layout Write7Scenes(const std::filesystem::path& folder, const LayoutInput& input);
// 12 Scenes: the first sequence is the test. Its camera's center, and ScanNet's, is counted from
// the center of the first pixel.
Layout Write12Scenes(const std::filesystem::path& folder, const LayoutInput& input);
// Cambridge Landmarks: every photograph has a focal length of its own.
Layout WriteCambridge(const std::filesystem::path& folder, const LayoutInput& input);
// Aachen Day-Night v1.1: the first query was taken by day, the others at night.
Layout WriteAachen(const std::filesystem::path& folder, const LayoutInput& input);
// Extended CMU Seasons: slice2 with two cameras that take turns; all query poses are public.
Layout WriteCmu(const std::filesystem::path& folder, const LayoutInput& input);
// Gangnam Station: pairs of photographs by a rig of two cameras whose poses are the rig's.
Layout WriteGangnam(const std::filesystem::path& folder, const LayoutInput& input);
// nerfstudio: intrinsics per frame, and an applied transform and scale; frames/0001.png on.
Layout WriteNerfstudio(const std::filesystem::path& folder, const LayoutInput& input);
// TUM RGB-D: the sequence rgbd_dataset_freiburg3_tiny, the photographs in their order.
Layout WriteTum(const std::filesystem::path& folder, const LayoutInput& input);
// ScanNet: an exported scene.
Layout WriteScanNet(const std::filesystem::path& folder, const LayoutInput& input);
// ScanNet++: the references are the DSLR's training photographs, the queries its test photographs;
// the telephone took a frame from each query's place, too.
Layout WriteScanNetPp(const std::filesystem::path& folder, const LayoutInput& input);
// ETH3D: photographs as they were taken.
Layout WriteEth3d(const std::filesystem::path& folder, const LayoutInput& input);
// LaMAR: the map by a rig of two cameras, and queries of a telephone.
Layout WriteLamar(const std::filesystem::path& folder, const LayoutInput& input);

}  // namespace raylift
