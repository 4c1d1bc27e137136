// Matches of pairs as numpy wrote them.

#include "io/scene/pair_pixels.h"

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

class PairPixelsOfNumpy : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!HasProgram("/usr/bin/python3") || !HasNumpy()) {
      GTEST_SKIP() << "python3 with numpy is not on this machine";
    }
  }
  static bool HasNumpy() {
    try {
      RunProgram("/usr/bin/python3 -c 'import numpy' 2>&1");
      return true;
    } catch (const std::exception&) {
      return false;
    }
  }

  // Of a file that `script` writes: np is numpy, p the file's name without its extension.
  fs::path Write(const std::string& script, const std::string& extension = ".npz") {
    const fs::path stem = folder_ / std::to_string(++count_);
    const fs::path file = folder_ / "script.py";
    WriteFile(file, "import numpy as np\np = '" + stem.string() + "'\n" + script + "\n");
    RunProgram("/usr/bin/python3 " + file.string());
    return stem.string() + extension;
  }
  PairPixels Read(const std::string& script, const std::string& extension = ".npz") {
    return ReadPairPixels(Write(script, extension));
  }
  // Two matches, (1, 2) with (3, 4) and (5, 6.5) with (7, 8).
  static void ExpectTwo(const PairPixels& pair) {
    EXPECT_THAT(pair.first_px, ElementsAre(Eigen::Vector2d(1, 2), Eigen::Vector2d(5, 6.5)));
    EXPECT_THAT(pair.second_px, ElementsAre(Eigen::Vector2d(3, 4), Eigen::Vector2d(7, 8)));
  }

  const fs::path folder_ = TestFolder();
  int count_ = 0;
  const std::string rows_ = "a = np.array([[1, 2, 3, 4], [5, 6.5, 7, 8]])\n";
};

TEST_F(PairPixelsOfNumpy, RowsOfFourNumbersOfAnyTypeAndOrder) {
  for (const char* type : {"<f8", ">f4", "f2"}) {
    const PairPixels pair = Read(rows_ + "np.save(p, a.astype('" + type + "'))", ".npy");
    ExpectTwo(pair);
    EXPECT_THAT(pair.scores, IsEmpty());
    EXPECT_EQ(pair.is_half, std::string(type) == "f2");
  }
  ExpectTwo(Read(rows_ + "np.save(p, np.asfortranarray(a))", ".npy"));
  ExpectTwo(Read(rows_ + "np.save(p, a[None])", ".npy"));
  ExpectTwo(Read(rows_ + "np.savez_compressed(p, anything=a)"));
  const PairPixels scored = Read(rows_ + "np.save(p, np.c_[a, [0.25, 0.5]])", ".npy");
  ExpectTwo(scored);
  EXPECT_THAT(scored.scores, ElementsAre(0.25, 0.5));
  EXPECT_THAT(Read("np.save(p, np.zeros((0, 4)))", ".npy").first_px, IsEmpty());
}

TEST_F(PairPixelsOfNumpy, TheKeysOfMatchers) {
  for (const char* keys : {"mkpts0=a[:, :2], mkpts1=a[:, 2:], mconf=s", "matches=a, scores=s",
                           "kpts0=a[None, :, :2], kpts1=a[None, :, 2:], certainty=s[None]",
                           "keypoints0=a[:, :2], keypoints1=a[:, 2:], confidence=s",
                           "matches=a, conf=s, names=np.array(['a', 'b']), K=np.eye(3)"}) {
    const PairPixels pair =
        Read(rows_ + "s = np.array([0.25, 0.5])\nnp.savez(p, " + std::string(keys) + ")");
    ExpectTwo(pair);
    EXPECT_THAT(pair.scores, ElementsAre(0.25, 0.5)) << keys;
  }
}

TEST_F(PairPixelsOfNumpy, IndicesOfKeypoints) {
  const std::string keypoints =
      "k = dict(keypoints0=[[9, 9], [5, 6.5], [1, 2]], keypoints1=[[3, 4], [9, 9], [7, 8]])\n";
  // SuperGlue's, LightGlue's with batches, and pairs of indices.
  for (const char* keys : {"matches=[-1, 2, 0], match_confidence=[0, 0.5, 0.25]",
                           "matches0=[[-1, 2, 0]], matching_scores0=[[0, 0.5, 0.25]]",
                           "matches=np.array([[1, 2], [2, 0]]), scores=[0.5, 0.25]"}) {
    const PairPixels pair = Read(keypoints + "np.savez(p, **k, " + std::string(keys) + ")");
    EXPECT_THAT(pair.first_px, ElementsAre(Eigen::Vector2d(5, 6.5), Eigen::Vector2d(1, 2))) << keys;
    EXPECT_THAT(pair.second_px, ElementsAre(Eigen::Vector2d(7, 8), Eigen::Vector2d(3, 4))) << keys;
    EXPECT_THAT(pair.scores, ElementsAre(0.5, 0.25)) << keys;
  }
}

TEST_F(PairPixelsOfNumpy, WhatIsNoMatchesIsNamed) {
  const auto fails = [&](const std::string& script, const std::vector<std::string>& parts,
                         const std::string& extension = ".npz") {
    const fs::path file = Write(script, extension);
    std::vector<std::string> all = parts;
    all.push_back(file.string());
    return FailsWithInputError([&] { ReadPairPixels(file); }, all);
  };
  EXPECT_TRUE(fails("np.save(p, np.zeros((7, 3)))", {"N x 4", "(7, 3)"}, ".npy"));
  EXPECT_TRUE(fails("np.save(p, np.array([[0, 1, np.nan, 0]]))", {"row 0", "finite"}, ".npy"));
  EXPECT_TRUE(fails("np.savez(p, a=np.eye(4), b=np.eye(4))", {"matches (N x 4)", "a, b"}));
  EXPECT_TRUE(fails("np.savez(p, mkpts0=np.ones((2, 2)), mkpts1=np.ones((3, 2)))",
                    {"mkpts1", "expected 2 pixels", "found 3"}));
  EXPECT_TRUE(fails("np.savez(p, mkpts0=np.ones((2, 3)), mkpts1=np.ones((2, 3)))",
                    {"mkpts0", "N x 2", "(2, 3)"}));
  EXPECT_TRUE(fails("np.savez(p, matches=np.eye(4), conf=np.ones(3))", {"conf", "4", "3"}));
  EXPECT_TRUE(
      fails("np.savez(p, keypoints0=np.ones((2, 2)), keypoints1=np.ones((2, 2)), "
            "matches0=[0, 2])",
            {"matches0", "below 2", "found 2"}));
  EXPECT_TRUE(fails("np.save(p, np.array([None, 1]))", {"objects"}, ".npy"));

  const fs::path file = Write(rows_ + "np.save(p, a)", ".npy");
  WriteFile(file, ReadFile(file).substr(0, 150));
  EXPECT_TRUE(FailsWithInputError([&] { ReadPairPixels(file); }, {"shape (2, 4)", "2 values"}));
  WriteFile(file, "neither");
  EXPECT_TRUE(FailsWithInputError([&] { ReadPairPixels(file); }, {"NPY"}));
}

}  // namespace
}  // namespace raylift
