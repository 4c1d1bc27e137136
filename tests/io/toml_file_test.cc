#include "io/text/toml_file.h"

#include <functional>
#include <limits>
#include <map>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {

enum class Finish { kMatt, kShiny };
template <>
inline constexpr auto kEnumNames<Finish> = std::to_array<EnumName<Finish>>({
    {Finish::kMatt, "matt"},
    {Finish::kShiny, "shiny"},
});

struct Coat {
  Finish finish = Finish::kMatt;
  bool is_dry = false;
  int layers = 1;
  double thickness_mm = 0.5;
  std::optional<double> age_s = std::nullopt;
  uint64_t batch = 0;
};

static std::vector<Field> FieldsOf(Coat& coat) {
  return {{"coat_finish", coat.finish, ""},
          {"coat_is_dry", coat.is_dry, ""},
          {"coat_layers", coat.layers, "", kAtLeastOne},
          {"coat_thickness_mm", coat.thickness_mm, "", kPositive},
          {"coat_age_s", coat.age_s, "", kNotNegative},
          {"coat_batch", coat.batch, ""}};
}

namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TomlTable ReadText(const std::string& text, TomlTable::Expand expand = {}) {
  const auto file = TestFolder() / "file.toml";
  WriteFile(file, text);
  return ReadToml(file, std::move(expand));
}

TEST(TomlFile, GivesValuesByKind) {
  TomlTable table = ReadText(
      "text = 'a'\nwhole = 3\nreal = 0.5\nyes = true\nlist = ['a', 1, 0.25, false]\n"
      "[part]\nx = 1\n[[rows]]\nname = 'first'\n[[rows]]\nname = 'second'\n");
  EXPECT_EQ(table.Text("text"), "a");
  EXPECT_EQ(table.Integer("whole"), 3);
  EXPECT_EQ(table.Number("whole"), 3);
  EXPECT_EQ(table.Number("real"), 0.5);
  EXPECT_EQ(table.Boolean("yes"), true);
  EXPECT_THAT(table.Values("list"), ElementsAre("a", "1", "0.25", "false"));
  EXPECT_THAT(table.Values("real"), ElementsAre("0.5"));
  EXPECT_EQ(table.Table("part")->Integer("x"), 1);
  EXPECT_EQ(table.LineOf("list"), 5);
  auto rows = table.Tables("rows");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[1].RequiredText("name"), "second");
  EXPECT_FALSE(table.Has("none"));
  EXPECT_FALSE(table.Text("none"));
  EXPECT_FALSE(table.Table("none"));
  EXPECT_THAT(table.Tables("none"), IsEmpty());
  EXPECT_THAT(table.Values("none"), IsEmpty());
  table.RequireAllRead();
}

TEST(TomlFile, PartsKeepTheWhole) {
  std::optional<TomlTable> part;
  {
    TomlTable table = ReadText("[a.b]\nname = 'deep'\n");
    part = table.Table("a")->Table("b");
  }
  EXPECT_EQ(part->RequiredText("name"), "deep");
}

TEST(TomlFile, GivesTheFieldsOfAStruct) {
  TomlTable table = ReadText("finish = 'shiny'\nis_dry = true\nlayers = 3\nage_s = 2\nbatch = 7\n");
  Coat coat;
  table.Take(coat, "coat_");
  EXPECT_EQ(coat.finish, Finish::kShiny);
  EXPECT_TRUE(coat.is_dry);
  EXPECT_EQ(coat.layers, 3);
  EXPECT_EQ(coat.thickness_mm, 0.5);
  EXPECT_EQ(coat.age_s, 2);
  EXPECT_EQ(coat.batch, 7u);
  table.RequireAllRead();
  for (const auto& [text, message] : std::map<std::string, std::string>{
           {"layers = 0", "line 1: layers: must be at least 1, found 0"},
           {"layers = 3000000000", "line 1: layers: is out of range"},
           {"batch = -1", "line 1: batch: is out of range"},
           {"thickness_mm = -1", "line 1: thickness_mm: must be positive, found -1"},
           {"age_s = 'old'", "line 1: age_s: expected a number"},
           {"finish = 'dull'", "line 1: finish: expected matt|shiny, found \"dull\""}}) {
    Coat wrong;
    EXPECT_TRUE(FailsWithInputError([&] { ReadText(text).Take(wrong, "coat_"); }, {message}));
  }
}

