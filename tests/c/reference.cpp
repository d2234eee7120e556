// Prints measurements through the C++ headers, as bits, one line each: what tests/c/calls.py and
// calls.rs, which know only the C header, have to print too.
#include <bit>
#include <cinttypes>
#include <cstdio>
#include <memory>
#include <vector>

#include "palpate/contact/body_contact.h"
#include "palpate/contact/scene.h"
#include "palpate/haptics/coupling.h"
#include "palpate/haptics/safety.h"
#include "palpate/palpate.h"
#include "scenes/scene.h"

namespace palpate {
namespace {

constexpr int kWidth = 160, kHeight = 120;

void print(const char* name, std::initializer_list<double> numbers) {
  std::printf("%s", name);
  for (const double number : numbers)
    std::printf(" %016" PRIx64, std::bit_cast<std::uint64_t>(number));
  std::printf("\n");
}

/// A step of two walls, bumpy, with holes.
std::vector<std::uint16_t> counts() {
  std::vector<std::uint16_t> all;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const int depth = (u > 90 ? 560 : 600) + (u * u / 37 + v * v / 53) % 5;
      all.push_back(static_cast<std::uint16_t>((u * 31 + v * 17) % 97 == 0 ? 0 : depth));
    }
  }
  return all;
}

Pose pose(int i) {
  return {{0.004 * i - 0.01, 0.003 * i, 0.54 + 0.01 * i},
          normalized(Quaternion{0.1 * i, 0.05, 0, 1})};
}

void measure(const Tool& tool, const SurfaceView& surface, const char* name,
             const ContactMethod& method) {
  const Contact contact = Contact::create(tool, method).value();
  for (int i = 0; i < 5; ++i) {
    const ContactResult r = contact.measure(surface, pose(i), {.stiffness = true});
    const auto& [force, torque] = r.penetration.measure_W;
    print(name, {r.penetration.volume, r.penetration.potential, force.x, force.y, force.z, torque.x,
                 torque.y, torque.z, r.stiffness ? r.stiffness->m[2][2] : 0,
                 r.stiffness ? r.stiffness->m[3][4] : 0});
  }
}

/// Measures beside a box: what the camera sees, plus the pair of bodies.
void measure_beside_box(const Tool& tool, const SurfaceView& surface) {
  const auto solid = check_solid(make_shape("box", 0.1).value()).value();
  const Tool box = Tool::pack(solid.mesh, {.max_spheres = 50}).value();
  const Pose X_WB{{0.05, 0.02, 0.56}, {}};
  const Contact contact = Contact::create(tool).value();
  const auto pair = make_body_pair_query(Place::cpu(), tool, box).value();
  for (int i = 0; i < 5; ++i) {
    const ContactResult seen = contact.measure(surface, pose(i), {.stiffness = true});
    const BodyPenetration with = pair->measure(pose(i), X_WB, true);
    const Vec3d force = seen.penetration.measure_W.force + with.on_a.measure_W.force;
    const Vec3d torque = seen.penetration.measure_W.torque + with.on_a.measure_W.torque;
    const auto first = [&](int row, int column) {
      return seen.moments.first[row][column] + with.moments_a.first[row][column];
    };
    print("body",
          {seen.penetration.volume + with.on_a.volume, with.on_a.volume, force.x, force.y, force.z,
           torque.x, torque.y, torque.z, seen.stiffness->m[2][2] + with.stiffness_a->m[2][2],
           first(0, 0), first(0, 1), first(0, 2), first(1, 0), first(1, 1), first(1, 2),
           first(2, 0), first(2, 1), first(2, 2), seen.moments.polar + with.moments_a.polar});
  }
}

