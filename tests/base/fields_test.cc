#include "base/fields.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {

enum class Shade { kLight, kDark };
template <>
inline constexpr auto kEnumNames<Shade> = std::to_array<EnumName<Shade>>({
    {Shade::kLight, "light"},
    {Shade::kDark, "dark"},
});

namespace {

struct Paint {
  Shade shade = Shade::kLight;
  bool glossy = false;
  double thickness_mm = 1;
  std::optional<int> coats = std::nullopt;
};

std::vector<Field> FieldsOf(Paint& paint) {
  return {{"shade", paint.shade, "{}"},
          {"glossy", paint.glossy, "Shines"},
          {"thickness_mm", paint.thickness_mm, "Of all coats", kPositive},
          {"coats", paint.coats, "How many", kAtLeastOne}};
}

std::string ErrorOfPaint(const Paint& paint) {
  try {
    CheckRanges(ConstFieldsOf(paint));
    return "";
  } catch (const OptionError& error) {
    return error.what();
  }
}

TEST(Fields, NumbersOutOfTheirRangeAreNamed) {
  EXPECT_EQ(ErrorOfPaint({}), "");
  EXPECT_EQ(ErrorOfPaint({.thickness_mm = 0}), "thickness_mm = 0: must be positive");
  EXPECT_EQ(ErrorOfPaint({.thickness_mm = std::numeric_limits<double>::infinity()}),
            "thickness_mm = inf: must be positive");
  EXPECT_EQ(ErrorOfPaint({.coats = 0}), "coats = 0: must be at least 1");
}

TEST(Fields, RangesEndWhereTheySay) {
  EXPECT_TRUE(kShare.Contains(0) && kShare.Contains(1));
  EXPECT_FALSE(kShare.Contains(1.001) || kPositive.Contains(0) ||
               kAnyNumber.Contains(std::nan("")));
}

TEST(Fields, AnEnumIsSetByTheIndexOfItsName) {
  Paint paint;
  const NamedValue shade = std::get<NamedValue>(FieldsOf(paint).front().value);
  EXPECT_THAT(shade.names(), testing::ElementsAre("light", "dark"));
  shade.Set(1);
  EXPECT_EQ(paint.shade, Shade::kDark);
  EXPECT_EQ(shade.name(), "dark");
}

TEST(Fields, AnOptionalEnumMayBeOpen) {
  std::optional<Shade> shade;
  const NamedValue value(shade, "auto");
  EXPECT_EQ(value.name(), "auto");
  value.Set(0);
  EXPECT_EQ(shade, Shade::kLight);
  value.Set(2);
  EXPECT_EQ(shade, std::nullopt);
}

}  // namespace
}  // namespace raylift
