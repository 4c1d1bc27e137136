// Depth maps that numpy, OpenCV and OpenEXR's tools wrote, and ours read by them.

#include "io/depth_test_files.h"
#include "support/matchers.h"

#include "raylift/io/depth_file.h"

namespace raylift {
namespace {

#define SKIP_WITHOUT_NUMPY() \
  if (!HasNumpyAndOpenCv()) GTEST_SKIP() << "python3 with numpy and cv2 is not on this machine"

TEST(DepthFromNumpy, EverySampleTypeByteOrderAndArrayOrderReads) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  const std::string names = RunNumpy(folder, R"(
for code in 'f2 f4 f8 u1 u2 u4 u8 i1 i2 i4 i8'.split():
  for order in '<>':
    for layout in 'CF':
      name = f'{code}{"big" if order == ">" else "little"}{layout}.npy'
      np.save(name, np.array(ramp, dtype=order + code, order=layout))
      print(name)
)");
  int count = 0;
  for (size_t begin = 0; begin < names.size();) {
    const size_t end = names.find('\n', begin);
    const std::string name = names.substr(begin, end - begin);
    EXPECT_TRUE(IsRamp(ReadDepthFile(folder / name))) << name;
    begin = end + 1;
    ++count;
  }
  EXPECT_EQ(count, 44);
}

TEST(DepthFromNumpy, SidesOfOneAreNoSides) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
for i, shape in enumerate([(5, 7, 1), (1, 5, 7), (1, 1, 5, 7), (1, 5, 7, 1)]):
  np.save(f'{i}.npy', np.asfortranarray(ramp.astype('f4').reshape(shape)))
np.save('three.npy', np.zeros((5, 7, 3)))
np.save('flat.npy', np.zeros(35))
np.save('column.npy', np.zeros((35, 1)))
)");
  for (const char* name : {"0.npy", "1.npy", "2.npy", "3.npy"}) {
    EXPECT_TRUE(IsRamp(ReadDepthFile(folder / name))) << name;
  }
  for (const char* name : {"three.npy", "flat.npy"}) {
    EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / name); },
                                    {name, "expected one value per pixel", "(height, width)"}));
  }
  EXPECT_EQ(ReadDepthFile(folder / "column.npy").height_px, 35);
}

TEST(DepthFromNumpy, ArraysThatAreNoNumbersAreRefused) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
np.save('object.npy', ramp.astype(object))
np.save('text.npy', ramp.astype('U3'))
np.save('complex.npy', ramp.astype('c8'))
np.save('record.npy', np.zeros((5, 7), dtype=[('z', 'f4')]))
)");
  for (const char* name : {"object.npy", "text.npy", "complex.npy", "record.npy"}) {
    EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / name); },
                                    {name, "NPY header", "expected numbers"}));
  }
}

TEST(DepthFromNumpy, ArchivesReadStoredDeflatedAndZip64) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
import zipfile
np.savez('stored.npz', depth=ramp, other=np.ones((2, 2)))
np.savez_compressed('deflated.npz', depth=ramp.astype('f2'))
np.savez('single.npz', ramp.astype('f4'))
np.savez('two.npz', a=ramp, b=ramp)
class Streaming:
  def __init__(self, f): self.f = f
  def write(self, data): return self.f.write(data)
  def flush(self): self.f.flush()
with open('zip64.npz', 'wb') as f:
  with zipfile.ZipFile(Streaming(f), 'w', zipfile.ZIP_DEFLATED) as z:
    with z.open('depth.npy', 'w', force_zip64=True) as entry:
      np.lib.format.write_array(entry, ramp.astype('>f4'))
)");
  for (const char* name : {"stored.npz", "deflated.npz", "single.npz", "zip64.npz"}) {
    EXPECT_TRUE(IsRamp(ReadDepthFile(folder / name))) << name;
  }
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "two.npz"); },
                                  {"two.npz", "expected an array \"depth\", found a, b"}));
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "two.npz", {.layer = "b"})));
}

