#include "io/binary/inflate.h"

#include <limits>
#include <memory>

#include <fmt/format.h>
#include <zlib.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr int kGzipWindowBits = 16 + MAX_WBITS;
constexpr size_t kMaxInflated = size_t{1} << 32;  // more than the largest depth map takes

class GzipStream {
 public:
  explicit GzipStream(std::string_view bytes) {
    // zlib only reads its input.
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream_.avail_in = static_cast<uInt>(bytes.size());
    RAYLIFT_CHECK_EQ(inflateInit2(&stream_, kGzipWindowBits), Z_OK);
  }
  ~GzipStream() { inflateEnd(&stream_); }
  GzipStream(const GzipStream&) = delete;
  GzipStream& operator=(const GzipStream&) = delete;

  z_stream& get() { return stream_; }

 private:
  z_stream stream_{};
};

}  // namespace

bool IsGzip(std::string_view bytes) { return bytes.starts_with("\x1f\x8b"); }

std::string InflateGzip(const std::filesystem::path& path, std::string_view bytes) {
  if (bytes.size() > std::numeric_limits<uInt>::max()) {
    throw InputError(path, "the gzip file is too large");
  }
  GzipStream gzip(bytes);
  z_stream& stream = gzip.get();
  std::string result;
  auto buffer = std::make_unique<char[]>(1 << 18);
  while (true) {
    stream.next_out = reinterpret_cast<Bytef*>(buffer.get());
    stream.avail_out = 1 << 18;
    const int status = inflate(&stream, Z_NO_FLUSH);
    result.append(buffer.get(), (1 << 18) - stream.avail_out);
    if (status == Z_STREAM_END) {
      if (stream.avail_in == 0) return result;
      if (inflateReset(&stream) != Z_OK) break;
    } else if (status != Z_OK) {
      throw InputError(path, fmt::format("the gzip file is damaged or truncated: {}",
                                         stream.msg != nullptr ? stream.msg : "it ends too early"));
    }
    if (result.size() > kMaxInflated) break;
  }
  throw InputError(path, "the gzip file holds more than a depth map can have");
}

}  // namespace raylift