TEST(TomlFile, ErrorsNameFileLineAndKey) {
  const auto fails = [](const std::string& text, const std::function<void(TomlTable&)>& read,
                        const std::string& message) {
    return FailsWithInputError(
        [&] {
          TomlTable table = ReadText(text);
          read(table);
        },
        {"file.toml: " + message});
  };
  EXPECT_TRUE(fails(
      "\na = 1", [](TomlTable& t) { t.Text("a"); }, "line 2: a: expected a string"));
  EXPECT_TRUE(fails(
      "a = 'x'", [](TomlTable& t) { t.Number("a"); }, "line 1: a: expected a number"));
  EXPECT_TRUE(fails(
      "a = 0.5", [](TomlTable& t) { t.Integer("a"); }, "line 1: a: expected a whole number"));
  EXPECT_TRUE(fails(
      "a = 1", [](TomlTable& t) { t.Boolean("a"); }, "line 1: a: expected true or false"));
  EXPECT_TRUE(fails(
      "a = []", [](TomlTable& t) { t.Values("a"); }, "line 1: a: must not be empty"));
  EXPECT_TRUE(fails(
      "a = [1979-05-27]", [](TomlTable& t) { t.Values("a"); }, "line 1: a: expected a string, a"));
  EXPECT_TRUE(fails(
      "a = 1", [](TomlTable& t) { t.Table("a"); }, "line 1: a: expected a table"));
  EXPECT_TRUE(fails(
      "a = [1]", [](TomlTable& t) { t.Tables("a"); }, "line 1: a: expected [[a]] tables"));
  EXPECT_TRUE(fails(
      "[a]\nb = 1", [](TomlTable& t) { t.Table("a")->Text("b"); },
      "line 2: a.b: expected a string"));
  EXPECT_TRUE(fails(
      "[[a]]\n[[a]]\n", [](TomlTable& t) { t.Tables("a")[1].RequiredText("b"); },
      "a 2.b: is missing"));
  EXPECT_TRUE(fails(
      "[[a]]\n[[a]]\n", [](TomlTable& t) { t.Tables("a")[1].FailHere("is bad"); },
      "line 2: a 2: is bad"));
  EXPECT_TRUE(fails(
      "a = 1\nb = 2", [](TomlTable& t) { t.FailAtLineOf("b", "bad"); }, "line 2: bad"));
  EXPECT_TRUE(fails(
      "a = 1\na = 2", [](TomlTable&) {}, "line 2: "));
}

TEST(TomlFile, KeysThatNobodyAskedForAreErrors) {
  TomlTable table = ReadText("[part]\na = 1\nb = 2\n");
  TomlTable part = *table.Table("part");
  part.Number("a");
  EXPECT_THAT(part.UnreadKeys(), ElementsAre("b"));
  EXPECT_TRUE(FailsWithInputError([&] { part.RequireAllRead(); },
                                  {"line 3: part.b: is no key that can stand here"}));
}

TEST(TomlFile, ErrorsOfExpandedTextsAreToldWithTheirPlace) {
  TomlTable table = ReadText("a = 'good'\nb = ['bad']\n", [](const std::string& text) {
    if (text == "bad") throw InputError("bad is bad");
    return text + "!";
  });
  EXPECT_EQ(table.Text("a"), "good!");
  EXPECT_TRUE(FailsWithInputError([&] { table.Values("b"); }, {"line 2: b: bad is bad"}));
}

TEST(TomlFile, IntegersBeyond64BitsAreAnError) {
  for (const std::string number :
       {"9223372036854775808", "-9223372036854775809", "0xffffffffffffffff"}) {
    for (const std::string& text :
         {"\nseed = " + number, "\n[a]\nb = {seed = [1, " + number + "]}"}) {
      const std::string reason = number + "' is not representable in 64 bits";
      const std::string unsigned_reason = reason.substr(reason.find_first_not_of('-'));
      EXPECT_TRUE(
          FailsWithInputError([&] { ReadText(text); }, {"file.toml: line ", unsigned_reason}));
#if !__has_include(<toml++/toml.h>)
      EXPECT_TRUE(FailsWithInputError([&] { ReadText(text); }, {": seed: '" + reason}));
#endif
    }
  }
  TomlTable table = ReadText("least = -9_223_372_036_854_775_808\nmost = 0x7fff_ffff_ffff_ffff\n");
  EXPECT_EQ(table.Integer("least"), std::numeric_limits<int64_t>::min());
  EXPECT_EQ(table.Integer("most"), std::numeric_limits<int64_t>::max());
}

TEST(TomlFile, KeysOfTooManyPartsAreAnError) {
  const auto key = [](int count) {
    std::string text = "a";
    for (int i = 1; i < count; ++i) text += ".a";
    return text;
  };
  for (const std::string& text :
       {key(1000000) + " = 1\n", "[" + key(1000000) + "]\n", "b = {" + key(1000000) + " = 1}\n"}) {
    EXPECT_TRUE(
        FailsWithInputError([&] { ReadText("\n" + text); }, {"line 2: a key has too many parts"}));
  }
  EXPECT_TRUE(FailsWithInputError([&] { ReadText("[" + key(200) + "]\n" + key(200) + " = 1\n"); },
                                  {"line 2: is nested too deeply"}));
  EXPECT_TRUE(ReadText(key(200) + " = 1\n").Has("a"));
  // Many dots are no key.
  const std::string dots(1000, '.');
  EXPECT_EQ(ReadText("# " + dots + "\na = '" + dots + "'\n").Text("a"), dots);
}

TEST(TomlFile, StringsAreQuotedSoThatTheyReadBack) {
  for (const std::string text : {"", "plain", "it's \"quoted\"", "back\\slash", "two\nlines",
                                 "tab\t", "\x01\x7f", "größer 部屋", "it's\\"}) {
    EXPECT_EQ(ReadText("a = " + TomlString(text)).Text("a"), text);
    EXPECT_EQ(ReadText(TomlString(text) + " = 1").Integer(text), 1);
  }
}

}  // namespace
}  // namespace raylift
