#include <array>
#include <cmath>
#include <cstring>

#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/image_file.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

// A frame of a sphere before nothing, with all maps.
Frame RenderSphere(FrameOptions options = {}) {
  const auto caster = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 4}, 1, 40, 80)));
  std::vector<ProductOutput> all;
  for (const Product product : AllValues<Product>()) all.push_back({product, ""});
  Request(all, options);
  const double params[] = {40, 40, 16, 12};
  Frame frame;
  FrameRenderer(caster, options)
      .Render(PixelRays(Camera(CameraModel::kPinhole, 33, 25, params), 1), Rigid3(), 1, frame);
  return frame;
}

const std::vector<float>& FloatsOf(const Frame& frame, Product product) {
  return product == Product::kDepth      ? frame.depth
         : product == Product::kDistance ? frame.distance
                                         : frame.incidence_deg;
}

TEST(Product, HasANameAndFormats) {
  EXPECT_TRUE(NamesEveryValue<Product>());
  for (const Product product : AllValues<Product>()) {
    EXPECT_FALSE(FormatsOf(product).empty());
  }
}

TEST(Product, FloatsComeBackFromEveryFormat) {
  const auto folder = TestFolder();
  const Frame frame = RenderSphere();
  for (const Product product : {Product::kDepth, Product::kDistance, Product::kIncidence}) {
    const std::vector<float>& expected = FloatsOf(frame, product);
    for (const std::string_view format : FormatsOf(product)) {
      const auto file = folder / (std::string(ToString(product)) + "." + std::string(format));
      const WrittenFile written = WriteProduct(file, {product, std::string(format)}, frame, {}, {});
      EXPECT_EQ(written.bytes, std::filesystem::file_size(file));
      EXPECT_EQ(written.dropped, 0u);
      const StoredDepth stored = ReadDepthFile(file);
      ASSERT_EQ(stored.width_px, 33);
      ASSERT_EQ(stored.height_px, 25);
      const float unit = format == "png" ? 0.001f : 1.0f;
      for (size_t i = 0; i < expected.size(); ++i) {
        // PXR24 keeps 16 bits of the mantissa; PNG half a step.
        ASSERT_NEAR(stored.values[i] * unit, expected[i],
                    format == "png" ? 0.00051 : std::abs(expected[i]) * 0x1p-16)
            << file << " " << i;
      }
    }
  }
}

TEST(Product, PointsAndInverseDepthAreThoseOfTheDepth) {
  const Frame frame = RenderSphere();
  ASSERT_EQ(frame.points.size(), 3 * frame.depth.size());
  const std::vector<float> inverse = InverseDepths(frame);
  for (size_t i = 0; i < frame.depth.size(); ++i) {
    const double z = frame.depth[i];
    const Eigen::Map<const Eigen::Vector3f> point(&frame.points[3 * i]);
    if (z == 0) {
      EXPECT_TRUE(point.array().isNaN().all());
      EXPECT_EQ(inverse[i], 0);
      continue;
    }
    EXPECT_NEAR(inverse[i] * z, 1, 1e-6);
    // The camera stands at the origin.
    const Eigen::Vector3d expected((static_cast<double>(i % 33) + 0.5 - 16) / 40 * z,
                                   (static_cast<double>(i / 33) + 0.5 - 12) / 40 * z, z);
    EXPECT_LT((point.cast<double>() - expected).norm(), 1e-5 * z);
  }
  const auto file = TestFolder() / "points.npy";
  WriteProduct(file, {Product::kPoints, "npy"}, frame, {}, {});
  const std::string bytes = ReadFile(file);
  const size_t data = frame.points.size() * sizeof(float);
  EXPECT_EQ(std::memcmp(bytes.data() + bytes.size() - data, frame.points.data(), data), 0);
}

// One point of a cloud, as its rows are.
struct CloudRow {
  Eigen::Vector3d point;
  Eigen::Vector3f normal;
  std::array<uint8_t, 3> rgb;
};

