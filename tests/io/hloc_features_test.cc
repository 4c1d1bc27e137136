// Feature files and global descriptors, against h5py.
#include <chrono>
#include <thread>

#include "io/h5py.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

class HlocFeatures : public testing::Test {
 protected:
  void SetUp() override {
    if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not installed";
    path_ = TestFolder() / "features.h5";
  }
  std::filesystem::path path_;
};

TEST_F(HlocFeatures, FilesOfHlocAreReadWithTheHalfPixelShift) {
  RunH5py(path_, "w", R"(
g = f.create_group('query/night/a.jpg')
g.create_dataset('keypoints', data=np.array([[0, 0], [10.25, 20.5], [639.5, 479]], np.float32))
g['keypoints'].attrs['uncertainty'] = 1.5
g.create_dataset('scores', data=np.array([0.5, 0.25, 1], np.float16))
g.create_dataset('descriptors', data=np.arange(6, dtype=np.float16).reshape(2, 3))
g.create_dataset('image_size', data=np.array([640, 480]))
)");
  const FeatureFile file(path_);
  const Features features = file.Read("query/night/a.jpg");
  EXPECT_THAT(features.keypoints_px,
              testing::ElementsAre(Eigen::Vector2d(0.5, 0.5), Eigen::Vector2d(10.75, 21),
                                   Eigen::Vector2d(640, 479.5)));
  EXPECT_THAT(features.scores, testing::ElementsAre(0.5f, 0.25f, 1.0f));
  Eigen::MatrixXf expected(2, 3);
  expected << 0, 1, 2, 3, 4, 5;
  EXPECT_EQ(features.descriptors, expected);
  EXPECT_EQ(features.image_width_px, 640);
  EXPECT_EQ(features.image_height_px, 480);
  EXPECT_EQ(features.uncertainty_px, 1.5f);
  EXPECT_TRUE(file.Warnings().empty());
}

TEST_F(HlocFeatures, EveryHalfIsTheNumberThatNumpyMeans) {
  RunH5py(path_, "w", R"(
bits = np.arange(65536, dtype=np.uint16)
halves = bits.view(np.float16)
halves = halves[np.isfinite(halves)]
g = f.create_group('a')
g.create_dataset('keypoints', data=np.zeros((len(halves), 2), np.float16))
g.create_dataset('descriptors', data=np.stack([halves, -halves]))
g.create_dataset('scores', data=halves.astype(np.float32))
)");
  const Features features = FeatureFile(path_).Read("a");
  ASSERT_EQ(features.scores.size(), 63488u);
  for (size_t i = 0; i < features.scores.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    ASSERT_EQ(features.descriptors(0, column), features.scores[i]);
    ASSERT_EQ(features.descriptors(1, column), -features.scores[i]);
  }
}

TEST_F(HlocFeatures, DoublesSurviveAndCompressedFilesAreRead) {
  RunH5py(path_, "w", R"(
g = f.create_group('a.jpg')
g.create_dataset('keypoints', data=np.full((1000, 2), 1.1), compression='gzip')
g.create_dataset('scores', data=np.zeros(1000, '>f4'), compression='gzip', shuffle=True)
)");
  const Features features = FeatureFile(path_).Read("a.jpg");
  ASSERT_EQ(features.keypoints_px.size(), 1000u);
  EXPECT_EQ(features.keypoints_px[999].y(), 1.1 + 0.5);
  EXPECT_EQ(features.scores.size(), 1000u);
}

// Semi-dense files hold keypoints and `score` only; others keep the size as an attribute.
TEST_F(HlocFeatures, MissingPartsAreTolerated) {
  RunH5py(path_, "w", R"(
g = f.create_group('a.jpg')
g.create_dataset('keypoints', data=np.zeros((2, 2), np.float32))
g.create_dataset('score', data=np.array([3, 4], np.float32))
g = f.create_group('b.jpg')
g.create_dataset('keypoints', data=np.zeros((0, 2), np.float32))
g.create_dataset('descriptors', data=np.zeros((128, 0), np.float16))
g.attrs['image_size'] = [64, 48]
)");
  const FeatureFile file(path_);
  const Features a = file.Read("a.jpg");
  EXPECT_EQ(a.image_width_px, 0);
  EXPECT_EQ(a.descriptors.size(), 0);
  EXPECT_EQ(a.uncertainty_px, 1.0f);
  EXPECT_THAT(a.scores, testing::ElementsAre(3, 4));
  const Features b = file.Read("b.jpg");
  EXPECT_TRUE(b.keypoints_px.empty());
  EXPECT_EQ(b.image_width_px, 64);
  EXPECT_EQ(b.image_height_px, 48);
}

