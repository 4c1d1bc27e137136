// The records of COLMAP's models: each names its fields once, which the forms read and write.
//
// The two forms of COLMAP's models, each as a reader and a writer of fields that are taken one
// after the other: text (COLMAP's doc/format.rst), with numbers in their shortest form that reads
// back as the same double, and binary (src/colmap/scene/reconstruction_io_binary.cc), little endian
// and packed. Readers name the record and the field in their messages: "images.bin: image 3 of 11,
// tvec: the file ends here", "images.txt: line 7: tvec: ...". Writers leave the fields as they are.

#include <bit>
#include <climits>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/bytes.h"
#include "io/colmap/colmap_files.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift::colmap {
namespace {

static_assert(std::endian::native == std::endian::little, "bytes are copied as they are");

// COLMAP's "no point".
constexpr uint64_t kNoPoint3D = ~uint64_t{0};

// The names of sensors' types, by type.
constexpr std::string_view kSensorTypes[] = {"CAMERA", "IMU"};

class BinaryReader {
 public:
  // The number of records is not trusted: each is read from the bytes that are there.
  explicit BinaryReader(const std::filesystem::path& path)
      : path_(path), contents_(ReadFile(path)), num_records_(Read<uint64_t>("number of records")) {}

  // Goes on to the next record, of this kind; returns false at the end, where the file must end.
  bool NextRecord(const char* kind) {
    if (record_ < num_records_) {
      kind_ = kind;
      ++record_;
      return true;
    }
    if (Remaining() > 0) {
      throw InputError(path_, fmt::format("expected the end after {} bytes, found {} more",
                                          position_, Remaining()));
    }
    return false;
  }
  void EndRecord() const {}
  void NextLine() const {}

  template <typename T>
  void Number(const char* field, T& value) {
    value = Read<T>(field);
  }
  template <typename Numbers>
  void Vector(const char* field, Numbers& vector) {
    for (double& x : vector) {
      x = Read<double>(field);
      if (!std::isfinite(x)) Fail(field, fmt::format("expected a finite number, found {}", x));
    }
  }
  void Rotation(const char* field, Eigen::Vector4d& qvec_wxyz) {
    Vector(field, qvec_wxyz);
    if (HasDirection(qvec_wxyz)) return;
    Fail(field,
         fmt::format("expected a rotation, found the quaternion {}", fmt::join(qvec_wxyz, " ")));
  }
  void Name(const char* field, std::string& name) {
    const size_t end = contents_.find('\0', position_);
    if (end == std::string::npos) Fail(field, "the file ends here");
    name = contents_.substr(position_, end - position_);
    position_ = end + 1;
    if (name.empty()) Fail(field, "expected a name, found none");
  }
  void PointId(const char* field, std::optional<uint64_t>& id) {
    const auto number = Read<uint64_t>(field);
    if (number != kNoPoint3D) id = number;
  }
  void Flag(const char* field, bool& flag) { flag = Read<uint8_t>(field) != 0; }
  void SensorType(const char* field, int32_t& type) {
    type = Read<int32_t>(field);
    if (type == 0 || type == 1) return;
    Fail(field, fmt::format("expected 0 (camera) or 1 (IMU), found {}", type));
  }
  void Lens(Camera& camera) {
    const auto id = Read<int32_t>("model");
    const auto model = CameraModelFromId(id);
    if (!model) {
      Fail("model", fmt::format("expected the id of a camera model (0 to {}), found {}",
                                AllCameraModels().size() - 1, id));
    }
    const int width = Side("width");
    const int height = Side("height");
    std::vector<double> params(GetCameraModelInfo(*model).num_params);
    Vector("params", params);
    try {
      camera = Camera(*model, width, height, params);
    } catch (const InputError& error) {
      Fail("params", error.what());
    }
  }
  // Reads the number of items that take at least `bytes_per_item` each, which is no more than the
  // file can hold.
  template <typename T>
  void Count(const char* field, size_t bytes_per_item, T& count) {
    count = Read<T>(field);
    if (count <= Remaining() / bytes_per_item) return;
    Fail(field, fmt::format("the file ends here: {} items of {} bytes each cannot be in the {} "
                            "bytes that are left",
                            count, bytes_per_item, Remaining()));
  }
  // Reads the last items of a record, with their number.
  template <typename Item, typename Take>
  void Rest(const char* field, size_t bytes_per_item, std::vector<Item>& items, const Take& take) {
    uint64_t count = 0;
    Count(field, bytes_per_item, count);
    items.resize(count);
    for (Item& item : items) take(item);
  }

