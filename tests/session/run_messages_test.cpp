// Messages of a recording, read back to the same bits, and the series of a report.
#include "src/session/internal/run_messages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/report/run_series.h"
#include "tests/session/live_hand.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

using test::SyntheticStream;

TEST(RunMessages, TicksReadBackToTheSameBits) {
  TickRecord tick;
  tick.number = 18446744073709551615u;
  tick.time = 0.1 + 0.2;
  tick.dt = std::nextafter(0.001, 1.0);
  tick.device = {1e5 / 3, {{1.0 / 3, -0.0, 5e-324}, axis_angle({1, 2, 3}, 0.7)}, {}, 5, true,
                 false};
  tick.step.stretch = std::numeric_limits<double>::quiet_NaN();
  tick.step.energy = -std::numeric_limits<double>::infinity();
  tick.step.stored = 1.0 / 7;
  tick.F_H_B = {{1.7976931348623157e308, 2, 3}, {4, 5, 6}};
  tick.safety = {ForceState::off, Fault::stale_sensor, 12.5, 3, 0.25, 1e-3, 2.5, 77};
  tick.is_force_requested = true;
  tick.is_stopping = true;
  tick.compute_nanoseconds = -12;
  const std::string text = tick_message(tick);
  const auto back = read_tick(text);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(tick_message(*back), text);
  EXPECT_EQ(back->number, tick.number);
  EXPECT_EQ(back->dt, tick.dt);
  EXPECT_EQ(back->device.X_BH, tick.device.X_BH);
  EXPECT_TRUE(std::signbit(back->device.X_BH.translation.y));
  EXPECT_TRUE(back->device.is_valid);
  EXPECT_FALSE(back->device.has_force);
  EXPECT_EQ(back->step.stored, tick.step.stored);
  EXPECT_TRUE(std::isnan(back->step.stretch));
  EXPECT_EQ(back->step.energy, tick.step.energy);
  EXPECT_EQ(back->safety.fault, Fault::stale_sensor);
  EXPECT_EQ(back->safety.state, ForceState::off);
  EXPECT_EQ(back->safety.num_faults, 3u);
  EXPECT_TRUE(back->is_force_requested);
  EXPECT_EQ(back->safety.num_limited, 77u);
  for (std::size_t size = 0; size + 4 < text.size(); size += 17) {
    EXPECT_FALSE(read_tick(text.substr(0, size))) << size;
  }
}

TEST(RunMessages, ContactsReadBackToTheSameBits) {
  ContactRecord contact;
  contact.number = 12;
  contact.cameras.num = 2;
  contact.cameras.of[0] = {3, 1.0 / 7};
  contact.cameras.of[1] = {5, 2.0 / 7};
  contact.penetration = {1e-5 / 3, {{1, 2, 3}, {4, 5, 6}},       0.125, 7, 8,
                         9,        StepStatus::ambiguous_normals};
  contact.contact.is_valid = true;
  for (int i = 0; i < 36; ++i) contact.contact.stiffness.m[i / 6][i % 6] = 1.0 / (i + 3);
  const std::string text = contact_message(contact);
  const auto back = read_contact(text);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(contact_message(*back), text);
  EXPECT_EQ(back->contact.stiffness.m[4][5], contact.contact.stiffness.m[4][5]);
  EXPECT_EQ(back->penetration.num_points, 9);
}

TEST(RunMessages, NoiseReadsBackAndOlderMessagesHaveNone) {
  TickRecord tick;
  tick.number = 5;
  ContactRecord contact;
  contact.number = 6;
  // A message of before the field ends before the number of its numbers.
  const std::string text = tick_message(tick), of_contact = contact_message(contact);
  const auto older = read_tick(text.substr(0, text.size() - 4));
  const auto older_contact = read_contact(of_contact.substr(0, of_contact.size() - 4));
  ASSERT_TRUE(older && older_contact);
  EXPECT_EQ(older->number, 5u);
  EXPECT_FALSE(older->noise || older_contact->noise);

  tick.noise = contact.noise = MeasureNoise{
      1e-18, {{{1, 0.2, 0.3}, {0.2, 4, 0.5}, {0.3, 0.5, 6}}}, {{{7, 1, 2}, {1, 8, 3}, {2, 3, 9}}}};
  const auto back = read_tick(tick_message(tick));
  const auto back_contact = read_contact(contact_message(contact));
  ASSERT_TRUE(back && back->noise && back_contact && back_contact->noise);
  EXPECT_EQ(tick_message(*back), tick_message(tick));
  EXPECT_EQ(back->noise->volume, 1e-18);
  EXPECT_EQ(back->noise->force.m[2][1], 0.5);
  EXPECT_EQ(back_contact->noise->torque.m[1][0], 1);
  EXPECT_FALSE(difference(tick, *older).empty());
}

