// Files of the field: COLMAP models, depth maps, poses, query lists.

#include <cmath>

#include "apps/python/conversions.h"

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/query_list.h"

namespace raylift::python {
namespace {

using ModelPointer = std::shared_ptr<ColmapModel>;

// Returns an image of a model, with items of its own, as COLMAP's are.
py::dict ImageDict(const ColmapImage& image) {
  py::dict dict;
  dict["name"] = image.name;
  dict["camera_id"] = image.camera_id;
  dict["cam_from_world"] = image.CamFromWorld();
  dict["points2d"] =
      MakeRows(image.points2d.size(), 2, [&](size_t i) { return image.points2d[i].pixel; });
  py::array_t<int64_t> ids(std::ssize(image.points2d));
  for (size_t i = 0; i < image.points2d.size(); ++i) {
    const auto& id = image.points2d[i].point3d_id;
    ids.mutable_data()[i] = id ? static_cast<int64_t>(*id) : -1;
  }
  dict["point3d_ids"] = ids;
  return dict;
}

py::dict PointsDict(const ColmapModel& model) {
  const auto count = std::ssize(model.points3d);
  py::array_t<uint64_t> ids(count);
  py::array_t<double> positions({count, py::ssize_t{3}}), errors(count);
  py::array_t<uint8_t> colors({count, py::ssize_t{3}});
  py::array_t<int64_t> lengths(count);
  size_t i = 0;
  for (const auto& [id, point] : model.points3d) {
    ids.mutable_data()[i] = id;
    for (size_t k = 0; k < 3; ++k) {
      positions.mutable_data()[3 * i + k] = point.position_in_world[static_cast<Eigen::Index>(k)];
      colors.mutable_data()[3 * i + k] = point.color_rgb[k];
    }
    errors.mutable_data()[i] = point.error_px;
    lengths.mutable_data()[i] = std::ssize(point.track);
    ++i;
  }
  py::dict dict;
  dict["ids"] = ids;
  dict["positions"] = positions;
  dict["colors"] = colors;
  dict["errors_px"] = errors;
  dict["track_lengths"] = lengths;
  return dict;
}

const ColmapPoint3D& PointOf(const ColmapModel& model, uint64_t id) {
  const auto point = model.points3d.find(id);
  if (point == model.points3d.end()) throw InputError(fmt::format("the model has no point {}", id));
  return point->second;
}

py::array_t<int64_t> Track(const ColmapModel& model, uint64_t id) {
  const ColmapPoint3D& point = PointOf(model, id);
  py::array_t<int64_t> track({std::ssize(point.track), py::ssize_t{2}});
  int64_t* number = track.mutable_data();
  for (const auto& observation : point.track) {
    *number++ = observation.image_id;
    *number++ = observation.point2d_index;
  }
  return track;
}

void RequireFinite(const std::string& name, const auto& numbers) {
  if (!numbers.allFinite()) throw InputError(name + ": expected finite numbers");
}

// Adds an image, whose keypoints say which points they observe, or learn it by `add_point3d`.
void AddImage(ColmapModel& model, uint32_t image_id, const std::string& name, uint32_t camera_id,
              const PoseLike& pose, const std::optional<ArrayLike>& points2d,
              const std::optional<ArrayLike>& point3d_ids) {
  const std::string what = fmt::format("image {}", image_id);
  if (!model.cameras.contains(camera_id)) {
    throw InputError(fmt::format("{}: the model has no camera {}", what, camera_id));
  }
  if (model.images.contains(image_id)) throw InputError(what + ": the model has one already");
  if (name.empty() || name.find('\n') != std::string::npos) {
    throw InputError(fmt::format("{}, name: expected one line of text, found '{}'", what, name));
  }
  for (const auto& [id, other] : model.images) {
    if (other.name == name) {
      throw InputError(fmt::format("{}: image {} has the name {}, too", what, id, name));
    }
  }
  ColmapImage image;
  image.name = name;
  image.camera_id = camera_id;
  image.SetCamFromWorld(ToPose(pose));
  const Rows<2> pixels(points2d, "points2d");
  const auto ids = PerMatch<int64_t>(point3d_ids, "point3d_ids", pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    RequireFinite(fmt::format("{}, points2d, row {}", what, i), pixels[i]);
    auto& point = image.points2d.emplace_back();
    point.pixel = pixels[i];
    if (ids && ids->data()[i] >= 0) point.point3d_id = static_cast<uint64_t>(ids->data()[i]);
  }
  model.images[image_id] = std::move(image);
}

// Returns the keypoint that a track names. Throws InputError where there is none, or it observes
// another point.
ColmapImage::Point2D& Observed(ColmapModel& model, uint64_t point_id, int64_t image_id,
                               int64_t index) {
  const std::string what = fmt::format("point {}, track", point_id);
  const auto image =
      image_id < 0 ? model.images.end() : model.images.find(static_cast<uint32_t>(image_id));
  if (image == model.images.end() || image->first != image_id) {
    throw InputError(fmt::format("{}: the model has no image {}", what, image_id));
  }
  auto& keypoints = image->second.points2d;
  if (index < 0 || index >= std::ssize(keypoints)) {
    throw InputError(fmt::format("{}: image {} has {} keypoints, and none of index {}", what,
                                 image_id, keypoints.size(), index));
  }
  ColmapImage::Point2D& keypoint = keypoints[static_cast<size_t>(index)];
  if (keypoint.point3d_id.value_or(point_id) != point_id) {
    throw InputError(fmt::format("{}: keypoint {} of image {} observes point {} already", what,
                                 index, image_id, *keypoint.point3d_id));
  }
  return keypoint;
}

void AddPoint(ColmapModel& model, uint64_t id, const ArrayLike& position, const ArrayLike& track,
              const ArrayLike& color, double error_px) {
  const std::string what = fmt::format("point {}", id);
  if (model.points3d.contains(id)) throw InputError(what + ": the model has one already");
  ColmapPoint3D point;
  const auto xyz = internal::ArrayOf<double>(position, "position", "3 numbers");
  if (xyz.size() != 3) internal::ThrowShape("position", "3 numbers", xyz);
  point.position_in_world = Eigen::Map<const Eigen::Vector3d>(xyz.data());
  RequireFinite(what + ", position", point.position_in_world);
  constexpr const char* kColor = "3 integers from 0 to 255";
  const auto rgb = internal::ArrayOf<double>(color, "color", kColor);
  if (rgb.ndim() != 1 || rgb.size() != 3) internal::ThrowShape("color", kColor, rgb);
  point.color_rgb = ToColors(py::make_tuple(color).cast<ArrayLike>(), "color").front();
  point.error_px = error_px;
  const Rows<2, int64_t> observations(track, "track");
  std::vector<ColmapImage::Point2D*> observed;
  for (size_t i = 0; i < observations.size(); ++i) {
    observed.push_back(&Observed(model, id, observations[i][0], observations[i][1]));
    point.track.push_back(
        {static_cast<uint32_t>(observations[i][0]), static_cast<uint32_t>(observations[i][1])});
  }
  for (ColmapImage::Point2D* const keypoint : observed) keypoint->point3d_id = id;
  model.points3d[id] = std::move(point);
}

// Throws InputError where keypoints observe points that are not there: COLMAP reads no such model.
void RequireObservedPoints(const ColmapModel& model) {
  for (const auto& [id, image] : model.images) {
    for (size_t i = 0; i < image.points2d.size(); ++i) {
      const auto point = image.points2d[i].point3d_id;
      if (!point || model.points3d.contains(*point)) continue;
      throw InputError(fmt::format("image {}: keypoint {} observes point {}, which the model lacks",
                                   id, i, *point));
    }
  }
}

// The names and bytes of the model's files, and its warnings.
using ModelState = std::pair<std::map<std::string, py::bytes>, std::vector<std::string>>;

ModelState StateOf(const ColmapModel& model) {
  const py::object folder = py::module_::import("tempfile").attr("TemporaryDirectory")();
  const std::filesystem::path path = folder.attr("name").cast<std::string>();
  WriteColmapModel(path, model, ColmapForm::kBinary);
  std::map<std::string, py::bytes> files;
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    files[entry.path().filename().string()] = py::bytes(ReadFile(entry.path()));
  }
  folder.attr("cleanup")();
  return {files, model.warnings};
}

ModelPointer ModelOf(const ModelState& state) {
  const py::object folder = py::module_::import("tempfile").attr("TemporaryDirectory")();
  const std::filesystem::path path = folder.attr("name").cast<std::string>();
  for (const auto& [name, bytes] : state.first) {
    WriteFile(path / std::filesystem::path(name).filename(), bytes.cast<std::string>());
  }
  auto model = std::make_shared<ColmapModel>(ReadColmapModel(path));
  folder.attr("cleanup")();
  model->warnings = state.second;
  return model;
}

void BindModel(py::module_& module) {
  py::class_<ColmapModel, ModelPointer> bound(
      module, "ColmapModel", "A COLMAP model: cameras, images and points, kept without loss.");
  bound.def(py::init<>(), "An empty one.")
      .def_static(
          "read",
          [](const PathLike& folder) {
            const std::filesystem::path path = ToPath(folder, "folder");
            return WithoutLock(
                [&] { return std::make_shared<ColmapModel>(ReadColmapModel(path)); });
          },
          py::arg("folder"), "Text or binary. Raises InputError naming file and record.")
      .def(
          "write",
          [](const ColmapModel& model, const PathLike& folder, const std::string& form) {
            if (form != "binary" && form != "text") {
              throw OptionError("form", form, "expected binary|text");
            }
            const std::filesystem::path path = ToPath(folder, "folder");
            RequireObservedPoints(model);
            std::filesystem::create_directories(path);
            WithoutLock([&] {
              WriteColmapModel(path, model,
                               form == "text" ? ColmapForm::kText : ColmapForm::kBinary);
            });
          },
          py::arg("folder"), py::arg("form") = "binary", "form: \"binary\" or \"text\".")
      .def_property_readonly(
          "cameras", [](const ColmapModel& model) { return model.cameras; },
          "A dict of Camera by id; a copy.")
      .def_property_readonly(
          "image_ids",
          [](const ColmapModel& model) {
            std::vector<uint32_t> ids;
            for (const auto& [id, image] : model.images) ids.push_back(id);
            return ids;
          },
          "In order.")
      .def(
          "image",
          [](const ColmapModel& model, uint32_t id) {
            const auto image = model.images.find(id);
            if (image == model.images.end()) {
              throw InputError(fmt::format("the model has no image {}", id));
            }
            return ImageDict(image->second);
          },
          py::arg("image_id"),
          "An image as a dict: name, camera_id, cam_from_world, points2d (N, 2), point3d_ids (N,), "
          "-1:\n"
          "none.")
      .def_property_readonly(
          "posed_images", [](const ColmapModel& model) { return model.PosedImages(); },
          "The images with their cameras, a list of PosedImage sorted by name.")
      .def_property_readonly(
          "points3d", &PointsDict,
          "A dict of arrays: ids (N,), positions (N, 3), colors (N, 3) uint8, errors_px (N,),\n"
          "track_lengths (N,); copies.")
      .def("track", &Track, py::arg("point3d_id"),
           "What observes a point (K, 2): the image's id, and the index of its points2d.")
      .def(
          "add_camera",
          [](ColmapModel& model, uint32_t id, const CameraLike& camera) {
            if (!model.cameras.emplace(id, ToCamera(camera)).second) {
              throw InputError(fmt::format("camera {}: the model has one already", id));
            }
          },
          py::arg("camera_id"), py::arg("camera"))
      .def("add_image", &AddImage, py::arg("image_id"), py::arg("name"), py::arg("camera_id"),
           py::arg("cam_from_world"), py::arg("points2d") = py::none(),
           py::arg("point3d_ids") = py::none(),
           "Raises InputError where the camera is not there yet, or another image has the id or "
           "name.")
      .def("add_point3d", &AddPoint, py::arg("point3d_id"), py::arg("position"), py::arg("track"),
           py::arg("color") = py::make_tuple(0, 0, 0), py::arg("error_px") = -1.0,
           "track (K, 2): the image's id, and the index of its points2d, which then observes the\n"
           "point. color: red, green and blue, from 0 to 255. Raises InputError where there is no "
           "such\n"
           "keypoint, or it observes another point.")
      .def_readonly("warnings", &ColmapModel::warnings)
      .def("__repr__", [](const ColmapModel& model) {
        return fmt::format("<raylift.ColmapModel {} cameras, {} images, {} points>",
                           model.cameras.size(), model.images.size(), model.points3d.size());
      });
  BindState(bound, py::overload_cast<const ColmapModel&>(&StateOf), &ModelOf);
}

py::array_t<float> ReadDepth(const PathLike& file, const std::string& layer,
                             const std::optional<std::pair<int, int>>& raw_size) {
  const std::filesystem::path path = ToPath(file, "file");
  DepthReadOptions options{.layer = layer};
  if (raw_size) options.raw_size = PlaneSize{raw_size->first, raw_size->second};
  StoredDepth stored = WithoutLock([&] { return ReadDepthFile(path, options); });
  const py::ssize_t height = stored.height_px, width = stored.width_px;
  return HandOver(std::move(stored.values), {height, width});
}

py::dict WriteDepth(const PathLike& file, const ArrayLike& depth, const py::kwargs& given) {
  const std::filesystem::path path = ToPath(file, "file");
  constexpr const char* kExpected = "an array of shape (height, width)";
  const auto array = internal::ArrayOf<float>(depth, "depth", kExpected);
  if (array.ndim() != 2) internal::ThrowShape("depth", kExpected, array);
  DepthWriteOptions options;
  Keywords keywords(given);
  keywords.Take("sample", options.sample);
  keywords.Take("exr_compression", options.exr_compression);
  keywords.Take("png_step", options.png_step);
  keywords.Take("out_of_range", options.out_of_range);
  keywords.Take("deflate_npz", options.deflate_npz);
  keywords.Take("layer", options.layer);
  keywords.RequireAllTaken();
  const FloatPlane plane(static_cast<int>(array.shape(1)), static_cast<int>(array.shape(0)),
                         {array.data(), static_cast<size_t>(array.size())});
  const DepthWriteReport report = WithoutLock([&] { return WriteDepthFile(path, plane, options); });
  py::dict dict;
  dict["bytes"] = report.bytes;
  dict["dropped"] = report.dropped;
  dict["max_rounding"] = report.max_rounding;
  return dict;
}

void BindLists(py::module_& module) {
  module.def(
      "read_poses",
      [](const PathLike& file) {
        py::dict poses;
        for (const NamedPose& pose : ReadPoseFile(ToPath(file, "file"))) {
          poses[py::str(pose.name)] = pose.cam_from_world;
        }
        return poses;
      },
      py::arg("file"),
      "Lines `name qw qx qy qz tx ty tz`, world to camera: a dict of Rigid3 by name. Raises "
      "InputError\n"
      "naming the line.");
  module.def(
      "write_poses",
      [](const PathLike& file, const py::dict& poses) {
        std::vector<NamedPose> named;
        for (const auto& [name, pose] : poses) {
          named.push_back(
              {ToText(name, "poses, name"), ToPose(py::reinterpret_borrow<PoseLike>(pose))});
        }
        WritePoseFile(ToPath(file, "file"), named);
      },
      py::arg("file"), py::arg("poses"), "A dict of poses (cam_from_world) by name; in its order.");
  module.def(
      "read_queries",
      [](const PathLike& file, const std::optional<PathLike>& images,
         const std::optional<PathLike>& priors, const std::optional<PathLike>& rigs) {
        auto queries = ReadQueryList(ToPath(file, "file"),
                                     images ? ToPath(*images, "images") : std::filesystem::path());
        if (priors) TakePosePriors(ToPath(*priors, "priors"), queries);
        if (rigs) TakeRigs(ToPath(*rigs, "rigs"), queries);
        return queries;
      },
      py::arg("file"), py::kw_only(), py::arg("images") = py::none(),
      py::arg("priors") = py::none(), py::arg("rigs") = py::none(),
      R"(Lines `name MODEL width height params... [focal_sigma S]`: a list of Query, which unpack as
(name, camera). images: folder of the photographs; a line may then be a name alone, whose
focal length EXIF tells or localizing finds, and a folder stands for those in it. priors,
rigs: files as of `raylift localize --priors` and `--rigs`; photographs that a rig took at
one moment are then localized together.)");
  module.def(
      "write_queries",
      [](const PathLike& file, const std::vector<QueryLike>& queries) {
        std::vector<Query> list;
        for (const QueryLike& query : queries) list.push_back(ToQuery(query));
        WriteQueryList(ToPath(file, "file"), list);
      },
      py::arg("file"), py::arg("queries"), "From a list of Query, or of (name, camera).");
}

}  // namespace

