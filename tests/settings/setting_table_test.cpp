#include "palpate/settings/setting_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace palpate {
namespace {

enum class Color { red, green, blue };
constexpr auto names_of(Color) { return std::array{"red", "green", "blue"}; }

enum class Missing { red, green, blue };
constexpr auto names_of(Missing) { return std::array{"red", "green"}; }
enum class Swapped { red, green, blue };
constexpr auto names_of(Swapped) { return std::array{"red", "blue", "green"}; }
enum class Left { red, green };
constexpr auto names_of(Left) { return std::array{"red", "green", "blue"}; }
enum class Shorter { virtual_color, none };
constexpr auto names_of(Shorter) { return std::array{"virtual", "none"}; }

template <class Enum>
constexpr bool kAreRefused = !names_each<Enum>(std::make_index_sequence<names_of(Enum{}).size()>());
static_assert(kAreRefused<Missing> && kAreRefused<Swapped> && kAreRefused<Left>);
static_assert(!kAreRefused<Color> && !kAreRefused<Shorter>);

struct Part {
  double width = 0.5;
};
void add_settings(SettingTable& t, Part& o) {
  t.add("part_width", o.width, {0.25, 2, "m"}, "of the part");
}

struct Options {
  bool is_loud = false;
  int num_steps = 3;
  Color color = Color::green;
  std::optional<Color> trim;
  Pose X_WB;
  Part part;
};
void add_settings(SettingTable& t, Options& o) {
  t.section("paint");
  t.add("loud", o.is_loud, "shouts");
  t.add("steps", o.num_steps, {-1, 7, "steps"}, "up");
  t.add("color", o.color, "of the wall");
  t.add("trim", o.trim, "of the frame");
  t.add("base", o.X_WB, "where it stands");
  add_settings(t, o.part);
}

std::string refusal(Options& options, std::string_view key, const SettingValue& value) {
  const Options before = options;
  const Status status = settings_of(options).set(key, value);
  EXPECT_TRUE(has_same_settings(before, options));
  return status ? "" : status.error().message;
}

TEST(SettingTable, ReadsAndWritesTheMembers) {
  Options options;
  SettingTable table = settings_of(options);
  EXPECT_TRUE(table.set("paint.loud", true));
  EXPECT_TRUE(table.set("paint.steps", 7.0));
  EXPECT_TRUE(table.set("paint.color", "blue"));
  EXPECT_TRUE(table.set("paint.trim", "red"));
  EXPECT_TRUE(table.set("paint.base", Pose{{1, 2, 3}, {0, 0, 1, 0}}));
  EXPECT_TRUE(table.set("paint.part_width", 0.25));
  EXPECT_TRUE(options.is_loud);
  EXPECT_EQ(options.num_steps, 7);
  EXPECT_EQ(options.color, Color::blue);
  EXPECT_EQ(options.trim, Color::red);
  EXPECT_EQ(options.X_WB.translation.y, 2);
  EXPECT_EQ(options.X_WB.rotation.z, 1);
  EXPECT_EQ(options.part.width, 0.25);
  EXPECT_EQ(std::get<std::string>(table.find("paint.trim")->get()), "red");
  EXPECT_TRUE(table.set("paint.trim", "auto"));
  EXPECT_EQ(options.trim, std::nullopt);
  EXPECT_EQ(std::get<std::string>(table.find("paint.trim")->get()), "auto");
}

TEST(SettingTable, RefusalsSayNameValueRangeAndUnit) {
  Options o;
  const double above = std::nextafter(2.0, 3.0);
  EXPECT_EQ(refusal(o, "paint.part_width", above),
            "paint.part_width must be a number from 0.25 to 2 m, not 2.0000000000000004");
  EXPECT_EQ(refusal(o, "paint.part_width", NAN),
            "paint.part_width must be a number from 0.25 to 2 m, not nan");
  EXPECT_EQ(refusal(o, "paint.part_width", "wide"),
            "paint.part_width must be a number from 0.25 to 2 m, not 'wide'");
  EXPECT_EQ(refusal(o, "paint.steps", 8.0),
            "paint.steps must be a whole number from -1 to 7 steps, not 8");
  EXPECT_NE(refusal(o, "paint.steps", 1.5), "");
  EXPECT_EQ(refusal(o, "paint.loud", 1.0), "paint.loud must be true or false, not 1");
  EXPECT_EQ(refusal(o, "paint.color", "gren"),
            "paint.color must be one of red, green, blue, not 'gren'; did you mean green?");
  EXPECT_EQ(refusal(o, "paint.color", "xyzzy"),
            "paint.color must be one of red, green, blue, not 'xyzzy'");
  EXPECT_EQ(refusal(o, "paint.color", "auto"),
            "paint.color must be one of red, green, blue, not 'auto'");
  EXPECT_NE(refusal(o, "paint.trim", "gold").find("red, green, blue, auto"), std::string::npos);
  EXPECT_NE(refusal(o, "paint.base", Pose{{1001, 0, 0}, {}}).find("up to 1000 m"),
            std::string::npos);
  EXPECT_NE(refusal(o, "paint.base", Pose{{}, {0, 0, 0, 1.01}}), "");
  EXPECT_NE(refusal(o, "paint.base", Pose{{NAN, 0, 0}, {}}), "");
  EXPECT_EQ(refusal(o, "paint.stpes", 2.0),
            "there is no setting 'paint.stpes'; the nearest one is 'paint.steps'");
}

TEST(SettingTable, QuaternionsBecomeUnitAndOnesThatAreKeepTheirBits) {
  Options options;
  SettingTable table = settings_of(options);
  EXPECT_TRUE(table.set("paint.base", Pose{{}, {0, 0, 0, 1.0005}}));
  EXPECT_EQ(options.X_WB.rotation.w, 1);
  const Pose X{{}, axis_angle({1, 2, 3}, 0.7)};
  EXPECT_TRUE(table.set("paint.base", X));
  EXPECT_EQ(options.X_WB, X);
}

TEST(SettingTable, NumbersMayHaveNoValue) {
  std::optional<double> gloss;
  SettingTable table;
  table.section("paint");
  table.add(std::string("door") + ".gloss", gloss, {0, 1}, "of the door");
  Setting& setting = *table.find("paint.door.gloss");
  EXPECT_EQ(setting.get(), SettingValue("auto"));
  EXPECT_EQ(setting.accepted(), "a number from 0 to 1 or auto");
  EXPECT_TRUE(setting.set(0.25));
  EXPECT_EQ(gloss, 0.25);
  EXPECT_EQ(setting.get(), SettingValue(0.25));
  for (const SettingValue& wrong :
       {SettingValue(2.0), SettingValue(NAN), SettingValue("matt"), SettingValue(true)}) {
    EXPECT_FALSE(setting.set(wrong));
    EXPECT_EQ(gloss, 0.25);
  }
  EXPECT_EQ(setting.set("matt").error().message,
            "paint.door.gloss must be a number from 0 to 1 or auto, not 'matt'");
  EXPECT_TRUE(setting.set("auto"));
  EXPECT_EQ(gloss, std::nullopt);
  EXPECT_TRUE(check_settings(table));
  gloss = 7;
  EXPECT_FALSE(check_settings(table));
}

TEST(SettingTable, ChecksWhatALibraryUserHasSet) {
  Options options;
  EXPECT_TRUE(check_settings(options));
  options.part.width = -1;
  const Status status = check_settings(options);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "paint.part_width must be a number from 0.25 to 2 m, not -1");
  Options odd;
  odd.color = static_cast<Color>(3);
  EXPECT_FALSE(check_settings(odd));
}

TEST(SettingTable, KnowsWhatDiffersAndCopiesByName) {
  Options a, b;
  b.part.width = 1;
  EXPECT_EQ(first_difference(settings_of(a), settings_of(b))->key(), "paint.part_width");
  copy_settings(settings_of(b), settings_of(a));
  EXPECT_TRUE(has_same_settings(a, b));
  Part part{2};
  copy_settings(settings_of(part), settings_of(a));  // "part_width" is another name
  EXPECT_TRUE(has_same_settings(a, b));
}

TEST(Names, OfEnumerations) {
  EXPECT_EQ(name_of(Color::blue), "blue");
  EXPECT_EQ(name_of(static_cast<Color>(7)), "?");
  EXPECT_EQ(value_named<Color>("green"), Color::green);
  EXPECT_EQ(value_named<Color>("Green"), std::nullopt);
}

}  // namespace
}  // namespace palpate