TEST(DepthFromNumpy, GzippedArraysReadMemberByMember) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
import gzip, io
with gzip.open('a.npy.gz', 'wb') as f: np.save(f, ramp.astype('f4')[..., None])
data = io.BytesIO(); np.save(data, ramp); data = data.getvalue()
with open('two.npy.gz', 'wb') as f: f.write(gzip.compress(data[:50]) + gzip.compress(data[50:]))
)");
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.npy.gz")));
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "two.npy.gz")));
  EXPECT_EQ(ReadDepthFile(folder / "a.npy.gz").format, DepthFileFormat::kNpyGz);
}

TEST(DepthFromNumpy, PfmReadsInBothByteOrdersBottomUp) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
for name, order, scale in [('little', '<', '-1.0'), ('big', '>', '1.0'), ('scaled', '<', '-2.5')]:
  with open(name + '.pfm', 'wb') as f:
    f.write(b'Pf\n7 5\n' + scale.encode() + b'\n' + ramp[::-1].astype(order + 'f4').tobytes())
cv2.imwrite('opencv.pfm', ramp.astype('f4'))
)");
  for (const char* name : {"little.pfm", "big.pfm", "scaled.pfm", "opencv.pfm"}) {
    EXPECT_TRUE(IsRamp(ReadDepthFile(folder / name))) << name;
  }
  EXPECT_EQ(ReadDepthFile(folder / "scaled.pfm").declared_scale, 2.5);
}

TEST(DepthFromNumpy, ColmapMapsReadAsColmapsScriptWritesThem) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
with open('a.jpg.geometric.bin', 'wb') as f:
  f.write(b'7&5&1&'); f.write(ramp.astype('<f4').tobytes())
with open('normals.bin', 'wb') as f:
  f.write(b'7&5&3&'); f.write(np.zeros(105, 'f4').tobytes())
)");
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.jpg.geometric.bin")));
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "normals.bin"); },
                                  {"normals.bin", "one channel, found 3 (normals)"}));
}

TEST(DepthFromOpenCv, PngTiffAndPgmReadInEverySampleType) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
cv2.imwrite('u16.png', ramp.astype('u2')); cv2.imwrite('u8.png', ramp.astype('u1'))
cv2.imwrite('u16.pgm', ramp.astype('u2')); cv2.imwrite('u8.pgm', ramp.astype('u1'))
for code, t in [('u8', 'u1'), ('u16', 'u2'), ('f32', 'f4'), ('f64', 'f8')]:
  cv2.imwrite(code + '.tiff', ramp.astype(t))
# A big-endian TIFF of 16 bits and a big one (64-bit offsets) of floats.
def tiff(name, order, bits, form, data, big):
  tags = [(256, 7), (257, 5), (258, bits), (259, 1), (262, 1), (273, 0), (277, 1), (278, 5),
          (279, len(data)), (339, form)]
  start = 16 if big else 8
  size = 8 + len(tags) * 20 + 8 if big else 2 + len(tags) * 12 + 4
  out = (b'MM' if order == '>' else b'II')
  out += struct.pack(order + 'HHHQ', 43, 8, 0, start) if big else struct.pack(order + 'HI', 42, start)
  out += struct.pack(order + ('Q' if big else 'H'), len(tags))
  for tag, value in tags:
    if tag == 273: value = start + size
    out += struct.pack(order + ('HHQQ' if big else 'HHII'), tag, 16 if big else 4, 1, value)
  open(name, 'wb').write(out + struct.pack(order + ('Q' if big else 'I'), 0) + data)
tiff('big_endian.tif', '>', 16, 1, ramp.astype('>u2').tobytes(), False)
tiff('big_tiff.tif', '<', 32, 3, ramp.astype('<f4').tobytes(), True)
# As skimage and tifffile write numpy's integers (tags 258 and 339).
for order in '<>':
  tiff('i32' + order + '.tif', order, 32, 2, ramp.astype(order + 'i4').tobytes(), False)
  tiff('u32' + order + '.tif', order, 32, 1, ramp.astype(order + 'u4').tobytes(), order == '<')