std::vector<CloudRow> ReadCloudRows(const std::filesystem::path& file) {
  const std::string bytes = ReadFile(file);
  constexpr size_t kRowBytes = 39;
  const std::string_view end = "end_header\n";
  std::vector<CloudRow> rows;
  for (size_t i = bytes.find(end) + end.size(); i + kRowBytes <= bytes.size(); i += kRowBytes) {
    CloudRow& row = rows.emplace_back();
    std::memcpy(row.point.data(), &bytes[i], 24);
    std::memcpy(row.normal.data(), &bytes[i + 24], 12);
    std::memcpy(row.rgb.data(), &bytes[i + 36], 3);
  }
  EXPECT_NE(bytes.find("element vertex " + std::to_string(rows.size()) + "\n"), std::string::npos);
  return rows;
}

TEST(Product, ACloudHasTheSurfacesPointsWhereCoordinatesAreLarge) {
  const ProductOutput output{Product::kPoints, "ply"};
  const Eigen::Vector3d center(5e5, 5.4e6, 100);
  TriangleMesh mesh = MakeSphere({0, 0, 0}, 1, 40, 80);
  mesh.origin_in_world = center;
  const double params[] = {40, 40, 16, 12};
  const Rigid3 cam_from_world = LookAt(center + Eigen::Vector3d(2, 1, -3), center);
  for (const auto normals_in :
       {FrameOptions::NormalsIn::kWorld, FrameOptions::NormalsIn::kCamera}) {
    FrameOptions options;
    options.normals_in = normals_in;
    options.color_options.untextured_rgb = {10, 20, 30};
    Request(std::span(&output, 1), options);
    Frame frame;
    FrameRenderer(std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(mesh)),
                  options)
        .Render(PixelRays(Camera(CameraModel::kPinhole, 33, 25, params), 1), cam_from_world, 1,
                frame);
    const auto file = TestFolder() / "cloud.ply";
    const WrittenFile written = WriteProduct(file, output, frame, mesh, {});
    EXPECT_EQ(written.bytes, std::filesystem::file_size(file));
    const std::vector<CloudRow> rows = ReadCloudRows(file);
    ASSERT_EQ(rows.size(), frame.num_hits);
    ASSERT_GT(rows.size(), 100u);
    const bool world = normals_in == FrameOptions::NormalsIn::kWorld;
    const Eigen::Vector3d middle = world ? center : cam_from_world * center;
    for (const CloudRow& row : rows) {
      // The facets lie up to 0.4 % within the sphere; floats of the coordinates would err by 0.25.
      const Eigen::Vector3d out = row.point - middle;
      ASSERT_NEAR(out.norm(), 0.998, 0.0021);
      ASSERT_GT(out.normalized().dot(row.normal.cast<double>()), 0.996);
      ASSERT_EQ(row.rgb, (std::array<uint8_t, 3>{10, 20, 30}));
    }
  }
}

TEST(Product, NormalsComeBackFromEveryFormat) {
  const auto folder = TestFolder();
  const Frame frame = RenderSphere();
  for (const std::string format : {"npy", "npz", "bin"}) {
    const auto file = folder / ("normals." + format);
    WriteProduct(file, {Product::kNormals, format}, frame, {}, {});
    const std::string bytes = ReadFile(file);
    const size_t data_bytes = frame.normals.size() * sizeof(float);
    EXPECT_GT(bytes.size(), data_bytes);
    if (format == "npz") continue;
    std::vector<float> values(frame.normals.size());
    std::memcpy(values.data(), bytes.data() + bytes.size() - data_bytes, data_bytes);
    const size_t pixels = values.size() / 3;
    for (size_t i = 0; i < pixels; ++i) {
      for (size_t c = 0; c < 3; ++c) {
        const float value = format == "npy" ? values[3 * i + c] : values[c * pixels + i];
        ASSERT_EQ(value, frame.normals[3 * i + c]) << format;
      }
    }
  }
  const auto exr = folder / "normals.exr";
  WriteProduct(exr, {Product::kNormals, "exr"}, frame, {}, {});
  const std::array<std::string, 3> layers = {"R", "G", "B"};
  for (size_t c = 0; c < 3; ++c) {
    const StoredDepth stored = ReadDepthFile(exr, {.layer = layers[c]});
    for (size_t i = 0; i < stored.values.size(); ++i) {
      ASSERT_NEAR(stored.values[i], frame.normals[3 * i + c], 0x1p-16);
    }
  }
  const auto png = folder / "normals.png";
  WriteProduct(png, {Product::kNormals, "png"}, frame, {}, {});
  const Image picture = ReadImage(png, ImageChannels::kRgb);
  EXPECT_EQ(picture.Pixel(0, 0)[0], 128);  // nothing there
  EXPECT_LT(picture.Pixel(16, 12)[2], 3);  // straight at the camera, -z
}

