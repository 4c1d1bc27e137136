#include "io/colmap/colmap_database.h"

#include <array>
#include <numeric>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

// Writes the tables that CreateTables() of COLMAP's src/colmap/scene/database.cc (3.8) and
// database_sqlite.cc (4.x) makes, as far as they are read.
class Writer {
 public:
  explicit Writer(const fs::path& file) {
    fs::remove(file);
    EXPECT_EQ(sqlite3_open(file.c_str(), &database_), SQLITE_OK);
    Run("CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER "
        "NOT NULL, width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, "
        "prior_focal_length INTEGER NOT NULL)");
    Run("CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT "
        "NULL UNIQUE, camera_id INTEGER NOT NULL)");
    Run("CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, "
        "cols INTEGER NOT NULL, data BLOB)");
    Run("CREATE TABLE matches (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols "
        "INTEGER NOT NULL, data BLOB)");
    Run("CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, rows INTEGER NOT "
        "NULL, cols INTEGER NOT NULL, data BLOB, config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB)");
    Run("INSERT INTO cameras VALUES (1, 2, 640, 480, NULL, 0)");
  }
  ~Writer() { sqlite3_close(database_); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  void AddImage(int id, const std::string& name) {
    Run("INSERT INTO images VALUES (" + std::to_string(id) + ", '" + name + "', 1)");
  }

  template <typename T>
  void AddMatrix(const std::string& table, int64_t id, int rows, int cols,
                 const std::vector<T>& values) {
    const bool is_geometry = table == "two_view_geometries";
    const std::string sql = "INSERT INTO " + table + " VALUES (?, ?, ?, ?" +
                            (is_geometry ? ", 2, NULL, NULL, NULL)" : ")");
    sqlite3_stmt* statement = nullptr;
    ASSERT_EQ(sqlite3_prepare_v2(database_, sql.c_str(), -1, &statement, nullptr), SQLITE_OK);
    sqlite3_bind_int64(statement, 1, id);
    sqlite3_bind_int64(statement, 2, rows);
    sqlite3_bind_int64(statement, 3, cols);
    sqlite3_bind_blob(statement, 4, values.data(), static_cast<int>(values.size() * sizeof(T)),
                      SQLITE_TRANSIENT);
    EXPECT_EQ(sqlite3_step(statement), SQLITE_DONE);
    sqlite3_finalize(statement);
  }

  void Run(const std::string& sql) {
    EXPECT_EQ(sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(database_);
  }

 private:
  sqlite3* database_ = nullptr;
};

// ImagePairToPairId(): the smaller id first.
constexpr int64_t PairId(int64_t a, int64_t b) { return 2147483647 * a + b; }

std::vector<uint32_t> Pairs(uint32_t count) {
  std::vector<uint32_t> values(2 * count);
  std::iota(values.begin(), values.end(), 0u);
  return values;
}

void WriteImages(Writer& writer) {
  // Ids are in no order of names.
  writer.AddImage(2, "query/q.jpg");
  writer.AddImage(1, "ref/c.jpg");
  writer.AddImage(5, "ref/a.jpg");
  writer.AddImage(7, "ref/b.jpg");
  writer.AddImage(9, "ref/in_vain.jpg");
}

TEST(ColmapDatabase, KeypointsOfEveryWidthAreColmapsPixels) {
  const fs::path file = TestFolder() / "database.db";
  {
    Writer writer(file);
    WriteImages(writer);
    writer.AddMatrix<float>("keypoints", 2, 2, 2, {0.5f, 1.5f, 639.25f, 479.5f});
    writer.AddMatrix<float>("keypoints", 1, 1, 4, {10, 20, 2, 0.1f});
    writer.AddMatrix<float>("keypoints", 5, 2, 6, {1, 2, 1, 0, 0, 1, 3, 4, 1, 0, 0, 1});
    writer.AddMatrix<float>("keypoints", 7, 0, 6, {});
  }
  EXPECT_TRUE(IsColmapDatabase(file));
  const ColmapDatabase database(file);
  EXPECT_THAT(database.ImageNames(),
              ElementsAre("query/q.jpg", "ref/a.jpg", "ref/b.jpg", "ref/c.jpg", "ref/in_vain.jpg"));
  const Features query = database.ReadKeypoints("query/q.jpg");
  EXPECT_EQ(query.image_width_px, 640);
  EXPECT_EQ(query.image_height_px, 480);
  EXPECT_THAT(query.keypoints_px,
              ElementsAre(Eigen::Vector2d(0.5, 1.5), Eigen::Vector2d(639.25, 479.5)));
  EXPECT_THAT(database.ReadKeypoints("ref/c.jpg").keypoints_px,
              ElementsAre(Eigen::Vector2d(10, 20)));
  EXPECT_THAT(database.ReadKeypoints("ref/a.jpg").keypoints_px,
              ElementsAre(Eigen::Vector2d(1, 2), Eigen::Vector2d(3, 4)));
  EXPECT_THAT(database.ReadKeypoints("ref/b.jpg").keypoints_px, IsEmpty());
  EXPECT_TRUE(FailsWithInputError([&] { database.ReadKeypoints("ref/in_vain.jpg"); },
                                  {"database.db", "no keypoints of ref/in_vain.jpg"}));
  EXPECT_TRUE(
      FailsWithInputError([&] { database.ReadKeypoints("x.jpg"); }, {"database.db", "\"x.jpg\""}));
}

TEST(ColmapDatabase, PairsAreRankedByInliersAndBringTheirMatches) {
  const fs::path file = TestFolder() / "database.db";
  {
    Writer writer(file);
    WriteImages(writer);
    writer.AddMatrix<uint32_t>("matches", PairId(1, 2), 3, 2, {3, 8, 6, 1, 9, 9});
    writer.AddMatrix<uint32_t>("matches", PairId(2, 5), 1, 2, {7, 7});
    writer.AddMatrix<uint32_t>("matches", PairId(2, 7), 20, 2, Pairs(20));
    writer.AddMatrix<uint32_t>("matches", PairId(2, 9), 8, 2, Pairs(8));
    writer.AddMatrix<uint32_t>("matches", PairId(5, 9), 0, 2, {});
    writer.AddMatrix<uint32_t>("two_view_geometries", PairId(1, 2), 2, 2, {3, 8, 6, 1});
    // Guided matching finds more than there were.
    writer.AddMatrix<uint32_t>("two_view_geometries", PairId(2, 5), 3, 2, {0, 1, 2, 3, 4, 5});
    writer.AddMatrix<uint32_t>("two_view_geometries", PairId(2, 9), 0, 2, {});
  }
  const ColmapDatabase database(file);
  EXPECT_THAT(database.MatchedWith("query/q.jpg"),
              ElementsAre("ref/a.jpg", "ref/c.jpg", "ref/b.jpg", "ref/in_vain.jpg"));
  EXPECT_THAT(database.MatchedWith("ref/b.jpg"), ElementsAre("query/q.jpg"));
  EXPECT_THAT(database.MatchedWith("x.jpg"), IsEmpty());
  // The reference's id is smaller: its indices stand first.
  using Matches = std::vector<FeatureMatch>;
  EXPECT_EQ(database.ReadMatches("query/q.jpg", "ref/c.jpg"),
            (Matches{{8, 3, 1}, {1, 6, 1}, {9, 9, 1}}));
  EXPECT_EQ(database.ReadMatches("ref/c.jpg", "query/q.jpg"),
            (Matches{{3, 8, 1}, {6, 1, 1}, {9, 9, 1}}));
  EXPECT_EQ(database.ReadMatches("query/q.jpg", "ref/a.jpg"),
            (Matches{{0, 1, 1}, {2, 3, 1}, {4, 5, 1}}));
  EXPECT_EQ(database.ReadMatches("query/q.jpg", "ref/in_vain.jpg")->size(), 8u);
  EXPECT_FALSE(database.ReadMatches("ref/a.jpg", "ref/in_vain.jpg"));
  EXPECT_FALSE(database.ReadMatches("ref/a.jpg", "ref/b.jpg"));
}

TEST(ColmapDatabase, WrongFilesAreNamed) {
  const fs::path folder = TestFolder(), file = folder / "a?b#c%.db";
  EXPECT_FALSE(IsColmapDatabase(folder / "none.db"));
  EXPECT_FALSE(IsColmapDatabase(folder));
  WriteFile(folder / "text.db", "no database at all");
  EXPECT_FALSE(IsColmapDatabase(folder / "text.db"));
  EXPECT_TRUE(FailsWithInputError([&] { ColmapDatabase(folder / "text.db"); },
                                  {"text.db", "expected COLMAP's database"}));
  {
    Writer writer(file);
    WriteImages(writer);
    writer.AddMatrix<float>("keypoints", 2, 3, 2, {1, 2});
    writer.AddMatrix<float>("keypoints", 1, 1, 7, {1, 2, 3, 4, 5, 6, 7});
    writer.AddMatrix<float>("keypoints", 5, 1, 2, {1, std::numeric_limits<float>::quiet_NaN()});
    writer.AddMatrix<uint32_t>("matches", PairId(2, 5), 2, 2, Pairs(1));
  }
  const ColmapDatabase database(file);
  EXPECT_TRUE(FailsWithInputError([&] { database.ReadKeypoints("query/q.jpg"); },
                                  {"a?b#c%.db", "keypoints of query/q.jpg", "8 bytes for 3 x 2"}));
  EXPECT_TRUE(FailsWithInputError([&] { database.ReadKeypoints("ref/c.jpg"); }, {"1 x 7"}));
  EXPECT_TRUE(FailsWithInputError([&] { database.ReadKeypoints("ref/a.jpg"); }, {"not finite"}));
  EXPECT_TRUE(FailsWithInputError([&] { database.ReadMatches("query/q.jpg", "ref/a.jpg"); },
                                  {"matches of query/q.jpg and ref/a.jpg"}));
  // A database of something else, and one that is cut short.
  {
    Writer writer(folder / "other.db");
    writer.Run("DROP TABLE images");
  }
  EXPECT_TRUE(FailsWithInputError([&] { ColmapDatabase(folder / "other.db"); },
                                  {"other.db", "no such table: images"}));
  const std::string bytes = ReadFile(file);
  WriteFile(folder / "cut.db", bytes.substr(0, 3000));
  EXPECT_TRUE(FailsWithInputError([&] { ColmapDatabase(folder / "cut.db"); }, {"cut.db"}));
}

}  // namespace
}  // namespace raylift