  [[noreturn]] void Fail(const char* field, std::string_view message) const {
    if (kind_.empty()) throw InputError(path_, field, message);
    throw InputError(path_, fmt::format("{} {} of {}, {}", kind_, record_, num_records_, field),
                     message);
  }

 private:
  template <typename T>
  T Read(const char* field) {
    if (Remaining() < sizeof(T)) Fail(field, "the file ends here");
    const T value = LoadNumber<T>(contents_.data() + position_);
    position_ += sizeof(T);
    return value;
  }
  int Side(const char* field) {
    const auto side = Read<uint64_t>(field);
    if (side == 0 || side > INT_MAX) {
      Fail(field, fmt::format("expected a number of pixels, found {}", side));
    }
    return static_cast<int>(side);
  }
  size_t Remaining() const { return contents_.size() - position_; }

  std::filesystem::path path_;
  std::string contents_;
  size_t position_ = 0;
  std::string_view kind_;
  uint64_t record_ = 0;  // from 1
  uint64_t num_records_ = 0;
};

class BinaryWriter {
 public:
  explicit BinaryWriter(size_t num_records) { Number("", uint64_t{num_records}); }

  const std::string& contents() const { return contents_; }
  void EndRecord() const {}
  void NextLine() const {}

  template <typename T>
  void Number(const char*, T value) {
    contents_ += AsBytes(std::span(&value, 1));
  }
  template <typename Numbers>
  void Vector(const char* field, const Numbers& vector) {
    for (const double x : vector) Number(field, x);
  }
  void Rotation(const char* field, const Eigen::Vector4d& qvec_wxyz) { Vector(field, qvec_wxyz); }
  void Name(const char*, const std::string& name) {
    contents_.append(name.c_str(), name.size() + 1);
  }
  void PointId(const char* field, std::optional<uint64_t> id) {
    Number(field, id.value_or(kNoPoint3D));
  }
  void Flag(const char* field, bool flag) { Number(field, uint8_t{flag}); }
  void SensorType(const char* field, int32_t type) { Number(field, type); }
  void Lens(const Camera& camera) {
    Number("model", static_cast<int32_t>(camera.model()));
    Number("width", static_cast<uint64_t>(camera.width_px()));
    Number("height", static_cast<uint64_t>(camera.height_px()));
    Vector("params", camera.params());
  }
  template <typename T>
  void Count(const char* field, size_t, T count) {
    Number(field, count);
  }
  template <typename Item, typename Take>
  void Rest(const char* field, size_t, std::vector<Item>& items, const Take& take) {
    Number(field, uint64_t{items.size()});
    for (Item& item : items) take(item);
  }

 private:
  std::string contents_;
};

class TextReader {
 public:
  explicit TextReader(const std::filesystem::path& path) : lines_(path), tokens_(lines_, {}) {}

  bool NextRecord(const char*) {
    const auto line = lines_.NextContent();
    if (line) tokens_ = LineTokens(lines_, *line);
    return line.has_value();
  }
  void EndRecord() { tokens_.ExpectEnd(); }
  // It stands there even if it is empty; only the last one of a file may be missing.
  void NextLine() { tokens_ = LineTokens(lines_, lines_.Next().value_or("")); }

