// How much of a tool lies behind what a depth camera sees, and the force that pushes it out.
#include <cstdio>
#include <vector>

#include "palpate/palpate.h"

using namespace palpate;

int main() {
  // A tool: a closed mesh in meters, filled with spheres. Doing it once is enough; save_tool and
  // load_tool keep it in a file.
  const Tool tool = Tool::pack(make_cylinder(0.02, 0.1, 64), {.max_spheres = 2000}).value();

  // What the camera sees: a wall, 0.5 m away, in counts of a millimeter.
  const std::vector<std::uint16_t> counts(640 * 480, 500);
  Sensor sensor = Sensor::create({640, 480, {525, 525, 319.5, 239.5}}).value();
  const SurfaceView surface = sensor.update({640, 480, counts.data(), 0.001});

  // The tool in the world, which is the camera's frame: x right, y down, z forward.
  const Pose X_WT{.translation = {0, 0, 0.5}};
  const Contact contact = Contact::create(tool).value();
  const Penetration measured = contact.measure(surface, X_WT).penetration;
  if (measured.status.is_unmeasured()) return 1;

  // The measure is a volume times a direction, in m3; a stiffness in N/m3 makes it newtons.
  const Wrench F_W = VolumeStiffness{1e5} * measured.measure_W;
  std::printf("inside: %.1f %% of %.1f cm3\n", 100 * contact.fraction(measured),
              1e6 * tool.mesh_mass().volume);
  std::printf("force: %.2f %.2f %.2f N\n", F_W.force.x, F_W.force.y, F_W.force.z);
}
