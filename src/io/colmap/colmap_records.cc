// The records of COLMAP's models: each names its fields once, which the forms read and write.

#include "io/colmap/colmap_files.h"
#include "io/colmap/colmap_forms.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift::colmap {
namespace {

template <typename Form>
void Take(Form& form, Camera& camera) {
  form.Lens(camera);
}

template <typename Form>
void Take(Form& form, ColmapImage& image) {
  form.Rotation("qvec", image.qvec_wxyz);
  form.Vector("tvec", image.tvec);
  form.Number("camera id", image.camera_id);
  form.Name("name", image.name);
  form.NextLine();
  form.Rest("points2D", 24, image.points2d, [&form](ColmapImage::Point2D& point) {
    form.Vector("points2D", point.pixel);
    form.PointId("points2D", point.point3d_id);
  });
}

template <typename Form>
void Take(Form& form, ColmapPoint3D& point) {
  form.Vector("xyz", point.position_in_world);
  for (uint8_t& channel : point.color_rgb) form.Number("rgb", channel);
  form.Number("error", point.error_px);
  form.Rest("track", 8, point.track, [&form](ColmapPoint3D::Observation& observation) {
    form.Number("track", observation.image_id);
    form.Number("track", observation.point2d_index);
  });
}

template <typename Form>
void Take(Form& form, ColmapPose& pose) {
  form.Rotation("qvec", pose.qvec_wxyz);
  form.Vector("tvec", pose.tvec);
}

template <typename Form>
void Take(Form& form, ColmapSensor& sensor) {
  form.SensorType("sensor type", sensor.type);
  form.Number("sensor id", sensor.id);
}

// The item at an index, which a reader has only now come to. Counts in files are not trusted.
template <typename Item>
Item& ItemAt(std::vector<Item>& items, size_t index) {
  return index < items.size() ? items[index] : items.emplace_back();
}

template <typename Form>
void Take(Form& form, ColmapRig& rig) {
  auto count = static_cast<uint32_t>(rig.reference_sensor ? rig.sensors.size() + 1 : 0);
  form.Count("number of sensors", 8, count);
  if (count == 0) return;
  if (!rig.reference_sensor) rig.reference_sensor.emplace();
  Take(form, *rig.reference_sensor);
  for (uint32_t i = 1; i < count; ++i) {
    auto& [sensor, sensor_from_rig] = ItemAt(rig.sensors, i - 1);
    Take(form, sensor);
    bool has_pose = sensor_from_rig.has_value();
    form.Flag("has pose", has_pose);
    if (has_pose) Take(form, sensor_from_rig ? *sensor_from_rig : sensor_from_rig.emplace());
  }
}

template <typename Form>
void Take(Form& form, ColmapFrame& frame) {
  form.Number("rig id", frame.rig_id);
  Take(form, frame.rig_from_world);
  auto count = static_cast<uint32_t>(frame.data.size());
  form.Count("number of data ids", 16, count);
  for (uint32_t i = 0; i < count; ++i) {
    ColmapFrame::Data& data = ItemAt(frame.data, i);
    Take(form, data.sensor);
    form.Number("data id", data.data_id);
  }
}

// Their order is kept where it is not that of the ids.
template <typename Reader, typename Id, typename Record>
void ReadAll(Reader reader, const char* kind, std::map<Id, Record>& records,
             std::vector<Id>& order) {
  bool is_sorted = true;
  while (reader.NextRecord(kind)) {
    Id id = 0;
    reader.Number("id", id);
    if (!records.empty() && id < records.rbegin()->first) is_sorted = false;
    if (records.contains(id)) {
      reader.Fail("id", fmt::format("{} is the id of an earlier {}, too", id, kind));
    }
    order.push_back(id);
    Take(reader, records.emplace_hint(records.end(), id, Record())->second);
    reader.EndRecord();
  }
  if (is_sorted) order.clear();
}

template <typename Writer, typename Id, typename Record>
void WriteAll(Writer writer, const std::filesystem::path& path, const std::map<Id, Record>& records,
              const std::vector<Id>& order) {
  for (const Id id : IdsInOrder(records, order)) {
    writer.Number("id", id);
    // NOLINTNEXTLINE(cppcoreguidelines-pro-type-const-cast): writers leave records as they are
    Take(writer, const_cast<Record&>(records.at(id)));
    writer.EndRecord();
  }
  WriteFile(path, writer.contents());
}

// Calls `use(kind, comment, records, order)` with what the file holds.
template <typename Model, typename Use>
void WithRecordsOf(std::string_view file, Model& model, const Use& use) {
  if (file == kCameras) {
    use("camera", "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n", model.cameras, model.camera_order);
  } else if (file == kImages) {
    use("image",
        "# Two lines each:\n"
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n"
        "# POINTS2D[] as (X Y POINT3D_ID)\n",
        model.images, model.image_order);
  } else if (file == kPoints3D) {
    use("point", "# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID POINT2D_IDX)\n",
        model.points3d, model.point3d_order);
  } else if (file == kRigs) {
    use("rig",
        "# RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID SENSORS[] as (SENSOR_TYPE "
        "SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ])\n",
        model.rigs, model.rig_order);
  } else if (file == kFrames) {
    use("frame",
        "# FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS DATA_IDS[] as (SENSOR_TYPE "
        "SENSOR_ID DATA_ID)\n",
        model.frames, model.frame_order);
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

void ReadRecords(std::string_view file, const std::filesystem::path& path, ColmapForm form,
                 ColmapModel& model) {
  WithRecordsOf(file, model, [&](const char* kind, const char*, auto& records, auto& order) {
    if (form == ColmapForm::kText) {
      ReadAll(TextReader(path), kind, records, order);
    } else {
      ReadAll(BinaryReader(path), kind, records, order);
    }
  });
}

void WriteRecords(std::string_view file, const std::filesystem::path& path, ColmapForm form,
                  const ColmapModel& model) {
  if (form == ColmapForm::kText && file == kImages) RequireTextNames(path, model);
  WithRecordsOf(file, model,
                [&](const char*, const char* comment, const auto& records, const auto& order) {
                  if (form == ColmapForm::kText) {
                    WriteAll(TextWriter(comment, records.size()), path, records, order);
                  } else {
                    WriteAll(BinaryWriter(records.size()), path, records, order);
                  }
                });
}

}  // namespace raylift::colmap
