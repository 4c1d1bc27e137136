// The binary form of COLMAP's models: little endian, packed; see COLMAP's
// src/colmap/scene/reconstruction_io_binary.cc.

#include <bit>
#include <climits>
#include <cmath>
#include <cstring>
#include <string>
#include <type_traits>

#include "io/colmap/colmap_files.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift::colmap {
namespace {

static_assert(std::endian::native == std::endian::little, "the readers copy bytes as they are");

// Reads the bytes of a file from first to last and names the record and the field in its messages:
// "images.bin: image 3 of 11, tvec: the file ends here".
class BinaryReader {
 public:
  explicit BinaryReader(const std::filesystem::path& path);

  // From here on, fields belong to record `index` (from 0) of `count`.
  void EnterRecord(std::string_view kind, uint64_t index, uint64_t count);

  template <typename T>
  T Read(const char* field) {
    static_assert(std::is_arithmetic_v<T>);
    Require(sizeof(T), field);
    T value;
    std::memcpy(&value, contents_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }

  double ReadFinite(const char* field) {
    const double value = Read<double>(field);
    if (!std::isfinite(value)) {
      FailNotFinite(field, value);
    }
    return value;
  }

  // Up to the terminating zero.
  std::string ReadString(const char* field);

  // A count of items that take at least `bytes_per_item` each: no more than the file can hold.
  template <typename Count>
  Count ReadCount(const char* field, size_t bytes_per_item) {
    const Count count = Read<Count>(field);
    CheckCount(field, count, bytes_per_item);
    return count;
  }

  size_t Remaining() const { return contents_.size() - position_; }
  void ExpectEnd();
  [[noreturn]] void Fail(const char* field, std::string_view message) const;

 private:
  void Require(size_t num_bytes, const char* field) const {
    if (Remaining() < num_bytes) {
      Fail(field, "the file ends here");
    }
  }
  void CheckCount(const char* field, uint64_t count, size_t bytes_per_item) const;
  [[noreturn]] void FailNotFinite(const char* field, double value) const;

  std::filesystem::path path_;
  std::string contents_;
  size_t position_ = 0;
  std::string_view record_kind_;
  uint64_t record_index_ = 0;
  uint64_t record_count_ = 0;
};

class BinaryWriter {
 public:
  template <typename T>
  void Write(std::type_identity_t<T> value) {
    static_assert(std::is_arithmetic_v<T>);
    const size_t position = contents_.size();
    contents_.resize(position + sizeof(T));
    std::memcpy(contents_.data() + position, &value, sizeof(T));
  }
  void WriteString(const std::string& text) { contents_.append(text.c_str(), text.size() + 1); }
  const std::string& contents() const { return contents_; }

