// Settings that a page may change, and the stages that it shows.
#include "src/viewer/protocol/controls.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "palpate/viewer/viewer.h"
#include "src/viewer/protocol/messages.h"
#include "tests/session/live_hand.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;
using test::small_tool;
using test::SyntheticStream;

TEST(Controls, AreTheSettingsThatCanChange) {
  const RunSettings settings;
  const Json list = list_controls(settings_of(settings), is_live_control);
  std::set<std::string> keys;
  for (const Json& control : list) keys.insert(control["key"]);
  EXPECT_TRUE(keys.contains("contact.method"));
  EXPECT_TRUE(keys.contains("coupling.stiffness"));
  for (const char* key :
       {"coupling.base_in_scene", "coupling.tool_in_hand", "safety.max_slew", "loop.threads"}) {
    EXPECT_FALSE(keys.contains(key)) << key;
  }
  for (const Json& control : list_controls(settings_of(settings), is_recorded_control)) {
    EXPECT_FALSE(control["key"].get<std::string>().starts_with("coupling.")) << control;
  }
  const Json& method = list[0];
  EXPECT_EQ(method["kind"], "choice");
  EXPECT_EQ(method["value"], "field");
  EXPECT_EQ(method["choices"], Json({"weighted", "simplified", "graph", "field"}));
}

TEST(Controls, EachCanBeSetToWhatItSaysItCanBe) {
  RunSettings settings;
  for (const auto& control : list_controls(settings_of(settings), is_live_control)) {
    nlohmann::ordered_json value = true;
    if (control["kind"] == "choice") value = control["choices"].back();
    if (control["kind"] == "number") value = control["high"];
    const auto key = control["key"].get<std::string>();
    const auto taken = set_control(settings_of(settings), is_live_control, key, value);
    ASSERT_TRUE(taken) << control << taken.error().message;
    EXPECT_EQ(*taken, value) << control;
    EXPECT_EQ(control_values(settings_of(settings), is_live_control)[key], value) << control;
  }
  EXPECT_EQ(settings.coupling.stiffness, 1e6);
}

TEST(Controls, RefusesWhatItCannotBe) {
  RunSettings settings;
  const auto set = [&](const char* key, const nlohmann::ordered_json& value) {
    return set_control(settings_of(settings), is_live_control, key, value);
  };
  EXPECT_NE(set("contact.method", "magic").error().message.find("weighted"), std::string::npos);
  EXPECT_FALSE(set("contact.method", 3));
  EXPECT_FALSE(set("contact.method", nullptr));
  EXPECT_FALSE(set("surface.filter", 1));
  EXPECT_FALSE(set("surface.min_depth", -1));
  EXPECT_FALSE(set("surface.min_depth", "1"));
  EXPECT_FALSE(set("safety.max_slew", 5));
  EXPECT_FALSE(set("contact", 5));
  EXPECT_FALSE(set("", 5));
  EXPECT_EQ(control_values(settings_of(settings), is_live_control),
            control_values(settings_of(RunSettings{}), is_live_control));
  EXPECT_EQ(*set("surface.normal_radius", 2.7), 3);
  EXPECT_EQ(settings.surface.normals.radius, 3);
}

TEST(Controls, OfObjectsHaveTheirNames) {
  RunSettings settings;
  settings.objects.resize(3);
  settings.objects[0].name = "block";
  settings.objects[1].name = "block_2";
  const auto set = [&](const char* key, const nlohmann::ordered_json& value) {
    const auto taken = set_control(settings_of(settings), is_live_control, key, value);
    return taken ? taken->dump() : taken.error().message;
  };
  const Json list = list_controls(settings_of(settings), is_live_control);
  const auto found = std::ranges::find(list, "objects.block.friction",
                                       [](const Json& control) { return control["key"]; });
  ASSERT_NE(found, list.end());
  EXPECT_EQ((*found)["kind"], "number");
  EXPECT_EQ((*found)["low"], 0);
  EXPECT_EQ((*found)["high"], 10);
  EXPECT_EQ((*found)["choices"], Json({"auto"}));
  EXPECT_EQ((*found)["value"], "auto");
  EXPECT_EQ(set("objects.block_2.friction", 0.25), "0.25");
  EXPECT_EQ(settings.objects[0].friction, std::nullopt);
  EXPECT_EQ(settings.objects[1].friction, 0.25);
  EXPECT_EQ(control_values(settings_of(settings), is_live_control)["objects.block_2.friction"],
            0.25);
  EXPECT_EQ(set("objects.block_2.friction", 11),
            "objects.block_2.friction must be a number from 0 to 10 or auto, not 11");
  EXPECT_EQ(set("objects.block_2.friction", "rough"),
            "objects.block_2.friction must be a number from 0 to 10 or auto, not 'rough'");
  EXPECT_EQ(set("objects.blok.friction", 1),
            "there is no setting 'objects.blok.friction'; the nearest one is "
            "'objects.block.friction'");
  EXPECT_EQ(settings.objects[1].friction, 0.25);
  EXPECT_EQ(set("objects.block_2.friction", "auto"), "\"auto\"");
  EXPECT_EQ(settings.objects[1].friction, std::nullopt);

  const Tool tool = small_tool();
  for (SceneObject& object : settings.objects) object.shape = std::make_shared<const Tool>(tool);
  const auto view =
      LiveView::create(tool, {SyntheticStream(1).info()}, "hand", {.objects = settings.objects});
  EXPECT_NE(view->controls().find("objects.block.friction"), std::string::npos)
      << "pages ask before the run begins";
}

TEST(Stages, KeepAllOfAHistogramInFewBars) {
  LatencyHistogram times;
  std::int64_t duration = 40;
  for (int i = 0; i < 3000; ++i) times.record(duration += duration / 200 + 1);
  const Json stage = stage_json("x", times);
  EXPECT_EQ(stage["num"], 3000);
  std::uint64_t num = 0;
  double last = -1;
  for (const Json& bar : stage["histogram"]) {
    EXPECT_GT(bar[0].get<double>(), last);
    last = bar[0];
    EXPECT_GT(bar[1], 0);
    num += bar[1].get<std::uint64_t>();
  }
  EXPECT_EQ(num, 3000u);
  EXPECT_LE(stage["histogram"].size(), 60u);
  EXPECT_EQ(stage_json("x", LatencyHistogram())["histogram"], Json::array());
}

}  // namespace
}  // namespace palpate
