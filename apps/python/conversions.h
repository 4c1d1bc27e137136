// Conversions between Python and the library: numpy arrays, keyword arguments, cameras and poses of
// several kinds, and the interpreter's lock.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/fields.h"
#include "localization/matching/pixel_matches.h"
#include <Eigen/Core>
#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "raylift/base/enum_names.h"
#include "raylift/base/error.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/features.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

// Defines the type of an argument that may be an object of many kinds; signatures show a name of
// raylift/_types.py for it. A missing argument (None) is none of them.
#define RAYLIFT_PYTHON_ARGUMENT(Class, is_one, shown)                 \
  namespace raylift::python {                                         \
  class Class : public pybind11::object {                             \
   public:                                                            \
    PYBIND11_OBJECT_DEFAULT(Class, pybind11::object, is_one)          \
  };                                                                  \
  }                                                                   \
  template <>                                                         \
  struct pybind11::detail::handle_type_name<raylift::python::Class> { \
    static constexpr auto name = const_name(shown);                   \
  };

namespace raylift {
struct FrontEndOptions;
struct MatchReading;
}  // namespace raylift

namespace raylift::python {
inline bool IsSomething(PyObject* object) { return object != Py_None; }
}  // namespace raylift::python

RAYLIFT_PYTHON_ARGUMENT(ArrayLike, IsSomething, "numpy.typing.ArrayLike")
RAYLIFT_PYTHON_ARGUMENT(CameraLike, IsSomething, "raylift._types.CameraLike")
RAYLIFT_PYTHON_ARGUMENT(PoseLike, IsSomething, "raylift._types.PoseLike")
RAYLIFT_PYTHON_ARGUMENT(PosedImageLike, IsSomething, "raylift._types.PosedImageLike")
RAYLIFT_PYTHON_ARGUMENT(PathLike, IsSomething, "raylift._types.PathLike")
RAYLIFT_PYTHON_ARGUMENT(ModelLike, IsSomething, "raylift._types.ModelLike")
RAYLIFT_PYTHON_ARGUMENT(QueryLike, IsSomething, "raylift._types.QueryLike")
RAYLIFT_PYTHON_ARGUMENT(ExtractorLike, IsSomething, "raylift._types.Extractor")
RAYLIFT_PYTHON_ARGUMENT(MatcherLike, IsSomething, "raylift._types.Matcher")
RAYLIFT_PYTHON_ARGUMENT(DescriptorLike, IsSomething, "raylift._types.GlobalDescriptor")
// Is a function that is called with (done, total, what), from any thread.
RAYLIFT_PYTHON_ARGUMENT(ProgressCall, PyCallable_Check, "raylift._types.Progress")

