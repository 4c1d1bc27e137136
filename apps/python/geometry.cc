// Camera, Rigid3, Query and PosedImage.

#include "apps/python/conversions.h"

#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift::python {
namespace {

// These stand for no pixel and no ray: all of their numbers are NaN.
const Eigen::Vector2d kNoPixel = Eigen::Vector2d::Constant(std::nan(""));
const Eigen::Vector3d kNoRay = Eigen::Vector3d::Constant(std::nan(""));

py::tuple CameraState(const Camera& camera) {
  return py::make_tuple(
      std::string(GetCameraModelInfo(camera.model()).name), camera.width_px(), camera.height_px(),
      ToArray(Eigen::VectorXd::Map(camera.params().data(), std::ssize(camera.params()))));
}

Camera MakeCamera(const std::string& model, int width, int height, const ArrayLike& params) {
  const auto known = CameraModelFromName(model);
  if (!known) throw InputError(fmt::format("camera, model: {} is none of COLMAP's", model));
  const auto numbers = internal::ArrayOf<double>(params, "camera, params", "numbers");
  return {*known, width, height, std::span(numbers.data(), static_cast<size_t>(numbers.size()))};
}

Camera PinholeOf(const ArrayLike& matrix, int width, int height) {
  const Rows<3> rows(matrix, "matrix");
  const bool is_pinhole = rows.size() == 3 && rows[0].y() == 0 && rows[1].x() == 0 &&
                          rows[2] == Eigen::Vector3d::UnitZ();
  if (!is_pinhole) {
    throw InputError("matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
  }
  return {CameraModel::kPinhole, width, height,
          std::array{rows[0].x(), rows[1].y(), rows[0].z(), rows[1].z()}};
}

void BindCamera(py::module_& module) {
  py::class_<Camera>(
      module, "Camera",
      "A camera's intrinsics, of any of COLMAP's models.\n\n"
      "The frame is COLMAP's: x right, y down, z forward. So are pixels: the center of the first\n"
      "one is (0.5, 0.5). Wherever a camera is an argument, the text \"MODEL width height\n"
      "params...\", a dict with model, width, height and params, and pycolmap's cameras serve, "
      "too.")
      .def(py::init(&MakeCamera), py::arg("model"), py::arg("width"), py::arg("height"),
           py::arg("params"),
           "From COLMAP's name of the model (\"SIMPLE_RADIAL\"), the image's size in pixels and "
           "the\n"
           "model's parameters in COLMAP's order.\n\n"
           "Raises InputError for a wrong count of parameters, or one out of its range.")
      .def_static(
          "of", [](const CameraLike& camera) { return ToCamera(camera); }, py::arg("camera"),
          "From anything that an argument `camera` may be.")
      .def_static(
          "from_matrix", &PinholeOf, py::arg("matrix"), py::arg("width"), py::arg("height"),
          R"(A PINHOLE from the 3 x 3 matrix of its focal lengths and principal point, that of
Camera.matrix. Where the center of the first pixel is (0, 0), as OpenCV's, 0.5 is to be added to
the principal point.)")
      .def_property_readonly(
          "model",
          [](const Camera& camera) { return std::string(GetCameraModelInfo(camera.model()).name); },
          "COLMAP's name of the model.")
      .def_property_readonly(
          "width", [](const Camera& camera) { return camera.width_px(); }, "Pixels.")
      .def_property_readonly(
          "height", [](const Camera& camera) { return camera.height_px(); }, "Pixels.")
      .def_property_readonly(
          "params",
          [](const Camera& camera) {
            return ToArray(
                Eigen::VectorXd::Map(camera.params().data(), std::ssize(camera.params())));
          },
          "The model's parameters in COLMAP's order.")
      .def_property_readonly(
          "matrix",
          [](const Camera& camera) {
            Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
            matrix(0, 0) = camera.focal_x_px();
            matrix(1, 1) = camera.focal_y_px();
            matrix.topRightCorner<2, 1>() = camera.principal_point_px();
            return ToArray(matrix);
          },
          "3 x 3: focal lengths and principal point in pixels, without the distortion.")
      .def(
          "project",
          [](const Camera& camera, const ArrayLike& points) {
            const Rows<3> rows(points, "points");
            return MakeRows(rows.size(), 2, [&](size_t i) {
              return camera.ImgFromCam(rows[i]).value_or(kNoPixel);
            });
          },
          py::arg("points"),
          "The pixels (N, 2) of points (N, 3) in the camera's frame; NaN where a point is behind "
          "the\n"
          "camera or outside the lens model's domain.")
      .def(
          "rays",
          [](const Camera& camera, const ArrayLike& pixels) {
            const Rows<2> rows(pixels, "pixels");
            return MakeRows(rows.size(), 3,
                            [&](size_t i) { return camera.RayInCam(rows[i]).value_or(kNoRay); });
          },
          py::arg("pixels"),
          "The unit rays (N, 3) in the camera's frame through pixels (N, 2); NaN where there is "
          "none.")
      .def("scaled", &Camera::Scaled, py::arg("width"), py::arg("height"),
           "The same lens on an image of another size.")
      .def(
          "__eq__",
          [](const Camera& a, const py::object& b) {
            return py::isinstance<Camera>(b) && a == b.cast<Camera>();
          },
          py::arg("other"))
      .def("__hash__",
           [](const Camera& camera) { return std::hash<std::string>()(camera.ToString()); })
      .def(
          "__str__", [](const Camera& camera) { return camera.ToString(); },
          "\"MODEL width height params...\"")
      .def("__repr__",
           [](const Camera& camera) {
             return fmt::format("<raylift.Camera {}>", camera.ToString());
           })
      .def(py::pickle(&CameraState, [](const py::tuple& state) {
        return MakeCamera(state[0].cast<std::string>(), state[1].cast<int>(), state[2].cast<int>(),
                          py::reinterpret_borrow<ArrayLike>(state[3]));
      }));
}

Eigen::Vector4d QvecWxyz(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  return {q.w(), q.x(), q.y(), q.z()};
}

std::string PoseText(const Rigid3& pose) {
  const Eigen::Vector4d q = QvecWxyz(pose);
  const Eigen::Vector3d& t = pose.translation;
  return fmt::format("<raylift.Rigid3 qvec=[{} {} {} {}] tvec=[{} {} {}]>", FormatDouble(q[0]),
                     FormatDouble(q[1]), FormatDouble(q[2]), FormatDouble(q[3]), FormatDouble(t[0]),
                     FormatDouble(t[1]), FormatDouble(t[2]));
}

Eigen::Matrix<double, 7, 1> Numbers(const Rigid3& pose) {
  Eigen::Matrix<double, 7, 1> numbers;
  numbers << QvecWxyz(pose), pose.translation;
  return numbers;
}

Eigen::Matrix4d Matrix4(const Rigid3& pose) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = pose.translation;
  return matrix;
}

py::array_t<double> TransformPoints(const Rigid3& pose, const ArrayLike& points) {
  const auto one = internal::ArrayOf<double>(points, "points", "an array of shape (N, 3) or (3,)");
  if (one.ndim() == 1 && one.shape(0) == 3) {
    return ToArray(Eigen::Vector3d(pose * Eigen::Map<const Eigen::Vector3d>(one.data())));
  }
  const Rows<3> rows(points, "points");
  return MakeRows(rows.size(), 3, [&](size_t i) { return pose * rows[i]; });
}

void BindRigid3(py::module_& module) {
  py::class_<Rigid3>(
      module, "Rigid3",
      "A rigid motion of space, named target_from_source: cam_from_world takes points of the "
      "world\n"
      "to the camera's frame. Products chain: a_from_c = a_from_b * b_from_c.\n\n"
      "Wherever a pose is an argument, a 4 x 4 or 3 x 4 matrix, a pair (qvec, tvec), a dict with\n"
      "these keys, and the poses of pycolmap and PoseLib serve, too.")
      .def(py::init([](const ArrayLike& rotation, const ArrayLike& translation) {
             return ToPose(
                 py::reinterpret_steal<PoseLike>(py::make_tuple(rotation, translation).release()));
           }),
           py::arg("rotation"), py::arg("translation"),
           "From a quaternion (w, x, y, z) or a 3 x 3 matrix, and a translation in scene units.\n\n"
           "Raises InputError for what is no rotation.")
      .def(py::init<>(), "The identity.")
      .def_static(
          "of", [](const PoseLike& pose) { return ToPose(pose); }, py::arg("pose"),
          "From anything that an argument `pose` may be.")
      .def_static(
          "from_matrix", [](const ArrayLike& matrix) { return ToPose(matrix.cast<PoseLike>()); },
          py::arg("matrix"), "From a 4 x 4 or 3 x 4 matrix, that of Rigid3.matrix.")
      .def_property_readonly(
          "qvec", [](const Rigid3& pose) { return ToArray(QvecWxyz(pose)); },
          "The rotation as a unit quaternion (w, x, y, z).")
      .def_property_readonly(
          "tvec", [](const Rigid3& pose) { return ToArray(pose.translation); },
          "The translation (3,), scene units.")
      .def_property_readonly(
          "rotation", [](const Rigid3& pose) { return ToArray(pose.rotation.toRotationMatrix()); },
          "The rotation as a 3 x 3 matrix.")
      .def_property_readonly(
          "matrix", [](const Rigid3& pose) { return ToArray(Matrix4(pose)); }, "4 x 4.")
      .def_property_readonly(
          "center", [](const Rigid3& pose) { return ToArray(pose.OriginInSource()); },
          "Of cam_from_world: the camera's center in the world (3,).")
      .def(
          "inverse", [](const Rigid3& pose) { return pose.Inverse(); }, "source_from_target.")
      .def("transform", &TransformPoints, py::arg("points"),
           "Points (N, 3), or one (3,), of the source in the target's frame.")
      .def(
          "__mul__", [](const Rigid3& a, const Rigid3& b) { return a * b; }, py::arg("other"),
          py::is_operator())
      .def("__mul__", &TransformPoints, py::arg("other"), py::is_operator(),
           "With another motion, or with points (3,) or (N, 3) of the source.")
      .def(
          "__matmul__", [](const Rigid3& a, const Rigid3& b) { return a * b; }, py::arg("other"),
          py::is_operator())
      .def(
          "__eq__",
          [](const Rigid3& a, const py::object& b) {
            return py::isinstance<Rigid3>(b) && Numbers(a) == Numbers(b.cast<Rigid3>());
          },
          py::arg("other"), "Equal in every number; poses that are computed differ by rounding.")
      .def("__hash__", [](const Rigid3& pose) { return std::hash<std::string>()(PoseText(pose)); })
      .def(
          "__array__",
          [](const Rigid3& pose, const py::object& dtype, const py::object&) -> py::object {
            const py::object matrix = ToArray(Matrix4(pose));
            return dtype.is_none() ? matrix : matrix.attr("astype")(dtype);
          },
          py::arg("dtype") = py::none(), py::arg("copy") = py::none(), "The matrix, 4 x 4.")
      .def("__repr__", &PoseText)
      .def(py::pickle(
          [](const Rigid3& pose) {
            return py::make_tuple(ToArray(QvecWxyz(pose)), ToArray(pose.translation));
          },
          [](const py::tuple& state) { return ToPose(py::reinterpret_borrow<PoseLike>(state)); }));
}

// The priors of a query as its arguments say them, with lists for arrays, so that tuples of them
// compare.
using List = std::vector<double>;
using PositionState = std::optional<std::pair<List, List>>;
using GravityState = std::optional<std::tuple<List, List, double>>;
using HeadingState = std::optional<std::tuple<List, List, List, double>>;
using OrientationState = std::optional<std::pair<List, double>>;
using RigState = std::optional<std::tuple<std::string, int, Rigid3>>;

List ToList(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

PositionState PositionOf(const Query& query) {
  const auto& prior = query.priors.position;
  if (!prior) return std::nullopt;
  return {{ToList(prior->position), ToList(prior->sigma)}};
}

GravityState GravityOf(const Query& query) {
  const auto& prior = query.priors.gravity;
  if (!prior) return std::nullopt;
  return {{ToList(prior->down_in_cam), ToList(prior->down_in_world), prior->sigma_deg}};
}

HeadingState HeadingOf(const Query& query) {
  const auto& prior = query.priors.heading;
  if (!prior) return std::nullopt;
  return {{ToList(prior->right_in_cam), ToList(prior->right_in_world), ToList(prior->down_in_world),
           prior->sigma_deg}};
}

OrientationState OrientationOf(const Query& query) {
  const auto& prior = query.priors.orientation;
  if (!prior) return std::nullopt;
  const Eigen::Quaterniond& q = prior->cam_from_world;
  return {{List{q.w(), q.x(), q.y(), q.z()}, prior->sigma_deg}};
}

RangeArgument RangeOf(const Query& query) {
  const auto& prior = query.priors.range;
  if (!prior) return std::nullopt;
  return {{prior->range, prior->sigma}};
}

RigState RigOf(const Query& query) {
  if (!query.rig) return std::nullopt;
  return {{query.rig->frame, query.rig->sensor, query.rig->cam_from_rig}};
}

using RigArgument = std::optional<std::tuple<std::string, int, PoseLike>>;

Query MakeQuery(const std::string& name, const std::optional<CameraLike>& camera,
                const std::optional<PathLike>& images, const PriorArguments& priors,
                const RigArgument& rig) {
  if (camera.has_value() == images.has_value()) {
    throw InputError("camera: expected it, or images, the folder of a photograph that tells it");
  }
  Query query = WithPriors(camera ? Query{name, ToCamera(*camera)}
                                  : QueryOfUnknownCamera(name, ToPath(*images, "images")),
                           ToPriors(priors));
  if (rig) {
    const auto& [frame, sensor, cam_from_rig] = *rig;
    query.rig = {frame, sensor, ToPose(cam_from_rig)};
  }
  return query;
}

py::tuple StateOf(const Query& query) {
  return py::make_tuple(query.name, query.camera, PositionOf(query), GravityOf(query),
                        HeadingOf(query), OrientationOf(query), RangeOf(query),
                        query.priors.focal_sigma, query.priors.focal_range, RigOf(query));
}

Query QueryOf(const py::tuple& state) {
  return MakeQuery(state[0].cast<std::string>(), state[1].cast<CameraLike>(), std::nullopt,
                   {state[2].cast<PositionArgument>(), state[3].cast<GravityArgument>(),
                    state[4].cast<HeadingArgument>(), state[5].cast<OrientationArgument>(),
                    state[6].cast<RangeArgument>(), state[7].cast<std::optional<double>>(),
                    state[8].cast<double>()},
                   state[9].cast<RigArgument>());
}

bool EqualsQuery(const Query& query, const py::object& other) {
  if (py::isinstance<Query>(other)) return StateOf(query).equal(StateOf(other.cast<Query>()));
  return py::isinstance<py::tuple>(other) && py::make_tuple(query.name, query.camera).equal(other);
}

void BindQuery(py::module_& module) {
  const auto none = py::none();
  const auto at = [](const Query& query, int index) -> py::object {
    if (index == 0 || index == -2) return py::str(query.name);
    if (index == 1 || index == -1) return py::cast(query.camera);
    throw py::index_error("a query is a pair (name, camera)");
  };
  py::class_<Query>(module, "Query",
                    "A photograph whose pose is looked for: its name, its camera and what is known "
                    "beforehand.\n\n"
                    "It unpacks as the pair (name, camera), which serves wherever one is an "
                    "argument.")
      .def(
          py::init([](const std::string& name, const std::optional<CameraLike>& camera,
                      const std::optional<PathLike>& images, const PositionArgument& position,
                      const GravityArgument& gravity, const HeadingArgument& heading,
                      const OrientationArgument& orientation, const RangeArgument& range,
                      const std::optional<double>& focal_sigma, double focal_range,
                      const RigArgument& rig) {
            return MakeQuery(
                name, camera, images,
                {position, gravity, heading, orientation, range, focal_sigma, focal_range}, rig);
          }),
          py::arg("name"), py::arg("camera") = none, py::kw_only(), py::arg("images") = none,
          py::arg("position_prior") = none, py::arg("gravity_prior") = none,
          py::arg("heading_prior") = none, py::arg("orientation_prior") = none,
          py::arg("range_prior") = none, py::arg("focal_sigma") = none,
          py::arg("focal_range") = 1.0, py::arg("rig") = none,
          R"(images: in place of the camera, the folder of the photograph, whose focal length EXIF tells or
localizing finds. position_prior: (position, sigma) of the camera's center in the world, sigma
one number or one per axis. gravity_prior: (down_in_cam, down_in_world, sigma_deg).
heading_prior: (right_in_cam, right_in_world, down_in_world, sigma_deg), of a compass: where y is
north and z up, a camera that is held upright and looks h clockwise from north has (1, 0, 0) and
(cos h, -sin h, 0). orientation_prior: (rotation, sigma_deg), of cam_from_world, a quaternion
(w, x, y, z) or a 3 x 3 matrix. range_prior: (range, sigma), along the optical axis to the
surface, by a laser. focal_sigma: standard deviation of the camera's focal length as a share of
it. focal_range: it is the camera's up to this factor either way. rig: (frame, sensor,
cam_from_rig), for photographs that a rig took at one moment, the frame, with the sensor of this
index; what is known of the pose is that of the first sensor's.)")
      .def_readonly("name", &Query::name)
      .def_readonly("camera", &Query::camera)
      .def_property_readonly("position_prior", &PositionOf, "(position, sigma), lists; or None.")
      .def_property_readonly("gravity_prior", &GravityOf,
                             "(down_in_cam, down_in_world, sigma_deg), or None.")
      .def_property_readonly("heading_prior", &HeadingOf,
                             "(right_in_cam, right_in_world, down_in_world, sigma_deg), or None.")
      .def_property_readonly("orientation_prior", &OrientationOf,
                             "(quaternion, sigma_deg) of cam_from_world, (w, x, y, z); or None.")
      .def_property_readonly("range_prior", &RangeOf, "(range, sigma), or None.")
      .def_property_readonly(
          "focal_sigma", [](const Query& query) { return query.priors.focal_sigma; },
          "None: nothing is known of it.")
      .def_property_readonly("focal_range",
                             [](const Query& query) { return query.priors.focal_range; })
      .def_property_readonly("rig", &RigOf,
                             "(frame, sensor, cam_from_rig) where a rig took it, or None.")
      .def("__eq__", &EqualsQuery, py::arg("other"), "With another Query, or a pair.")
      .def("__hash__", [](const Query& query) { return std::hash<std::string>()(query.name); })
      .def(py::pickle(py::overload_cast<const Query&>(&StateOf), &QueryOf))
      .def("__iter__",
           [](const Query& query) { return py::iter(py::make_tuple(query.name, query.camera)); })
      .def("__len__", [](const Query&) { return 2; })
      .def("__getitem__", at, py::arg("index"))
      .def("__repr__", [](const Query& query) {
        return fmt::format("<raylift.Query {}, {}>", query.name, query.camera.ToString());
      });
}

}  // namespace

void BindGeometry(py::module_& module) {
  BindCamera(module);
  BindRigid3(module);
  BindQuery(module);
  py::class_<PosedImage> bound(
      module, "PosedImage",
      "A reference photograph: its name, its camera and where it was taken.\n\n"
      "Wherever one is an argument, a pair (camera, cam_from_world) and\n"
      "pycolmap's images serve, too.");
  bound
      .def(py::init([](std::string name, const CameraLike& camera, const PoseLike& pose) {
             return PosedImage{std::move(name), ToCamera(camera), ToPose(pose)};
           }),
           py::arg("name"), py::arg("camera"), py::arg("cam_from_world"))
      .def_readonly("name", &PosedImage::name, "As in the model: a path within the image folder.")
      .def_readonly("camera", &PosedImage::camera)
      .def_readonly("cam_from_world", &PosedImage::cam_from_world)
      .def("__repr__",
           [](const PosedImage& image) {
             return fmt::format("<raylift.PosedImage {}>", image.name);
           })
      .def("__hash__",
           [](const PosedImage& image) { return std::hash<std::string>()(image.name); });
  BindState(
      bound,
      [](const PosedImage& image) {
        return std::tuple(image.name, image.camera, image.cam_from_world);
      },
      [](const std::tuple<std::string, Camera, Rigid3>& state) {
        return PosedImage{std::get<0>(state), std::get<1>(state), std::get<2>(state)};
      });
}

}  // namespace raylift::python
