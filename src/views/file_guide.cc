#include <vector>

#include "views/job_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

constexpr std::string_view kFrame =
    "PRODUCT/NAME.FORMAT, one of each image; NAME is the image's without its extension, or what\n"
    "the pattern made of it. Rows from the top, the first pixel's center at (0.5, 0.5) as in\n"
    "COLMAP. Units are those of mesh and poses. manifest.jsonl lists the files, summary.json has\n"
    "counts, options and warnings. numpy reads NPY and NPZ; OpenCV reads TIFF, PNG, PFM (with\n"
    "IMREAD_UNCHANGED) and JPEG; imageio TIFF, PNG and JPEG; Open3D PNG, JPEG and PLY. EXR is\n"
    "read by the Python package OpenEXR, and by an OpenCV that was built with it (Debian's;\n"
    "PyPI's OpenCV 5 is not): OPENCV_IO_ENABLE_OPENEXR=1, set before.\n";

std::string_view MeaningOf(Product product) {
  switch (product) {
    case Product::kDepth:
      return "z along the camera's optical axis, in scene units. 0: no surface, or one that is\n"
             "  not in front of the image plane (lenses of more than 180 degrees; coverage counts\n"
             "  it, and distance has it). A panorama's depth is the distance.";
    case Product::kDistance:
      return "from the camera's center along the ray, in scene units. 0: no surface.";
    case Product::kInverseDepth:
      return "1 / depth, in 1 / scene units: the disparity of stereo over baseline and focal\n"
             "  length. 0: no surface.";
    case Product::kPoints:
      return "x, y, z of the surface's point, in scene units. As float: where coordinates are\n"
             "  large (1e6 and more) ask for those of the camera, or for PLY. NaN: no surface.";
    case Product::kNormals:
      return "x, y, z of the surface's unit normal, on the side that the camera sees. 0, 0, 0: no\n"
             "  surface.";
    case Product::kColor:
      return "RGB, 8 bits; the background where there is no surface.";
    case Product::kTriangle:
      return "which face of the mesh's file, counted from 0 (parts of a cut polygon share its\n"
             "  number; where several meshes are one scene, object says of which). 4294967295: no\n"
             "  surface.";
    case Product::kObject:
      return "which mesh, counted from 0 in the order they were given in (a folder's by name).\n"
             "  4294967295: no surface.";
    case Product::kInstance:
      return "which part of the meshes' files, counted from 0: a node of glTF and others, an "
             "object\n"
             "  and group of OBJ, an object of a city model; instance.txt says what ids are "
             "called.\n"
             "  4294967295: no surface, or one without a name.";
    case Product::kSemantic:
      return "which material or, of a city model, kind of surface, counted from 0 by name; or the\n"
             "  id of the table of semantics. semantic.txt says what ids are called. 4294967295: "
             "no\n"
             "  surface, or one without a name.";
    case Product::kIncidence:
      return "angle between the ray and the normal in degrees: 0 seen from straight ahead, 90\n"
             "  grazing. -1: no surface.";
    case Product::kMask:
      return "255: a surface, 0: none.";
  }
  RAYLIFT_CHECK(false);
}

std::string ArrayText(Product product, const StorageOptions& storage) {
  const std::string_view shape = IsVector(product) ? "(height, width, 3)" : "(height, width)";
  const bool half = storage.floats.sample == FloatSample::kFloat16;
  return fmt::format("{} {}", IsId(product) ? "uint32" : half ? "float16" : "float32", shape);
}

std::string KeyOf(Product product) { return IsId(product) ? "id" : std::string(ToString(product)); }

std::string ExrText(Product product, const StorageOptions& storage) {
  const bool several = IsVector(product);
  const std::string_view type = IsId(product)                                    ? "uint32"
                                : storage.floats.sample == FloatSample::kFloat16 ? "float16"
                                                                                 : "float32";
  std::string text =
      fmt::format("channel{} {}, {}", several ? "s" : "", ExrChannels(product), type);
  if (IsId(product)) return text + ", exactly; OpenCV reads no whole numbers: take npy";
  if (storage.floats.exr_compression == ExrCompression::kPxr24 &&
      storage.floats.sample != FloatSample::kFloat16) {
    text += ", 24 bits of it (pxr24: 2^-16 of the value)";
  }
  return several ? text + ": x, y, z (in OpenCV z, y, x)" : text;
}

std::string PngText(Product product, const StorageOptions& storage) {
  if (IsId(product)) return "16 bits, ids up to 65534; 65535: none";
  if (product == Product::kColor) return "8 bits, RGB";
  if (product == Product::kMask) return "8 bits, gray";
  if (product == Product::kNormals) {
    return "to look at: (n + 1) * 127.5 in 8 bits as RGB, 128 where there is none";
  }
  return fmt::format("16 bits: value times {} (the step) is in scene units",
                     FormatDouble(storage.floats.png_step));
}

std::string FormatText(Product product, const std::string& format, const StorageOptions& storage) {
  if (format == "exr") return ExrText(product, storage);
  if (format == "npy") return "an array " + ArrayText(product, storage);
  if (format == "npz")
    return fmt::format("key \"{}\": {}", KeyOf(product), ArrayText(product, storage));
  if (format == "png") return PngText(product, storage);
  if (format == "jpg") return "8 bits, RGB, lossy";
  if (format == "ply") {
    return "a cloud of the surface's points alone: x, y, z in double, normals (nx, ny, nz) in\n"
           "  float32, colors in 8 bits";
  }
  if (format == "bin") {
    return product == Product::kNormals
               ? "COLMAP's: \"width&height&3&\", then float32, all x, all y, all z"
               : "COLMAP's: \"width&height&1&\", then float32";
  }
  if (format == "pfm") return "float32, gray; as in all PFM files the lowest row is the first";
  return "float32, gray";  // tiff
}

std::string Guide(std::span<const ProductOutput> outputs, const StorageOptions& storage,
                  std::string_view normals_frame) {
  std::string text = fmt::format("{}\n\n{}", kFileGuideTitle, kFrame);
  const ProductOutput* before = nullptr;
  for (const ProductOutput& output : outputs) {
    if (before == nullptr || before->product != output.product) {
      text += fmt::format("\n{}: {}\n", ToString(output.product), MeaningOf(output.product));
      if (IsVector(output.product)) text += fmt::format("  In {}.\n", normals_frame);
    }
    text += fmt::format("  .{}: {}\n", output.format,
                        FormatText(output.product, output.format, storage));
    before = &output;
  }
  return text;
}

}  // namespace

std::string FileGuide(std::span<const ProductOutput> outputs, const StorageOptions& storage,
                      FrameOptions::NormalsIn normals_in) {
  return Guide(outputs, storage,
               normals_in == FrameOptions::NormalsIn::kCamera
                   ? "the camera's frame: x right, y down, z ahead"
                   : "the world's frame, that of the poses");
}

std::string FileGuide() {
  std::vector<ProductOutput> all;
  for (const Product product : AllValues<Product>()) {
    for (const std::string_view format : FormatsOf(product)) {
      all.push_back({product, std::string(format)});
    }
  }
  return Guide(all, {}, "the world's frame, or in the camera's, as asked for");
}

}  // namespace raylift