TEST_F(HlocFeatures, NamesAreFoundInNestedGroups) {
  RunH5py(path_, "w", R"(
for name in ['b.jpg', 'query/night/x.jpg', 'query/a.jpg']:
    f.create_group(name).create_dataset('keypoints', data=np.zeros((1, 2), np.float32))
)");
  const FeatureFile file(path_);
  EXPECT_THAT(file.ImageNames(), testing::ElementsAre("b.jpg", "query/a.jpg", "query/night/x.jpg"));
  EXPECT_TRUE(file.Contains("query/a.jpg"));
  EXPECT_FALSE(file.Contains("query"));
  EXPECT_FALSE(file.Contains("query/none/x.jpg"));
  EXPECT_FALSE(file.Contains(""));
  EXPECT_FALSE(file.Contains("b.jpg/keypoints"));
}

TEST_F(HlocFeatures, CoarseHalfKeypointsAreWarnedOf) {
  RunH5py(path_, "w", R"(
for name, width in [('narrow', 512), ('wide', 640), ('wider', 4000)]:
    g = f.create_group(name)
    g.create_dataset('keypoints', data=np.ones((1, 2), np.float16))
    g.create_dataset('image_size', data=np.array([width, 480]))
)");
  const FeatureFile file(path_);
  file.Read("narrow");
  EXPECT_TRUE(file.Warnings().empty());
  file.Read("wider");
  file.Read("wide");
  file.Read("wide");
  ASSERT_EQ(file.Warnings().size(), 1u);
  EXPECT_THAT(file.Warnings()[0], testing::HasSubstr("float16"));
  EXPECT_THAT(file.Warnings()[0], testing::HasSubstr("2 images are that large, e.g. \"wide\""));
}

TEST_F(HlocFeatures, WrongContentsAreNamed) {
  RunH5py(path_, "w", R"(
def image(name, keypoints=np.zeros((2, 2), np.float32), **more):
    g = f.create_group(name)
    g.create_dataset('keypoints', data=keypoints)
    for k, v in more.items(): g.create_dataset(k, data=v)
image('flat', np.zeros(4, np.float32))
image('three', np.zeros((4, 3), np.float32))
image('nan', np.array([[0, 1], [np.nan, 2]], np.float16))
image('text', np.array([[b'a', b'b']]))
image('columns', descriptors=np.zeros((2, 128), np.float32))
image('infinite', descriptors=np.full((1, 2), np.inf, np.float16))
image('scores', scores=np.zeros(3, np.float32))
image('size', image_size=np.array([640, 480, 3]))
image('negative', image_size=np.array([640, -480]))
image('uncertainty')
f['uncertainty/keypoints'].attrs['uncertainty'] = -1.0
f.create_group('empty')
f.create_group('group').create_group('keypoints')
f.create_dataset('unwritten/keypoints', shape=(1 << 40, 2), dtype=np.float32)
f.create_dataset('chunked/keypoints', shape=(1 << 40, 2), dtype=np.float32, chunks=(1024, 2))
)");
  const FeatureFile file(path_);
  const auto expect_failure = [&](const std::string& image, const std::vector<std::string>& parts) {
    EXPECT_TRUE(FailsWithInputError([&] { file.Read(image); }, parts)) << image;
  };
  expect_failure("none", {"features.h5: none: the image is not in the file"});
  expect_failure("empty", {"features.h5: empty/keypoints: is not in the file"});
  expect_failure("group", {"features.h5: group/keypoints: expected a data set"});
  expect_failure("flat", {"features.h5: flat/keypoints: expected N x 2 numbers, found 4"});
  expect_failure("three", {"three/keypoints: expected N x 2 numbers, found 4 x 3"});
  expect_failure("nan", {"nan/keypoints: expected finite numbers, number 3 is nan"});
  expect_failure("text", {"text/keypoints: expected numbers, found another type"});
  expect_failure("columns", {"columns/descriptors: expected D x 2 numbers", "found 2 x 128"});
  expect_failure("infinite", {"infinite/descriptors: expected finite numbers"});
  expect_failure("scores", {"scores/scores: expected 2 numbers, found 3"});
  expect_failure("size", {"size/image_size: expected width and height"});
  expect_failure("negative", {"negative/image_size: expected width and height"});
  expect_failure("uncertainty", {"uncertainty/keypoints: attribute \"uncertainty\""});
  expect_failure("unwritten", {"unwritten/keypoints: the file is too short for 1099511627776 x 2"});
  expect_failure("chunked", {"chunked/keypoints: the file is too short for 1099511627776 x 2"});
}

