#include "io/h5py.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"

// HDF5 loses some memory where it meets damage.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions() {
  return "leak:libhdf5\n";
}

namespace raylift {
namespace {

class HlocGlobalFeatures : public ::testing::Test {
 protected:
  std::filesystem::path path_ = TestFolder() / "global.h5";
};

TEST_F(HlocGlobalFeatures, AreReadAndWritten) {
  RunH5py(path_, "w", R"(
for i, name in enumerate(['query/b.jpg', 'a.jpg']):
    g = f.create_group(name)
    g.create_dataset('global_descriptor', data=np.array([i, 0.5, -1], np.float16))
    g.create_dataset('image_size', data=np.array([640, 480]))
)");
  const std::vector<std::string> names = GlobalFeatureFile(path_).ImageNames();
  EXPECT_THAT(names, testing::ElementsAre("a.jpg", "query/b.jpg"));
  const Eigen::MatrixXf descriptors = GlobalFeatureFile(path_).Read(names);
  EXPECT_EQ(descriptors.col(0), Eigen::Vector3f(1, 0.5, -1));
  EXPECT_EQ(descriptors.col(1), Eigen::Vector3f(0, 0.5, -1));
  WriteGlobalDescriptors(path_, names, descriptors);
  EXPECT_EQ(GlobalFeatureFile(path_).Read(names), descriptors);
  EXPECT_EQ(RunH5py(path_, "r", "print(f['query/b.jpg/global_descriptor'][:].tolist())"),
            "[0.0, 0.5, -1.0]\n");
}

TEST_F(HlocGlobalFeatures, AreColumnsOfTheImagesThatAreAskedFor) {
  RunH5py(path_, "w", R"(
f.create_dataset('db/1.jpg/global_descriptor', data=np.array([1, 2], np.float32))
f.create_dataset('db/2.jpg/global_descriptor', data=np.array([3, 4], np.float16))
f.create_dataset('db/day/3.jpg/global_descriptor', data=np.array([5, 6], np.float64))
)");
  const GlobalFeatureFile file(path_);
  EXPECT_EQ(file.Read(std::vector<std::string>{"db/day/3.jpg", "db/1.jpg"}),
            (Eigen::Matrix2f() << 5, 1, 6, 2).finished());
  EXPECT_EQ(file.Read(std::vector<std::string>{"db/2.jpg"}),
            Eigen::MatrixXf(Eigen::Vector2f(3, 4)));
  EXPECT_EQ(file.Read({}).size(), 0);
  EXPECT_THAT(file.ImageNames(), testing::ElementsAre("db/1.jpg", "db/2.jpg", "db/day/3.jpg"));
}

TEST_F(HlocGlobalFeatures, NoneIsMissingInSilenceWhereTheFileIsDamaged) {
  std::vector<std::string> names;
  for (int i = 10; i < 50; ++i) names.push_back(fmt::format("db/{}.jpg", i));
  WriteGlobalDescriptors(path_, names, Eigen::MatrixXf::Ones(1, 40));
  const std::string whole = ReadFile(path_);
  constexpr size_t kHeader = 48, kDamage = 16;
  size_t num_refused = 0;
  for (size_t at = kHeader; at + kDamage < whole.size(); at += kDamage) {
    std::string damaged = whole;
    for (size_t i = 0; i < kDamage; ++i) damaged[at + i] = static_cast<char>(~damaged[at + i]);
    WriteFile(path_, damaged);
    try {
      EXPECT_EQ(GlobalFeatureFile(path_).ImageNames().size(), names.size()) << at;
    } catch (const InputError&) {
      ++num_refused;
    }
  }
  EXPECT_GT(num_refused, 0);
}

TEST_F(HlocGlobalFeatures, AreReadAfterAFailureUnlessTheFileWasReplaced) {
  const std::vector<std::string> names = {"a.jpg"}, missing = {"b.jpg"};
  const Eigen::MatrixXf ones = Eigen::MatrixXf::Ones(2, 1);
  WriteGlobalDescriptors(path_, names, ones);
  const GlobalFeatureFile file(path_);
  EXPECT_THROW(file.Read(missing), InputError);
  EXPECT_EQ(file.Read(names), ones);
  WriteGlobalDescriptors(path_, names, 2 * ones);
  EXPECT_EQ(file.Read(names), ones);  // as when it was opened
  EXPECT_THROW(file.Read(missing), InputError);
  EXPECT_TRUE(FailsWithInputError([&] { file.Read(names); },
                                  {"global.h5: has been replaced since it was opened"}));
}

TEST_F(HlocGlobalFeatures, WrongOnesAreNamed) {
  RunH5py(path_, "w", R"(
f.create_dataset('a/global_descriptor', data=np.zeros(4, np.float32))
f.create_dataset('b/global_descriptor', data=np.zeros(3, np.float32))
f.create_dataset('c/global_descriptor', data=np.array([0, 1, np.nan, 1], np.float16))
f.create_dataset('d/global_descriptor', data=np.zeros((1, 4), np.float32))
f.create_dataset('e/global_descriptor', data=np.zeros(0, np.float32))
f.create_group('f')
)");
  const auto read = [&](const std::vector<std::string>& names) {
    return [this, names] { GlobalFeatureFile(path_).Read(names); };
  };
  EXPECT_TRUE(FailsWithInputError(
      read({"a", "b"}),
      {"global.h5: b/global_descriptor: expected 4 numbers as in \"a\", found 3"}));
  EXPECT_TRUE(FailsWithInputError(
      read({"c"}), {"global.h5: c/global_descriptor: expected finite numbers, number 3 is nan"}));
  EXPECT_TRUE(FailsWithInputError(
      read({"d"}), {"global.h5: d/global_descriptor: expected a vector, found 1 x 4"}));
  EXPECT_TRUE(FailsWithInputError(read({"e"}),
                                  {"global.h5: e/global_descriptor: expected a vector, found 0"}));
  EXPECT_TRUE(
      FailsWithInputError(read({"f"}), {"global.h5: f/global_descriptor: is not in the file"}));
  EXPECT_TRUE(FailsWithInputError(read({"a", "db/x.jpg"}),
                                  {"global.h5: db/x.jpg/global_descriptor: is not in the file"}));
}

}  // namespace
}  // namespace raylift