namespace raylift::python {

namespace py = pybind11;

// Is thrown for an argument of a wrong type: of Python's errors it is an InputError and a
// TypeError.
class WrongType : public InputError {
 public:
  using InputError::InputError;
};

// A camera is a Camera, "MODEL width height params...", a mapping with the keys model, width,
// height and params, or an object with attributes of these names (pycolmap's, PoseLib's).
Camera ToCamera(const CameraLike& camera);
// A pose is a Rigid3, a 4 x 4 or 3 x 4 matrix, a pair (qvec, tvec), a mapping with the keys qvec
// and tvec, or an object with the attributes rotation and translation (pycolmap's) or q and t
// (PoseLib's).
Rigid3 ToPose(const PoseLike& pose);
// A reference is a PosedImage, a pair (camera, pose), or an object with the attributes name, camera
// and cam_from_world (pycolmap's images), or camera and pose (PoseLib's).
PosedImage ToPosedImage(const PosedImageLike& image);
std::vector<PosedImage> ToPosedImages(const std::vector<PosedImageLike>& images);
// A query is a Query, or a pair (name, camera).
Query ToQuery(const QueryLike& query);
Eigen::Vector3d ToVector3(const ArrayLike& argument, std::string_view name);
// Arguments of priors: (position, sigma), sigma being one number or one per axis; (down_in_cam,
// down_in_world, sigma_deg); (right_in_cam, right_in_world, down_in_world, sigma_deg); (rotation,
// sigma_deg) of cam_from_world; (range, sigma).
using PositionArgument = std::optional<std::pair<ArrayLike, ArrayLike>>;
using GravityArgument = std::optional<std::tuple<ArrayLike, ArrayLike, double>>;
using HeadingArgument = std::optional<std::tuple<ArrayLike, ArrayLike, ArrayLike, double>>;
using OrientationArgument = std::optional<std::pair<ArrayLike, double>>;
using RangeArgument = std::optional<std::pair<double, double>>;
struct PriorArguments {
  PositionArgument position;
  GravityArgument gravity;
  HeadingArgument heading;
  OrientationArgument orientation;
  RangeArgument range = std::nullopt;
  std::optional<double> focal_sigma = std::nullopt;
  double focal_range = 1;
};
PosePriors ToPriors(const PriorArguments& given);
// Returns the query with these priors; its prior of the focal length stays where these have none.
Query WithPriors(Query query, PosePriors priors);
// Converts a str. Throws WrongType naming the argument for anything else.
std::string ToText(const py::handle& text, std::string_view name);
// Converts a mapping of poses (cam_from_world) by name.
std::map<std::string, Rigid3> ToNamedPoses(const py::object& mapping, std::string_view name);
// Converts a str, bytes or os.PathLike. Throws WrongType naming the argument for anything else.
std::filesystem::path ToPath(const PathLike& path, std::string_view name);
inline PlaneSize SizeOf(const Camera& camera) { return {camera.width_px(), camera.height_px()}; }
// Converts uint8: height x width, or height x width x 3 (red, green, blue).
Image ToImage(const ArrayLike& array);
py::array_t<uint8_t> ToArray(Image image);
// Converts a mapping with keypoints (N, 2) and descriptors (N, D). Throws InputError where most
// keypoints lie outside of an image of this size.
Features ToFeatures(const py::object& mapping, PlaneSize size);
struct OwnMatching {
  std::optional<ExtractorLike> extractor;
  std::optional<MatcherLike> matcher;
  std::optional<DescriptorLike> retrieval;
};
// Makes the front end extract, match and retrieve by what Python gave.
void UseOwn(const OwnMatching& own, const MatchReading& reading, FrontEndOptions* options);

namespace internal {
[[noreturn]] void ThrowNotNumbers(std::string_view name, std::string_view expected,
                                  const py::handle& found);
[[noreturn]] void ThrowShape(std::string_view name, std::string_view expected,
                             const py::array& found);
// Returns what numpy takes: the object itself, or what it gives by __dlpack__ where it knows no
// other way. Throws InputError for a masked array, whose mask would be dropped.
py::object ForNumpy(const ArrayLike& argument, std::string_view name);
// Throws InputError where a number of the argument is none of the integers lowest ... highest:
// numpy would cut it to one of these.
void RequireIntegers(const py::object& numbers, std::string_view name, int64_t lowest,
                     int64_t highest);
// Returns the argument as an array of T in C order; copies it only where it is none.
template <typename T>
py::array_t<T> ArrayOf(const ArrayLike& argument, std::string_view name,
                       std::string_view expected) {
  constexpr int kFlags =
      py::array::c_style | py::array::forcecast | py::detail::npy_api::NPY_ARRAY_ALIGNED_;
  const py::object numbers = ForNumpy(argument, name);
  if constexpr (std::is_integral_v<T>) {
    using Limits = std::numeric_limits<T>;
    if (!py::isinstance<py::array_t<T>>(numbers)) {
      RequireIntegers(numbers, name, Limits::min(), Limits::max());
    }
  }
  auto array = py::array_t<T, kFlags>::ensure(numbers);
  if (!array) ThrowNotNumbers(name, expected, argument);
  return array;
}
}  // namespace internal

// Holds the rows of an array of the shape (N, kColumns), and keeps it alive. Throws InputError
// naming the argument where it has another shape. An empty list is an array without rows.
template <int kColumns, typename T = double>
class Rows {
 public:
  using Row = Eigen::Matrix<T, kColumns, 1>;

  Rows(const ArrayLike& argument, std::string_view name)
      : array_(internal::ArrayOf<T>(argument, name, Expected())) {
    if (array_.size() == 0) return;
    if (array_.ndim() != 2 || array_.shape(1) != kColumns) {
      internal::ThrowShape(name, Expected(), array_);
    }
    size_ = static_cast<size_t>(array_.shape(0));
  }
  Rows(const std::optional<ArrayLike>& argument, std::string_view name)
      : Rows(argument ? Rows(*argument, name) : Rows()) {}
  Rows() = default;

  size_t size() const { return size_; }
  Row operator[](size_t i) const {
    return Eigen::Map<const Row>(array_.data() + i * size_t{kColumns});
  }
  std::vector<Row> ToVector() const {
    std::vector<Row> rows(size_);
    for (size_t i = 0; i < size_; ++i) rows[i] = (*this)[i];
    return rows;
  }

 private:
  static std::string Expected() { return fmt::format("an array of shape (N, {})", kColumns); }

