// The SIMD kernels: the layout of the matches that they take, and the kernels as a table of
// functions for each instruction set that the build has.
//
// Blocks are of 64-byte rows, one row per component, so that a kernel streams through memory and
// every row is one AVX-512 register, two of AVX or four of SSE. Plain declarations only: this
// header is compiled for several instruction sets.

#pragma once

namespace raylift::kernels {

// joint.h defines these.
struct JointBlocks;
struct JointParameters;
struct JointVoting;
struct JointNormals;
struct JointExpectation;
struct JointSums;

// A row of 64 bytes has so many lanes: 16 floats or 8 doubles.
template <typename T>
inline constexpr int kLanes = 64 / sizeof(T);

// Holds 2D-3D matches. With p = R x + t and n = image_from_ray * p, the residual is n.xy / n.z:
// pixels over the threshold, exact for a pinhole camera and to first order for any other lens (see
// PixelFrame in geometry/residuals.h; its rows are divided by the threshold here). A match counts
// only where n.z > 0. Unused lanes have all rows zero and so never count.
template <typename T>
struct alignas(64) Block2D3D {
  T x[3][kLanes<T>];
  T image_from_ray[9][kLanes<T>];  // row-major
  // The variance of the 3D point times the squared scale of the pixel rows: with it the squared
  // residual is |n.xy|^2 / (n.z^2 + variance_at_unit_depth), that is over t^2 plus the point's
  // variance in pixels.
  T variance_at_unit_depth[kLanes<T>];
};

// Holds 2D-2D matches of one reference. Rays are unit vectors, the reference's turned to the
// problem's world axes. The gradients are d ray / d pixel times the threshold, so that
//   e^2 = (q . E r)^2 / (|G_q' E r|^2 + |G_r' E' q|^2)
// is the squared Sampson error over the squared threshold. Unused lanes are zero and never count.
template <typename T>
struct alignas(64) Block2D2D {
  T query_ray[3][kLanes<T>];
  T reference_ray[3][kLanes<T>];
  T query_gradient[6][kLanes<T>];      // two vectors: xyz xyz
  T reference_gradient[6][kLanes<T>];  // two vectors, in world axes
  // The angle by which an error of one threshold may turn the two rays against each other, radians:
  // a point that seems to lie behind the cameras by less than that may be far away in front of
  // them.
  T parallax[kLanes<T>];
};

// A pose, cam_from_local, row-major.
template <typename T>
struct KernelPose {
  T rotation[9];
  T translation[3];
};

struct KernelScore {
  double cost;  // sum over the lanes of min(e^2, 1); lanes that do not count cost 1
  int inliers;  // e^2 < 1 and in front of the cameras
};

// The loss rho of a squared residual e^2 in a refinement (in units of the squared threshold).
enum class LossShape {
  kTruncated,  // rho = min(e^2, limit), as the MSAC score has it with a limit of 1
  kBiweight,   // Tukey's: rho = limit / 3 * (1 - (1 - e^2 / limit)^3), limit / 3 beyond
};
struct KernelLoss {
  LossShape shape = LossShape::kTruncated;
  double limit = 1;
};

// Sums of a Gauss-Newton step over a match set, for the residuals in units of the threshold: the
// upper triangle of J' W J row by row (21), J' W e (6).
struct KernelNormals {
  double hessian[21];
  double gradient[6];
  double cost;  // sum of rho, over all lanes
  int inliers;
};

struct KernelTable {
  // Return the scores of `count` consecutive blocks. The centers of the 2D-2D matches' references
  // are given in the query's camera frame: `centers[3 * block_camera_reference[i]]`.
  KernelScore (*score_2d3d)(const Block2D3D<float>* blocks, int count,
                            const KernelPose<float>& pose);
  KernelScore (*score_2d2d)(const Block2D2D<float>* blocks, const int* block_camera_reference,
                            int count, const KernelPose<float>& pose, const float* centers);

  // Write e^2 of every lane, infinite where a lane does not count; `kLanes` per block.
  void (*residuals_2d3d)(const Block2D3D<double>* blocks, int count, const KernelPose<double>& pose,
                         double* squared_residuals);
  void (*residuals_2d2d)(const Block2D2D<double>* blocks, const int* block_camera_reference,
                         int count, const KernelPose<double>& pose, const double* centers,
                         double* squared_residuals);

  // Return the normal equations, summed over these blocks alone.
  KernelNormals (*normals_2d3d)(const Block2D3D<double>* blocks, int count,
                                const KernelPose<double>& pose, const KernelLoss& loss);
  KernelNormals (*normals_2d2d)(const Block2D2D<double>* blocks, const int* block_camera_reference,
                                int count, const KernelPose<double>& pose, const double* centers,
                                const KernelLoss& loss);
  KernelNormals (*normals_2d3d_float)(const Block2D3D<float>* blocks, int count,
                                      const KernelPose<float>& pose, const KernelLoss& loss);
  KernelNormals (*normals_2d2d_float)(const Block2D2D<float>* blocks,
                                      const int* block_camera_reference, int count,
                                      const KernelPose<float>& pose, const float* centers,
                                      const KernelLoss& loss);

  // The kernels of the joint refinement: they fill what voting needs of each piece; vote, once the
  // slots have their references' clutter; return the normal equations, with the points eliminated;
  // move the points after the query's step, which `parameters` have taken already; and take the E
  // step.
  void (*scan_jointly)(const JointBlocks& blocks, const JointParameters& parameters);
  void (*vote_jointly)(const JointBlocks& blocks, const JointParameters& parameters,
                       const JointVoting& voting);
  JointNormals (*linearize_jointly)(const JointBlocks& blocks, const JointParameters& parameters);
  void (*move_jointly)(const JointBlocks& blocks, const JointParameters& parameters,
                       const double* step, double focal_step);
  JointSums (*expect_jointly)(const JointBlocks& blocks, const JointParameters& parameters,
                              const JointExpectation& expectation);
};

namespace sse2 {  // the baseline, on any processor
const KernelTable& Kernels();
}
namespace avx2 {
const KernelTable& Kernels();
}
namespace avx512 {
const KernelTable& Kernels();
}

}  // namespace raylift::kernels
