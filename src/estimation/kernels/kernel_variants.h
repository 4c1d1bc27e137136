// The kernels as a table of functions, and the tables of the instruction sets that the build has.
// Plain declarations only, as this header is compiled for several instruction sets.

#pragma once

#include "estimation/kernels/blocks.h"

namespace raylift::kernels {

struct KernelTable {
  // Scores of `count` consecutive blocks. The camera centers of the pairs' references are given in
  // the query's camera frame: `centers[3 * block_reference[i]]`.
  KernelScore (*score_points)(const PointBlock<float>* blocks, int count,
                              const KernelPose<float>& pose);
  KernelScore (*score_pairs)(const PairBlock<float>* blocks, const int* block_reference, int count,
                             const KernelPose<float>& pose, const float* centers);

  // e^2 of every lane, infinite where a lane does not count; `kLanes` per block.
  void (*point_residuals)(const PointBlock<double>* blocks, int count,
                          const KernelPose<double>& pose, double* squared_residuals);
  void (*pair_residuals)(const PairBlock<double>* blocks, const int* block_reference, int count,
                         const KernelPose<double>& pose, const double* centers,
                         double* squared_residuals);
  void (*point_residuals_float)(const PointBlock<float>* blocks, int count,
                                const KernelPose<float>& pose, float* squared_residuals);
  void (*pair_residuals_float)(const PairBlock<float>* blocks, const int* block_reference,
                               int count, const KernelPose<float>& pose, const float* centers,
                               float* squared_residuals);

  // Normal equations, added to nothing: the sums over these blocks alone.
  KernelNormals (*point_normals)(const PointBlock<double>* blocks, int count,
                                 const KernelPose<double>& pose, const KernelLoss& loss);
  KernelNormals (*pair_normals)(const PairBlock<double>* blocks, const int* block_reference,
                                int count, const KernelPose<double>& pose, const double* centers,
                                const KernelLoss& loss);
  KernelNormals (*point_normals_float)(const PointBlock<float>* blocks, int count,
                                       const KernelPose<float>& pose, const KernelLoss& loss);
  KernelNormals (*pair_normals_float)(const PairBlock<float>* blocks, const int* block_reference,
                                      int count, const KernelPose<float>& pose,
                                      const float* centers, const KernelLoss& loss);
};

const KernelTable& KernelTableSse2();  // the baseline, on any processor
const KernelTable& KernelTableAvx2();
const KernelTable& KernelTableAvx512();

}  // namespace raylift::kernels