TEST(Product, TriangleIdsComeBackExactly) {
  const auto folder = TestFolder();
  Frame frame = RenderSphere();
  frame.triangle[0] = 16777217;  // no float
  for (const std::string format : {"exr", "npy", "npz"}) {
    const auto file = folder / ("triangle." + format);
    WriteProduct(file, {Product::kTriangle, format}, frame, {}, {});
    if (format == "npy") {
      const std::string bytes = ReadFile(file);
      const size_t data_bytes = frame.triangle.size() * sizeof(uint32_t);
      std::vector<uint32_t> ids(frame.triangle.size());
      std::memcpy(ids.data(), bytes.data() + bytes.size() - data_bytes, data_bytes);
      EXPECT_EQ(ids, frame.triangle);
    }
    const StoredDepth stored = ReadDepthFile(file);
    EXPECT_EQ(stored.sample_type, "uint32");
    for (size_t i = 0; i < stored.values.size(); ++i) {
      ASSERT_EQ(stored.values[i], static_cast<float>(frame.triangle[i])) << format;
    }
  }
}

TEST(Product, IdsAreTheFilesFacesAndTheObjects) {
  const auto folder = TestFolder();
  TriangleMesh mesh;  // two files: faces 0 and 2 of the first one, 1 of the second one
  mesh.triangle_faces = {0, 2, 1};
  mesh.object_begins = {0, 2};
  Frame frame;
  frame.width_px = 4;
  frame.height_px = 1;
  frame.triangle = {1, HitBlock::kNoTriangle, 0, 2};
  const auto written = [&](Product product) {
    const auto file = folder / "ids.npz";
    WriteProduct(file, {product, "npz"}, frame, mesh, {});
    return ReadDepthFile(file).values;
  };
  EXPECT_EQ(written(Product::kTriangle), (std::vector<float>{2, 4294967295.0f, 0, 1}));
  EXPECT_EQ(written(Product::kObject), (std::vector<float>{0, 4294967295.0f, 0, 1}));
}

TEST(Product, ColorAndMaskComeBack) {
  const auto folder = TestFolder();
  FrameOptions options;
  options.color_options.background_rgb = {9, 8, 7};
  const Frame frame = RenderSphere(options);
  WriteProduct(folder / "c.png", {Product::kColor, "png"}, frame, {}, {});
  EXPECT_EQ(ReadImage(folder / "c.png", ImageChannels::kRgb).data, frame.color.data);
  WriteProduct(folder / "m.png", {Product::kMask, "png"}, frame, {}, {});
  EXPECT_EQ(ReadImage(folder / "m.png", ImageChannels::kGray).data, frame.mask.data);
  WriteProduct(folder / "c.jpg", {Product::kColor, "jpg"}, frame, {}, {});
  EXPECT_EQ(ReadImage(folder / "c.jpg", ImageChannels::kRgb).width_px, 33);
}

TEST(Product, DepthBeyondAPngIsRefusedOrDropped) {
  const auto folder = TestFolder();
  const Frame frame = RenderSphere();
  StorageOptions storage;
  storage.floats.png_step = 1e-5;  // up to 0.65
  const auto file = folder / "depth.png";
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        WriteProduct(file, {Product::kDepth, "png"}, frame, {}, storage);
      },
      {file.string()}));
  EXPECT_FALSE(std::filesystem::exists(file));
  storage.floats.out_of_range = DepthWriteOptions::OutOfRange::kDrop;
  EXPECT_EQ(WriteProduct(file, {Product::kDepth, "png"}, frame, {}, storage).dropped,
            frame.num_hits);
}

}  // namespace
}  // namespace raylift
