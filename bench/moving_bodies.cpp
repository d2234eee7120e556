// Moving objects against their goals, on a table below a simulated depth camera; on
// a simulated clock: the same numbers on every machine, except the cost of a step.
//   moving_bodies CSV [FIGURE...]
// rest: drift of a box in 60 s, with the noise of a Kinect, by average of depth over time.
// stack: the same of five boxes on each other.
// energy: energy gained without any work from outside.
// tunnel: plates that meet the table, each other and a tool at 1 m/s.
// cost: CPU time of a step in its thread: eight bodies of 1,000 spheres and a tool.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/harness.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/math/internal/rotation_vector.h"
#include "src/run/internal/pipeline.h"
#include "tests/bodies/camera_table.h"
#include "tests/test_util/random.h"

namespace palpate::bench {
namespace {

using test::CameraTableOptions;
using test::kTable;
using test::packed_shape;
using test::TableTop;

constexpr double kDegrees = 180 / 3.14159265358979323846;
const Vec3d kBox{0.06, 0.05, 0.04};

ResultRows* rows = nullptr;
void row(const std::string& figure, const std::string& of, double value, const char* unit,
         double goal) {
  rows->add(figure + "/" + of, value, unit, goal);
}

SceneObject object_at(const std::shared_ptr<const Tool>& shape, const Pose& X_WB, double mass) {
  return {shape, X_WB, {}, true, mass};
}
std::vector<SceneObject> stack_of(int num) {
  const auto shape = packed_shape(make_box(kBox), 1000);
  std::vector<SceneObject> boxes;
  for (int i = 0; i < num; ++i) {
    boxes.push_back(
        object_at(shape, {{1e-3 * (i % 2), 0, kTable - kBox.z * (i + 0.5) - 2e-4 * i}, {}}, 0.3));
  }
  return boxes;
}

/// Measures the drift of the uppermost of `num` stacked boxes, from 3 s on.
void rest(int num, bool may_sleep, const char* figure) {
  for (const DepthAverage average : {DepthAverage::none, DepthAverage::kalman}) {
    CameraTableOptions seen;
    seen.has_noise = true;
    seen.width = 640;
    seen.time.average.kind = average;
    BodyOptions options;
    options.may_sleep = may_sleep;
    TableTop world(stack_of(num), seen, options);
    Pose begin;
    double shift = 0, turn = 0;
    for (int i = 0; i < 63000; ++i) {
      world.step();
      const Pose& now = world.body(num - 1).X_WB;
      if (i < 3000) begin = now;
      shift = std::max(shift, norm(now.translation - begin.translation));
      turn = std::max(turn, norm(rotation_between(begin.rotation, now.rotation)));
    }
    const std::string of = std::string(num > 1 ? "top of five, average " : "box, average ") +
                           (average == DepthAverage::none ? "none" : "kalman") +
                           (may_sleep ? "" : ", kept awake");
    const Pose& end = world.body(num - 1).X_WB;
    row(figure, of + ": farthest in 60 s", 1e3 * shift, "mm", 0.1);
    row(figure, of + ": most turned in 60 s", kDegrees * turn, "degrees", 0.1);
    row(figure, of + ": after 60 s", 1e3 * norm(end.translation - begin.translation), "mm", 0.1);
    const double height = kTable - end.translation.z;
    row(figure, of + ": height over where it should be", 1e3 * (height - kBox.z * (num - 0.5)),
        "mm", 0);
  }
}

void energy() {
  double max_fallen = 0, max_all = 0, max_resting = 0;
  test::Random random(3);
  const auto shape = packed_shape(make_box(kBox), 400);
  for (int run = 0; run < 10; ++run) {
    std::vector<SceneObject> boxes;
    for (int i = 0; i < 4; ++i) {
      const auto any = [&] { return random.uniform(-1.0, 1.0); };
      boxes.push_back(object_at(shape,
                                {{0.05 * any(), 0.05 * any(), kTable - 0.06 - 0.08 * i},
                                 axis_angle({any(), any(), any()}, 3 * any())},
                                0.3));
    }
    BodyOptions options;
    options.may_sleep = false;
    options.damping = 0;
    TableTop world(boxes, {}, options);
    const auto all = [&] {
      double sum = 0;
      for (const RigidBody& body : world.bodies->bodies()) {
        sum += kinetic_energy(body) - body.mass * 9.81 * body.center_W().z;
      }
      return sum;
    };
    const double scale = 4 * 0.3 * 9.81 * 0.1;  // J: scale of the potential energy
    double before = all(), least = before, min_all = 1e9;
    for (int i = 0; i < 3000; ++i) {
      world.step();
      const double now = all(), with_springs = world.bodies->energy();
      max_fallen = std::max(max_fallen, (now - before) / scale);
      if (i > 500) max_resting = std::max(max_resting, (now - least) / scale);
      if (i > 0) max_all = std::max(max_all, (with_springs - min_all) / scale);
      least = std::min(least, now);
      min_all = std::min(min_all, with_springs);
    }
  }
  row("energy", "motion and height, over the beginning", 100 * max_fallen, "%", 0);
  row("energy", "motion and height, over the least so far, from 0.5 s on", 100 * max_resting, "%",
      0);
  row("energy", "with what contacts hold, over the least so far", 100 * max_all, "%", 0);
}

void tunnel() {
  for (const double thick : {0.01, 0.02, 0.04}) {
    const auto plate = packed_shape(make_box({0.1, 0.08, thick}), 1000);
    int through_table = 0, through_body = 0, num = 0;
    double deepest = 0;
    for (int k = 0; k < 12; ++k) {
      const Quaternion turned = axis_angle({1, 0.3 * k, 0.1}, k * kPi / 12);
      std::vector<SceneObject> plates{
          object_at(plate, {{0, 0, kTable - thick / 2}, {}}, 0),
          object_at(plate, {{0.01, 0.005, kTable - thick / 2 - 0.12}, turned}, 0),
          object_at(plate, {{0.25, 0, kTable - 0.12}, turned}, 0)};
      BodyOptions options;
      options.may_sleep = false;
      TableTop world(plates, {}, options);
      for (int i = 0; i < 1500; ++i) {
        world.step();
        for (int b = 0; b < 3; ++b) {
          for (const Vec3d& corner : plate->mesh().vertices) {
            deepest = std::max(deepest, (world.body(b).X_WB * corner).z - kTable);
          }
        }
      }
      ++num;
      through_table += world.body(2).center_W().z > kTable || world.body(0).center_W().z > kTable;
      // Below the other plate, or in it.
      const Vec3d apart = world.body(1).center_W() - world.body(0).center_W();
      const bool is_beside = std::hypot(apart.x, apart.y) > 0.06;
      through_body += !is_beside && apart.z > -0.6 * thick;
    }
    const std::string of = "plate of " + std::to_string(std::lround(1e3 * thick)) + " mm";
    row("tunnel", of + ", of " + std::to_string(num) + " through the table", through_table, "times",
        0);
    row("tunnel", of + ", through another plate", through_body, "times", 0);
    row("tunnel", of + ", deepest corner in the table", 1e3 * deepest, "mm", 10);
  }
}

/// Moves a tool of 6 cm at 1 m/s against a free plate, with the stiffness of a device.
void tunnel_tool() {
  for (const double thick : {0.01, 0.02, 0.04}) {
    for (const double max_force : {8.0, 20.0}) {
      const auto plate = packed_shape(make_box({0.1, 0.08, thick}), 1000);
      RunSettings settings;
      settings.num_threads = 1;
      settings.coupling.kind = CouplingKind::none;
      settings.coupling.force_at_eighth = max_force;
      settings.bodies.gravity_y = 0;
      settings.objects = {object_at(plate, {{0, 0, 0.4}, {}}, 0)};
      const auto tool = packed_shape(make_box(kBox), 1000);
      DepthStreamInfo stream;
      stream.width = 64, stream.height = 48;
      stream.intrinsics = {60, 60, 31.5, 23.5};
      stream.unit = 0.001;
      auto pipeline = Pipeline::create(*tool, stream, DeviceInfo{}, settings).value();
      DepthFrame frame;
      frame.width = 64, frame.height = 48, frame.unit = 0.001;
      frame.pixels.assign(64 * 48, 3000);
      pipeline.push(frame, 0);
      for (int i = 0; i < 400; ++i) {
        pipeline.measure({{0.004, 0.003, 0.25 + 1e-3 * i}, {}}, 1e-3 * i);
      }
      const double ahead = pipeline.contact().bodies.of[0].translation.z - (0.25 + 0.399);
      row("tunnel",
          "tool at 1 m/s through a free plate of " + std::to_string(std::lround(1e3 * thick)) +
              " mm, " + std::to_string(std::lround(max_force)) + " N at an eighth",
          ahead < 0 ? 1 : 0, "times", 0);
    }
  }
}

void cost() {
  const auto shape = packed_shape(make_box(kBox), 1000);
  for (const bool is_pile : {false, true}) {
    RunSettings settings;
    settings.num_threads = 1;
    settings.coupling.kind = CouplingKind::none;
    settings.bodies.gravity_y = 0;
    settings.bodies.gravity_z = 9.81;
    settings.bodies.may_sleep = false;
    for (int i = 0; i < 8; ++i) {
      const double x = is_pile ? 0.05 * (i % 2) : 0.08 * (i % 4) - 0.12;
      const double y = is_pile ? 0.045 * (i / 2 % 2) : 0.1 * (i / 4);
      const double z = kTable - kBox.z * (is_pile ? 0.5 + i / 4 : 0.5) - 1e-3;
      settings.objects.push_back(object_at(shape, {{x, y, z}, {}}, 0.3));
    }
    test::CameraTable::Options seen;
    seen.has_noise = true;
    seen.width = 640;
    test::CameraTable table(seen);
    DepthStreamInfo stream;
    stream.width = 640, stream.height = 480;
    stream.intrinsics = {575.8157, 575.8157, 319.5, 239.5};
    auto part = make_contact_part(ToolIndex::create(*shape), settings,
                                  {thesis_volume_stiffness(8, shape->mesh_mass().volume), 0});
    std::vector<double> micros;
    for (int i = 0; i < 6000; ++i) {
      const double time = 1e-3 * i;
      const SurfaceBlend blend = table.at(time);
      ContactRecord record;
      record.contact.time = time;
      record.X_WT = {{0.01, 0.02 * std::sin(time), kTable - (is_pile ? 0.1 : 0.055)}, {}};
      const double begin = thread_cpu_now();
      (*part)->measure({&blend, 1}, true, record);
      const double took = thread_cpu_now() - begin;
      if (i >= 1000) micros.push_back(1e6 * took);
    }
    const std::string of = is_pile ? "8 bodies of 1,000 spheres in two layers"
                                   : "8 bodies of 1,000 spheres side by side";
    rows->times("cost/" + of + ": contact and step", call_times(std::move(micros)), "goal_us=1000");
  }
}

}  // namespace
}  // namespace palpate::bench

int main(int num, char** words) {
  using namespace palpate::bench;
  if (num < 2) {
    std::fprintf(
        stderr,
        "usage: moving_bodies CSV [energy tunnel cost rest rest_awake stack stack_awake]\n");
    return 2;
  }
  ResultRows all(num, words);
  if (!all.open(words[1])) return 1;
  rows = &all;
  const auto is_requested = [&](const std::string& figure) {
    return num == 2 ||
           std::any_of(words + 2, words + num, [&](const char* w) { return w == figure; });
  };
  if (is_requested("energy")) energy();
  if (is_requested("tunnel")) tunnel();
  if (is_requested("tunnel")) tunnel_tool();
  if (is_requested("cost")) cost();
  if (is_requested("rest")) rest(1, true, "rest");
  if (is_requested("rest_awake")) rest(1, false, "rest");
  if (is_requested("stack")) rest(5, true, "stack");
  if (is_requested("stack_awake")) rest(5, false, "stack");
  return all.close() ? 0 : 1;
}
