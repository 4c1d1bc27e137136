// Reads the matches of one pair of images as pixels from numpy's files, as dense and learned
// matchers (RoMa, LoFTR, MASt3R, SuperGlue, LightGlue) write them where pairs share no features.
//
//   NPY  N x 4 numbers, x and y in the first image, then in the second; a fifth column is a score
//   NPZ  `matches`, or any name where it is the only array: the same
//        mkpts0 and mkpts1, kpts0 and kpts1, or keypoints0 and keypoints1: N x 2 each
//        keypoints0 and keypoints1 with `matches0` or `matches`: for each keypoint of the first
//        image the index of one of the second or -1, or K x 2 indices
//        scores, conf, confidence, mconf, match_confidence, matching_scores0 or certainty: a score
//        of each match

#pragma once

#include <filesystem>
#include <vector>

#include <Eigen/Core>

namespace raylift {

struct PairPixels {
  // Matched pixels, row by row, as they stand in the file: the position of the first pixel's center
  // is not known here.
  std::vector<Eigen::Vector2d> first_px, second_px;
  std::vector<double> scores;  // empty where there are none
  bool is_half = false;        // pixels are float16, which has steps of 0.5 from 512 on
};

// Returns whether the name is that of such a file: *.npy or *.npz.
bool IsPairFileName(const std::filesystem::path& file);

// Throws InputError naming file and array for anything else, and for numbers that are not finite.
PairPixels ReadPairPixels(const std::filesystem::path& file);

}  // namespace raylift
