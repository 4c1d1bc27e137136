#include "io/hloc/hdf5_file.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <mutex>
#include <utility>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include <Eigen/Core>
#include <hdf5.h>
#include <sys/stat.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

std::mutex& GlobalMutex() {
  static std::mutex mutex;
  return mutex;
}

class Lock {
 public:
  // The setting belongs to the thread where the library knows threads.
  Lock() : lock_(GlobalMutex()) { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

 private:
  std::scoped_lock<std::mutex> lock_;
};

// Returns the innermost message of the library's last error, which is the most specific.
std::string LastError() {
  std::string text;
  const auto take_first = [](unsigned n, const H5E_error2_t* error, void* out) -> herr_t {
    if (n == 0 && error->desc != nullptr) {
      *static_cast<std::string*>(out) = error->desc;
    }
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take_first, &text);
  std::replace(text.begin(), text.end(), '\n', ' ');
  // Of the error of a system call only the system's text is kept, without addresses and times.
  constexpr std::string_view kOfSystem = "error message = '";
  if (const size_t begin = text.find(kOfSystem); begin != std::string::npos) {
    const size_t from = begin + kOfSystem.size();
    return text.substr(from, text.find('\'', from) - from);
  }
  return text.empty() ? "unknown error of HDF5" : text;
}

class Handle {
 public:
  using Close = herr_t (*)(hid_t);
  Handle(hid_t id, Close close) : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&&) = delete;
  ~Handle() {
    if (id_ >= 0) {
      close_(id_);
    }
  }
  bool IsValid() const { return id_ >= 0; }
  hid_t get() const { return id_; }
  // Closes it; returns false where data that is only now written does not find a place.
  bool CloseNow() { return close_(std::exchange(id_, -1)) >= 0; }

 private:
  hid_t id_;
  Close close_;
};

std::string NameOfFileOf(hid_t object) {
  const ssize_t size = H5Fget_name(object, nullptr, 0);
  std::string name(static_cast<size_t>(std::max<ssize_t>(size, 0)) + 1, '\0');
  H5Fget_name(object, name.data(), name.size());
  name.pop_back();
  return name;
}

[[noreturn]] void FailToRead(hid_t object, const std::string& why) {
  throw InputError(NameOfFileOf(object), fmt::format("cannot be read: {}", why));
}

// Returns whether something is there by HDF5's answer about an object, which is below 0 where that
// could not be read: this must not pass for what is not there.
bool IsThere(htri_t answer, hid_t object) {
  if (answer < 0) FailToRead(object, LastError());
  return answer > 0;
}

// Returns nullopt where there is none: the link leads nowhere.
std::optional<Handle> OpenObject(hid_t group, const std::string& name) {
  Handle object(H5Oopen(group, name.c_str(), H5P_DEFAULT), H5Oclose);
  if (object.IsValid()) return object;
  const std::string why = LastError();
  if (IsThere(H5Oexists_by_name(group, name.c_str(), H5P_DEFAULT), group)) FailToRead(group, why);
  return std::nullopt;
}

bool IsGroup(const std::optional<Handle>& object) {
  return object && H5Iget_type(object->get()) == H5I_GROUP;
}

// Returns whether a path exists; H5Lexists needs every group on the way to exist.
bool PathExists(hid_t file, const std::string& path) {
  if (path.empty() || path.find('\0') != std::string::npos) {
    return false;
  }
  std::string parent = "/";
  for (size_t end = path.find('/', 1);; end = path.find('/', end + 1)) {
    const std::string prefix = path.substr(0, end);
    const htri_t answer = H5Lexists(file, prefix.c_str(), H5P_DEFAULT);
    if (answer < 0) {
      const std::string why = LastError();
      if (IsGroup(OpenObject(file, parent))) FailToRead(file, why);
    }
    if (answer <= 0) return false;
    if (end == std::string::npos) {
      return IsThere(H5Oexists_by_name(file, path.c_str(), H5P_DEFAULT), file);
    }
    parent = prefix;
  }
}

