#include "io/binary/binary_buffer.h"

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {

BinaryReader::BinaryReader(const std::filesystem::path& path)
    : path_(path), contents_(ReadFile(path)) {}

void BinaryReader::EnterRecord(std::string_view kind, uint64_t index, uint64_t count) {
  record_kind_ = kind;
  record_index_ = index;
  record_count_ = count;
}

std::string BinaryReader::ReadString(const char* field) {
  const size_t end = contents_.find('\0', position_);
  if (end == std::string::npos) {
    Fail(field, "the file ends here");
  }
  std::string text = contents_.substr(position_, end - position_);
  position_ = end + 1;
  return text;
}

void BinaryReader::ExpectEnd() {
  if (Remaining() > 0) {
    throw InputError(path_, fmt::format("expected the end after {} bytes, found {} more", position_,
                                        Remaining()));
  }
}

void BinaryReader::Fail(const char* field, std::string_view message) const {
  if (record_kind_.empty()) {
    throw InputError(path_, field, message);
  }
  throw InputError(
      path_, fmt::format("{} {} of {}, {}", record_kind_, record_index_ + 1, record_count_, field),
      message);
}

void BinaryReader::CheckCount(const char* field, uint64_t count, size_t bytes_per_item) const {
  if (count > Remaining() / bytes_per_item) {
    Fail(field, fmt::format("the file ends here: {} items of {} bytes each cannot be in the {} "
                            "bytes that are left",
                            count, bytes_per_item, Remaining()));
  }
}

void BinaryReader::FailNotFinite(const char* field, double value) const {
  Fail(field, fmt::format("expected a finite number, found {}", value));
}

}  // namespace raylift
