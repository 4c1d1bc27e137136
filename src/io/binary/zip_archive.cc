#include "io/binary/zip_archive.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <utility>

#include "base/read_limits.h"
#include "io/depth/depth_formats.h"
#include <fmt/format.h>
#include <zip.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr uint16_t kDosDate1980 = (1 << 5) | 1;

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
using ZipHandle = std::unique_ptr<zip_t, Discard>;

struct CloseEntry {
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};

class ZipError {
 public:
  ZipError() { zip_error_init(&error_); }
  ~ZipError() { zip_error_fini(&error_); }
  ZipError(const ZipError&) = delete;
  ZipError& operator=(const ZipError&) = delete;
  zip_error_t* get() { return &error_; }
  std::string text() { return zip_error_strerror(&error_); }

 private:
  zip_error_t error_;
};

// Opens an archive for reading, on a buffer that is not its own.
ZipHandle Open(const path& file, const void* data, size_t size) {
  ZipError error;
  zip_source_t* source = zip_source_buffer_create(data, size, 0, error.get());
  zip_t* archive =
      source != nullptr ? zip_open_from_source(source, ZIP_RDONLY, error.get()) : nullptr;
  if (archive == nullptr) {
    if (source != nullptr) zip_source_free(source);
    throw InputError(file,
                     fmt::format("the ZIP archive is damaged or truncated: {}", error.text()));
  }
  return ZipHandle(archive);
}

void Require(bool good, const path& file, zip_t* archive) {
  if (!good) {
    throw InputError(file, fmt::format("the ZIP archive cannot be made: {}",
                                       zip_error_strerror(zip_get_error(archive))));
  }
}

struct FreeSource {
  void operator()(zip_source_t* source) const { zip_source_free(source); }
};
using SourceHandle = std::unique_ptr<zip_source_t, FreeSource>;

std::string TakeBytes(const path& file, zip_source_t* source) {
  zip_stat_t stat;
  zip_stat_init(&stat);
  std::string bytes;
  if (zip_source_stat(source, &stat) == 0 && zip_source_open(source) == 0) {
    bytes.resize(stat.size);
    const zip_int64_t count = zip_source_read(source, bytes.data(), bytes.size());
    zip_source_close(source);
    if (count == static_cast<zip_int64_t>(bytes.size())) return bytes;
  }
  throw InputError(file, "the ZIP archive cannot be made");
}

}  // namespace

struct ZipReader::Archive {
  ZipHandle handle;
  size_t num_bytes;
};

bool IsZip(std::string_view bytes) { return bytes.starts_with("PK\x03\x04"); }

ZipReader::ZipReader(path path_for_messages, std::string_view bytes)
    : path_(std::move(path_for_messages)),
      archive_(std::make_unique<Archive>(
          Archive{Open(path_, bytes.data(), bytes.size()), bytes.size()})) {
  const zip_int64_t count = zip_get_num_entries(archive_->handle.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    const char* name = zip_get_name(archive_->handle.get(), static_cast<zip_uint64_t>(i), 0);
    if (name != nullptr) names_.emplace_back(name);
  }
}

ZipReader::~ZipReader() = default;

std::string ZipReader::Read(const std::string& name) const {
  zip_t* archive = archive_->handle.get();
  const auto fail = [&](std::string_view message) { throw InputError(path_, name, message); };
  zip_stat_t stat;
  zip_stat_init(&stat);
  if (zip_stat(archive, name.c_str(), 0, &stat) != 0) fail("no such entry");
  const auto compressed = std::min<uint64_t>(stat.comp_size, archive_->num_bytes);
  if (stat.size > kMaxDeflateRatio * (compressed + 1)) {
    fail(fmt::format("claims {} bytes, more than its {} compressed bytes can become", stat.size,
                     compressed));
  }
  const std::unique_ptr<zip_file_t, CloseEntry> entry(zip_fopen(archive, name.c_str(), 0));
  if (entry == nullptr) {
    fail(fmt::format("cannot be read: {}", zip_error_strerror(zip_get_error(archive))));
  }
  // libzip compares the checksum when it is asked for more than there is.
  std::string contents(stat.size + 1, '\0');
  size_t size = 0;
  while (size < contents.size()) {
    const zip_int64_t count =
        zip_fread(entry.get(), contents.data() + size, contents.size() - size);
    if (count < 0) fail("the entry is damaged or truncated");
    if (count == 0) break;
    size += static_cast<size_t>(count);
  }
  if (size != stat.size) {
    fail(fmt::format("expected {} bytes, found {}{}", stat.size,
                     size > stat.size ? "more than " : "", std::min<size_t>(size, stat.size)));
  }
  contents.resize(size);
  return contents;
}

