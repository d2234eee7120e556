// How a robot's tool may move near what a depth camera sees: rows A V <= b that a quadratic program
// takes, V being the velocities of the tool's centre of mass in W. guard_arm.py moves an arm by
// them.
#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "palpate/mesh/mesh.h"
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

int main() {
  const TriangleMesh mesh = make_box({0.06, 0.06, 0.06});
  const SpherePacking packing = pack_spheres(mesh, {.max_spheres = 1000}).value();
  const Tool tool = Tool::build(mesh, packing, GapRule::relative, "a guard").value();
  const Contact contact = Contact::create(tool).value();
  const std::vector<std::uint16_t> counts(640 * 480, 500);  // a wall, half a metre away
  Sensor sensor = Sensor::create({640, 480, {525, 525, 319.5, 239.5}}).value();
  const SurfaceView surface = sensor.update({640, 480, counts.data(), 0.001});

  const Pose X_WT{.translation = {0.01, 0, 0.475}};
  const ContactResult now = contact.measure(surface, X_WT, {.stiffness = true});
  const Row row = keep_away(now.penetration, 1e-7, 20);
  std::printf("row: %.2e %.2e %.2e | %.2e %.2e %.2e <= %.2e\n", row.a[0], row.a[1], row.a[2],
              row.a[3], row.a[4], row.a[5], row.b);

  // What the row and the stiffness say of a step of half a millimetre, and what is measured there.
  const double step = 0.0005;
  const double told = row.a[2] * step + 0.5 * now.stiffness->m[2][2] * step * step;
  const Pose there{.translation = {0.01, 0, 0.475 + step}};
  const double came =
      contact.measure(surface, there).penetration.potential - now.penetration.potential;
  std::printf("told: %.3e m4, came: %.3e m4\n", told, came);
  const bool is_right = std::abs(told - came) < 0.01 * came;
  std::printf("the row %s\n", is_right ? "is right" : "is wrong");
  return is_right ? 0 : 1;
}
