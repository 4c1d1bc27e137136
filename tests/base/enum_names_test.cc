#include "raylift/base/enum_names.h"

#include <array>

#include "support/enum_names.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

enum class Fruit { kApple, kPear, kPlum };

struct Basket {
  enum class Handle { kOne };
};

enum class Nameless { kNone };

}  // namespace

template <>
inline constexpr auto kEnumNames<Fruit> = std::to_array<EnumName<Fruit>>({
    {Fruit::kApple, "apple", "Malus", "keeps well"},
    {Fruit::kPear, "pear"},
});

template <>
inline constexpr auto kEnumNames<Basket::Handle> = std::to_array<EnumName<Basket::Handle>>({
    {Basket::Handle::kOne, "one"},
});

namespace {

static_assert(NamedEnum<Fruit> && NamedEnum<Basket::Handle>);
static_assert(!NamedEnum<Nameless> && !NamedEnum<int>);
static_assert(ToString(Fruit::kPear) == "pear");
static_assert(FromName<Fruit>("apple") == Fruit::kApple);

TEST(EnumNames, LeadThereAndBack) {
  for (const Fruit fruit : {Fruit::kApple, Fruit::kPear}) {
    EXPECT_EQ(FromName<Fruit>(ToString(fruit)), fruit);
  }
  EXPECT_EQ(FromName<Fruit>("Apple"), std::nullopt);
  EXPECT_EQ(FromName<Fruit>(""), std::nullopt);
}

TEST(EnumNames, AreTitlesWhereThereIsNoOther) {
  EXPECT_EQ(TitleOf(Fruit::kApple), "Malus");
  EXPECT_EQ(TitleOf(Fruit::kPear), "pear");
  EXPECT_EQ(kEnumNames<Fruit>[0].description, "keeps well");
}

TEST(EnumNames, AreListedInTheOrderOfTheTable) {
  EXPECT_EQ(NameList<Fruit>(), "apple|pear");
  EXPECT_EQ(NameList<Basket::Handle>(), "one");
  EXPECT_EQ(AllValues<Fruit>(), (std::array{Fruit::kApple, Fruit::kPear}));
}

TEST(EnumNames, AValueThatIsMissingInTheTableIsNoticed) {
  EXPECT_FALSE(NamesEveryValue<Fruit>());  // kPlum
  EXPECT_TRUE(NamesEveryValue<Basket::Handle>());
  EXPECT_EQ(ToString(Fruit::kPlum), "");
}

}  // namespace
}  // namespace raylift
