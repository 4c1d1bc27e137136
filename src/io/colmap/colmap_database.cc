#include "io/colmap/colmap_database.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <map>
#include <mutex>
#include <unordered_map>

#include "base/read_limits.h"
#include <fmt/format.h>
#include <sqlite3.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kMagicOfSqlite("SQLite format 3\0", 16);

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close(database); }
};
struct FinalizeStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};

// The rows of one query, which may hold one `?`.
class Rows {
 public:
  Rows(sqlite3* database, const path& file, const char* sql) : database_(database), file_(file) {
    sqlite3_stmt* statement = nullptr;
    const int result = sqlite3_prepare_v2(database, sql, -1, &statement, nullptr);
    statement_.reset(statement);
    if (result != SQLITE_OK) Fail();
  }

  void Bind(int64_t value) {
    if (sqlite3_bind_int64(statement_.get(), 1, value) != SQLITE_OK) Fail();
  }

  bool Next() {
    const int result = sqlite3_step(statement_.get());
    if (result != SQLITE_ROW && result != SQLITE_DONE) Fail();
    return result == SQLITE_ROW;
  }

  int64_t Int(int column) const { return sqlite3_column_int64(statement_.get(), column); }

  std::string Text(int column) const {
    const auto* text = sqlite3_column_text(statement_.get(), column);
    return text == nullptr ? "" : reinterpret_cast<const char*>(text);
  }

  // Returns the numbers of the matrix in the columns "rows, cols, data" from this one on.
  template <typename T>
  std::vector<T> Matrix(int column, int64_t min_cols, int64_t max_cols,
                        const std::string& what) const {
    const int64_t rows = Int(column), cols = Int(column + 1);
    const auto bytes = static_cast<int64_t>(sqlite3_column_bytes(statement_.get(), column + 2));
    if (rows == 0) return {};
    if (rows < 0 || rows > kMaxDatabaseRows || cols < min_cols || cols > max_cols ||
        bytes != rows * cols * static_cast<int64_t>(sizeof(T))) {
      throw InputError(file_, what,
                       fmt::format("expected rows of {} to {} numbers, found {} bytes for {} x {}",
                                   min_cols, max_cols, bytes, rows, cols));
    }
    std::vector<T> values(static_cast<size_t>(rows * cols));
    std::memcpy(values.data(), sqlite3_column_blob(statement_.get(), column + 2),
                static_cast<size_t>(bytes));
    return values;
  }

 private:
  [[noreturn]] void Fail() const { throw InputError(file_, sqlite3_errmsg(database_)); }

  sqlite3* database_;
  const path& file_;
  std::unique_ptr<sqlite3_stmt, FinalizeStatement> statement_;
};

struct ImageRow {
  int64_t id = 0;
  int width_px = 0;
  int height_px = 0;
};

struct Partner {
  std::string name;
  int64_t num_inliers = 0;
  int64_t num_matches = 0;
};

// Returns the id of a pair as COLMAP makes it, the smaller image id first.
constexpr int64_t kMaxNumImages = 2147483647;
int64_t PairIdOf(int64_t a, int64_t b) { return std::min(a, b) * kMaxNumImages + std::max(a, b); }

// Returns a path as a URI of SQLite.
std::string UriOf(const path& file, bool is_closed) {
  std::string uri = "file:";
  for (const char c : file.string()) {
    const bool is_special = c == '%' || c == '?' || c == '#';
    uri += is_special ? fmt::format("%{:02x}", static_cast<unsigned char>(c)) : std::string(1, c);
  }
  // A database that nobody writes needs no lock, so that its folder may be read-only.
  return uri + (is_closed ? "?mode=ro&immutable=1" : "?mode=ro");
}

}  // namespace

bool IsColmapDatabase(const path& file) {
  if (!IsFile(file)) return false;
  std::ifstream stream(file, std::ios::binary);
  std::array<char, 16> start{};
  return stream.read(start.data(), start.size()) &&
         std::string_view(start.data(), start.size()) == kMagicOfSqlite;
}

struct ColmapDatabase::Impl {
  path file;
  std::unique_ptr<sqlite3, CloseDatabase> database;
  std::map<std::string, ImageRow> images;
  std::unordered_map<std::string, std::vector<Partner>> partners;
  mutable std::mutex mutex;

  Rows Select(const char* sql) const { return Rows(database.get(), file, sql); }

