// Little-endian records in and out of memory; every read is checked against the bytes that are
// left. Private to io.

#pragma once

#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>

namespace raylift {

static_assert(std::endian::native == std::endian::little, "the readers copy bytes as they are");

// Reads the bytes of a file from first to last and names the record and the field in its messages:
// "images.bin: image 3 of 11, tvec: the file ends here".
class BinaryReader {
 public:
  explicit BinaryReader(const std::filesystem::path& path);

  // From here on, fields belong to record `index` (from 0) of `count`.
  void EnterRecord(std::string_view kind, uint64_t index, uint64_t count);

  template <typename T>
  T Read(const char* field) {
    static_assert(std::is_arithmetic_v<T>);
    Require(sizeof(T), field);
    T value;
    std::memcpy(&value, contents_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }

  double ReadFinite(const char* field) {
    const double value = Read<double>(field);
    if (!std::isfinite(value)) {
      FailNotFinite(field, value);
    }
    return value;
  }

  // Up to the terminating zero.
  std::string ReadString(const char* field);

  // A count of items that take at least `bytes_per_item` each: no more than the file can hold.
  template <typename Count>
  Count ReadCount(const char* field, size_t bytes_per_item) {
    const Count count = Read<Count>(field);
    CheckCount(field, count, bytes_per_item);
    return count;
  }

  size_t Remaining() const { return contents_.size() - position_; }
  void ExpectEnd();
  [[noreturn]] void Fail(const char* field, std::string_view message) const;

 private:
  void Require(size_t num_bytes, const char* field) const {
    if (Remaining() < num_bytes) {
      Fail(field, "the file ends here");
    }
  }
  void CheckCount(const char* field, uint64_t count, size_t bytes_per_item) const;
  [[noreturn]] void FailNotFinite(const char* field, double value) const;

  std::filesystem::path path_;
  std::string contents_;
  size_t position_ = 0;
  std::string_view record_kind_;
  uint64_t record_index_ = 0;
  uint64_t record_count_ = 0;
};

class BinaryWriter {
 public:
  template <typename T>
  void Write(std::type_identity_t<T> value) {
    static_assert(std::is_arithmetic_v<T>);
    const size_t position = contents_.size();
    contents_.resize(position + sizeof(T));
    std::memcpy(contents_.data() + position, &value, sizeof(T));
  }
  void WriteString(const std::string& text) { contents_.append(text.c_str(), text.size() + 1); }
  const std::string& contents() const { return contents_; }

 private:
  std::string contents_;
};

}  // namespace raylift
