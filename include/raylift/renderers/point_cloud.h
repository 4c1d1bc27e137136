// Points measured on surfaces, by laser scanners or photogrammetry, as files hold them.

#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace raylift {

struct PointCloud {
  std::vector<Eigen::Vector3d> points_in_world;
  // Per point, unit, either sign; empty where there are none.
  std::vector<Eigen::Vector3f> normals;
  std::vector<std::array<uint8_t, 3>> colors_rgb;  // per point; empty where there are none

  // What the reader should tell the user: points that were left out, ...
  std::vector<std::string> warnings;
};

// Reads PLY (the vertices, whatever else it holds), LAS 1.0 to 1.4 (not compressed), PCD (ascii and
// binary) or text (.xyz, .txt, .asc, .pts, .csv), by the file's extension. Text has x, y and z in
// its first columns; further ones are by the names in its first line ("//X Y Z R G B Nx Ny Nz");
// without one, three whole numbers up to 255 are a color and three of unit length a normal. Points
// that are not finite, and those that a LAS file withholds or calls noise, are left out and counted
// in `warnings`. InputError naming the file and field where it cannot be read or no point is left.
PointCloud ReadPointCloud(const std::filesystem::path& path);

// As ListMeshFiles: those of "a.las+b.ply", "scans/*.las" or a folder.
std::vector<std::filesystem::path> ListCloudFiles(const std::string& files);

// Reads all of them as one cloud. It has normals, or colors, where all of them do.
PointCloud ReadPointClouds(std::span<const std::filesystem::path> files);

}  // namespace raylift
