// How much of a tool lies behind what a depth camera sees, and the force that pushes it out.
#include <cstdio>

#include "palpate/contact/contact_query.h"
#include "palpate/io/tool_file.h"
#include "palpate/mesh/shapes.h"

using namespace palpate;

int main() {
  // A tool: a closed mesh in metres, filled with spheres. Doing it once is enough.
  const TriangleMesh mesh = make_cylinder(0.02, 0.1, 64);
  const SpherePacking packing = pack_spheres(mesh, {.max_spheres = 2000}).value();
  if (const Status saved = save_tool(
          Tool::build(mesh, packing, GapRule::relative, "a cylinder").value(), "cylinder.palp");
      !saved) {
    std::fprintf(stderr, "%s\n", saved.error().message.c_str());
    return 1;
  }
  const Tool tool = load_tool("cylinder.palp").value();

  // What the camera sees: a wall, 0.5 m away. Depth is in counts of a millimetre.
  const Intrinsics camera{.fx = 525, .fy = 525, .cx = 319.5, .cy = 239.5};
  const DepthFrame frame{.width = 640,
                         .height = 480,
                         .unit = 0.001,
                         .pixels = std::vector<std::uint16_t>(640 * 480, 500)};

  // From the image to a surface.
  ThreadPool threads(0);  // one per core
  SurfaceEstimator estimator = SurfaceEstimator::create(640, 480, camera).value();
  DepthField field = DepthField::create(640, 480).value();
  estimator.update(frame, threads);
  field.update(estimator.cloud(), threads);

  // The tool in the world, which is the camera's frame: x right, y down, z forward.
  const Pose X_WT{.translation = {0, 0, 0.5}};
  const auto query = make_contact_query(Backend::cpu, tool).value();
  const Penetration contact = query->measure({estimator.cloud(), field.view()}, X_WT).penetration;

  // The measure is a volume times a direction, in m3; a spring constant in N/m3 makes it newtons.
  const double stiffness = 1e5;
  const Vec3d force_W = stiffness * contact.measure_W.force;
  std::printf("inside: %.1f %% of %.1f cm3\n", 100 * contact.volume / tool.mesh_mass().volume,
              1e6 * tool.mesh_mass().volume);
  std::printf("force: %.2f %.2f %.2f N\n", force_W.x, force_W.y, force_W.z);
}
