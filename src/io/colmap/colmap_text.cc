// The text form of COLMAP's models: doc/format.rst of COLMAP, numbers in their shortest form that
// reads back as the same double.

#include "io/colmap/colmap_files.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift::colmap {
namespace {

template <typename Id, typename Record, typename ReadRecord>
void ReadRecords(const std::filesystem::path& path, std::string_view kind,
                 std::map<Id, Record>* records, std::vector<Id>* order, ReadRecord read_record) {
  LineReader lines(path);
  bool is_sorted = true;
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    Id id;
    if constexpr (sizeof(Id) == 4) {
      id = tokens.Uint32("id");
    } else {
      id = tokens.Uint64("id");
    }
    if (!records->empty() && id < records->rbegin()->first) {
      is_sorted = false;
    }
    if (records->contains(id)) {
      tokens.Fail(fmt::format("id: {} is the id of an earlier {}, too", id, kind));
    }
    order->push_back(id);
    records->emplace_hint(records->end(), id, read_record(lines, tokens));
  }
  if (is_sorted) {
    order->clear();
  }
}

Camera ReadCamera(LineReader&, LineTokens& tokens) { return tokens.CameraToEnd(); }

ColmapPose ReadPose(LineTokens& tokens) {
  ColmapPose pose;
  pose.qvec_wxyz = tokens.Quaternion("qvec");
  pose.tvec = tokens.Vector<3>("tvec");
  return pose;
}

std::vector<ColmapImage::Point2D> ReadPoints2D(LineTokens& tokens) {
  std::vector<ColmapImage::Point2D> points;
  while (!tokens.AtEnd()) {
    ColmapImage::Point2D& point = points.emplace_back();
    point.pixel = tokens.Vector<2>("points2D");
    const std::string_view id = tokens.Token("points2D");
    if (id == "-1") {
      continue;
    }
    point.point3d_id = ParseUint(id);
    if (!point.point3d_id) {
      tokens.Fail(fmt::format("points2D: expected the id of a point or -1, found \"{}\"", id));
    }
  }
  return points;
}

ColmapImage ReadImage(LineReader& lines, LineTokens& tokens) {
  ColmapImage image;
  const ColmapPose pose = ReadPose(tokens);
  image.qvec_wxyz = pose.qvec_wxyz;
  image.tvec = pose.tvec;
  image.camera_id = tokens.Uint32("camera id");
  image.name = tokens.Rest();  // all of it: a name may hold blanks
  if (image.name.empty()) {
    tokens.Fail("name: expected a name, the line ends here");
  }
  // The points' line stands there even if it is empty; only the last one may be missing.
  if (const auto points_line = lines.Next()) {
    LineTokens points_tokens(lines, *points_line);
    image.points2d = ReadPoints2D(points_tokens);
  }
  return image;
}

ColmapPoint3D ReadPoint3D(LineReader&, LineTokens& tokens) {
  ColmapPoint3D point;
  point.position_in_world = tokens.Vector<3>("xyz");
  for (uint8_t& channel : point.color_rgb) {
    const uint64_t value = tokens.Uint64("rgb");
    if (value > 255) {
      tokens.Fail(fmt::format("rgb: expected 0 to 255, found {}", value));
    }
    channel = static_cast<uint8_t>(value);
  }
  const std::string_view error = tokens.Token("error");
  const auto error_px = ParseDouble(error);
  if (!error_px) {
    tokens.Fail(fmt::format("error: expected a number, found \"{}\"", error));
  }
  point.error_px = *error_px;
  while (!tokens.AtEnd()) {
    ColmapPoint3D::Observation& observation = point.track.emplace_back();
    observation.image_id = tokens.Uint32("track");
    observation.point2d_index = tokens.Uint32("track");
  }
  return point;
}

constexpr std::string_view kCameraSensor = "CAMERA";
constexpr std::string_view kImuSensor = "IMU";

ColmapSensor ReadSensor(LineTokens& tokens) {
  ColmapSensor sensor;
  const std::string_view type = tokens.Token("sensor type");
  if (type != kCameraSensor && type != kImuSensor) {
    tokens.Fail(fmt::format("sensor type: expected CAMERA or IMU, found \"{}\"", type));
  }
  sensor.type = type == kCameraSensor ? 0 : 1;
  sensor.id = tokens.Uint32("sensor id");
  return sensor;
}

ColmapRig ReadRig(LineReader&, LineTokens& tokens) {
  ColmapRig rig;
  const uint64_t num_sensors = tokens.Uint64("number of sensors");
  if (num_sensors > 0) {
    rig.reference_sensor = ReadSensor(tokens);
  }
  for (uint64_t i = 1; i < num_sensors; ++i) {
    const ColmapSensor sensor = ReadSensor(tokens);
    const std::string_view has_pose = tokens.Token("has pose");
    if (has_pose != "0" && has_pose != "1") {
      tokens.Fail(fmt::format("has pose: expected 0 or 1, found \"{}\"", has_pose));
    }
    rig.sensors.emplace_back(sensor,
                             has_pose == "1" ? std::optional(ReadPose(tokens)) : std::nullopt);
  }
  tokens.ExpectEnd();
  return rig;
}

ColmapFrame ReadFrame(LineReader&, LineTokens& tokens) {
  ColmapFrame frame;
  frame.rig_id = tokens.Uint32("rig id");
  frame.rig_from_world = ReadPose(tokens);
  const uint64_t num_data = tokens.Uint64("number of data ids");
  for (uint64_t i = 0; i < num_data; ++i) {
    const ColmapSensor sensor = ReadSensor(tokens);
    frame.data.push_back({sensor, tokens.Uint64("data id")});
  }
  tokens.ExpectEnd();
  return frame;
}

