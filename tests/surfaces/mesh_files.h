// Small mesh files and pictures for the readers' tests.

#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// A 4 x 2 picture without equal texels, and its PNG file.
Image TestPicture();
std::string TestPicturePng();

// All corners of all triangles in world coordinates, in order: what a file shows, whatever the
// number of its vertices.
std::vector<Eigen::Vector3d> Corners(const TriangleMesh& mesh);

// The largest distance between corresponding corners; infinity where the counts differ.
double MaxCornerDistance(const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& expected);

double SurfaceArea(const TriangleMesh& mesh);

// Reads `contents` cut off after every number of bytes (or every `step`-th): each must give a mesh
// or an InputError of one line that names the file. Returns how many gave a mesh.
int ReadTruncated(const std::filesystem::path& path, const std::string& contents, size_t step = 1);

// Binary glTF of a document and its buffer, whose size is a multiple of 4.
std::string GlbOf(std::string json, const std::string& bin);

// Appends the bytes of a number, reversed for big-endian files.
template <typename T>
void AppendBytes(std::string& bytes, T value, bool reversed = false) {
  std::string own(reinterpret_cast<const char*>(&value), sizeof(T));
  if (reversed) own.assign(own.rbegin(), own.rend());
  bytes += own;
}

}  // namespace raylift