// Returns the names of a group's links in no order: for a sorted table of them HDF5 1.10 frees what
// it never made where reading fails.
std::vector<std::string> LinkNames(hid_t group) {
  std::vector<std::string> names;
  const auto append = [](hid_t, const char* name, const H5L_info_t*, void* out) -> herr_t {
    static_cast<std::vector<std::string>*>(out)->emplace_back(name);
    return 0;
  };
  if (H5Literate(group, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, append, &names) < 0) {
    FailToRead(group, LastError());
  }
  return names;
}

void CollectGroupsWith(hid_t group, const std::string& path, const std::string& member, int depth,
                       std::vector<std::string>* paths) {
  if (IsThere(H5Lexists(group, member.c_str(), H5P_DEFAULT), group)) {
    paths->push_back(path);
    return;
  }
  if (depth == kMaxGroupNesting) {
    return;
  }
  for (const std::string& name : LinkNames(group)) {
    const std::optional<Handle> object = OpenObject(group, name);
    if (IsGroup(object)) {
      CollectGroupsWith(object->get(), path.empty() ? name : fmt::format("{}/{}", path, name),
                        member, depth + 1, paths);
    }
  }
}

// Returns the type of numpy's and h5py's float16.
Handle HalfType() {
  Handle type(H5Tcopy(H5T_IEEE_F32LE), H5Tclose);
  H5Tset_fields(type.get(), 15, 10, 5, 0, 10);
  H5Tset_size(type.get(), 2);
  H5Tset_ebias(type.get(), 15);
  return type;
}

std::optional<Hdf5Kind> KindOf(hid_t type) {
  switch (H5Tget_class(type)) {
    case H5T_INTEGER:
      return Hdf5Kind::kInteger;
    case H5T_FLOAT:
      return H5Tget_size(type) <= 2   ? Hdf5Kind::kHalf
             : H5Tget_size(type) <= 4 ? Hdf5Kind::kFloat
                                      : Hdf5Kind::kDouble;
    default:
      return std::nullopt;
  }
}

template <typename T>
hid_t NativeType();
template <>
hid_t NativeType<float>() {
  return H5T_NATIVE_FLOAT;
}
template <>
hid_t NativeType<double>() {
  return H5T_NATIVE_DOUBLE;
}
template <>
hid_t NativeType<int64_t>() {
  return H5T_NATIVE_INT64;
}

// Converts from float16, as the library's own conversion takes a tenth of a microsecond per number.
template <typename T>
void ConvertHalves(const std::string& bytes, std::vector<T>* values) {
  for (size_t i = 0; i < values->size(); ++i) {
    uint16_t bits = 0;
    std::memcpy(&bits, bytes.data() + i * sizeof(bits), sizeof(bits));
    (*values)[i] =
        static_cast<T>(static_cast<float>(Eigen::half(Eigen::half_impl::raw_uint16_to_half(bits))));
  }
}

std::vector<size_t> ShapeOf(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  std::vector<hsize_t> dims(static_cast<size_t>(std::max(rank, 0)));
  if (!dims.empty()) {
    H5Sget_simple_extent_dims(space, dims.data(), nullptr);
  }
  return {dims.begin(), dims.end()};
}

// Returns the number of elements; nullopt where the file cannot hold so many.
std::optional<size_t> CountElements(hid_t dataset, size_t num_bytes_each,
                                    const std::vector<size_t>& shape, size_t file_size) {
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  const bool is_chunked = H5Pget_layout(properties.get()) == H5D_CHUNKED;
  const size_t stored = std::min<size_t>(H5Dget_storage_size(dataset), file_size);
  const size_t limit = is_chunked ? stored * kMaxDeflateRatio : stored;
  if (std::find(shape.begin(), shape.end(), size_t{0}) != shape.end()) {
    return 0;
  }
  size_t count = 1;
  for (const size_t side : shape) {
    if (count > limit / side) {
      return std::nullopt;
    }
    count *= side;
  }
  return count <= limit / num_bytes_each ? std::optional(count) : std::nullopt;
}

Handle SpaceOf(std::span<const size_t> shape) {
  const std::vector<hsize_t> dims(shape.begin(), shape.end());
  return {H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr), H5Sclose};
}