TEST_F(HlocFeatures, DataInOtherFilesIsRefused) {
  RunH5py(path_, "w", R"(
raw = f.create_dataset('raw/keypoints', (4, 2), 'f4', external=[('raw.bin', 0, h5.h5f.UNLIMITED)])
layout = h5.VirtualLayout((4, 2), 'f4')
layout[:] = h5.VirtualSource('other.h5', 'keypoints', (4, 2))
f.create_virtual_dataset('virtual/keypoints', layout)
with h5.File(f.filename + '.other', 'w') as other: other.create_dataset('keypoints', (4, 2), 'f4')
f['link'] = h5.ExternalLink(f.filename + '.other', '/')
f['deep/keypoints'] = h5.ExternalLink(f.filename + '.other', '/keypoints'))");
  for (const std::string name : {"raw", "virtual", "link", "deep"}) {
    EXPECT_TRUE(FailsWithInputError([&] { FeatureFile(path_).Read(name); },
                                    {"features.h5: " + name + "/keypoints: lies in other files"}));
  }
}

TEST_F(HlocFeatures, AttributesInOtherFilesAreRefused) {
  RunH5py(path_, "w", R"(
f.create_dataset('own/keypoints', data=np.ones((4, 2), 'f4'))
with h5.File(f.filename + '.other', 'w') as other:
    image = other.create_group('image')
    image.attrs['image_size'] = np.array([640, 480])
    image['keypoints'] = h5.ExternalLink(f.filename, '/own/keypoints')
f['link'] = h5.ExternalLink(f.filename + '.other', '/image'))");
  EXPECT_NO_THROW(FeatureFile(path_).Read("own"));
  EXPECT_TRUE(FailsWithInputError([&] { FeatureFile(path_).Read("link"); },
                                  {"features.h5: link: lies in other files"}));
}

TEST_F(HlocFeatures, FilesThatAreNoHdf5AreNamed) {
  EXPECT_TRUE(FailsWithInputError([&] { FeatureFile{path_}; }, {"features.h5: no such file"}));
  EXPECT_TRUE(FailsWithInputError([&] { FeatureFile{path_.parent_path()}; }, {"found a folder"}));
  WriteFile(path_, "this is text");
  EXPECT_TRUE(FailsWithInputError([&] { FeatureFile{path_}; },
                                  {"features.h5: expected an HDF5 file, found something else"}));
}

Features SomeFeatures(Rng& rng, int n) {
  Features features;
  features.image_width_px = 640;
  features.image_height_px = 480;
  features.uncertainty_px = 0.75f;
  features.descriptors.resize(8, n);
  for (int i = 0; i < n; ++i) {
    // Multiples of 1/8 px, so that float32 and the shift are exact.
    features.keypoints_px.emplace_back(rng.UniformIndex(5120) / 8.0, rng.UniformIndex(3840) / 8.0);
    features.scores.push_back(static_cast<float>(rng.Uniform()));
    for (int d = 0; d < 8; ++d) {
      features.descriptors(d, i) = static_cast<float>(rng.Normal());
    }
  }
  return features;
}

