// A small scene on disk with known truth: a room with a block in it, noise on all surfaces.

#pragma once

#include <filesystem>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/photographs.h"

namespace raylift {

struct RoomOptions {
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // of everything
  bool matches = true;                               // hloc's files
  bool pictures = false;                             // of the room at 0 alone
};

// The room is 6 x 3 x 4 units, y down; six references look one way, two queries stand among them.
struct RoomScene {
  std::filesystem::path folder;
  std::vector<PosedImage> references;
  std::vector<PosedImage> queries;  // with the true poses

  std::filesystem::path mesh() const { return folder / "room.obj"; }
  std::filesystem::path model() const { return folder / "model"; }  // text
  std::filesystem::path truth() const { return folder / "truth"; }  // COLMAP model, binary
  std::filesystem::path query_list() const { return folder / "queries.txt"; }
  std::filesystem::path images() const { return folder / "images"; }
  // hloc's files. Keypoints are the exact projections of points of the surfaces, and matches are
  // those of the same point: poses are found up to the rounding of float keypoints.
  std::filesystem::path features() const { return folder / "features.h5"; }
  std::filesystem::path matches() const { return folder / "matches.h5"; }
  std::filesystem::path pairs() const { return folder / "pairs.txt"; }
};

// Writes the scene's files to `folder`.
RoomScene WriteRoomScene(const std::filesystem::path& folder, const RoomOptions& options = {});

}  // namespace raylift