// Makes the groups on the way to a name, without the times that HDF5 would give them: equal
// contents give equal bytes.
void MakeGroups(hid_t file, const std::string& name) {
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_char_encoding(links.get(), H5T_CSET_UTF8);
  const Handle properties(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  H5Pset_obj_track_times(properties.get(), false);
  for (size_t end = name.find('/', 1); end != std::string::npos; end = name.find('/', end + 1)) {
    const std::string group = name.substr(0, end);
    if (H5Lexists(file, group.c_str(), H5P_DEFAULT) != 0) continue;
    const Handle made(H5Gcreate2(file, group.c_str(), links.get(), properties.get(), H5P_DEFAULT),
                      H5Gclose);
  }
}

// Writes a data set, without times, too. Returns the error, or nullopt: closing anything would
// clear the library's last error.
std::optional<std::string> WriteDataset(hid_t file, const std::string& name,
                                        std::span<const size_t> shape, hid_t type_in_file,
                                        hid_t type_in_memory, const void* data) {
  MakeGroups(file, name);
  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_char_encoding(links.get(), H5T_CSET_UTF8);
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_obj_track_times(properties.get(), false);
  const Handle space = SpaceOf(shape);
  Handle dataset(H5Dcreate2(file, name.c_str(), type_in_file, space.get(), links.get(),
                            properties.get(), H5P_DEFAULT),
                 H5Dclose);
  if (!dataset.IsValid()) return LastError();
  const bool is_empty = std::find(shape.begin(), shape.end(), size_t{0}) != shape.end();
  if (!is_empty &&
      H5Dwrite(dataset.get(), type_in_memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0) {
    return LastError();
  }
  if (!dataset.CloseNow()) return LastError();
  return std::nullopt;
}

// Returns whether an external link leads to it.
bool IsOfOtherFile(hid_t file, hid_t object) { return NameOfFileOf(file) != NameOfFileOf(object); }

// Returns whether it or its values lie in other files, wherever these are.
bool LiesInOtherFiles(hid_t file, hid_t dataset) {
  if (IsOfOtherFile(file, dataset)) return true;
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  return H5Pget_external_count(properties.get()) != 0 ||
         H5Pget_layout(properties.get()) == H5D_VIRTUAL;
}

}  // namespace

// Locks the library for one call of a reader. After a call that failed HDF5 may hold half of what
// it read for the whole of it, and fails for ever: the file is opened again for the next one.
class Hdf5Reader::Access {
 public:
  explicit Access(const Hdf5Reader& reader) : reader_(reader) {
    if (reader_.file_ < 0) reader_.Open();
  }
  ~Access() {
    if (std::uncaught_exceptions() > num_exceptions_) H5Fclose(std::exchange(reader_.file_, -1));
  }
  Access(const Access&) = delete;
  Access& operator=(const Access&) = delete;

 private:
  Lock lock_;
  const Hdf5Reader& reader_;
  int num_exceptions_ = std::uncaught_exceptions();
};

Hdf5Reader::Hdf5Reader(std::filesystem::path path) : path_(std::move(path)) {
  const Lock lock;
  Open();
}

void Hdf5Reader::Open() const {
  RequireRegularFile(path_);
  struct stat of_file {};
  const bool is_there = ::stat(path_.c_str(), &of_file) == 0;
  if (inode_ == 0 && is_there) inode_ = of_file.st_ino;
  if (!is_there || of_file.st_ino != inode_) {
    throw InputError(path_, "has been replaced since it was opened");
  }
  if (H5Fis_hdf5(path_.c_str()) == 0) {
    throw InputError(path_, "expected an HDF5 file, found something else");
  }
  // A plain file, whatever the environment says is usual.
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_fapl_sec2(access.get());
  file_ = H5Fopen(path_.c_str(), H5F_ACC_RDONLY, access.get());
  if (file_ < 0) {
    throw InputError(path_, fmt::format("cannot be opened: {}", LastError()));
  }
}

Hdf5Reader::~Hdf5Reader() {
  const Lock lock;
  if (file_ >= 0) H5Fclose(file_);
}

bool Hdf5Reader::Has(const std::string& object) const {
  const Access access(*this);
  return PathExists(file_, object);
}

std::vector<std::string> Hdf5Reader::GroupsWith(const std::string& member) const {
  std::vector<std::string> paths;
  {
    const Access access(*this);
    const Handle root(H5Gopen2(file_, "/", H5P_DEFAULT), H5Gclose);
    if (!root.IsValid()) {
      Fail("/", LastError());
    }
    CollectGroupsWith(root.get(), "", member, 0, &paths);
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

template <typename T>
Hdf5Array<T> Hdf5Reader::Read(const std::string& name) const {
  Hdf5Array<T> array;
  std::string halves;
  {
    const Access access(*this);
    if (!PathExists(file_, name)) {
      Fail(name, "is not in the file");
    }
    const Handle dataset(H5Dopen2(file_, name.c_str(), H5P_DEFAULT), H5Dclose);
    if (!dataset.IsValid()) {
      Fail(name, fmt::format("expected a data set: {}", LastError()));
    }
    if (LiesInOtherFiles(file_, dataset.get())) RefuseOtherFiles(name);
    const Handle type(H5Dget_type(dataset.get()), H5Tclose);
    const Handle space(H5Dget_space(dataset.get()), H5Sclose);
    if (!space.IsValid()) Fail(name, LastError());
    const auto kind = KindOf(type.get());
    if (!kind || H5Sget_simple_extent_type(space.get()) == H5S_NULL) {
      Fail(name, "expected numbers, found another type");
    }
    if (std::is_integral_v<T> && kind != Hdf5Kind::kInteger) {
      Fail(name, "expected integers, found floating-point numbers");
    }
    array.shape = ShapeOf(space.get());
    array.kind_in_file = *kind;
    std::error_code ignored;
    const auto count = CountElements(dataset.get(), H5Tget_size(type.get()), array.shape,
                                     std::filesystem::file_size(path_, ignored));
    if (!count) {
      Fail(name,
           fmt::format("the file is too short for {} numbers", fmt::join(array.shape, " x ")));
    }
    array.values.resize(*count);
    if (*count == 0) return array;
    const Handle half = HalfType();
    const bool is_half = H5Tequal(type.get(), half.get()) > 0;
    if (is_half) halves.resize(*count * sizeof(uint16_t));
    void* const destination = is_half ? halves.data() : static_cast<void*>(array.values.data());
    if (H5Dread(dataset.get(), is_half ? half.get() : NativeType<T>(), H5S_ALL, H5S_ALL,
                H5P_DEFAULT, destination) < 0) {
      Fail(name, fmt::format("cannot be read: {}", LastError()));
    }
  }
  // The bulk of the work, which the library need not know of: side by side with other threads.
  if (!halves.empty()) ConvertHalves(halves, &array.values);
  return array;
}

template Hdf5Array<float> Hdf5Reader::Read<float>(const std::string&) const;
template Hdf5Array<double> Hdf5Reader::Read<double>(const std::string&) const;
template Hdf5Array<int64_t> Hdf5Reader::Read<int64_t>(const std::string&) const;

std::optional<std::vector<double>> Hdf5Reader::ReadAttribute(const std::string& object,
                                                             const std::string& name) const {
  const Access access(*this);
  if (!PathExists(file_, object)) return std::nullopt;
  const std::optional<Handle> owner = OpenObject(file_, object);
  if (!owner || !IsThere(H5Aexists(owner->get(), name.c_str()), file_)) return std::nullopt;
  if (IsOfOtherFile(file_, owner->get())) RefuseOtherFiles(object);
  const Handle attribute(H5Aopen(owner->get(), name.c_str(), H5P_DEFAULT), H5Aclose);
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  constexpr hssize_t kMaxNumbers = 1024;  // attributes are small
  const hssize_t count = H5Sget_simple_extent_npoints(space.get());
  if (!KindOf(type.get()) || count < 0 || count > kMaxNumbers) {
    Fail(object, fmt::format("attribute \"{}\": expected numbers, found another type", name));
  }
  std::vector<double> values(static_cast<size_t>(count));
  if (count > 0 && H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, values.data()) < 0) {
    Fail(object, fmt::format("attribute \"{}\": cannot be read: {}", name, LastError()));
  }
  return values;
}

void Hdf5Reader::RefuseOtherFiles(const std::string& object) const {
  if (FilesMayBeAnywhere()) return;
  Fail(object, "lies in other files; RAYLIFT_FILES_ANYWHERE=1 in the environment allows that");
}

void Hdf5Reader::Fail(const std::string& object, std::string_view message) const {
  throw InputError(path_, object, message);
}

Hdf5Writer::Hdf5Writer(std::filesystem::path path) : path_(std::move(path)), file_on_disk_(path_) {
  const Lock lock;
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  // Groups as of HDF5 1.8: small, and every reader of today knows them.
  H5Pset_libver_bounds(access.get(), H5F_LIBVER_V18, H5F_LIBVER_LATEST);
  const Handle root(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  H5Pset_obj_track_times(root.get(), false);
  file_ =
      H5Fcreate(file_on_disk_.temporary_path().c_str(), H5F_ACC_TRUNC, root.get(), access.get());
  if (file_ < 0) {
    throw OutputError(path_, fmt::format("cannot be written: {}", LastError()));
  }
}

Hdf5Writer::~Hdf5Writer() {
  if (file_ >= 0) {
    const Lock lock;
    H5Fclose(file_);
  }
}

bool Hdf5Writer::Has(const std::string& object) const {
  const Lock lock;
  return PathExists(file_, object);
}

void Hdf5Writer::WriteFloats(const std::string& dataset, std::span<const size_t> shape,
                             std::span<const float> values, Hdf5Kind kind) {
  RAYLIFT_CHECK(kind == Hdf5Kind::kHalf || kind == Hdf5Kind::kFloat);
  const Lock lock;
  std::optional<std::string> error;
  if (kind == Hdf5Kind::kHalf) {
    std::vector<uint16_t> bits(values.size());
    std::transform(values.begin(), values.end(), bits.begin(), [](float value) {
      return Eigen::numext::bit_cast<uint16_t>(Eigen::half(value));
    });
    const Handle half = HalfType();
    error = WriteDataset(file_, dataset, shape, half.get(), half.get(), bits.data());
  } else {
    error = WriteDataset(file_, dataset, shape, H5T_IEEE_F32LE, H5T_NATIVE_FLOAT, values.data());
  }
  if (error) throw OutputError(path_, dataset, fmt::format("cannot be written: {}", *error));
}

void Hdf5Writer::WriteIntegers(const std::string& dataset, std::span<const size_t> shape,
                               std::span<const int64_t> values, int num_bytes_in_file) {
  const Lock lock;
  const hid_t type = num_bytes_in_file == 2   ? H5T_STD_I16LE
                     : num_bytes_in_file == 4 ? H5T_STD_I32LE
                                              : H5T_STD_I64LE;
  const auto error = WriteDataset(file_, dataset, shape, type, H5T_NATIVE_INT64, values.data());
  if (error) throw OutputError(path_, dataset, fmt::format("cannot be written: {}", *error));
}

void Hdf5Writer::WriteAttribute(const std::string& object, const std::string& name, double value) {
  const Lock lock;
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  Handle attribute(H5Acreate_by_name(file_, object.c_str(), name.c_str(), H5T_IEEE_F64LE,
                                     space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                   H5Aclose);
  if (!attribute.IsValid() || H5Awrite(attribute.get(), H5T_NATIVE_DOUBLE, &value) < 0 ||
      !attribute.CloseNow()) {
    throw OutputError(path_, object, fmt::format("cannot be written: {}", LastError()));
  }
}

void Hdf5Writer::Commit() {
  {
    const Lock lock;
    std::string error;
    if (H5Fflush(file_, H5F_SCOPE_LOCAL) < 0) error = LastError();
    if (H5Fclose(std::exchange(file_, -1)) < 0 && error.empty()) error = LastError();
    if (!error.empty()) throw OutputError(path_, fmt::format("cannot be written: {}", error));
  }
  file_on_disk_.Commit();
}

void LeaveHdf5AsItIsAtExit() { H5dont_atexit(); }

}  // namespace raylift
