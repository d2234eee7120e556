// Runs with objects that move: felt, pushed, recorded and repeated to the bit.
#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "tests/session/path_run.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/report_data.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::pressing_pose;
using test::SyntheticStream;

/// The wall of the stream is the floor; the tool presses on what lies there.
class MovingObjects : public ::testing::Test {
 protected:
  MovingObjects() {
    static const auto shape =
        std::make_shared<const Tool>(test::random_tool(150, 0.04, 9).with_solid_field());
    settings_.objects = {{shape, {{0.02, 0, 0.44}, axis_angle({0, 1, 0}, 0.3)}, {}, true, 0.2},
                         {shape, {{-0.06, 0.03, 0.47}, {}}},
                         {shape, {{-0.05, -0.02, 0.4}, {}}, 0.3, true}};
    settings_.bodies.gravity_y = 0;
    settings_.bodies.gravity_z = 9.81;
    settings_.bodies.num_spheres = 100;
  }
  Result<Pipeline> pipeline(const SyntheticStream& stream) const {
    return Pipeline::create(tool_, stream.info(), DeviceInfo{}, settings_);
  }
  Result<RunOutcome> record(const fs::path& name) {
    SyntheticStream stream(8);
    auto device = test::path_device(pressing_pose, settings_.contact_rate);
    return record_run(tool_, stream, **device, settings_, name);
  }
  fs::path run() const { return folder_.path() / "run"; }

  test::TemporaryFolder folder_;
  Tool tool_ = test::small_tool();
  RunSettings settings_ = test::path_settings();
};

TEST_F(MovingObjects, FallAndArePushedByTheTool) {
  settings_.bodies.damping = 20;  // they are round, and would roll away
  SyntheticStream stream(1);
  auto made = pipeline(stream);
  ASSERT_TRUE(made) << made.error().message;
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame).value());
  made->push(frame, 0);
  const Pose far{{0, 0, 0.2}, {}};
  for (int i = 0; i < 1000; ++i) made->measure(far, 1e-3 * i);
  const ContactRecord lying = made->contact();
  ASSERT_EQ(lying.bodies.num, 2u);
  for (int k = 0; k < 2; ++k) {
    EXPECT_GT(lying.bodies.of[k].translation.z, 0.44) << k;  // it has fallen
    EXPECT_LT(lying.bodies.of[k].translation.z, 0.5) << k;   // on the wall
  }
  EXPECT_EQ(lying.num_object_pairs, 0);
  // A tool that comes from the right at 0.1 m/s takes it along to the left, and feels it.
  double felt = 0;
  for (int i = 0; i < 800; ++i) {
    const Vec3d& begin = lying.bodies.of[0].translation;
    const Vec3d at{begin.x + 0.07 - 1e-4 * i, begin.y, 0.47};
    const ContactRecord& contact = made->measure({at, {}}, 1 + 1e-3 * i);
    felt = std::max(felt, contact.objects.measure_W.force.x);
  }
  EXPECT_GT(felt, 0);
  EXPECT_LT(made->contact().bodies.of[0].translation.x, lying.bodies.of[0].translation.x - 0.01);
}

TEST_F(MovingObjects, GoOnWhereTheyAreWhenSettingsChange) {
  SyntheticStream stream(1), same(1);
  auto one = pipeline(stream);
  auto other = pipeline(same);
  ASSERT_TRUE(one && other);
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame).value());
  one->push(frame, 0);
  other->push(frame, 0);
  const Pose far{{0, 0, 0.2}, {}};
  for (int i = 0; i < 400; ++i) {
    if (i == 200) {
      RunSettings fewer = settings_;
      fewer.num_spheres = 50;  // of the tool: another query, and another part
      ASSERT_TRUE(other->change(fewer));
    }
    one->measure(far, 1e-3 * i);
    other->measure(far, 1e-3 * i);
  }
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(one->contact().bodies.of[k], other->contact().bodies.of[k]) << k;
  }
  RunSettings softer = settings_, fewer = settings_;
  softer.bodies.sink = 1e-3;
  softer.bodies.friction = 0.2;
  fewer.bodies.num_spheres = 50;
  EXPECT_TRUE(one->change(softer));
  EXPECT_FALSE(one->change(fewer)) << "fixed while running";
}