/// Pushes a device's handle toward the wall for 400 ticks.
void push(const Tool& tool, const SurfaceView& surface) {
  const DeviceLimits limits{10, 0.5, 2000, 5, 10, 0.2, 1, 0.001};
  const MassProperties& mass = tool.sphere_mass();
  const CouplingOptions options = check_coupling({}, limits, 1e-3, mass).value().options;
  const auto coupling = make_coupling(options, limits, mass);
  SafetyFilter safety = SafetyFilter::create(limits, SafetyOptions{}).value();
  const VolumeStiffness scale =
      thesis_volume_stiffness(options.force_at_eighth, tool.mesh_mass().volume);
  const Contact contact = Contact::create(tool).value();
  Pose X_WT = pose(0);
  const Pose X_BH = handle_at(options, X_WT);
  for (int k = 0; k < 400; ++k) {
    const double time = 1 + 1e-3 * k;
    DeviceState state{time, X_BH, {}, 0, true};
    state.X_BH.translation.z += 2e-4 * k;
    if (k == 0) coupling->reset(state);
    const ContactResult r = contact.measure(surface, X_WT, {.stiffness = true});
    const Penetration& p = r.penetration;
    const ContactPatch patch = p.volume > 0
                                   ? contact_patch(p.measure_W, p.volume, *r.stiffness, r.moments)
                                   : ContactPatch{};
    const LocalContact local =
        local_contact(p, *r.stiffness, X_WT, mass.center_of_mass, scale, time, 0, patch);
    // The first tick has no time before it: the nominal step.
    const double last = k == 0 ? time - 1e-3 : 1 + 1e-3 * (k - 1);
    const CouplingStep step = coupling->step(state, local, time - last);
    SafetyInput input;
    input.time = time;
    input.state = state;
    input.is_free =
        p.volume == 0 && step.contact_W.force == Vec3d{} && step.contact_W.torque == Vec3d{};
    input.stored = step.stored;
    input.is_clutched = step.is_clutched;
    const Wrench F_H_B = safety.filter(step.desired_F_H_B, input);
    X_WT = step.X_WT;
    if (k % 50 == 49) {
      print("push", {F_H_B.force.x, F_H_B.force.y, F_H_B.force.z, X_WT.translation.z,
                     safety.status().energy});
    }
  }
}

void run() {
  const auto solid = check_solid(make_shape("stylus", 0.12).value()).value();
  const Tool tool = Tool::pack(solid.mesh, {.max_spheres = 300}).value();
  Sensor sensor = Sensor::create({kWidth, kHeight, {140, 140, 79.5, 59.5}}).value();
  const auto image = counts();
  const SurfaceView surface = sensor.update({kWidth, kHeight, image.data(), 0.001});
  measure(tool, surface, "field", FieldMethod{});
  measure(tool, surface, "graph", GraphMethod{.edges = Edges::cut});
  const Tool* const tools[] = {&tool};
  const SceneContact scene = SceneContact::create(tools).value();
  std::vector<Pose> poses;
  for (int i = 0; i < 5; ++i) poses.push_back(pose(i));
  std::vector<double> clearances(poses.size());
  const Status status =
      scene.measure({.surfaces = {surface}}, {.X_WT = poses}, {.clearance = clearances.data()});
  if (!status) std::printf("%s\n", status.error().message.c_str());
  for (const double clearance : clearances) print("clearance", {clearance});
  measure_beside_box(tool, surface);
  push(tool, surface);
  scenes::Scene hand = scenes::make_scene("hand").value();
  scenes::set_image_size(hand, 160, 120);
  scenes::SimulatedCameraOptions options;
  options.seed = 7;
  const auto camera = scenes::open_simulated_camera(hand, options).value();
  DepthFrame frame;
  for (int k = 0; k < 2; ++k) {
    static_cast<void>(camera->next(frame));
    std::uint64_t hash = 0xcbf29ce484222325;
    for (const std::uint16_t count : frame.pixels) hash = (hash ^ count) * 0x100000001b3;
    std::printf("frame %016" PRIx64 "\n", hash);
  }
}

}  // namespace
}  // namespace palpate

int main() { palpate::run(); }
