// How a robot's tool may move near what a depth camera sees: rows A V <= b that a quadratic program
// takes, V being the velocities of the tool's center of mass in W. guard_arm.py moves an arm by
// them.
#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "palpate/palpate.h"

using namespace palpate;

struct Row {
  std::array<double, 6> a;  // m3 and m4
  double b;                 // m4/s
};

/// The potential U (m4: how much is inside, and how deep) may rise up to `most`, the more slowly
/// the nearer it is. Keeping to a surface is the same with the signs turned: U stays above a least
/// one.
Row keep_away(const Penetration& measured, double most, double rate) {
  const auto& [f, t] = measured.measure_W;  // minus the gradient of U
  return {{-f.x, -f.y, -f.z, -t.x, -t.y, -t.z}, rate * (most - measured.potential)};
}

/// What a row and the stiffness say of a small step, and what is measured there.
bool is_right(const Contact& contact, const SurfaceView& surface, const Pose& X_WT, int axis) {
  const ContactResult now = contact.measure(surface, X_WT, {.stiffness = true});
  const Row row = keep_away(now.penetration, 1e-7, 20);
  const auto i = static_cast<std::size_t>(axis);
  std::printf("row: %.2e %.2e %.2e | %.2e %.2e %.2e <= %.2e\n", row.a[0], row.a[1], row.a[2],
              row.a[3], row.a[4], row.a[5], row.b);
  const double step = 0.0005;
  Pose there = X_WT;
  there.translation[axis] += step;
  const double predicted = row.a[i] * step + 0.5 * now.stiffness->m[axis][axis] * step * step;
  const double measured =
      contact.measure(surface, there).penetration.potential - now.penetration.potential;
  std::printf("predicted: %.3e m4, measured: %.3e m4\n", predicted, measured);
  return measured > 0 && std::abs(predicted - measured) < 0.02 * measured;
}

int main() {
  const Tool tool = Tool::pack(make_box({0.06, 0.06, 0.06}), {.max_spheres = 1000}).value();
  const Contact contact = Contact::create(tool).value();
  const Camera camera{640, 480, {525, 525, 319.5, 239.5}};

  // A wall, half a meter away. Its right half is black: nothing was measured there.
  std::vector<std::uint16_t> counts(640 * 480, 500);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (i % 640 >= 320) counts[i] = 0;
  }
  const DepthImageView image{640, 480, counts.data(), 0.001};
  Sensor sensor = Sensor::create(camera).value();
  const SurfaceView seen = sensor.update(image);
  const bool wall_is_right = is_right(contact, seen, {.translation = {-0.1, 0, 0.475}}, 2);

  // Where nobody has seen anything nothing is felt, and that row allows everything. All that was
  // not seen to be free is a second surface, and its row the policy for the unseen: deep inside
  // there is no gradient, so that nothing obeys the row, and the robot stops.
  SensorOptions options;
  options.field.unknown = UnknownSpace::blocked;
  options.field.fill_levels = 0;  // small holes are unseen, too
  Sensor doubting = Sensor::create(camera, Place::cpu(), options).value();
  const SurfaceView not_free = doubting.update(image);
  const Pose at_its_edge{.translation = {-0.028, 0, 0.3}};
  const double felt = contact.measure(seen, at_its_edge).penetration.potential;
  std::printf("at the edge of what is seen: U %.1e m4\n", felt);
  const bool edge_is_right = felt == 0 && is_right(contact, not_free, at_its_edge, 0);

  const bool are_right = wall_is_right && edge_is_right;
  std::printf("the rows %s\n", are_right ? "are right" : "are wrong");
  return are_right ? 0 : 1;
}