  void Number(const char* field, uint64_t& value) { value = tokens_.Uint64(field); }
  void Number(const char* field, uint32_t& value) { value = tokens_.Uint32(field); }
  void Number(const char* field, uint8_t& value) {
    const uint64_t number = tokens_.Uint64(field);
    if (number > UINT8_MAX) Fail(field, fmt::format("expected 0 to 255, found {}", number));
    value = static_cast<uint8_t>(number);
  }
  void Number(const char* field, double& value) {
    const std::string_view token = tokens_.Token(field);
    const auto number = ParseDouble(token);
    if (!number) Fail(field, fmt::format("expected a number, found \"{}\"", token));
    value = *number;
  }
  template <int N>
  void Vector(const char* field, Eigen::Matrix<double, N, 1>& vector) {
    vector = tokens_.Vector<N>(field);
  }
  void Rotation(const char* field, Eigen::Vector4d& qvec_wxyz) {
    qvec_wxyz = tokens_.Quaternion(field);
  }
  // Reads a name, which is all of the rest of the line, as it may hold blanks.
  void Name(const char* field, std::string& name) {
    name = tokens_.Rest();
    if (name.empty()) Fail(field, "expected a name, the line ends here");
  }
  void PointId(const char* field, std::optional<uint64_t>& id) {
    const std::string_view token = tokens_.Token(field);
    if (token == "-1") return;
    id = ParseUint(token);
    if (!id) Fail(field, fmt::format("expected the id of a point or -1, found \"{}\"", token));
  }
  void Flag(const char* field, bool& flag) {
    const std::string_view token = tokens_.Token(field);
    flag = token == "1";
    if (!flag && token != "0") Fail(field, fmt::format("expected 0 or 1, found \"{}\"", token));
  }
  void SensorType(const char* field, int32_t& type) {
    const std::string_view token = tokens_.Token(field);
    type = token == kSensorTypes[0] ? 0 : 1;
    if (token == kSensorTypes[type]) return;
    Fail(field, fmt::format("expected CAMERA or IMU, found \"{}\"", token));
  }
  void Lens(Camera& camera) { camera = tokens_.CameraToEnd(); }
  void Count(const char* field, size_t, uint32_t& count) { Number(field, count); }
  template <typename Item, typename Take>
  void Rest(const char*, size_t, std::vector<Item>& items, const Take& take) {
    while (!tokens_.AtEnd()) take(items.emplace_back());
  }

  [[noreturn]] void Fail(const char* field, std::string_view message) const {
    tokens_.Fail(fmt::format("{}: {}", field, message));
  }

 private:
  LineReader lines_;
  LineTokens tokens_;
};

class TextWriter {
 public:
  TextWriter(std::string_view comment, size_t num_records)
      : contents_(fmt::format("{}# Number of records: {}\n", comment, num_records)) {}

  const std::string& contents() const { return contents_; }
  void EndRecord() { contents_ += '\n'; }
  void NextLine() { contents_ += '\n'; }

  template <typename T>
  void Number(const char*, T value) {
    if constexpr (std::is_floating_point_v<T>) {
      Token(FormatDouble(value));
    } else {
      Token(std::to_string(value));
    }
  }
  template <typename Numbers>
  void Vector(const char* field, const Numbers& vector) {
    for (const double x : vector) Number(field, x);
  }
  void Rotation(const char* field, const Eigen::Vector4d& qvec_wxyz) { Vector(field, qvec_wxyz); }
  void Name(const char*, const std::string& name) { Token(name); }
  void PointId(const char*, std::optional<uint64_t> id) { Token(id ? std::to_string(*id) : "-1"); }
  void Flag(const char*, bool flag) { Token(flag ? "1" : "0"); }
  void SensorType(const char*, int32_t type) { Token(kSensorTypes[type == 0 ? 0 : 1]); }
  void Lens(const Camera& camera) { Token(camera.ToString()); }
  void Count(const char* field, size_t, uint32_t count) { Number(field, count); }
  template <typename Item, typename Take>
  void Rest(const char*, size_t, std::vector<Item>& items, const Take& take) {
    for (Item& item : items) take(item);
  }

 private:
  void Token(std::string_view token) {
    if (contents_.back() != '\n') contents_ += ' ';
    contents_ += token;
  }

  std::string contents_;
};

template <typename Form>
void Take(Form& form, Camera& camera) {
  form.Lens(camera);
}

template <typename Form>
void Take(Form& form, ColmapPose& pose) {
  form.Rotation("qvec", pose.qvec_wxyz);
  form.Vector("tvec", pose.tvec);
}

template <typename Form>
void Take(Form& form, ColmapImage& image) {
  Take(form, image.pose);
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
void Take(Form& form, ColmapSensor& sensor) {
  form.SensorType("sensor type", sensor.type);
  form.Number("sensor id", sensor.id);
}

// Returns the item at an index, which a reader has only now come to. Counts in files are not
// trusted.
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

// Reads all records, and in `order` their order in the file where it is not that of the ids.
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
