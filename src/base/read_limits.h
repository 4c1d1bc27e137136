// Limits of what files may claim. A reader allocates no more than a stated multiple of a file's
// bytes: what is counted in a header is held against the bytes that follow it before memory is
// taken for it. The limits here are for what the bytes do not bound: sizes of pictures whose pixels
// are compressed, and depths of nesting. They lie far beyond what cameras, scanners and tools make;
// what is larger is refused as bad input that names file and field.

#pragma once

#include <cstddef>
#include <cstdint>

namespace raylift {

/// Width and height of a photograph, a depth map or a camera, in pixels.
inline constexpr int kMaxImageSidePx = 1 << 20;

/// Pixels of one depth map: 1 GB as floats.
inline constexpr uint64_t kMaxDepthMapPixels = uint64_t{1} << 28;

/// Heights of one surface model, each a vertex and two triangles, and pixels of its orthophoto.
inline constexpr uint64_t kMaxHeights = uint64_t{1} << 26;
inline constexpr uint64_t kMaxOrthophotoPixels = uint64_t{1} << 30;

/// Bytes that Deflate makes of one byte at most (zlib's technical notes): PNG, NPZ, HDF5, EXR.
inline constexpr size_t kMaxDeflateRatio = 1032;

/// Bytes of one strip or tile of a TIFF.
inline constexpr int64_t kMaxTiffBlockBytes = int64_t{1} << 30;

/// Rows of one matrix in COLMAP's database.
inline constexpr int64_t kMaxDatabaseRows = int64_t{1} << 28;

/// Values of one field of a PCD point; more is no descriptor of a point.
inline constexpr uint64_t kMaxPcdFieldValues = uint64_t{1} << 16;

/// Nodes below each other: of a glTF file, and as assimp gives those of any file.
inline constexpr size_t kMaxGltfNodeNesting = 500;
inline constexpr int kMaxNodeNesting = 1000;

/// Meshes that the nodes and instances of a glTF file place, and their vertices and triangles.
inline constexpr size_t kMaxPlacedMeshes = size_t{1} << 22;
inline constexpr size_t kMaxPlacedParts = size_t{1} << 28;

/// Tiles of a tileset, in each other, and those that name one file; levels of implicit trees.
inline constexpr int kMaxTiles = 1 << 20;
inline constexpr int kMaxTileNesting = 400;
inline constexpr int kMaxTileUses = 1000;
inline constexpr int kMaxImplicitLevels = 31;
inline constexpr int kMaxSubtreeLevels = 15;

/// Groups in each other in an HDF5 file: deeper is a cycle, not folders of images.
inline constexpr int kMaxGroupNesting = 64;

/// Rigs on each other in a kapture data set.
inline constexpr int kMaxRigNesting = 3;

}  // namespace raylift