template <typename Id, typename Record, typename FormatRecord>
void WriteRecords(const std::filesystem::path& path, std::string_view comment,
                  const std::map<Id, Record>& records, const std::vector<Id>& order,
                  FormatRecord format_record) {
  std::string text = fmt::format("{}# Number of records: {}\n", comment, records.size());
  for (const Id id : IdsInOrder(records, order)) {
    text += std::to_string(id);
    format_record(records.at(id), &text);
    text += '\n';
  }
  WriteFile(path, text);
}

template <typename Vector>
void Append(const Vector& numbers, std::string* text) {
  for (const double number : numbers) {
    *text += ' ';
    *text += FormatDouble(number);
  }
}

void AppendPose(const Eigen::Vector4d& qvec, const Eigen::Vector3d& tvec, std::string* text) {
  Append(qvec, text);
  Append(tvec, text);
}

void FormatCamera(const Camera& camera, std::string* text) {
  *text += fmt::format(" {} {} {}", GetCameraModelInfo(camera.model()).name, camera.width_px(),
                       camera.height_px());
  Append(camera.params(), text);
}

void FormatImage(const ColmapImage& image, std::string* text) {
  AppendPose(image.qvec_wxyz, image.tvec, text);
  *text += fmt::format(" {} {}\n", image.camera_id, image.name);
  for (const ColmapImage::Point2D& point : image.points2d) {
    if (&point != image.points2d.data()) {
      *text += ' ';
    }
    *text += FormatDouble(point.pixel.x());
    *text += ' ';
    *text += FormatDouble(point.pixel.y());
    *text += ' ';
    *text += point.point3d_id ? std::to_string(*point.point3d_id) : "-1";
  }
}

void FormatPoint3D(const ColmapPoint3D& point, std::string* text) {
  Append(point.position_in_world, text);
  for (const int channel : point.color_rgb) {
    *text += fmt::format(" {}", channel);
  }
  *text += ' ';
  *text += FormatDouble(point.error_px);
  for (const ColmapPoint3D::Observation& observation : point.track) {
    *text += fmt::format(" {} {}", observation.image_id, observation.point2d_index);
  }
}

void AppendSensor(const ColmapSensor& sensor, std::string* text) {
  *text += fmt::format(" {} {}", sensor.type == 0 ? kCameraSensor : kImuSensor, sensor.id);
}

void FormatRig(const ColmapRig& rig, std::string* text) {
  if (!rig.reference_sensor) {
    *text += " 0";
    return;
  }
  *text += fmt::format(" {}", rig.sensors.size() + 1);
  AppendSensor(*rig.reference_sensor, text);
  for (const auto& [sensor, sensor_from_rig] : rig.sensors) {
    AppendSensor(sensor, text);
    *text += sensor_from_rig ? " 1" : " 0";
    if (sensor_from_rig) {
      AppendPose(sensor_from_rig->qvec_wxyz, sensor_from_rig->tvec, text);
    }
  }
}

void FormatFrame(const ColmapFrame& frame, std::string* text) {
  *text += fmt::format(" {}", frame.rig_id);
  AppendPose(frame.rig_from_world.qvec_wxyz, frame.rig_from_world.tvec, text);
  *text += fmt::format(" {}", frame.data.size());
  for (const ColmapFrame::Data& data : frame.data) {
    AppendSensor(data.sensor, text);
    *text += fmt::format(" {}", data.data_id);
  }
}

void RequireTextNames(const std::filesystem::path& path, const ColmapModel& model) {
  for (const auto& [id, image] : model.images) {
    if (image.name.find_first_of("\r\n") != std::string::npos || Trim(image.name) != image.name) {
      throw InputError(path, fmt::format("image {}", id),
                       "the text form cannot hold a name with line ends or outer blanks");
    }
  }
}

}  // namespace

void ReadText(std::string_view file, const std::filesystem::path& path, ColmapModel* model) {
  const auto read = [&](std::string_view kind, auto& records, auto& order, auto read_record) {
    ReadRecords(path, kind, &records, &order, read_record);
  };
  if (file == kCameras) read("camera", model->cameras, model->camera_order, ReadCamera);
  if (file == kImages) read("image", model->images, model->image_order, ReadImage);
  if (file == kPoints3D) read("point", model->points3d, model->point3d_order, ReadPoint3D);
  if (file == kRigs) read("rig", model->rigs, model->rig_order, ReadRig);
  if (file == kFrames) read("frame", model->frames, model->frame_order, ReadFrame);
}

void WriteText(std::string_view file, const std::filesystem::path& path, const ColmapModel& model) {
  const auto write = [&](std::string_view comment, const auto& records, const auto& order,
                         auto format_record) {
    WriteRecords(path, comment, records, order, format_record);
  };
  if (file == kCameras) {
    write("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n", model.cameras, model.camera_order,
          FormatCamera);
  } else if (file == kImages) {
    RequireTextNames(path, model);
    write(
        "# Two lines each:\n"
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n"
        "# POINTS2D[] as (X Y POINT3D_ID)\n",
        model.images, model.image_order, FormatImage);
  } else if (file == kPoints3D) {
    write("# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID POINT2D_IDX)\n", model.points3d,
          model.point3d_order, FormatPoint3D);
  } else if (file == kRigs) {
    write(
        "# RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID SENSORS[] as (SENSOR_TYPE "
        "SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ])\n",
        model.rigs, model.rig_order, FormatRig);
  } else if (file == kFrames) {
    write(
        "# FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS DATA_IDS[] as (SENSOR_TYPE "
        "SENSOR_ID DATA_ID)\n",
        model.frames, model.frame_order, FormatFrame);
  }
}

}  // namespace raylift::colmap