 private:
  std::string contents_;
};

BinaryReader::BinaryReader(const std::filesystem::path& path)
    : path_(path), contents_(ReadFile(path)) {}

void BinaryReader::EnterRecord(std::string_view kind, uint64_t index, uint64_t count) {
  record_kind_ = kind;
  record_index_ = index;
  record_count_ = count;
}

std::string BinaryReader::ReadString(const char* field) {
  const size_t end = contents_.find('\0', position_);
  if (end == std::string::npos) {
    Fail(field, "the file ends here");
  }
  std::string text = contents_.substr(position_, end - position_);
  position_ = end + 1;
  return text;
}

void BinaryReader::ExpectEnd() {
  if (Remaining() > 0) {
    throw InputError(path_, fmt::format("expected the end after {} bytes, found {} more", position_,
                                        Remaining()));
  }
}

void BinaryReader::Fail(const char* field, std::string_view message) const {
  if (record_kind_.empty()) {
    throw InputError(path_, field, message);
  }
  throw InputError(
      path_, fmt::format("{} {} of {}, {}", record_kind_, record_index_ + 1, record_count_, field),
      message);
}

void BinaryReader::CheckCount(const char* field, uint64_t count, size_t bytes_per_item) const {
  if (count > Remaining() / bytes_per_item) {
    Fail(field, fmt::format("the file ends here: {} items of {} bytes each cannot be in the {} "
                            "bytes that are left",
                            count, bytes_per_item, Remaining()));
  }
}

void BinaryReader::FailNotFinite(const char* field, double value) const {
  Fail(field, fmt::format("expected a finite number, found {}", value));
}

// Reads the records of a file into a map; their order is kept where it is not that of the ids.
// The number of records is not trusted: each is read from the bytes that are there.
template <typename Id, typename Record, typename ReadRecord>
void ReadRecords(const std::filesystem::path& path, std::string_view kind,
                 std::map<Id, Record>* records, std::vector<Id>* order, ReadRecord read_record) {
  BinaryReader reader(path);
  const auto count = reader.Read<uint64_t>("number of records");
  bool is_sorted = true;
  for (uint64_t i = 0; i < count; ++i) {
    reader.EnterRecord(kind, i, count);
    const auto id = reader.Read<Id>("id");
    if (!records->empty() && id < records->rbegin()->first) {
      is_sorted = false;
    }
    if (records->contains(id)) {
      reader.Fail("id", fmt::format("{} is the id of an earlier {}, too", id, kind));
    }
    order->push_back(id);
    records->emplace_hint(records->end(), id, read_record(reader));
  }
  reader.ExpectEnd();
  if (is_sorted) {
    order->clear();
  }
}

template <int N>
Eigen::Matrix<double, N, 1> ReadVector(BinaryReader& reader, const char* field) {
  Eigen::Matrix<double, N, 1> vector;
  for (double& x : vector) {
    x = reader.ReadFinite(field);
  }
  return vector;
}

ColmapPose ReadPose(BinaryReader& reader) {
  ColmapPose pose;
  pose.qvec_wxyz = ReadVector<4>(reader, "qvec");
  if (!HasDirection(pose.qvec_wxyz)) {
    reader.Fail("qvec", fmt::format("expected a rotation, found the quaternion {}",
                                    fmt::join(pose.qvec_wxyz, " ")));
  }
  pose.tvec = ReadVector<3>(reader, "tvec");
  return pose;
}

int ReadSide(BinaryReader& reader, const char* field) {
  const auto side = reader.Read<uint64_t>(field);
  if (side == 0 || side > INT_MAX) {
    reader.Fail(field, fmt::format("expected a number of pixels, found {}", side));
  }
  return static_cast<int>(side);
}

Camera ReadCamera(BinaryReader& reader) {
  const auto model_id = reader.Read<int32_t>("model");
  const auto model = CameraModelFromId(model_id);
  if (!model) {
    reader.Fail("model", fmt::format("expected the id of a camera model (0 to {}), found {}",
                                     AllCameraModels().size() - 1, model_id));
  }
  const int width = ReadSide(reader, "width");
  const int height = ReadSide(reader, "height");
  std::vector<double> params(GetCameraModelInfo(*model).num_params);
  for (double& param : params) {
    param = reader.ReadFinite("params");
  }
  try {
    return Camera(*model, width, height, params);
  } catch (const InputError& error) {
    reader.Fail("params", error.what());
  }
}

ColmapImage ReadImage(BinaryReader& reader) {
  ColmapImage image;
  const ColmapPose pose = ReadPose(reader);
  image.qvec_wxyz = pose.qvec_wxyz;
  image.tvec = pose.tvec;
  image.camera_id = reader.Read<uint32_t>("camera id");
  image.name = reader.ReadString("name");
  if (image.name.empty()) {
    reader.Fail("name", "expected a name, found none");
  }
  const auto num_points = reader.ReadCount<uint64_t>("points2D", 24);
  image.points2d.resize(num_points);
  for (ColmapImage::Point2D& point : image.points2d) {
    point.pixel = ReadVector<2>(reader, "points2D");
    const auto id = reader.Read<uint64_t>("points2D");
    if (id != kNoPoint3D) {
      point.point3d_id = id;
    }
  }
  return image;
}

ColmapPoint3D ReadPoint3D(BinaryReader& reader) {
  ColmapPoint3D point;
  point.position_in_world = ReadVector<3>(reader, "xyz");
  for (uint8_t& channel : point.color_rgb) {
    channel = reader.Read<uint8_t>("rgb");
  }
  point.error_px = reader.Read<double>("error");
  const auto length = reader.ReadCount<uint64_t>("track", 8);
  point.track.resize(length);
  for (ColmapPoint3D::Observation& observation : point.track) {
    observation.image_id = reader.Read<uint32_t>("track");
    observation.point2d_index = reader.Read<uint32_t>("track");
  }
  return point;
}

ColmapSensor ReadSensor(BinaryReader& reader) {
  ColmapSensor sensor;
  sensor.type = reader.Read<int32_t>("sensor type");
  if (sensor.type != 0 && sensor.type != 1) {
    reader.Fail("sensor type",
                fmt::format("expected 0 (camera) or 1 (IMU), found {}", sensor.type));
  }
  sensor.id = reader.Read<uint32_t>("sensor id");
  return sensor;
}

ColmapRig ReadRig(BinaryReader& reader) {
  ColmapRig rig;
  const auto num_sensors = reader.ReadCount<uint32_t>("number of sensors", 8);
  if (num_sensors == 0) {
    return rig;
  }
  rig.reference_sensor = ReadSensor(reader);
  for (uint32_t i = 1; i < num_sensors; ++i) {
    const ColmapSensor sensor = ReadSensor(reader);
    const bool has_pose = reader.Read<uint8_t>("has pose") != 0;
    rig.sensors.emplace_back(sensor, has_pose ? std::optional(ReadPose(reader)) : std::nullopt);
  }
  return rig;
}

ColmapFrame ReadFrame(BinaryReader& reader) {
  ColmapFrame frame;
  frame.rig_id = reader.Read<uint32_t>("rig id");
  frame.rig_from_world = ReadPose(reader);
  const auto num_data = reader.ReadCount<uint32_t>("data ids", 16);
  frame.data.resize(num_data);
  for (ColmapFrame::Data& data : frame.data) {
    data.sensor = ReadSensor(reader);
    data.data_id = reader.Read<uint64_t>("data ids");
  }
  return frame;
}

template <typename Id, typename Record, typename WriteRecord>
void WriteRecords(const std::filesystem::path& path, const std::map<Id, Record>& records,
                  const std::vector<Id>& order, WriteRecord write_record) {
  BinaryWriter writer;
  writer.Write<uint64_t>(records.size());
  for (const Id id : IdsInOrder(records, order)) {
    writer.Write<Id>(id);
    write_record(writer, records.at(id));
  }
  WriteFile(path, writer.contents());
}

template <typename Vector>
void WriteVector(BinaryWriter& writer, const Vector& vector) {
  for (const double x : vector) {
    writer.Write<double>(x);
  }
}

void WritePose(BinaryWriter& writer, const Eigen::Vector4d& qvec, const Eigen::Vector3d& tvec) {
  WriteVector(writer, qvec);
  WriteVector(writer, tvec);
}

void WriteCamera(BinaryWriter& writer, const Camera& camera) {
  writer.Write<int32_t>(static_cast<int32_t>(camera.model()));
  writer.Write<uint64_t>(static_cast<uint64_t>(camera.width_px()));
  writer.Write<uint64_t>(static_cast<uint64_t>(camera.height_px()));
  WriteVector(writer, camera.params());
}

void WriteImage(BinaryWriter& writer, const ColmapImage& image) {
  WritePose(writer, image.qvec_wxyz, image.tvec);
  writer.Write<uint32_t>(image.camera_id);
  writer.WriteString(image.name);
  writer.Write<uint64_t>(image.points2d.size());
  for (const ColmapImage::Point2D& point : image.points2d) {
    WriteVector(writer, point.pixel);
    writer.Write<uint64_t>(point.point3d_id.value_or(kNoPoint3D));
  }
}

void WritePoint3D(BinaryWriter& writer, const ColmapPoint3D& point) {
  WriteVector(writer, point.position_in_world);
  for (const uint8_t channel : point.color_rgb) {
    writer.Write<uint8_t>(channel);
  }
  writer.Write<double>(point.error_px);
  writer.Write<uint64_t>(point.track.size());
  for (const ColmapPoint3D::Observation& observation : point.track) {
    writer.Write<uint32_t>(observation.image_id);
    writer.Write<uint32_t>(observation.point2d_index);
  }
}

void WriteSensor(BinaryWriter& writer, const ColmapSensor& sensor) {
  writer.Write<int32_t>(sensor.type);
  writer.Write<uint32_t>(sensor.id);
}

void WriteRig(BinaryWriter& writer, const ColmapRig& rig) {
  if (!rig.reference_sensor) {
    writer.Write<uint32_t>(0);
    return;
  }
  writer.Write<uint32_t>(static_cast<uint32_t>(rig.sensors.size() + 1));
  WriteSensor(writer, *rig.reference_sensor);
  for (const auto& [sensor, sensor_from_rig] : rig.sensors) {
    WriteSensor(writer, sensor);
    writer.Write<uint8_t>(sensor_from_rig ? 1 : 0);
    if (sensor_from_rig) {
      WritePose(writer, sensor_from_rig->qvec_wxyz, sensor_from_rig->tvec);
    }
  }
}

void WriteFrame(BinaryWriter& writer, const ColmapFrame& frame) {
  writer.Write<uint32_t>(frame.rig_id);
  WritePose(writer, frame.rig_from_world.qvec_wxyz, frame.rig_from_world.tvec);
  writer.Write<uint32_t>(static_cast<uint32_t>(frame.data.size()));
  for (const ColmapFrame::Data& data : frame.data) {
    WriteSensor(writer, data.sensor);
    writer.Write<uint64_t>(data.data_id);
  }
}

}  // namespace

void ReadBinary(std::string_view file, const std::filesystem::path& path, ColmapModel* model) {
  const auto read = [&](std::string_view kind, auto& records, auto& order, auto read_record) {
    ReadRecords(path, kind, &records, &order, read_record);
  };
  if (file == kCameras) read("camera", model->cameras, model->camera_order, ReadCamera);
  if (file == kImages) read("image", model->images, model->image_order, ReadImage);
  if (file == kPoints3D) read("point", model->points3d, model->point3d_order, ReadPoint3D);
  if (file == kRigs) read("rig", model->rigs, model->rig_order, ReadRig);
  if (file == kFrames) read("frame", model->frames, model->frame_order, ReadFrame);
}

void WriteBinary(std::string_view file, const std::filesystem::path& path,
                 const ColmapModel& model) {
  if (file == kCameras) WriteRecords(path, model.cameras, model.camera_order, WriteCamera);
  if (file == kImages) WriteRecords(path, model.images, model.image_order, WriteImage);
  if (file == kPoints3D) WriteRecords(path, model.points3d, model.point3d_order, WritePoint3D);
  if (file == kRigs) WriteRecords(path, model.rigs, model.rig_order, WriteRig);
  if (file == kFrames) WriteRecords(path, model.frames, model.frame_order, WriteFrame);
}

}  // namespace raylift::colmap