TEST_F(MovingObjects, FallUpWhenGravityChanges) {
  SyntheticStream stream(1);
  auto made = pipeline(stream);
  ASSERT_TRUE(made);
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame).value());
  made->push(frame, 0);
  const Pose far{{0.3, 0, 0.2}, {}};
  for (int i = 0; i < 2000; ++i) made->measure(far, 1e-3 * i);  // they lie, and may sleep
  const double z = made->contact().bodies.of[0].translation.z;
  settings_.bodies.gravity_z = -1;
  ASSERT_TRUE(made->change(settings_));
  for (int i = 0; i < 500; ++i) made->measure(far, 2 + 1e-3 * i);
  EXPECT_NEAR(made->contact().bodies.of[0].translation.z, z - 0.5 * 0.25, 0.02);
}

TEST_F(MovingObjects, TicksDoNotAllocate) {
  SyntheticStream stream(1);
  auto made = pipeline(stream);
  ASSERT_TRUE(made);
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame).value());
  made->push(frame, 0);
  made->measure(pressing_pose(0), 0);
  const test::AllocationCounter counter;
  for (int i = 1; i < 50; ++i) made->measure(pressing_pose(1e-3 * i), 1e-3 * i);
  EXPECT_EQ(counter.count(), 0u);
}

TEST_F(MovingObjects, RunsAreRecordedAndRepeatedIdentically) {
  const auto outcome = record(run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  const auto summary = nlohmann::json::parse(read_file(run() / "summary.json").value());
  EXPECT_EQ(summary.at("objects").at(0).at("mass_kg"), 0.2);
  EXPECT_FALSE(summary.at("objects").at(1).contains("mass_kg"));
  EXPECT_GT(summary.at("objects").at(2).at("mass_kg"), 0);
  EXPECT_GT(summary.at("ticks_in_objects"), 0);
  EXPECT_GT(test::repeated(run()).num_contacts, 200u);
  const auto again =
      retry_run(run(), folder_.path() / "again", [](RunSettings&) -> Status { return Done{}; });
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->forces.max, 0);
  // A repetition computes where they are: with other gravity it finds them elsewhere.
  const auto other =
      retry_run(run(), folder_.path() / "other", [](RunSettings& settings) -> Status {
        settings.bodies.gravity_z = -9.81;
        return Done{};
      });
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_GT(other->forces.max, 0);
}

// The report has them where they were when the tool was deepest.
TEST_F(MovingObjects, AreInTheReport) {
  PALPATE_PAGES_OR_SKIP();
  settings_.objects[0].X_WB.translation = {0.06, 0, 0.4};  // falls before it is touched
  ASSERT_TRUE(record(run()));
  const auto page = test::report_data_of(run() / "report.html");
  const auto& moment = page.at("moment");
  std::map<std::uint64_t, ContactRecord> contacts;
  std::uint64_t deepest = 0;
  for (const test::RecordedMessage& message : test::messages(run())) {
    if (message.channel.topic == kContactTopic) {
      const ContactRecord contact = read_contact(message.data).value();
      contacts[contact.number] = contact;
    } else if (message.channel.topic == kTickTopic) {
      const TickRecord tick = read_tick(message.data).value();
      if (tick.time == moment.at("time_s")) deepest = tick.contact_number;
    }
  }
  const ContactRecord& contact = contacts.at(deepest);
  const Pose poses[] = {contact.bodies.of[0], settings_.objects[1].X_WB, contact.bodies.of[1]};
  EXPECT_GT(norm(poses[0].translation - settings_.objects[0].X_WB.translation), 1e-3);
  ASSERT_EQ(moment.at("objects").size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& object = moment.at("objects")[i];
    for (std::size_t k = 0; k < 7; ++k) {
      EXPECT_NEAR(object.at("X_WB")[k], seven_numbers(poses[i])[k], 1e-8) << i << ": " << k;
    }
    const TriangleMesh& mesh = settings_.objects[i].shape->mesh();
    EXPECT_EQ(test::from_packed<float>(object.at("mesh").at("positions")).size(),
              3 * mesh.vertices.size());
  }
  EXPECT_GT(contact.objects.volume, 0);
  EXPECT_NEAR(moment.at("objects_volume_m3"), contact.objects.volume,
              1e-4 * contact.objects.volume);
  EXPECT_EQ(page.at("summary").at("peaks").at("volume_in_objects_m3"), contact.objects.volume);
}

