#include "surfaces/gltf_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstring>
#include <limits>
#include <utility>

#include "base/input_paths.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr size_t kHeader = 12;

constexpr auto kLists =
    std::to_array<std::string_view>({"accessors", "buffers", "bufferViews", "images", "materials",
                                     "meshes", "nodes", "scenes", "textures"});

constexpr std::pair<std::string_view, size_t> kComponentsOfType[] = {
    {"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}, {"MAT2", 4}, {"MAT3", 9}, {"MAT4", 16}};

// Calls `use` with a number of the type that a glTF componentType says; returns false for others.
template <typename Use>
bool WithType(uint64_t component_type, const Use& use) {
  switch (component_type) {
    case 5120:
      use(int8_t{});
      return true;
    case 5121:
      use(uint8_t{});
      return true;
    case 5122:
      use(int16_t{});
      return true;
    case 5123:
      use(uint16_t{});
      return true;
    case 5125:
      use(uint32_t{});
      return true;
    case 5126:
      use(float{});
      return true;
    default:
      return false;
  }
}

// Converts a number; a normalized integer stands for its share of the largest one, but -128 is -1,
// too.
template <typename Out, typename In>
Out Converted(In in, bool is_normalized) {
  if constexpr (std::integral<In> && std::floating_point<Out>) {
    if (!is_normalized) return static_cast<Out>(in);
    return std::max(static_cast<Out>(in) / static_cast<Out>(std::numeric_limits<In>::max()),
                    Out{-1});
  } else {
    return static_cast<Out>(in);
  }
}

void RequireRoom(const JsonPlace& place, uint64_t end, uint64_t room) {
  if (end > room) place.Fail(fmt::format("it ends at {} bytes of {}", end, room));
}

void RequireUnsigned(const JsonPlace& place, uint64_t component_type) {
  if (component_type == 5121 || component_type == 5123 || component_type == 5125) return;
  place.Fail("expected the componentType of unsigned integers, 5121, 5123 or 5125");
}

}  // namespace

// The layout of an accessor's numbers in its bytes.
struct GltfFile::Items {
  std::string_view bytes;  // from the first item on; empty: all are zero
  size_t stride = 0;
  uint64_t count = 0;
  size_t components = 0;
  uint64_t component_type = 0;
  bool is_normalized = false;

  size_t NumBytes() const {
    size_t size = 0;
    WithType(component_type, [&](auto number) { size = sizeof(number); });
    return size * components;
  }

  // Sets item `index_of(i)` of `out` to the i-th one.
  template <typename Out, typename IndexOf>
  void Copy(std::vector<Out>& out, const IndexOf& index_of) const {
    WithType(component_type, [&]<typename In>(In in) {
      for (size_t i = 0; i < count; ++i) {
        const char* const item = bytes.data() + i * stride;
        Out* const to = &out[index_of(i) * components];
        for (size_t k = 0; k < components; ++k) {
          std::memcpy(&in, item + k * sizeof(In), sizeof(In));
          to[k] = Converted<Out>(in, is_normalized);
        }
      }
    });
  }
};

uint64_t CountOf(const JsonPlace& place, std::string_view member, uint64_t missing) {
  if (!place.Has(member)) return missing;
  const JsonPlace count = place.Member(member);
  const double value = count.Number();
  if (!(value >= 0 && value <= UINT32_MAX && value == std::floor(value))) {
    count.Fail("expected a number up to 4294967295");
  }
  return static_cast<uint64_t>(value);
}

GltfFile::GltfFile(const std::filesystem::path& path, std::string_view contents, GltfPlace place)
    : path_(path),
      place_(place),
      size_bytes_(contents.size()),
      rest_(contents),
      document_(TakeJson(), path),
      root_(document_.Root()) {
  const JsonPlace asset = root_.Member("asset");
  const JsonPlace version = asset.Member("version");
  if (!version.String().starts_with("2.")) version.Fail("expected glTF 2");
  for (const std::string_view list : kLists) {
    if (root_.Has(list)) lists_.emplace(list, root_.Member(list));
  }
}

// Takes the JSON. A binary file has a header of the magic word, the version and its size, then a
// chunk of JSON and one of data, each of a length, a name and its bytes.
std::string_view GltfFile::TakeJson() {
  if (!rest_.starts_with("glTF")) return rest_;
  uint32_t version = 0;
  if (rest_.size() >= kHeader) std::memcpy(&version, rest_.data() + 4, sizeof(version));
  if (version == 1) throw InputError(path_, "version", "expected glTF 2, found 1");
  rest_.remove_prefix(std::min(kHeader, rest_.size()));
  const std::string_view json = TakeChunk("JSON");
  if (!rest_.empty()) data_ = TakeChunk({"BIN\0", 4});
  return json;
}

std::string_view GltfFile::TakeChunk(std::string_view name) {
  uint32_t size = 0;
  if (rest_.size() >= 8) std::memcpy(&size, rest_.data(), sizeof(size));
  if (rest_.size() < 8 || rest_.substr(4, 4) != name || size > rest_.size() - 8) {
    throw InputError(
        path_, fmt::format("chunk {}", name.substr(0, name.find('\0'))),
        fmt::format("expected it with all its {} bytes, the file is damaged or truncated", size));
  }
  const std::string_view chunk = rest_.substr(8, size);
  rest_.remove_prefix(8 + size);
  return chunk;
}

size_t GltfFile::CountItems(const std::string& list) const {
  const auto found = lists_.find(list);
  return found == lists_.end() ? 0 : found->second.ArraySize();
}

JsonPlace GltfFile::Item(const std::string& list, size_t index) const {
  return lists_.at(list).At(index);
}

size_t GltfFile::Index(const std::string& list, const JsonPlace& index) const {
  const int value = index.Int();
  const size_t count = CountItems(list);
  if (value < 0 || static_cast<size_t>(value) >= count) {
    index.Fail(fmt::format("expected an index of one of {} {}", count, list));
  }
  return static_cast<size_t>(value);
}

std::optional<std::string> GltfFile::DataOfUri(const JsonPlace& uri) const {
  const std::string text = uri.String();
  if (text.starts_with("data:")) {
    const size_t comma = text.find(',');
    if (comma == std::string::npos || !text.substr(0, comma).ends_with(";base64")) {
      uri.Fail("expected data in base64");
    }
    return uri.Blame([&] { return DecodeBase64(std::string_view(text).substr(comma + 1)); });
  }
  // A file whose bytes are shown as a picture or written as a mesh must not be any file of this
  // machine.
  if (const std::string named = DecodedUri(text); !MayBeRead(named)) {
    uri.Fail(
        fmt::format("expected a file below the scene's folder, found {}; "
                    "RAYLIFT_FILES_ANYWHERE=1 in the environment allows it",
                    Shown(named)));
  }
  return std::nullopt;
}

std::string_view GltfFile::Buffer(size_t index) {
  const auto [entry, is_new] = buffers_.try_emplace(index);
  if (is_new) entry->second = ReadBuffer(index);
  return entry->second;
}

std::string_view GltfFile::ReadBuffer(size_t index) {
  const JsonPlace buffer = Item("buffers", index);
  const uint64_t size = CountOf(buffer, "byteLength", 0);
  std::string_view bytes = index == 0 ? data_.value_or("") : "";
  if (buffer.Has("uri")) {
    const JsonPlace uri = buffer.Member("uri");
    if (auto data = DataOfUri(uri)) {
      bytes = decoded_.emplace_back(std::move(*data));
    } else if (place_ == GltfPlace::kPartOfFile) {
      uri.Fail("expected the bytes in the file itself");
    } else {
      bytes = files_.emplace_back(path_.parent_path() / DecodedUri(uri.String())).contents();
    }
  }
  if (size > bytes.size()) {
    buffer.Fail(fmt::format("it claims {} bytes, there are {}", size, bytes.size()));
  }
  return bytes.substr(0, size);
}

// Returns a part of a buffer, by the members buffer, byteOffset and byteLength.
std::string_view GltfFile::PartOfBuffer(const JsonPlace& place) {
  const JsonPlace index = place.Member("buffer");
  const std::string_view bytes = Buffer(Index("buffers", index));
  const uint64_t offset = CountOf(place, "byteOffset", 0);
  const uint64_t size = CountOf(place, "byteLength", 0);
  RequireRoom(place, offset + size, bytes.size());
  return bytes.substr(offset, size);
}

const GltfFile::View& GltfFile::ViewAt(const JsonPlace& index) {
  const size_t number = Index("bufferViews", index);
  const auto [entry, is_new] = views_.try_emplace(number);
  View& view = entry->second;
  if (!is_new) return view;
  const JsonPlace place = Item("bufferViews", number);
  view.stride = CountOf(place, "byteStride", 0);
  bool is_compressed = false;
  IfThere(place, {"extensions", "EXT_meshopt_compression"}, [&](const JsonPlace& compressed) {
    is_compressed = true;
    const auto text = [&](std::string_view member) {
      return compressed.Has(member) ? compressed.Member(member).String() : "NONE";
    };
    const MeshoptView kind{text("mode"), text("filter"), CountOf(compressed, "count", 0),
                           CountOf(compressed, "byteStride", 0)};
    const std::string_view bytes = PartOfBuffer(compressed);
    // Views of the same bytes are decompressed each.
    num_decompressed_ += bytes.size();
    if (num_decompressed_ > NumBytes()) compressed.Fail("others have the same bytes");
    view.bytes =
        decoded_.emplace_back(compressed.Blame([&] { return DecodeMeshopt(bytes, kind); }));
  });
  if (!is_compressed) view.bytes = PartOfBuffer(place);
  return view;
}

uint64_t GltfFile::NumBytes() const {
  uint64_t sum = size_bytes_;
  for (const auto& [index, bytes] : buffers_) sum += bytes.size();
  return sum;
}

std::string_view GltfFile::BytesOfView(const JsonPlace& index) { return ViewAt(index).bytes; }

// Returns where the items of an accessor, or of a part of it, begin.
GltfFile::Items GltfFile::AtPlace(const JsonPlace& place, Items items) {
  const JsonPlace index = place.Member("bufferView");
  const View& view = ViewAt(index);
  const uint64_t offset = CountOf(place, "byteOffset", 0);
  const size_t size = items.NumBytes();
  items.stride = view.stride == 0 ? size : view.stride;
  if (size == 0) place.Fail("expected a known componentType and type");
  if (items.stride < size) place.Fail(fmt::format("its items of {} bytes overlap", size));
  RequireRoom(place, items.count == 0 ? 0 : offset + (items.count - 1) * items.stride + size,
              view.bytes.size());
  items.bytes = view.bytes.substr(std::min<uint64_t>(offset, view.bytes.size()));
  return items;
}

GltfFile::Items GltfFile::ItemsOf(const JsonPlace& accessor, size_t components) {
  Items items;
  items.count = CountOf(accessor, "count", 0);
  items.component_type = CountOf(accessor, "componentType", 0);
  items.is_normalized = accessor.Has("normalized") && accessor.Member("normalized").Bool();
  const std::string type = accessor.Member("type").String();
  for (const auto& [name, number] : kComponentsOfType) {
    if (name == type) items.components = number;
  }
  if (items.NumBytes() == 0) accessor.Fail("expected a known componentType and type");
  const bool fits = components == 0 ? items.components == 3 || items.components == 4
                                    : items.components == components;
  if (!fits) {
    accessor.Fail(fmt::format("expected items of {} numbers, found {}",
                              components == 0 ? "3 or 4" : std::to_string(components), type));
  }
  if (accessor.Has("bufferView")) return AtPlace(accessor, items);
  // All zero: no more than the files have bytes.
  IfThere(accessor, {"sparse", "values", "bufferView"},
          [&](const JsonPlace& view) { ViewAt(view); });
  RequireRoom(accessor, items.count * items.NumBytes(), NumBytes());
  return items;
}

template <typename Number>
std::vector<Number> GltfFile::Read(const JsonPlace& accessor, const Items& items) {
  std::vector<Number> numbers(items.count * items.components);
  if (!items.bytes.empty()) items.Copy(numbers, [](size_t i) { return i; });
  if (!accessor.Has("sparse")) return numbers;
  const JsonPlace sparse = accessor.Member("sparse");
  const JsonPlace where = sparse.Member("indices"), what = sparse.Member("values");
  Items changed = items, places;
  changed.count = places.count = CountOf(sparse, "count", 0);
  places.components = 1;
  places.component_type = CountOf(where, "componentType", 0);
  RequireUnsigned(where, places.component_type);
  places = AtPlace(where, places);
  changed = AtPlace(what, changed);
  std::vector<uint32_t> to(places.count);
  places.Copy(to, [](size_t i) { return i; });
  if (std::any_of(to.begin(), to.end(), [&](uint32_t i) { return i >= items.count; })) {
    where.Fail(fmt::format("expected indices below {}", items.count));
  }
  changed.Copy(numbers, [&](size_t i) { return to[i]; });
  return numbers;
}

VertexNumbers GltfFile::ReadNumbers(const JsonPlace& index, size_t components) {
  const JsonPlace accessor = Item("accessors", Index("accessors", index));
  const Items items = ItemsOf(accessor, components);
  return {items.components, Read<float>(accessor, items)};
}

VertexNumbers GltfFile::ReadAttribute(const JsonPlace& attributes, std::string_view name,
                                      size_t components) {
  if (!attributes.Has(name)) return {};
  const JsonPlace index = attributes.Member(name);
  return ReadNumbers(index, components);
}

std::vector<uint32_t> GltfFile::ReadIndices(const JsonPlace& index) {
  const JsonPlace accessor = Item("accessors", Index("accessors", index));
  const Items items = ItemsOf(accessor, 1);
  RequireUnsigned(accessor, items.component_type);
  return Read<uint32_t>(accessor, items);
}

}  // namespace raylift
