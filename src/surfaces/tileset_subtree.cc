#include <algorithm>
#include <cstring>
#include <optional>
#include <string_view>
#include <utility>

#include "surfaces/input_files.h"
#include "surfaces/tileset.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Returns a number of bytes.
size_t Size(const JsonPlace& object, std::string_view member) {
  const JsonPlace place = object.Member(member);
  const int size = place.Int();
  if (size < 0) place.Fail("expected a number of bytes");
  return static_cast<size_t>(size);
}

class SubtreeReader {
 public:
  SubtreeReader(const path& file, const ImplicitTree& tree,
                const std::function<path(const JsonPlace& uri)>& resolved)
      : tree_(tree), resolved_(resolved), bytes_(ReadFile(file)) {
    const std::string_view contents = bytes_;
    std::string_view text = contents;
    if (contents.starts_with("subt")) {
      constexpr size_t kHeader = 24;  // magic word, version, bytes of JSON, bytes of the rest
      uint64_t json = 0, binary = 0;
      if (contents.size() >= kHeader) {
        std::memcpy(&json, contents.data() + 8, sizeof(json));
        std::memcpy(&binary, contents.data() + 16, sizeof(binary));
      }
      const size_t left = contents.size() - std::min(kHeader, contents.size());
      if (contents.size() < kHeader || json > left || binary > left - json) {
        throw InputError(file, "the file is damaged or truncated");
      }
      text = contents.substr(kHeader, json);
      own_bytes_ = contents.substr(kHeader + json, binary);
    }
    document_.emplace(text, file);
  }

  Subtree Read(size_t num_contents) const {
    const JsonPlace root = document_->Root();
    const uint64_t num_tiles = tree_.FirstOfLevel(tree_.subtree_levels);
    const JsonPlace tiles = root.Member("tileAvailability");
    const JsonPlace children = root.Member("childSubtreeAvailability");
    Subtree subtree{
        Bits(root, tiles, num_tiles),
        {},
        Bits(root, children, uint64_t{1} << (tree_.BitsPerLevel() * tree_.subtree_levels))};
    if (!root.Has("contentAvailability")) {
      subtree.contents.assign(num_contents, Availability(false));
      return subtree;
    }
    const JsonPlace contents = root.Member("contentAvailability");
    // In the extension to version 1.0 it is no array, and stands where there are no contents, too.
    const bool is_array = contents.IsArray();
    const size_t num_found = is_array ? contents.ArraySize() : std::min<size_t>(num_contents, 1);
    if (num_found != num_contents) {
      contents.Fail(
          fmt::format("expected it of {} contents, found it of {}", num_contents, num_found));
    }
    for (size_t i = 0; i < num_contents; ++i) {
      const JsonPlace content = is_array ? contents.At(i) : contents;
      subtree.contents.push_back(Bits(root, content, num_tiles));
    }
    return subtree;
  }

 private:
  Availability Bits(const JsonPlace& root, const JsonPlace& availability, uint64_t count) const {
    if (availability.Has("constant")) {
      const JsonPlace constant = availability.Member("constant");
      return Availability(constant.Int() != 0);
    }
    const JsonPlace index =
        availability.Member(availability.Has("bufferView") ? "bufferView" : "bitstream");
    const JsonPlace views = root.Member("bufferViews");
    const JsonPlace view = Element(views, index);
    const JsonPlace buffers = root.Member("buffers");
    const JsonPlace buffer_index = view.Member("buffer");
    const JsonPlace buffer = Element(buffers, buffer_index);
    const size_t begin = Size(view, "byteOffset"), size = Size(view, "byteLength");
    const uint64_t needed = (count + 7) / 8;
    if (size < needed) {
      index.Fail(fmt::format("expected {} bits, found {} bytes", count, size));
    }
    std::optional<MappedFile> other;
    if (buffer.Has("uri")) {
      const JsonPlace uri = buffer.Member("uri");
      other.emplace(resolved_(uri));
    }
    const std::string_view bytes = other ? other->contents() : own_bytes_;
    if (begin > bytes.size() || size > bytes.size() - begin) {
      view.Fail(fmt::format("it ends at {} bytes, its buffer at {}", begin + size, bytes.size()));
    }
    return Availability(std::string(bytes.substr(begin, needed)));
  }

  static JsonPlace Element(const JsonPlace& list, const JsonPlace& index) {
    const int i = index.Int();
    if (i < 0 || static_cast<size_t>(i) >= list.ArraySize()) {
      index.Fail(fmt::format("expected an index of one of {}", list.ArraySize()));
    }
    return list.At(static_cast<size_t>(i));
  }

  const ImplicitTree& tree_;
  const std::function<path(const JsonPlace& uri)>& resolved_;
  std::string bytes_;
  std::string_view own_bytes_;  // after the JSON
  std::optional<JsonDocument> document_;
};

}  // namespace

Subtree ReadSubtree(const path& file, const ImplicitTree& tree, size_t num_contents,
                    const std::function<path(const JsonPlace& uri)>& resolved) {
  return SubtreeReader(file, tree, resolved).Read(num_contents);
}

}  // namespace raylift