  py::array_t<T> array_;
  size_t size_ = 0;
};

// Returns whether so many pixels lie outside of their images that these seem to have been resized:
// a few near the border may lie outside, too, and few pixels tell nothing.
inline bool LookResized(size_t outside, size_t count) {
  constexpr size_t kFewest = 10;
  return count >= kFewest && 2 * outside > count;
}

// Throws InputError where most pixels lie outside of their image, as those of a resized one do, or
// are not finite. `size_at` returns the size of a row's image.
template <typename Pixels, typename SizeAt>
void RequireMostInside(const Pixels& pixels, std::string_view name, const SizeAt& size_at) {
  size_t outside = 0, not_finite = 0;
  PlaneSize size;  // of an image that its pixel lies outside of
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (Shows(size_at(i), pixels[i])) continue;
    size = size_at(i);
    ++outside;
    if (!pixels[i].allFinite()) ++not_finite;
  }
  if (!LookResized(outside, pixels.size()) && 2 * not_finite <= pixels.size()) return;
  throw InputError(fmt::format(
      "{}: {} of {} lie outside of the image ({} x {}): are they those of a resized one?", name,
      outside, pixels.size(), size.width_px, size.height_px));
}

// Converts colors (N, 3), each from 0 to 255. Throws InputError also for floats from 0 to 1, as
// other libraries have them: their integers would be black.
std::vector<std::array<uint8_t, 3>> ToColors(const std::optional<ArrayLike>& argument,
                                             std::string_view name);

// Converts one number per match; nullopt where none are given. Throws InputError where their count
// differs.
template <typename T>
std::optional<py::array_t<T>> PerMatch(const std::optional<ArrayLike>& argument,
                                       std::string_view name, size_t count) {
  if (!argument) return std::nullopt;
  const std::string expected = fmt::format("an array of shape ({},)", count);
  auto array = internal::ArrayOf<T>(*argument, name, expected);
  const bool fits = array.ndim() == 1 && static_cast<size_t>(array.size()) == count;
  if (!fits) internal::ThrowShape(name, expected, array);
  return array;
}

// Returns an array of `rows` x `columns` whose rows `at` gives.
template <typename At>
py::array_t<double> MakeRows(size_t rows, size_t columns, const At& at) {
  py::array_t<double> array(std::vector<size_t>{rows, columns});
  double* number = array.mutable_data();
  for (size_t i = 0; i < rows; ++i) {
    const auto row = at(i);
    for (size_t j = 0; j < columns; ++j) *number++ = row[static_cast<Eigen::Index>(j)];
  }
  return array;
}

// Returns the numbers of a table by their names.
template <typename Number>
py::dict NumbersOf(std::span<const Field> fields) {
  py::dict dict;
  ForEachNumber<Number>(
      fields, [&](const std::string& name, Number number) { dict[py::str(name)] = number; });
  return dict;
}

template <typename Derived>
py::array_t<double> ToArray(const Eigen::MatrixBase<Derived>& matrix) {
  const auto rows = matrix.rows(), columns = matrix.cols();
  py::array_t<double> array(columns == 1 ? std::vector<Eigen::Index>{rows}
                                         : std::vector<Eigen::Index>{rows, columns});
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      array.mutable_data(), rows, columns) = matrix;
  return array;
}
inline py::array_t<bool> ToArray(const std::vector<bool>& flags) {
  py::array_t<bool> array(static_cast<py::ssize_t>(flags.size()));
  std::copy(flags.begin(), flags.end(), array.mutable_data());
  return array;
}

// Converts the numbers of a list to bytes as they lie in memory, and back. Throws InputError where
// bytes are left over.
template <typename T>
py::bytes ToBytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}
template <typename T>
void FromBytes(const py::handle& state, std::vector<T>& values) {
  const auto bytes = state.cast<std::string_view>();
  if (bytes.size() % sizeof(T) != 0) {
    throw InputError(fmt::format("state: expected numbers of {} bytes each, found {} bytes",
                                 sizeof(T), bytes.size()));
  }
  values.resize(bytes.size() / sizeof(T));
  if (values.empty()) return;  // null is no memory to copy to
  std::memcpy(static_cast<void*>(values.data()), bytes.data(), values.size() * sizeof(T));
}

// Makes objects pickle, copy and compare by a state, from which `make` makes them anew. Those
// without one (InputError says why) equal themselves alone.
template <typename T, typename... Bound, typename StateOf, typename Make>
void BindState(py::class_<T, Bound...>& bound, const StateOf& state_of, const Make& make) {
  const auto equals = [state_of](const T& one, const py::object& other) {
    if (!py::isinstance<T>(other)) return false;
    const T& another = other.cast<const T&>();
    if (&one == &another) return true;
    try {
      return py::make_tuple(state_of(one)).equal(py::make_tuple(state_of(another)));
    } catch (const InputError&) {
      return false;
    }
  };
  bound.def("__eq__", equals, py::arg("other"), "Equal in all that is kept when pickled.")
      .def(py::pickle(state_of, make));
}