void BindIo(py::module_& module) {
  BindModel(module);
  BindLists(module);
  module.def("read_depth", &ReadDepth, py::arg("file"), py::kw_only(), py::arg("layer") = "",
             py::arg("raw_size") = py::none(),
             R"(A depth map as it is stored (height, width), float32: EXR, PNG, TIFF, PGM, NPY, NPZ,
COLMAP's .bin, PFM, or plain floats with raw_size=(width, height). layer: the channel of an
EXR or key of an NPZ. DepthMaps knows what the numbers mean. Raises InputError.)");
  module.def(
      "write_depth", &WriteDepth, py::arg("file"), py::arg("depth"),
      R"(Writes a depth map (height, width) in the format of the file's name: .exr, .png, .tiff,
.npy, .npz, .bin (COLMAP), .pfm. Options as of `raylift render`: sample="float" (or
"half"), exr_compression="pxr24", png_step=0.001, out_of_range="refuse" (or "drop"),
deflate_npz=False; layer. Returns a dict: bytes, dropped values, max_rounding.)");
  module.def(
      "read_image",
      [](const PathLike& file) {
        const std::filesystem::path path = ToPath(file, "file");
        return ToArray(WithoutLock([&] { return ReadImage(path, ImageChannels::kRgb); }));
      },
      py::arg("file"),
      "A photograph (height, width, 3), uint8, RGB, without turning it by its tags.");
}

}  // namespace raylift::python