  void Open() {
    path log = file;
    log += "-wal";
    sqlite3* opened = nullptr;
    const int result =
        sqlite3_open_v2(UriOf(file, !std::filesystem::exists(log)).c_str(), &opened,
                        SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX, nullptr);
    database.reset(opened);
    if (result != SQLITE_OK) {
      throw InputError(file, opened == nullptr ? "cannot be opened" : sqlite3_errmsg(opened));
    }
    // COLMAP's tables are tables: what stands in their place as a view may have no end.
    sqlite3_db_config(opened, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
    sqlite3_db_config(opened, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  }

  void ReadImages() {
    Rows rows = Select(
        "SELECT image_id, name, width, height FROM images JOIN cameras ON "
        "images.camera_id = cameras.camera_id");
    while (rows.Next()) {
      const std::string name = rows.Text(1);
      const auto in_range = [&](int column, const char* what) {
        const int64_t value = rows.Int(column);
        if (value < 0 || value >= kMaxNumImages) {
          throw InputError(file, fmt::format("image {}, {}", name, what),
                           fmt::format("expected 0 to {}, found {}", kMaxNumImages - 1, value));
        }
        return value;
      };
      images[name] = {in_range(0, "id"), static_cast<int>(in_range(2, "width")),
                      static_cast<int>(in_range(3, "height"))};
    }
  }

  void ReadPairs() {
    std::unordered_map<int64_t, std::string> names;
    for (const auto& [name, row] : images) names.emplace(row.id, name);
    std::map<int64_t, Partner> pairs;  // without names
    for (Rows rows = Select("SELECT pair_id, rows FROM matches"); rows.Next();) {
      pairs[rows.Int(0)].num_matches = rows.Int(1);
    }
    for (Rows rows = Select("SELECT pair_id, rows FROM two_view_geometries"); rows.Next();) {
      pairs[rows.Int(0)].num_inliers = rows.Int(1);
    }
    for (const auto& [id, pair] : pairs) {
      const auto a = names.find(id / kMaxNumImages), b = names.find(id % kMaxNumImages);
      if (a == names.end() || b == names.end()) continue;
      if (pair.num_matches == 0 && pair.num_inliers == 0) continue;
      partners[a->second].push_back({b->second, pair.num_inliers, pair.num_matches});
      partners[b->second].push_back({a->second, pair.num_inliers, pair.num_matches});
    }
    for (auto& [name, of_image] : partners) {
      std::sort(of_image.begin(), of_image.end(), [](const Partner& x, const Partner& y) {
        if (x.num_inliers != y.num_inliers) return x.num_inliers > y.num_inliers;
        if (x.num_matches != y.num_matches) return x.num_matches > y.num_matches;
        return x.name < y.name;
      });
    }
  }

  const ImageRow& Image(const std::string& name) const {
    const auto image = images.find(name);
    if (image == images.end()) throw InputError(file, fmt::format("holds no image \"{}\"", name));
    return image->second;
  }
};

ColmapDatabase::ColmapDatabase(const path& file) : impl_(std::make_unique<Impl>()) {
  impl_->file = file;
  if (!IsColmapDatabase(file)) throw InputError(file, "expected COLMAP's database (SQLite)");
  impl_->Open();
  impl_->ReadImages();
  impl_->ReadPairs();
}

ColmapDatabase::~ColmapDatabase() = default;
ColmapDatabase::ColmapDatabase(ColmapDatabase&&) noexcept = default;
ColmapDatabase& ColmapDatabase::operator=(ColmapDatabase&&) noexcept = default;

std::vector<std::string> ColmapDatabase::ImageNames() const {
  std::vector<std::string> names;
  for (const auto& [name, row] : impl_->images) names.push_back(name);
  return names;
}

Features ColmapDatabase::ReadKeypoints(const std::string& image) const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const ImageRow& row = impl_->Image(image);
  Rows rows = impl_->Select("SELECT rows, cols, data FROM keypoints WHERE image_id = ?");
  rows.Bind(row.id);
  if (!rows.Next()) throw InputError(impl_->file, fmt::format("no keypoints of {}", image));
  // x, y; then scale and orientation, or an affine shape.
  const auto values = rows.Matrix<float>(0, 2, 6, fmt::format("keypoints of {}", image));
  const auto num_cols = static_cast<size_t>(rows.Int(1));
  Features features;
  features.image_width_px = row.width_px;
  features.image_height_px = row.height_px;
  for (size_t i = 0; i < values.size(); i += num_cols) {
    features.keypoints_px.emplace_back(values[i], values[i + 1]);
    if (!features.keypoints_px.back().allFinite()) {
      throw InputError(impl_->file,
                       fmt::format("keypoint {} of {} is not finite", i / num_cols, image));
    }
  }
  return features;
}

std::vector<std::string> ColmapDatabase::MatchedWith(const std::string& image) const {
  std::vector<std::string> names;
  const auto partners = impl_->partners.find(image);
  if (partners == impl_->partners.end()) return names;
  for (const Partner& partner : partners->second) names.push_back(partner.name);
  return names;
}

std::optional<std::vector<FeatureMatch>> ColmapDatabase::ReadMatches(
    const std::string& query, const std::string& reference) const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const int64_t query_id = impl_->Image(query).id, reference_id = impl_->Image(reference).id;
  std::vector<uint32_t> indices;
  for (const char* sql : {"SELECT rows, cols, data FROM matches WHERE pair_id = ?",
                          "SELECT rows, cols, data FROM two_view_geometries WHERE pair_id = ?"}) {
    Rows rows = impl_->Select(sql);
    rows.Bind(PairIdOf(query_id, reference_id));
    if (!rows.Next()) continue;
    auto values =
        rows.Matrix<uint32_t>(0, 2, 2, fmt::format("matches of {} and {}", query, reference));
    if (values.size() > indices.size()) indices = std::move(values);
  }
  if (indices.empty()) return std::nullopt;
  const size_t query_column = query_id < reference_id ? 0 : 1;
  std::vector<FeatureMatch> matches;
  for (size_t i = 0; i < indices.size(); i += 2) {
    matches.push_back({static_cast<int>(indices[i + query_column]),
                       static_cast<int>(indices[i + 1 - query_column]), 1});
  }
  return matches;
}

}  // namespace raylift