// Makes objects hash by their repr, as nothing in Python can change them and equal ones look alike.
template <typename T, typename... Bound>
void BindHash(py::class_<T, Bound...>& bound) {
  bound.def("__hash__", [](const T& one) { return py::hash(py::repr(py::cast(&one))); });
}
// Makes objects hash and copy; copies share what they hold.
template <typename T, typename... Bound>
void BindCopies(py::class_<T, Bound...>& bound) {
  BindHash(bound);
  bound.def("__copy__", [](const T& one) { return std::make_shared<T>(one); })
      .def(
          "__deepcopy__", [](const T& one, const py::object&) { return std::make_shared<T>(one); },
          py::arg("memo"));
}

// Returns a small table of two columns, for notebooks.
std::string HtmlTable(const std::string& title,
                      const std::vector<std::pair<std::string, std::string>>& rows);

// Returns an array that takes over the vector's memory.
template <typename T>
py::array_t<T> HandOver(std::vector<T>&& values, const std::vector<py::ssize_t>& shape) {
  auto* owned = new std::vector<T>(std::move(values));
  const py::capsule owner(owned, [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return py::array_t<T>(shape, owned->data(), owner);
}

// These bind the parts of the module raylift._core; each adds its classes and functions.
void BindGeometry(py::module_& module);
void BindEstimation(py::module_& module);
void BindMesh(py::module_& module);
void BindRendering(py::module_& module);
void BindLifting(py::module_& module);
void BindScene(py::module_& module);
void BindLocalization(py::module_& module);
void BindFeatures(py::module_& module);
void BindIo(py::module_& module);
void BindTracking(py::module_& module);

// Returns the value of an enum by its name on the command line. Throws OptionError for other names.
template <NamedEnum Enum>
Enum ToEnum(std::string_view name, const std::string& value) {
  if (const auto known = FromName<Enum>(value)) return *known;
  throw OptionError(name, value, "expected " + NameList<Enum>());
}

// Keyword arguments, each of which is taken once.
class Keywords {
 public:
  explicit Keywords(const py::kwargs& given) : given_(given), left_(given.size()) {}

  // Takes a keyword; leaves the value as it is where it is not given. Throws OptionError for a
  // value of another kind.
  template <typename T>
  void Take(const char* name, T& value) {
    names_.push_back(name);
    if (left_ == 0) return;
    PyObject* const found = PyDict_GetItemString(given_.ptr(), name);
    if (found == nullptr) return;
    --left_;
    const py::handle handle(found);
    try {
      if constexpr (NamedEnum<T>) {
        value = ToEnum<T>(name, handle.cast<std::string>());
      } else if constexpr (std::is_same_v<T, std::filesystem::path>) {
        value = ToPath(py::reinterpret_borrow<PathLike>(handle), name);
      } else {
        value = handle.cast<T>();
      }
    } catch (const py::cast_error&) {
      ThrowKind(name, handle, KindOf<T>());
    }
  }

  // Takes the fields of a table under their names.
  void Take(std::span<const Field> fields);

  // Throws OptionError naming a keyword that was not taken.
  void RequireAllTaken() const;

 private:
  template <typename T>
  static constexpr const char* KindOf() {
    if constexpr (std::is_same_v<T, bool>) return "True or False";
    if constexpr (std::is_integral_v<T>) return "an integer";
    if constexpr (std::is_floating_point_v<T>) return "a number";
    if constexpr (std::is_same_v<T, std::optional<double>>) return "a number or None";
    if constexpr (std::is_same_v<T, std::optional<std::pair<double, double>>>) return "(near, far)";
    if constexpr (std::is_same_v<T, std::array<uint8_t, 3>>) return "3 integers from 0 to 255";
    if constexpr (std::is_same_v<T, std::string> || NamedEnum<T>) return "a str";
    return "another value";
  }
  [[noreturn]] static void ThrowKind(const char* name, const py::handle& found, const char* kind);

  py::kwargs given_;
  size_t left_;
  std::vector<std::string_view> names_;
};

// Does work without the interpreter's lock. Calls `progress` where it is given; Ctrl-C, or an
// exception of `progress`, ends the work.
void WatchedWithoutLock(const std::optional<ProgressCall>& progress,
                        const std::function<void()>& work);
template <typename Work>
auto WithoutLock(const std::optional<ProgressCall>& progress, const Work& work) {
  if constexpr (std::is_void_v<decltype(work())>) {
    WatchedWithoutLock(progress, work);
  } else {
    std::optional<decltype(work())> result;
    WatchedWithoutLock(progress, [&] { result.emplace(work()); });
    return *std::move(result);
  }
}
template <typename Work>
auto WithoutLock(const Work& work) {
  return WithoutLock(std::nullopt, work);
}

}  // namespace raylift::python