TEST_F(HlocFeatures, WrittenFilesReadBack) {
  Rng rng = TestRng();
  const std::map<std::string, Features> written = {
      {"query/a.jpg", SomeFeatures(rng, 50)}, {"b.jpg", SomeFeatures(rng, 1)}, {"c.jpg", {}}};
  for (const bool half : {false, true}) {
    WriteFeatureFile(path_, written, half);
    const FeatureFile file(path_);
    EXPECT_THAT(file.ImageNames(), testing::ElementsAre("b.jpg", "c.jpg", "query/a.jpg"));
    for (const auto& [name, features] : written) {
      const Features back = file.Read(name);
      EXPECT_EQ(back.keypoints_px, features.keypoints_px);
      EXPECT_EQ(back.scores, features.scores);
      EXPECT_EQ(back.image_width_px, features.image_width_px);
      EXPECT_EQ(back.uncertainty_px, features.uncertainty_px);
      // float16 has 11 significant bits.
      EXPECT_TRUE(back.descriptors.isApprox(features.descriptors, half ? 1.0 / 2048 : 0.0));
    }
  }
}

TEST_F(HlocFeatures, H5pyFindsHlocsLayoutInWrittenFiles) {
  Features features;
  features.keypoints_px = {{0.5, 0.5}, {10.75, 21}};
  features.descriptors = Eigen::MatrixXf::Zero(3, 2);
  features.descriptors(2, 0) = 0.1f;
  features.scores = {0.5f, 1.0f};
  features.image_width_px = 640;
  features.image_height_px = 480;
  WriteFeatureFile(path_, {{"query/a.jpg", features}}, true);
  EXPECT_EQ(RunH5py(path_, "r", R"(
g = f['query']['a.jpg']
for name in sorted(g): print(name, g[name].dtype, g[name].shape)
print(g['keypoints'][:].tolist(), g['keypoints'].attrs['uncertainty'], g['image_size'][:].tolist())
assert g['descriptors'][2, 0] == np.float16(0.1)
)"),
            "descriptors float16 (3, 2)\n"
            "image_size int64 (2,)\n"
            "keypoints float32 (2, 2)\n"
            "scores float32 (2,)\n"
            "[[0.0, 0.0], [10.25, 20.5]] 1.0 [640, 480]\n");
}

TEST_F(HlocFeatures, EqualContentsGiveEqualBytes) {
  Rng rng = TestRng();
  const std::map<std::string, Features> features = {{"a.jpg", SomeFeatures(rng, 5)}};
  WriteFeatureFile(path_, features, true);
  const std::string bytes = ReadFile(path_);
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));  // HDF5 knows times to the second
  WriteFeatureFile(path_, features, true);
  EXPECT_TRUE(ReadFile(path_) == bytes);
}

TEST_F(HlocFeatures, SeveralThreadsMayRead) {
  Rng rng = TestRng();
  std::map<std::string, Features> written;
  for (int i = 0; i < 20; ++i) {
    written["query/" + std::to_string(i) + ".jpg"] = SomeFeatures(rng, 100);
  }
  WriteFeatureFile(path_, written, false);
  const FeatureFile file(path_);
  std::vector<std::thread> threads;
  std::atomic<int> num_wrong = 0;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (const auto& [name, features] : written) {
        num_wrong += file.Read(name).keypoints_px != features.keypoints_px;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(num_wrong, 0);
}

// Opens and reads all of a file; returns whether that worked. Only an InputError may come of it.
bool IsReadable(const std::filesystem::path& path) {
  try {
    const FeatureFile file(path);
    for (const std::string& name : file.ImageNames()) {
      file.Read(name);
    }
    return true;
  } catch (const InputError&) {
    return false;
  }
}

TEST_F(HlocFeatures, TruncatedFilesAreInputErrors) {
  Rng rng = TestRng();
  WriteFeatureFile(path_, {{"query/a.jpg", SomeFeatures(rng, 3)}}, true);
  const std::string bytes = ReadFile(path_);
  for (size_t size = 0; size < bytes.size(); size += 7) {
    WriteFile(path_, bytes.substr(0, size));
    EXPECT_FALSE(IsReadable(path_)) << size << " of " << bytes.size() << " bytes";
  }
}

TEST_F(HlocFeatures, RealFilesAreRead) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const FeatureFile file(*data / "features.h5");
  const auto names = file.ImageNames();
  ASSERT_FALSE(names.empty());
  for (const std::string& name : names) {
    const Features features = file.Read(name);
    EXPECT_EQ(features.image_width_px, 640);
    EXPECT_EQ(features.descriptors.rows(), 128);
    EXPECT_FALSE(features.keypoints_px.empty());
  }
}

}  // namespace
}  // namespace raylift
