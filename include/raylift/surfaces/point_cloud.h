// Points measured on surfaces, by laser scanners or photogrammetry, as files hold them.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace raylift {

struct PointCloud {
  std::vector<Eigen::Vector3d> points_in_world;
  // There is one for each point, of unit length and either sign; the list is empty where there are
  // none.
  std::vector<Eigen::Vector3f> normals;
  std::vector<std::array<uint8_t, 3>> colors_rgb;  // per point; empty where there are none

  // The reader warns the user of this: points that were left out, ...
  std::vector<std::string> warnings;
};

// Reads PLY (the vertices, whatever else it holds), LAS 1.0 to 1.4 (not compressed), PCD (ascii and
// binary) or text (.xyz, .txt, .asc, .pts, .csv), by the file's extension. Text has x, y and z in
// its first columns; further ones are by the names in its first line ("//X Y Z R G B Nx Ny Nz");
// without such a line, three whole numbers up to 255 are a color and three of unit length a normal.
// Points that are not finite, and those that a LAS file withholds or calls noise, are left out and
// counted in `warnings`. Throws InputError naming the file and field where it cannot be read or no
// point is left.
PointCloud ReadPointCloud(const std::filesystem::path& path);

// Returns the files that "a.las+b.ply", "scans/*.las" or a folder name, as ListMeshFiles() does.
std::vector<std::filesystem::path> ListCloudFiles(const std::string& files);
// Returns whether the extension, in any case, is that of a point cloud.
bool IsCloudFileName(const std::filesystem::path& file);

// Reads all of them as one cloud. It has normals, or colors, where all of them do.
PointCloud ReadPointClouds(std::span<const std::filesystem::path> files);

// Surfels: a point cloud as small discs that lie on the surface its points were measured on, so
// that rays can be cast at it.
//
// A disc lies in a plane through the k points nearest to its own. Its radius r is such that its
// mean squared distance from its center, r^2 / 2, is theirs. Then
//  - on average k discs cover a place of a surface that was sampled at random, whatever the density
//    is. RayCaster takes a place for a surface where their centers surround it: all but a share of
//    k exp(-k / 2) of its places (0.5 % for k = 16), and no place outside;
//  - where the surface is curved, the points' mean, through which the plane goes, lies behind it by
//    r^2 / 4R, as much as the discs that meet at a place lie before it on average: the mean of
//    their depths has no bias of second order.

struct SurfelOptions {
  std::optional<double> radius = std::nullopt;  // of all discs; nullopt: by the local density
  int neighbors = 16;                           // k: more smooth more, and hold against more noise
  int threads = 0;                              // <= 0: all; never changes the result
};

struct Surfels {
  // The discs' centers are float, relative to this origin, which is subtracted in double before
  // rounding.
  Eigen::Vector3d origin_in_world = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector4f> discs;  // center and radius
  std::vector<Eigen::Vector3f> normals;
  // The standard deviation of the points about each disc's plane.
  std::vector<float> sigmas;
  std::vector<std::array<uint8_t, 3>> colors_rgb;  // empty where the cloud has none
  std::vector<std::string> warnings;

  size_t MemoryBytes() const;
};

// Makes a disc of each point. Points at one place count as one. Points whose neighbors span no
// plane (fewer than three places, or all on a line) are left out and counted. Throws InputError if
// none is left.
Surfels MakeSurfels(PointCloud cloud, const SurfelOptions& options = {});

}  // namespace raylift
