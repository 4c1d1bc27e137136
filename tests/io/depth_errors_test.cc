// Depth map files that are truncated, damaged or lie about their size.

#include <array>
#include <cstdint>
#include <cstring>

#include "io/depth_test_files.h"
#include "support/matchers.h"
#include <zlib.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

const std::string kName = "liar";

void ExpectRefused(std::string bytes, const std::vector<std::string>& parts) {
  std::vector<std::string> all = parts;
  all.insert(all.begin(), kName);
  EXPECT_TRUE(FailsWithInputError([&] { ParseDepthFile(kName, bytes); }, all));
}

std::string NpyBytes(const std::string& header, const std::string& data) {
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xff);
  bytes += static_cast<char>(header.size() >> 8);
  return bytes + header + data;
}

std::string BytesOf(const std::string& extension) {
  const auto path = TestFolder() / ("a" + extension);
  WriteDepthFile(path, MakeRamp(), {.deflate_npz = true, .png_step = 0.01});
  return ReadFile(path);
}

template <typename T>
void Overwrite(std::string& bytes, size_t offset, T value) {
  ASSERT_LE(offset + sizeof(T), bytes.size());
  std::memcpy(bytes.data() + offset, &value, sizeof(T));
}

// Little endian, 32-bit floats, not compressed, of which there are a few.
std::string TiffThatClaims(uint32_t width, uint32_t height) {
  constexpr uint32_t kLong = 4;  // the type of all entries
  const std::vector<std::array<uint32_t, 2>> entries = {
      {256, width}, {257, height}, {258, 32},     {259, 1},  {262, 1},
      {273, 8},     {277, 1},      {278, height}, {279, 16}, {339, 3}};
  std::string bytes("II*\0\x18\0\0\0", 8);
  const auto append = [&bytes](auto value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  for (int i = 0; i < 4; ++i) append(1.5f);
  append(static_cast<uint16_t>(entries.size()));
  for (const auto& [tag, value] : entries) {
    append(static_cast<uint16_t>(tag));
    append(static_cast<uint16_t>(kLong));
    append(uint32_t{1});
    append(value);
  }
  append(uint32_t{0});  // no further directory
  return bytes;
}

TEST(DepthErrors, ASmallTiffWithoutCompressionReads) {
  const StoredDepth depth = ParseDepthFile(kName, TiffThatClaims(2, 2));
  EXPECT_EQ(depth.values, std::vector<float>(4, 1.5f));
  EXPECT_EQ(depth.sample_type, "float32");
}

TEST(DepthErrors, EveryTruncationIsAnError) {
  for (const char* extension : {".exr", ".npy", ".npz", ".png", ".tiff", ".bin", ".pfm"}) {
    const std::string bytes = BytesOf(extension);
    for (size_t size = 0; size < bytes.size(); ++size) {
      EXPECT_THROW(ParseDepthFile(kName, bytes.substr(0, size)), InputError)
          << extension << " of " << bytes.size() << " bytes, cut to " << size;
    }
  }
}

TEST(DepthErrors, NoDamagedByteCrashesTheReader) {
  for (const char* extension : {".exr", ".npy", ".npz", ".png", ".tiff", ".bin", ".pfm"}) {
    const std::string bytes = BytesOf(extension);
    for (size_t i = 0; i < bytes.size(); ++i) {
      for (const char bits : {'\x01', '\x80', '\xff'}) {
        std::string damaged = bytes;
        damaged[i] = static_cast<char>(damaged[i] ^ bits);
        try {
          const StoredDepth depth = ParseDepthFile(kName, damaged);
          EXPECT_EQ(depth.values.size(),
                    static_cast<size_t>(depth.width_px) * static_cast<size_t>(depth.height_px));
        } catch (const InputError&) {
        }
      }
    }
  }
}

TEST(DepthErrors, SizesThatNoDepthMapHasAreRefused) {
  const std::vector<std::string> parts = {"claims 1000000000 x 1000000000 pixels", "at most"};
  ExpectRefused("1000000000&1000000000&1&abcd", parts);
  ExpectRefused("Pf\n1000000000 1000000000\n-1\nabcd", parts);
  ExpectRefused("P5\n1000000000 1000000000\n65535\nabcd", parts);
  ExpectRefused(NpyBytes("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, "
                         "1000000000), }\n",
                         "abcd"),
                parts);
  std::string png = BytesOf(".png");
  Overwrite(png, 16, __builtin_bswap32(1000000000));
  Overwrite(png, 20, __builtin_bswap32(1000000000));
  ExpectRefused(png, parts);
  ExpectRefused(TiffThatClaims(1000000000, 1000000000), parts);
  std::string exr = BytesOf(".exr");
  for (const char* window : {"dataWindow", "displayWindow"}) {
    // name, 0, "box2i", 0, a size of 4 bytes, then x and y of both corners
    const size_t corner = exr.find(window) + std::strlen(window) + 1 + 6 + 4 + 8;
    Overwrite(exr, corner, 999999999);
    Overwrite(exr, corner + 4, 999999999);
  }
  ExpectRefused(exr, {});
}

TEST(DepthErrors, SizesThatTheFileCannotHoldAreRefused) {
  const std::vector<std::string> parts = {"claims 9000 x 8000 pixels, more than the file can hold"};
  ExpectRefused("9000&8000&1&abcd", parts);
  ExpectRefused("Pf\n9000 8000\n-1\nabcd", parts);
  ExpectRefused("P5\n9000 8000\n65535\nabcd", parts);
  ExpectRefused(
      NpyBytes("{'descr': '<f4', 'fortran_order': True, 'shape': (8000, 9000), }\n", "abcd"),
      parts);
  std::string png = BytesOf(".png");
  Overwrite(png, 16, __builtin_bswap32(9000));
  Overwrite(png, 20, __builtin_bswap32(8000));
  ExpectRefused(png, parts);
  ExpectRefused(TiffThatClaims(9000, 8000), parts);
  std::string exr = BytesOf(".exr");
  for (const char* window : {"dataWindow", "displayWindow"}) {
    const size_t corner = exr.find(window) + std::strlen(window) + 1 + 6 + 4 + 8;
    Overwrite(exr, corner, 8999);
    Overwrite(exr, corner + 4, 7999);
  }
  ExpectRefused(exr, {});
}

// A gzip member of one stored block.
std::string GzipOf(const std::string& bytes) {
  std::string gzip("\x1f\x8b\x08\0\0\0\0\0\0\xff\x01", 11);
  const auto append = [&gzip](auto value) {
    gzip.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  append(static_cast<uint16_t>(bytes.size()));
  append(static_cast<uint16_t>(~bytes.size()));
  gzip += bytes;
  append(static_cast<uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size()))));
  append(static_cast<uint32_t>(bytes.size()));
  return gzip;
}

