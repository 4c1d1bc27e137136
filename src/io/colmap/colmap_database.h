// Reads COLMAP's database (SQLite; versions 3.8 to 4.x): keypoints of images and matches between
// them, by whatever COLMAP or others have put there.

#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"

namespace raylift {

// Returns whether the file starts as SQLite's do; false if it cannot be read.
bool IsColmapDatabase(const std::filesystem::path& file);

class ColmapDatabase {
 public:
  // Throws InputError where this is no database of COLMAP's.
  explicit ColmapDatabase(const std::filesystem::path& file);
  ~ColmapDatabase();
  ColmapDatabase(ColmapDatabase&&) noexcept;
  ColmapDatabase& operator=(ColmapDatabase&&) noexcept;

  // Reads all images, by name.
  std::vector<std::string> ImageNames() const;

  // Reads the keypoints and the size of the image's camera, without descriptors. Throws InputError
  // where the image or its keypoints are missing. Pixels are COLMAP's. Thread safe, as
  // ReadMatches().
  Features ReadKeypoints(const std::string& image) const;

  // Returns the images that this one is matched with, best first: by the inliers of their verified
  // pairs (two_view_geometries), then by their matches.
  std::vector<std::string> MatchedWith(const std::string& image) const;

  // Returns the matches of a pair, in whichever order it is stored; the inliers where they are
  // more, as after guided matching or where others put nothing else there. nullopt where there are
  // neither.
  std::optional<std::vector<FeatureMatch>> ReadMatches(const std::string& query,
                                                       const std::string& reference) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
