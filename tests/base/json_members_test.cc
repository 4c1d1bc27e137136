#include "base/json_members.h"

#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {

enum class Weather { kDry, kWet };
template <>
inline constexpr auto kEnumNames<Weather> = std::to_array<EnumName<Weather>>({
    {Weather::kDry, "dry"},
    {Weather::kWet, "wet"},
});

namespace {

struct Stop {
  std::string name;
  std::optional<double> depth_m = std::nullopt;
  int x = 0, y = 0;
};
struct Trip {
  Weather weather = Weather::kDry;
  std::vector<Stop> stops = {};
  Eigen::Matrix2d turn = Eigen::Matrix2d::Identity();
  std::optional<std::string> note = std::nullopt;
};

}  // namespace

static void Members(JsonMembers& members, Stop& stop) {
  members("name", stop.name);
  members("depth_m", stop.depth_m);
  members("at", std::tie(stop.x, stop.y));
}

static void Members(JsonMembers& members, Trip& trip) {
  members.Format("trip/1");
  members("weather", trip.weather);
  members("stops", trip.stops);
  members("turn", trip.turn);
  members.If(trip.note.has_value(), "note", trip.note);
  if (trip.stops.empty()) members.Fail("stops", "expected one at least");
}

namespace {

const Trip kTrip{.weather = Weather::kWet,
                 .stops = {{"a", 1.5, 1, 2}, {.name = "b"}},
                 .turn = (Eigen::Matrix2d() << 1, 2, 3, 0.1).finished()};

TEST(JsonMembers, AreWrittenInTheirOrder) {
  EXPECT_EQ(JsonText(ToJson(kTrip)),
            R"({"format":"trip/1","weather":"wet","stops":[{"name":"a","depth_m":1.5,"at":[1,2]},)"
            R"({"name":"b","depth_m":null,"at":[0,0]}],"turn":[[1.0,2.0],[3.0,0.1]]})");
}

TEST(JsonMembers, AreReadAsTheyWereWritten) {
  Trip trip = kTrip;
  trip.note = "wind";
  const auto read = ParseJson<Trip>(JsonText(ToJson(trip)));
  EXPECT_EQ(JsonText(ToJson(read)), JsonText(ToJson(trip)));
  EXPECT_EQ(read.note, "wind");
  EXPECT_EQ(read.turn, trip.turn);
}

TEST(JsonMembers, FaultsSayWhereTheyAre) {
  const std::string good = JsonText(ToJson(kTrip));
  const auto expect_fault = [&](const std::string& from, const std::string& to,
                                const std::string& fault) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    EXPECT_TRUE(FailsWithInputError([&] { ParseJson<Trip>(text); }, {fault})) << text;
  };
  expect_fault("trip/1", "trip/2", "format: expected \"trip/1\"");
  expect_fault("wet", "hot", "weather: expected dry|wet, found \"hot\"");
  expect_fault("1.5", "\"deep\"", "stops[0].depth_m: type must be number");
  expect_fault("[0,0]", "[0]", "stops[1].at: ");
  expect_fault("\"name\":\"b\",", "", "stops[1].name: key 'name' not found");
  expect_fault("[3.0,0.1]", "[3.0]", "turn: expected 2 values");
  expect_fault("]}", "", "parse error");
  EXPECT_TRUE(FailsWithInputError([&] { ParseJson<Trip>("[]"); }, {"format"}));
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        ParseJson<Trip>(R"({"format":"trip/1","weather":"dry","stops":[],"turn":[[1,0],[0,1]]})");
      },
      {"stops: expected one at least"}));
}

TEST(Dismantle, EmptiesAllLevelsOfRecords) {
  nlohmann::ordered_json json = ToJson(kTrip);
  const std::string text = JsonText(json);
  EXPECT_EQ(JsonText(nlohmann::ordered_json(json)), text);
  nlohmann::ordered_json given = json;
  EXPECT_EQ(JsonText(std::move(given)), text);
  Dismantle(json);
  EXPECT_TRUE(json.empty());
  auto deep = nlohmann::json::parse(std::string(100000, '[') + std::string(100000, ']'));
  Dismantle(deep);
  auto number = nlohmann::json(3);
  Dismantle(number);
  EXPECT_EQ(number, 3);
}

}  // namespace
}  // namespace raylift