std::string MakeZip(const path& file, const std::string& name, const std::string& contents,
                    ZipMethod method) {
  ZipError error;
  const SourceHandle target(zip_source_buffer_create(nullptr, 0, 0, error.get()));
  RAYLIFT_CHECK(target != nullptr);
  zip_source_keep(target.get());  // the archive's own reference
  ZipHandle archive(zip_open_from_source(target.get(), ZIP_CREATE | ZIP_TRUNCATE, error.get()));
  if (archive == nullptr) {
    zip_source_free(target.get());
    throw InputError(file, fmt::format("the ZIP archive cannot be made: {}", error.text()));
  }
  zip_source_t* source = zip_source_buffer(archive.get(), contents.data(), contents.size(), 0);
  Require(source != nullptr, file, archive.get());
  const zip_int64_t index = zip_file_add(archive.get(), name.c_str(), source, ZIP_FL_ENC_UTF_8);
  if (index < 0) zip_source_free(source);
  Require(index >= 0, file, archive.get());
  const auto entry = static_cast<zip_uint64_t>(index);
  Require(zip_set_file_compression(archive.get(), entry,
                                   method == ZipMethod::kDeflate ? ZIP_CM_DEFLATE : ZIP_CM_STORE,
                                   1) == 0,
          file, archive.get());
  Require(zip_file_set_dostime(archive.get(), entry, 0, kDosDate1980, 0) == 0, file, archive.get());
  Require(zip_close(archive.get()) == 0, file, archive.get());
  static_cast<void>(archive.release());  // closed
  return TakeBytes(file, target.get());
}

namespace {

// The source from which libzip asks for an entry's bytes.
struct LazyEntry {
  const ZipEntry* entry;
  std::exception_ptr* failure;  // of any entry: no exception may pass through libzip
  std::string contents = {};
  size_t position = 0;
};

zip_int64_t Answer(LazyEntry& lazy, void* data, zip_uint64_t size, zip_source_cmd_t command) {
  switch (command) {
    case ZIP_SOURCE_OPEN:
      lazy.contents = lazy.entry->contents();
      lazy.position = 0;
      return 0;
    case ZIP_SOURCE_READ: {
      const size_t count = std::min<size_t>(size, lazy.contents.size() - lazy.position);
      std::memcpy(data, lazy.contents.data() + lazy.position, count);
      lazy.position += count;
      return static_cast<zip_int64_t>(count);
    }
    case ZIP_SOURCE_CLOSE:
      lazy.contents = {};
      return 0;
    case ZIP_SOURCE_STAT: {
      auto& stat = *static_cast<zip_stat_t*>(data);
      zip_stat_init(&stat);  // the size is not known yet
      return sizeof(stat);
    }
    case ZIP_SOURCE_ERROR: {
      const int codes[] = {ZIP_ER_INTERNAL, 0};
      std::memcpy(data, codes, sizeof(codes));
      return sizeof(codes);
    }
    case ZIP_SOURCE_SUPPORTS:
      return ZIP_SOURCE_SUPPORTS_READABLE;
    case ZIP_SOURCE_FREE:
      return 0;
    default:
      return -1;
  }
}

zip_int64_t AnswerSafely(void* lazy, void* data, zip_uint64_t size, zip_source_cmd_t command) {
  auto& entry = *static_cast<LazyEntry*>(lazy);
  try {
    return Answer(entry, data, size, command);
  } catch (...) {
    *entry.failure = std::current_exception();
    return -1;
  }
}

}  // namespace

void WriteZip(const path& file, std::span<const ZipEntry> entries) {
  AtomicFile target(file);
  std::exception_ptr failure;
  std::vector<LazyEntry> lazy;  // outlives the archive, which looks at it
  lazy.reserve(entries.size());
  int code = ZIP_ER_OK;
  ZipHandle archive(zip_open(target.temporary_path().c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
  const auto fail = [&](const std::string& why) {
    throw OutputError(file, fmt::format("cannot be written: {}", why));
  };
  if (archive == nullptr) {
    ZipError error;
    zip_error_init_with_code(error.get(), code);
    fail(error.text());
  }
  const auto require = [&](bool good, const std::string& entry = {}) {
    if (failure) std::rethrow_exception(failure);
    if (!good) {
      fail(fmt::format("{}{}{}", entry, entry.empty() ? "" : ": ",
                       zip_error_strerror(zip_get_error(archive.get()))));
    }
  };
  for (const ZipEntry& entry : entries) {
    lazy.push_back({&entry, &failure});
    zip_source_t* source = zip_source_function(archive.get(), AnswerSafely, &lazy.back());
    require(source != nullptr);
    const zip_int64_t index =
        zip_file_add(archive.get(), entry.name.c_str(), source, ZIP_FL_ENC_UTF_8);
    if (index < 0) zip_source_free(source);
    require(index >= 0, entry.name);
    const auto number = static_cast<zip_uint64_t>(index);
    require(zip_set_file_compression(archive.get(), number, ZIP_CM_STORE, 0) == 0);
    require(zip_file_set_dostime(archive.get(), number, 0, kDosDate1980, 0) == 0);
  }
  require(zip_close(archive.get()) == 0);
  static_cast<void>(archive.release());  // closed
  target.Commit();
}

}  // namespace raylift
