// The whole front end on real photographs with known poses.

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <set>

#include "base/statistics.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <opencv2/imgcodecs.hpp>

#include "raylift/base/parallel.h"
#include "raylift/features/local_features.h"
#include "raylift/features/vlad.h"
#include "raylift/geometry/residuals.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

Image ReadGray(const std::filesystem::path& path) {
  const cv::Mat gray =
      cv::imread(path.string(), cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  Image image{.width_px = gray.cols, .height_px = gray.rows, .channels = 1, .data = {}};
  image.data.assign(gray.data, gray.data + gray.total());
  return image;
}

std::vector<Features> ExtractAll(const std::filesystem::path& image_folder,
                                 const std::vector<PosedImage>& images) {
  std::vector<Features> features(images.size());
  ParallelFor(images.size(), 0, [&](size_t i) {
    features[i] = ExtractRootSift(ReadGray(image_folder / images[i].name));
  });
  return features;
}

// The references of each query in a pairs file, best first.
std::map<std::string, std::vector<std::string>> ReadPairs(const std::filesystem::path& path) {
  std::map<std::string, std::vector<std::string>> pairs;
  std::ifstream stream(path);
  std::string query;
  std::string reference;
  while (stream >> query >> reference) pairs[query].push_back(reference);
  return pairs;
}

// |Sampson error| of each match under the true poses.
std::vector<double> SampsonErrorsPx(const PosedImage& query, const Features& query_features,
                                    const PosedImage& reference,
                                    const Features& reference_features) {
  std::vector<double> errors_px;
  for (const FeatureMatch& match : MatchMutualNearest(query_features, reference_features)) {
    const auto residual = SampsonError(query.camera, query.cam_from_world,
                                       query_features.keypoints_px[match.query_index],
                                       reference.camera, reference.cam_from_world,
                                       reference_features.keypoints_px[match.reference_index]);
    if (residual) errors_px.push_back(std::abs(residual->error_px));
  }
  return errors_px;
}

class RgbdPhotographs : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto data = FindTestData("rgbd_small");
    if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
    queries = ReadColmapModel(*data / "model_query_gt").PosedImages();
    references = ReadColmapModel(*data / "model_ref").PosedImages();
    image_folder = *data / "images";
    pairs = ReadPairs(*data / "pairs.txt");
  }

  std::vector<PosedImage> queries, references;
  std::filesystem::path image_folder;
  std::map<std::string, std::vector<std::string>> pairs;
};

TEST_F(RgbdPhotographs, MatchesObeyTheTrueEpipolarGeometry) {
  std::vector<PosedImage> best_references;
  for (const PosedImage& query : queries) {
    const std::string& best = pairs.at(query.name).at(0);
    best_references.push_back(
        *std::find_if(references.begin(), references.end(),
                      [&](const PosedImage& reference) { return reference.name == best; }));
  }
  const std::vector<Features> query_features = ExtractAll(image_folder, queries);
  const std::vector<Features> reference_features = ExtractAll(image_folder, best_references);
  std::vector<double> errors_px;
  for (size_t q = 0; q < queries.size(); ++q) {
    const auto pair_errors_px =
        SampsonErrorsPx(queries[q], query_features[q], best_references[q], reference_features[q]);
    EXPECT_GT(pair_errors_px.size(), 40u) << queries[q].name;
    errors_px.insert(errors_px.end(), pair_errors_px.begin(), pair_errors_px.end());
  }
  // The ground truth itself is good to about 0.6 px, keypoints to somewhat less.
  EXPECT_LT(UpperMedianOr(errors_px, 0), 0.6);
  const auto num_good = std::count_if(errors_px.begin(), errors_px.end(),
                                      [](double error_px) { return error_px < 3; });
  EXPECT_GT(num_good, 0.85 * static_cast<double>(errors_px.size()));
}

TEST_F(RgbdPhotographs, RetrievalFindsReferencesThatSeeTheSame) {
  const std::vector<Features> query_features = ExtractAll(image_folder, queries);
  const std::vector<Features> reference_features = ExtractAll(image_folder, references);
  const Vocabulary vocabulary = TrainVocabulary(reference_features);
  const auto vectors = [&](const std::vector<Features>& images) {
    Eigen::MatrixXf result(vocabulary.words.size(), images.size());
    for (size_t i = 0; i < images.size(); ++i) result.col(i) = ComputeVlad(images[i], vocabulary);
    return result;
  };
  const auto results = RetrieveTopK(vectors(query_features), vectors(reference_features), 10);
  size_t num_common = 0;
  for (size_t q = 0; q < queries.size(); ++q) {
    const auto& listed = pairs.at(queries[q].name);
    const std::set<std::string> expected(listed.begin(), listed.end());
    bool has_near = false;
    for (const RetrievedReference& retrieved : results[q]) {
      const PosedImage& reference = references[retrieved.reference_index];
      num_common += expected.count(reference.name);
      has_near |= static_cast<bool>(
          IsNearPose(reference.cam_from_world, queries[q].cam_from_world, 42, 0.6));
    }
    // For every query there is a reference turned away by at most 41 degrees.
    EXPECT_TRUE(has_near) << queries[q].name;
  }
  // The list is from another VLAD, with another vocabulary; the lower ranks are a matter of luck.
  EXPECT_GE(num_common, 65u);
}

// COLMAP's keypoints come from another implementation of SIFT; most are found by both.
TEST(RootSiftOnPhotographs, KeypointsLieWhereColmapFindsThem) {
  const auto data = FindTestData("sceaux_sfm");
  if (!data) GTEST_SKIP() << "sceaux_sfm is not on this machine";
  const ColmapModel model = ReadColmapModel(*data / "model_full");
  const ColmapImage& image = model.images.begin()->second;
  const Features features = ExtractRootSift(ReadGray(*data / "images" / image.name));
  std::vector<double> x_differences_px, y_differences_px;
  for (const Eigen::Vector2d& keypoint_px : features.keypoints_px) {
    const auto nearest = std::min_element(
        image.points2d.begin(), image.points2d.end(), [&](const auto& a, const auto& b) {
          return (a.pixel - keypoint_px).squaredNorm() < (b.pixel - keypoint_px).squaredNorm();
        });
    const Eigen::Vector2d difference_px = keypoint_px - nearest->pixel;
    if (difference_px.cwiseAbs().maxCoeff() < 0.6) {
      x_differences_px.push_back(difference_px.x());
      y_differences_px.push_back(difference_px.y());
    }
  }
  EXPECT_GT(x_differences_px.size(), 0.5 * static_cast<double>(features.keypoints_px.size()));
  EXPECT_NEAR(UpperMedianOr(x_differences_px, 0), 0, 0.03);
  EXPECT_NEAR(UpperMedianOr(y_differences_px, 0), 0, 0.03);
}

}  // namespace
}  // namespace raylift