tiff('i16.tif', '<', 16, 2, ramp.astype('<i2').tobytes(), False)
)");
  for (const char* name : {"u16.png", "u8.png", "u16.pgm", "u8.pgm", "u8.tiff", "u16.tiff",
                           "f32.tiff", "f64.tiff", "big_endian.tif", "big_tiff.tif", "i32<.tif",
                           "i32>.tif", "u32<.tif", "u32>.tif", "i16.tif"}) {
    EXPECT_TRUE(IsRamp(ReadDepthFile(folder / name))) << name;
  }
  EXPECT_EQ(ReadDepthFile(folder / "u8.png").sample_type, "uint8");
  EXPECT_EQ(ReadDepthFile(folder / "f64.tiff").sample_type, "float64");
  EXPECT_EQ(ReadDepthFile(folder / "u32>.tif").sample_type, "int32");
}

TEST(DepthFromOpenCv, PicturesThatAreNoDepthAreRefused) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
color = np.zeros((5, 7, 3), 'u1')
cv2.imwrite('color.png', color); cv2.imwrite('color.tiff', color)
cv2.imwrite('photo.jpg', color); cv2.imwrite('s16.tiff', ramp.astype('i2'))
)");
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "color.png"); },
                                  {"color.png", "expected a gray PNG"}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "color.tiff"); },
                                  {"color.tiff", "expected a TIFF of one channel", "found 3"}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "photo.jpg"); },
                                  {"photo.jpg", "expected a depth map (EXR"}));
}

TEST(DepthFromOpenCv, ExrReadsFloatHalfAndColors) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  RunNumpy(folder, R"(
cv2.imwrite('float.exr', ramp.astype('f4'))
cv2.imwrite('half.exr', ramp.astype('f4'), [cv2.IMWRITE_EXR_TYPE, cv2.IMWRITE_EXR_TYPE_HALF])
cv2.imwrite('rgb.exr', np.dstack([0 * ramp, 0 * ramp + 1, ramp]).astype('f4'))
)");
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "float.exr")));
  EXPECT_EQ(ReadDepthFile(folder / "float.exr").sample_type, "float32");
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "half.exr")));
  EXPECT_EQ(ReadDepthFile(folder / "half.exr").sample_type, "float16");
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "rgb.exr")));
  EXPECT_EQ(ReadDepthFile(folder / "rgb.exr").layer, "R");
}

TEST(DepthForOthers, NumpyReadsArraysAndArchives) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  WriteDepthFile(folder / "a.npy", MakeRamp());
  WriteDepthFile(folder / "half.npy", MakeRamp(), {.sample = FloatSample::kFloat16});
  WriteDepthFile(folder / "a.npz", MakeRamp());
  WriteDepthFile(folder / "b.npz", MakeRamp(),
                 {.sample = FloatSample::kFloat16, .deflate_npz = true});
  WriteDepthFile(folder / "a.bin", MakeRamp());
  EXPECT_EQ(RunNumpy(folder, R"(
a = np.load('a.npy'); assert a.dtype == '<f4' and (a == ramp).all()
a = np.load('half.npy'); assert a.dtype == '<f2' and (a == ramp).all()
a = np.load('a.npz'); assert a.files == ['depth'] and (a['depth'] == ramp).all()
a = np.load('b.npz'); assert a['depth'].dtype == '<f2' and (a['depth'] == ramp).all()
data = open('a.bin', 'rb').read()
assert data[:6] == b'7&5&1&' and (np.frombuffer(data[6:], '<f4').reshape(5, 7) == ramp).all()
assert open('a.npy', 'rb').read(128).index(b'\n') % 64 == 63
print('ok'))"),
            "ok\n");
}

TEST(DepthForOthers, OpenCvReadsPicturesAndExrOfEveryCompression) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  WriteDepthFile(folder / "a.png", MakeRamp(), {.png_step = 0.5});
  WriteDepthFile(folder / "a.tiff", MakeRamp());
  WriteDepthFile(folder / "a.pfm", MakeRamp());
  for (const char* name : {"pxr24", "zip", "zips", "piz", "dwaa", "none"}) {
    for (const FloatSample sample : {FloatSample::kFloat32, FloatSample::kFloat16}) {
      WriteDepthFile(
          folder / (std::string(name) + (sample == FloatSample::kFloat16 ? "_half.exr" : ".exr")),
          MakeRamp(),
          {.sample = sample, .exr_compression = FromName<ExrCompression>(name).value()});
    }
  }
  EXPECT_EQ(RunNumpy(folder, R"(
import glob
a = cv2.imread('a.png', -1); assert a.dtype == 'u2' and (a == 2 * ramp).all()
a = cv2.imread('a.tiff', -1); assert a.dtype == 'f4' and (a == ramp).all()
a = cv2.imread('a.pfm', -1); assert a.dtype == 'f4' and (a == ramp).all()
files = glob.glob('*.exr'); assert len(files) == 12
for f in files:
  a = cv2.imread(f, -1)
  assert np.abs(a - ramp).max() <= (0.5 if 'dwaa' in f else 0), (f, a)
print('ok'))"),
            "ok\n");
}