TEST(RunMessages, DepthFramesAreImages) {
  SyntheticStream stream(1);
  DepthFrame frame;
  ASSERT_TRUE(*stream.next(frame));
  const std::string image = image_message({1'500'000'007, "camera"}, frame);
  const auto back = read_depth_image(image, frame.unit);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->pixels, frame.pixels);
  EXPECT_EQ(back->width, frame.width);
  for (const std::size_t size :
       {std::size_t(0), std::size_t(3), image.size() / 2, image.size() - 1})
    EXPECT_FALSE(read_depth_image(image.substr(0, size), frame.unit)) << size;
}

TEST(RunMessages, PointsOfLargeImagesAreThinned) {
  DepthFrame frame;
  frame.width = 1920;
  frame.height = 1080;
  frame.pixels.assign(1920 * 1080, 1500);
  const std::string message = points_message({}, frame, {1400, 1400, 959.5, 539.5});
  const auto num_points = message.size() / 12;
  EXPECT_LE(num_points, static_cast<std::size_t>(kMaxRecordedPoints));
  EXPECT_GE(num_points, static_cast<std::size_t>(kMaxRecordedPoints / 2));
  frame.pixels.assign(frame.pixels.size(), 65535);
  EXPECT_LT(points_message({}, frame, {1400, 1400, 959.5, 539.5}).size(), 200u);
}

TEST(RunMessages, SettingsOfOtherVersionsAreRefused) {
  RunSetup setup;
  setup.streams = {SyntheticStream(2).info()};
  const std::string message = settings_message(setup);
  ASSERT_TRUE(read_settings(message));
  const auto changed = [&](std::string_view from, std::string_view to) {  // of the same length
    std::string other = message;
    const std::size_t at = other.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return other.replace(at, from.size(), to);
  };
  const auto unreleased = read_settings(changed("palpate.run", "palpate run"));
  ASSERT_FALSE(unreleased);
  EXPECT_EQ(unreleased.error().message,
            "the recording was made by an unreleased version of palpate; record the run again");
  const auto later = read_settings(changed("\"version\":1", "\"version\":7"));
  ASSERT_FALSE(later);
  EXPECT_EQ(
      later.error().message,
      "the recording has format version 7, this program reads 1; use the version that wrote it");
  EXPECT_FALSE(read_settings(changed("palpate.run", "palpate.not")));
}

TEST(RunMessages, SchemasNameEveryTypeOnce) {
  const std::string text = tick_channel().schema;
  EXPECT_EQ(tick_channel().schema_name, "palpate_msgs/msg/Tick");
  for (const char* type :
       {"geometry_msgs/Vector3", "geometry_msgs/Pose", "palpate_msgs/SafetyStatus",
        "palpate_msgs/Penetration", "geometry_msgs/Point"}) {
    const std::size_t first = text.find(std::string("MSG: ") + type + "\n");
    ASSERT_NE(first, std::string::npos) << type;
    EXPECT_EQ(text.find(std::string("MSG: ") + type + "\n", first + 1), std::string::npos) << type;
  }
  EXPECT_NE(text.find("float64 contact_age\n"), std::string::npos);
}

TEST(RunSeries, StaysSmallAndKeepsTheStrongestTick) {
  RunSeries series;
  TickRecord tick;
  for (int i = 0; i < 300000; ++i) {
    tick.time = i;
    tick.F_H_B.force.x = i == 123457 ? 5 : 0.001 * (i % 7);
    series.add(tick);
  }
  EXPECT_LE(series.ticks().size(), std::size_t(1) << 14);
  EXPECT_GT(series.ticks().size(), std::size_t(1) << 12);
  double strongest = 0, last = -1;
  for (const TickRecord& kept : series.ticks()) {
    EXPECT_GT(kept.time, last);
    last = kept.time;
    strongest = std::max(strongest, kept.F_H_B.force.x);
  }
  EXPECT_EQ(strongest, 5);
}

}  // namespace
}  // namespace palpate