TEST(DepthErrors, GzippedArraysAreCheckedAsWell) {
  const std::string npy = BytesOf(".npy");
  const std::string gzip = GzipOf(npy);
  EXPECT_TRUE(IsRamp(ParseDepthFile(kName, gzip)));
  for (size_t size = 0; size < gzip.size(); ++size) {
    EXPECT_THROW(ParseDepthFile(kName, gzip.substr(0, size)), InputError) << size;
  }
  std::string damaged = gzip;
  damaged[100] = static_cast<char>(damaged[100] ^ 1);
  ExpectRefused(damaged, {});
  ExpectRefused(GzipOf(NpyBytes("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, "
                                "1000000000), }\n",
                                "abcd")),
                {"claims 1000000000 x 1000000000 pixels"});
}

TEST(DepthErrors, ZipEntriesThatClaimMoreThanTheyHoldAreRefused) {
  std::string npz = BytesOf(".npz");
  const size_t directory = npz.find("PK\x01\x02");
  ASSERT_NE(directory, std::string::npos);
  Overwrite(npz, directory + 24, uint32_t{0x70000000});
  ExpectRefused(npz, {});
}

TEST(DepthErrors, NumpyHeadersAreReadStrictly) {
  const std::string data(size_t{35} * 4, '\0');
  const auto header = [](const std::string& text) {
    return NpyBytes(text, std::string(140, '\0'));
  };
  EXPECT_NO_THROW(
      ParseDepthFile(kName, header("{'shape':(5,7),\"descr\":\"<f4\",'fortran_order':False}")));
  ExpectRefused(header("{'descr': '<f4', 'shape': (5, 7), }\n"), {"expected the keys descr"});
  ExpectRefused(header("{'descr': '<f4', 'fortran_order': 1, 'shape': (5, 7), }\n"),
                {"True or False"});
  ExpectRefused(header("{'descr': '<f4', 'fortran_order': False, 'shape': (5, -7), }\n"),
                {"expected a shape", "-7"});
  ExpectRefused(header("{'descr': '<f4', 'fortran_order': False, 'shape': (0, 7), }\n"),
                {"at least one pixel"});
  ExpectRefused(header("{'descr': '<f3', 'fortran_order': False, 'shape': (5, 7), }\n"),
                {"expected numbers", "<f3"});
  ExpectRefused(header("['descr']"), {"NPY header", "expected \"{\""});
  ExpectRefused(header("{"), {"NPY header"});
  std::string version = header("{}");
  version[6] = '\x09';
  ExpectRefused(version, {"unknown version 9"});
}

TEST(DepthErrors, NetpbmHeadersAreReadStrictly) {
  ExpectRefused("Pf\n7 x\n-1\nabcd", {"height", "expected a count", "x"});
  ExpectRefused("Pf\n7 5\n0\nabcd", {"scale", "other than 0"});
  ExpectRefused("Pf\n7 5\nnan\nabcd", {"scale"});
  ExpectRefused("PF\n7 5\n-1\nabcd", {"one channel (Pf), found three"});
  ExpectRefused("P5\n7 5\n70000\nabcd", {"largest value", "70000"});
  ExpectRefused("P5\n7 5 # no end", {"the file ends here"});
}

TEST(DepthErrors, TruncatedPgmAndRawFilesAreRefused) {
  const std::string pgm = "P5\n7 5\n65535\n" + std::string(70, 'a');
  EXPECT_NO_THROW(ParseDepthFile(kName, pgm));
  for (size_t size = 0; size < pgm.size(); ++size) {
    EXPECT_THROW(ParseDepthFile(kName, pgm.substr(0, size)), InputError) << size;
  }
  const DepthReadOptions raw{.raw_size = PlaneSize{7, 5}};
  EXPECT_NO_THROW(ParseDepthFile(kName, std::string(140, 'a'), raw));
  for (const size_t size : {0, 1, 139, 141, 280}) {
    EXPECT_THROW(ParseDepthFile(kName, std::string(size, 'a'), raw), InputError) << size;
  }
}

TEST(DepthErrors, OtherFilesAreNamedAsSuch) {
  ExpectRefused("", {"expected a depth map, found an empty file"});
  ExpectRefused("hello", {"expected a depth map (EXR, PNG"});
  EXPECT_TRUE(FailsWithInputError([] { ReadDepthFile("/nowhere/a.exr"); },
                                  {"/nowhere/a.exr", "no such file"}));
}

}  // namespace
}  // namespace raylift