TEST(DepthForOthers, OpenCvReadsNormalsAndDepthAsItIsTold) {
  SKIP_WITHOUT_NUMPY();
  const auto folder = TestFolder();
  WriteDepthFile(folder / "a.exr", MakeRamp());
  std::vector<float> normals;
  for (const float z : MakeRamp().z) normals.insert(normals.end(), {z, 0.5f, -1.0f});
  WriteVectorMap(folder / "n.exr", {7, 5}, normals);
  EXPECT_EQ(RunNumpy(folder, R"(
for flags in (cv2.IMREAD_UNCHANGED, cv2.IMREAD_ANYDEPTH, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE):
  a = cv2.imread('a.exr', flags); assert a.dtype == 'f4' and (a == ramp).all(), (flags, a)
n = cv2.imread('n.exr', cv2.IMREAD_UNCHANGED)[..., ::-1]
assert (n[..., 0] == ramp).all() and (n[..., 1] == 0.5).all() and (n[..., 2] == -1).all(), n
print('ok'))"),
            "ok\n");
}

TEST(DepthFile, FilesWithAChannelZAreReadAsBefore) {
  const auto path = TestFolder() / "a.exr";
  WriteDepthFile(path, MakeRamp(), {.layer = "Z"});
  EXPECT_TRUE(IsRamp(ReadDepthFile(path)));
  EXPECT_TRUE(IsRamp(ReadDepthFile(path, {.layer = "Z"})));
}

TEST(DepthForOthers, OpenExrsToolsSeeTheChannelAndTheCompression) {
  if (!HasProgram("exrinfo")) GTEST_SKIP() << "OpenEXR's tools are not on this machine";
  const auto path = TestFolder() / "a.exr";
  WriteDepthFile(path, MakeRamp());
  // OpenEXR 3.1's exrinfo returns a number that it never sets.
  const std::string info = RunProgram("exrinfo " + path.string() + " || true");
  EXPECT_NE(info.find("'pxr24'"), std::string::npos) << info;
  EXPECT_NE(info.find("'Y': float"), std::string::npos) << info;
  EXPECT_NE(info.find("7 x 5"), std::string::npos) << info;
}

TEST(DepthFromOpenExrsTools, PartsAndTilesRead) {
  if (!HasProgram("exrmultipart")) GTEST_SKIP() << "OpenEXR's tools are not on this machine";
  const auto folder = TestFolder();
  DepthMap ones = MakeRamp();
  for (float& z : ones.z) z = 1;
  const std::string a = (folder / "a.exr").string();
  const std::string b = (folder / "b.exr").string();
  const std::string both = (folder / "both.exr").string();
  const std::string tiled = (folder / "tiled.exr").string();
  WriteDepthFile(a, ones, {.layer = "A"});
  WriteDepthFile(b, MakeRamp());
  RunProgram("exrmultipart -combine -i " + a + " " + b + " -o " + both);
  RunProgram("exrmaketiled -t 4 4 " + b + " " + tiled);
  EXPECT_TRUE(IsRamp(ReadDepthFile(both)));
  EXPECT_EQ(ReadDepthFile(both).layer, "b.Y");
  EXPECT_TRUE(IsRamp(ReadDepthFile(both, {.layer = "b.Y"})));
  EXPECT_EQ(ReadDepthFile(both, {.layer = "A"}).values[0], 1);
  EXPECT_TRUE(IsRamp(ReadDepthFile(tiled)));
}

}  // namespace
}  // namespace raylift