// Changes after one that waits for the next frame wait with it, and the last one is all that is
// used: what the tool has put into objects outlives a gravity that was none for no time. Without
// one that waits, all are used, and it is forgotten.
TEST_F(MovingObjects, RepeatChangesThatFollowEachOtherAtOnce) {
  settings_.bodies.damping = 20;
  SyntheticStream stream(100000);
  auto device = test::path_device(pressing_pose, settings_.contact_rate);
  std::atomic<bool> is_done = false;
  std::thread person;
  RunMonitor monitor;
  monitor.on_loop = [&](RunLoop* loop) {
    if (loop == nullptr) {
      person.join();
      return;
    }
    person = std::thread([&, loop] {
      const auto wait_for_ticks = [&](std::uint64_t num) {
        const std::uint64_t end = loop->report().num_ticks + num;
        EXPECT_TRUE(test::wait_for([&] { return loop->report().num_ticks >= end; }));
      };
      for (int i = 0; i < 8; ++i) {
        wait_for_ticks(150);
        loop->hold_frames(true);
        RunSettings other = loop->settings();
        const double gravity = std::exchange(other.bodies.gravity_z, 0);
        if (i % 2 == 0) other.surface.filter.enabled = !other.surface.filter.enabled;
        EXPECT_TRUE(loop->change(other));
        other.bodies.gravity_z = gravity;
        EXPECT_TRUE(loop->change(other));
        loop->hold_frames(false);
      }
      wait_for_ticks(700);
      is_done = true;
    });
  };
  RunOptions options;
  options.keep_going = [&] { return !is_done.load(); };
  options.monitor = &monitor;
  const auto outcome = record_run(tool_, stream, **device, settings_, run(), options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_GT(test::repeated(run()).num_contacts, 1500u);
}

TEST_F(MovingObjects, PosesAreInTheMessages) {
  ContactRecord record;
  record.bodies.num = 2;
  record.bodies.of[1] = {{1, 2, 3}, axis_angle({0, 0, 1}, 0.5)};
  const auto read = read_contact(contact_message(record));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->bodies.num, 2u);
  EXPECT_EQ(read->bodies.of[1], record.bodies.of[1]);
  ContactRecord moved = record;
  moved.bodies.of[1].translation.y = 2.5;
  EXPECT_EQ(difference(record, moved), "bodies/1/position/y: recorded 2, repeated 2.5");
  record.bodies.num = kMaxMovingBodies + 1;
  EXPECT_FALSE(read_contact(contact_message(record)));
}

TEST_F(MovingObjects, NeedTheField) {
  const auto message = [&] {
    const auto outcome = record(run());
    return outcome ? std::string() : outcome.error().message;
  };
  settings_.contact.method = MethodKind::graph;
  EXPECT_NE(message().find("--method field"), std::string::npos);
  settings_.contact = {};
  settings_.contact.bodies = BodyMethod::spheres;
  EXPECT_NE(message().find("--bodies field"), std::string::npos);
  settings_.contact = {};
  settings_.objects[0].mass = 1e9;
  EXPECT_NE(message().find("mass"), std::string::npos);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

}  // namespace
}  // namespace palpate
