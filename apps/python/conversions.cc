#include "apps/python/conversions.h"

#include <cmath>
#include <mutex>

#include "io/text/line_tokens.h"

#include "raylift/base/parallel.h"
#include "raylift/io/query_list.h"

namespace raylift::python {
namespace {

std::string TypeName(const py::handle& object) {
  return py::cast<std::string>(py::type::handle_of(object).attr("__name__"));
}

// Returns an attribute of an object or an item of a mapping.
py::object Member(const py::handle& object, const char* name) {
  if (py::isinstance<py::dict>(object)) {
    return py::reinterpret_borrow<py::dict>(object).attr("get")(name);
  }
  return py::getattr(object, name, py::none());
}

// Calls the member if it is a method: pycolmap has had some of them as methods, and has others as
// properties.
py::object Called(py::object member) {
  return PyCallable_Check(member.ptr()) != 0 ? member() : member;
}

CameraModel ToCameraModel(const py::handle& model) {
  std::optional<CameraModel> known;
  std::string text;
  if (py::isinstance<py::int_>(model) && !py::hasattr(model, "name")) {
    known = CameraModelFromId(model.cast<int>());
    text = py::str(model);
  } else {
    const py::object name = py::getattr(model, "name", py::reinterpret_borrow<py::object>(model));
    text = py::str(name);
    known = CameraModelFromName(text);
  }
  if (!known) throw InputError(fmt::format("camera, model: {} is none of COLMAP's", text));
  return *known;
}

std::vector<double> Numbers(const py::object& values, std::string_view name) {
  const auto array =
      internal::ArrayOf<double>(py::reinterpret_borrow<ArrayLike>(values), name, "numbers");
  return {array.data(), array.data() + array.size()};
}

int SizePx(const py::object& value, std::string_view name) {
  const std::vector<double> size = value.is_none() ? std::vector<double>() : Numbers(value, name);
  const bool is_size = size.size() == 1 && size[0] >= 1 && size[0] == std::floor(size[0]) &&
                       size[0] <= std::numeric_limits<int>::max();
  if (is_size) return static_cast<int>(size[0]);
  throw InputError(
      fmt::format("{}: expected a number of pixels, found {}", name, std::string(py::repr(value))));
}

Eigen::Vector3d Finite(const Eigen::Vector3d& translation) {
  if (translation.allFinite()) return translation;
  throw InputError(fmt::format("pose, translation: expected finite numbers, found ({}, {}, {})",
                               translation.x(), translation.y(), translation.z()));
}

Eigen::Vector3d Translation(const py::object& values) {
  const std::vector<double> t = Numbers(values, "pose, translation");
  if (t.size() != 3) {
    throw InputError(fmt::format("pose, translation: expected 3 numbers, found {}", t.size()));
  }
  return Finite({t[0], t[1], t[2]});
}

// Returns the quaternion at unit length; `what` names its owner in messages.
Eigen::Quaterniond Unit(double w, double x, double y, double z, std::string_view what) {
  const Eigen::Quaterniond q(w, x, y, z);
  if (!(q.norm() > 0) || !q.coeffs().allFinite()) {
    throw InputError(fmt::format("{}, rotation: the quaternion has no direction", what));
  }
  // One that is of unit length up to rounding keeps its digits.
  return std::abs(q.squaredNorm() - 1) < 1e-12 ? q : q.normalized();
}

Eigen::Quaterniond FromMatrix(const Eigen::Matrix3d& matrix, std::string_view what) {
  constexpr double kRounding = 1e-3;
  const bool is_rotation = matrix.allFinite() && matrix.determinant() > 0 &&
                           (matrix * matrix.transpose()).isIdentity(kRounding);
  if (!is_rotation) throw InputError(fmt::format("{}: its 3 x 3 part is no rotation", what));
  return Eigen::Quaterniond(matrix).normalized();
}

// Converts (w, x, y, z), or a 3 x 3 matrix.
Eigen::Quaterniond Rotation(const py::object& values, std::string_view what = "pose") {
  const std::vector<double> r = Numbers(values, fmt::format("{}, rotation", what));
  if (r.size() == 4) return Unit(r[0], r[1], r[2], r[3], what);
  if (r.size() == 9) {
    return FromMatrix(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data()),
                      what);
  }
  throw InputError(fmt::format(
      "{}, rotation: expected (w, x, y, z) or a 3 x 3 matrix, found {} numbers", what, r.size()));
}

Rigid3 FromMatrixRows(const py::object& values) {
  const std::vector<double> m = Numbers(values, "pose");
  if (m.size() != 12 && m.size() != 16) {
    throw InputError(
        fmt::format("pose: expected a 4 x 4 or 3 x 4 matrix, found {} numbers", m.size()));
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> upper(m.data());
  // A matrix in column order, as OpenGL's are, has its translation here.
  if (m.size() == 16 &&
      Eigen::Map<const Eigen::RowVector4d>(m.data() + 12) != Eigen::RowVector4d(0, 0, 0, 1)) {
    throw InputError(fmt::format(
        "pose: expected (0, 0, 0, 1) as the last row of a 4 x 4 matrix, found ({}, {}, {}, {}); "
        "is it transposed?",
        m[12], m[13], m[14], m[15]));
  }
  return {FromMatrix(upper.leftCols<3>(), "pose"), Finite(upper.col(3))};
}

}  // namespace

namespace internal {

void RequireIntegers(const py::object& numbers, std::string_view name, int64_t lowest,
                     int64_t highest) {
  const auto array = py::array::ensure(numbers);
  if (!array || array.size() == 0) return;
  const auto values = py::array_t<double, py::array::forcecast | py::array::c_style>::ensure(array);
  if (!values) return;
  for (py::ssize_t i = 0; i < values.size(); ++i) {
    const double value = values.data()[i];
    // 2^63 - 1 is no double; one more is.
    const bool fits = value == std::floor(value) && value >= static_cast<double>(lowest) &&
                      value < static_cast<double>(highest) + 1;
    if (!fits) {
      const bool is_whole = value == std::floor(value);
      throw InputError(fmt::format("{}: expected integers{}, found {}", name,
                                   is_whole ? fmt::format(" from {} to {}", lowest, highest) : "",
                                   value));
    }
  }
}

py::object ForNumpy(const ArrayLike& argument, std::string_view name) {
  if (py::hasattr(argument, "mask") && py::hasattr(argument, "filled")) {
    throw InputError(fmt::format(
        "{}: a masked array was given, whose mask would be lost; leave masked values out", name));
  }
  if (!py::isinstance<py::array>(argument) && py::hasattr(argument, "__dlpack__") &&
      !py::hasattr(argument, "__array__")) {
    return py::module_::import("numpy").attr("from_dlpack")(argument);
  }
  return argument;
}

void ThrowNotNumbers(std::string_view name, std::string_view expected, const py::handle& found) {
  PyErr_Clear();
  throw WrongType(fmt::format("{}: expected {}, found {}", name, expected, TypeName(found)));
}

void ThrowShape(std::string_view name, std::string_view expected, const py::array& found) {
  const py::str shape(found.attr("shape"));
  throw InputError(fmt::format("{}: expected {}, found {}", name, expected, std::string(shape)));
}

}  // namespace internal

Camera ToCamera(const CameraLike& camera) {
  if (py::isinstance<Camera>(camera)) return camera.cast<Camera>();
  if (py::isinstance<py::str>(camera)) return ParseCamera("camera", camera.cast<std::string>());
  py::object model = Member(camera, "model");
  if (model.is_none()) model = Called(Member(camera, "model_name"));  // PoseLib's
  const py::object params = Member(camera, "params");
  if (model.is_none() || params.is_none()) {
    throw WrongType(
        fmt::format("camera: expected a raylift.Camera, \"MODEL width height params...\", or "
                    "something with model, width, height and params, found {}",
                    TypeName(camera)));
  }
  return {ToCameraModel(model), SizePx(Member(camera, "width"), "camera, width"),
          SizePx(Member(camera, "height"), "camera, height"), Numbers(params, "camera, params")};
}

Rigid3 ToPose(const PoseLike& pose) {
  if (py::isinstance<Rigid3>(pose)) return pose.cast<Rigid3>();
  if (py::isinstance<py::dict>(pose)) {
    return {Rotation(Member(pose, "qvec")), Translation(Member(pose, "tvec"))};
  }
  if (py::hasattr(pose, "rotation") && py::hasattr(pose, "translation")) {
    const py::object rotation = pose.attr("rotation");
    // pycolmap's quaternions have w last.
    if (py::hasattr(rotation, "matrix")) {
      return {Rotation(rotation.attr("matrix")()), Translation(pose.attr("translation"))};
    }
    return {Rotation(rotation), Translation(pose.attr("translation"))};
  }
  if (py::hasattr(pose, "q") && py::hasattr(pose, "t")) {
    return {Rotation(pose.attr("q")), Translation(pose.attr("t"))};
  }
  const bool is_pair =
      (py::isinstance<py::tuple>(pose) || py::isinstance<py::list>(pose)) && py::len(pose) == 2;
  if (is_pair) {
    return {Rotation(pose[py::int_(0)]), Translation(pose[py::int_(1)])};
  }
  return FromMatrixRows(pose);
}

PosedImage ToPosedImage(const PosedImageLike& image) {
  if (py::isinstance<PosedImage>(image)) return image.cast<PosedImage>();
  const auto camera_of = [](const py::object& o) {
    return ToCamera(py::reinterpret_borrow<CameraLike>(o));
  };
  const auto pose_of = [](const py::object& o) {
    return ToPose(py::reinterpret_borrow<PoseLike>(o));
  };
  if (py::isinstance<py::tuple>(image) && py::len(image) == 2) {
    return {"", camera_of(image[py::int_(0)]), pose_of(image[py::int_(1)])};
  }
  const py::object camera = Member(image, "camera");
  py::object pose = Member(image, "cam_from_world");
  if (pose.is_none()) pose = Member(image, "pose");  // PoseLib's
  if (camera.is_none() || pose.is_none()) {
    throw WrongType(
        fmt::format("reference: expected a raylift.PosedImage, (camera, pose), or something with "
                    "camera and cam_from_world, found {}",
                    TypeName(image)));
  }
  const py::object name = Member(image, "name");
  return {name.is_none() ? "" : py::cast<std::string>(py::str(name)), camera_of(camera),
          pose_of(Called(pose))};
}

std::vector<PosedImage> ToPosedImages(const std::vector<PosedImageLike>& images) {
  std::vector<PosedImage> posed;
  posed.reserve(images.size());
  for (const PosedImageLike& image : images) posed.push_back(ToPosedImage(image));
  return posed;
}

std::string ToText(const py::handle& text, std::string_view name) {
  if (py::isinstance<py::str>(text)) return text.cast<std::string>();
  throw WrongType(fmt::format("{}: expected a str, found {}", name, TypeName(text)));
}

std::map<std::string, Rigid3> ToNamedPoses(const py::object& mapping, std::string_view name) {
  std::map<std::string, Rigid3> poses;
  for (const py::handle& key : mapping.attr("keys")()) {
    poses[ToText(key, fmt::format("{}, name", name))] = ToPose(mapping[key].cast<PoseLike>());
  }
  return poses;
}

std::filesystem::path ToPath(const PathLike& path, std::string_view name) {
  const auto text = py::reinterpret_steal<py::object>(PyOS_FSPath(path.ptr()));
  if (text) return text.cast<std::string>();
  PyErr_Clear();
  throw WrongType(
      fmt::format("{}: expected a path (str or os.PathLike), found {}", name, TypeName(path)));
}

Image ToImage(const ArrayLike& argument) {
  constexpr std::string_view kExpected =
      "a uint8 array of shape (height, width) or (height, width, 3)";
  const auto array = py::array::ensure(internal::ForNumpy(argument, "image"), py::array::c_style);
  if (!array) internal::ThrowNotNumbers("image", kExpected, argument);
  if (!py::isinstance<py::array_t<uint8_t>>(array)) {
    throw WrongType(fmt::format("image: expected {}, found {}", kExpected,
                                std::string(py::str(array.dtype()))));
  }
  const bool gray = array.ndim() == 2;
  if (!gray && !(array.ndim() == 3 && array.shape(2) == 3)) {
    internal::ThrowShape("image", kExpected, array);
  }
  const auto* data = static_cast<const uint8_t*>(array.data());
  return {.width_px = static_cast<int>(array.shape(1)),
          .height_px = static_cast<int>(array.shape(0)),
          .channels = gray ? 1 : 3,
          .data = {data, data + array.size()}};
}

std::vector<std::array<uint8_t, 3>> ToColors(const std::optional<ArrayLike>& argument,
                                             std::string_view name) {
  if (!argument) return {};
  const auto given = py::array::ensure(internal::ForNumpy(*argument, name));
  if (given && given.dtype().kind() == 'f' && given.size() > 0) {
    const auto most = given.attr("max")().cast<double>();
    if (most > 0 && most <= 1) {
      throw InputError(
          fmt::format("{}: expected integers from 0 to 255, found floats up to {}; colors from 0 "
                      "to 1 are to be multiplied by 255",
                      name, most));
    }
  }
  const Rows<3, uint8_t> rows(*argument, name);
  std::vector<std::array<uint8_t, 3>> colors(rows.size());
  for (size_t i = 0; i < rows.size(); ++i) colors[i] = {rows[i][0], rows[i][1], rows[i][2]};
  return colors;
}

Eigen::Vector3d ToVector3(const ArrayLike& argument, std::string_view name) {
  constexpr std::string_view kExpected = "an array of shape (3,)";
  const auto array = internal::ArrayOf<double>(argument, name, kExpected);
  if (array.ndim() != 1 || array.shape(0) != 3) internal::ThrowShape(name, kExpected, array);
  return Eigen::Map<const Eigen::Vector3d>(array.data());
}

namespace {

void RequirePrior(bool is_right, std::string_view name, std::string_view expected) {
  if (!is_right) throw InputError(fmt::format("{}: expected {}", name, expected));
}

Eigen::Vector3d ToDirection(const ArrayLike& argument, std::string_view name) {
  const Eigen::Vector3d direction = ToVector3(argument, name);
  RequirePrior(HasDirection(direction), name, "a direction");
  return direction;
}

double ToSigma(double sigma, std::string_view name) {
  RequirePrior(sigma >= 0, name, "at least 0");
  return sigma;
}

PositionPrior ToPosition(const ArrayLike& position, const ArrayLike& sigma) {
  constexpr std::string_view kSigma = "position_prior, sigma";
  const auto numbers =
      internal::ArrayOf<double>(sigma, kSigma, "a number or an array of shape (3,)");
  PositionPrior prior{.position = ToVector3(position, "position_prior"),
                      .sigma = numbers.size() == 1
                                   ? Eigen::Vector3d(Eigen::Vector3d::Constant(*numbers.data()))
                                   : ToVector3(sigma, kSigma)};
  RequirePrior(prior.position.allFinite(), "position_prior", "finite numbers");
  RequirePrior((prior.sigma.array() >= 0).all(), kSigma, "at least 0");
  return prior;
}

HeadingPrior ToHeading(const ArrayLike& right_in_cam, const ArrayLike& right_in_world,
                       const ArrayLike& down_in_world, double sigma_deg) {
  HeadingPrior prior{.right_in_cam = ToDirection(right_in_cam, "heading_prior, right_in_cam"),
                     .right_in_world = ToDirection(right_in_world, "heading_prior, right_in_world"),
                     .down_in_world = ToDirection(down_in_world, "heading_prior, down_in_world"),
                     .sigma_deg = ToSigma(sigma_deg, "heading_prior, sigma_deg")};
  RequirePrior(HasDirection(prior.down_in_world.cross(prior.right_in_world)),
               "heading_prior, down_in_world", "another direction than right_in_world");
  return prior;
}

RangePrior ToRange(double range, double sigma) {
  RequirePrior(range > 0 && std::isfinite(range), "range_prior", "a positive range");
  return {.range = range, .sigma = ToSigma(sigma, "range_prior, sigma")};
}

}  // namespace

PosePriors ToPriors(const PriorArguments& given) {
  PosePriors priors{.focal_range = given.focal_range, .focal_sigma = given.focal_sigma};
  if (given.position) priors.position = ToPosition(given.position->first, given.position->second);
  if (given.gravity) {
    const auto& [in_cam, in_world, sigma_deg] = *given.gravity;
    priors.gravity = {.down_in_cam = ToDirection(in_cam, "gravity_prior, down_in_cam"),
                      .down_in_world = ToDirection(in_world, "gravity_prior, down_in_world"),
                      .sigma_deg = ToSigma(sigma_deg, "gravity_prior, sigma_deg")};
  }
  if (given.heading) priors.heading = std::apply(&ToHeading, *given.heading);
  if (given.orientation) {
    const auto& [rotation, sigma_deg] = *given.orientation;
    priors.orientation = {.cam_from_world = Rotation(rotation, "orientation_prior"),
                          .sigma_deg = ToSigma(sigma_deg, "orientation_prior, sigma_deg")};
  }
  if (given.range) priors.range = ToRange(given.range->first, given.range->second);
  RequirePrior(
      !given.focal_sigma || (*given.focal_sigma >= 0 && *given.focal_sigma <= kMaxFocalSigma),
      "focal_sigma", fmt::format("a share of the focal length from 0 to {}", kMaxFocalSigma));
  RequirePrior(given.focal_range >= 1 && given.focal_range <= kMaxFocalRange, "focal_range",
               fmt::format("a factor from 1 to {}", kMaxFocalRange));
  return priors;
}

Query WithPriors(Query query, PosePriors priors) {
  if (priors.focal_range == 1) priors.focal_range = query.priors.focal_range;
  if (!priors.focal_sigma) priors.focal_sigma = query.priors.focal_sigma;
  query.priors = std::move(priors);
  return query;
}

Query ToQuery(const QueryLike& query) {
  if (py::isinstance<Query>(query)) return query.cast<Query>();
  if (!py::isinstance<py::sequence>(query) || py::isinstance<py::str>(query) ||
      py::len(query) != 2) {
    throw WrongType("query: expected a raylift.Query or a pair (name, camera), found a " +
                    TypeName(query));
  }
  const py::object name = query[py::int_(0)], camera = query[py::int_(1)];
  if (camera.is_none()) throw WrongType("query, camera: expected a camera, found None");
  return {ToText(name, "query, name"), ToCamera(py::reinterpret_borrow<CameraLike>(camera))};
}

std::string HtmlTable(const std::string& title,
                      const std::vector<std::pair<std::string, std::string>>& rows) {
  const py::object escape = py::module_::import("html").attr("escape");
  const auto escaped = [&](const std::string& text) { return escape(text).cast<std::string>(); };
  std::string html = "<table><caption>" + escaped(title) + "</caption>";
  for (const auto& [name, value] : rows) {
    html += "<tr><th>" + escaped(name) + "</th><td>" + escaped(value) + "</td></tr>";
  }
  return html + "</table>";
}

py::array_t<uint8_t> ToArray(Image image) {
  std::vector<py::ssize_t> shape{image.height_px, image.width_px};
  if (image.channels > 1) shape.push_back(image.channels);
  return HandOver(std::move(image.data), shape);
}

void Keywords::Take(std::span<const Field> fields) {
  for (const Field& field : fields) {
    const char* name = field.name.data();  // of a literal: it ends in a zero
    std::visit(
        [&]<typename Value>(const Value& value) {
          if constexpr (std::is_same_v<Value, NamedValue>) {
            std::string text = value.name();
            Take(name, text);
            const auto known = std::find(value.names().begin(), value.names().end(), text);
            if (known == value.names().end()) {
              throw OptionError(name, text,
                                fmt::format("expected {}", fmt::join(value.names(), "|")));
            }
            value.Set(static_cast<size_t>(known - value.names().begin()));
          } else {
            Take(name, *value);
          }
        },
        field.value);
  }
}

void Keywords::RequireAllTaken() const {
  if (left_ == 0) return;
  for (const auto& [key, value] : given_) {
    const auto name = key.cast<std::string>();
    if (std::find(names_.begin(), names_.end(), name) == names_.end()) {
      throw OptionError(
          fmt::format("{}: there is no such option; there are {}", name, fmt::join(names_, ", ")));
    }
  }
}

void Keywords::ThrowKind(const char* name, const py::handle& found, const char* kind) {
  throw OptionError(name, py::cast<std::string>(py::repr(found)), fmt::format("expected {}", kind));
}

void WatchedWithoutLock(const std::optional<ProgressCall>& progress,
                        const std::function<void()>& work) {
  // The exception that Python has raised meanwhile; only touched with the interpreter's lock.
  std::optional<py::error_already_set> raised;
  CallWatch::Hooks hooks;
  hooks.stop_wanted = [&raised] {
    const py::gil_scoped_acquire lock;
    if (!raised && PyErr_CheckSignals() != 0) raised.emplace();
    return raised.has_value();
  };
  if (progress) {
    hooks.on_progress = [&](const std::string& what, size_t done, size_t total) {
      const py::gil_scoped_acquire lock;
      if (raised) return;
      try {
        (*progress)(done, total, what);
      } catch (py::error_already_set& error) {
        raised.emplace(std::move(error));
      }
    };
  }
  try {
    const py::gil_scoped_release release;
    const CallWatch watch(std::move(hooks));
    work();
  } catch (const Cancelled&) {
    if (!raised) throw;
  }
  if (raised) throw std::move(*raised);
}

}  // namespace raylift::python
