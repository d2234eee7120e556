#include "src/contact/field/felt_tool_cuda.h"

#include <algorithm>
#include <vector>

namespace palpate::inline v0 {

FeltTool felt_tool(const ToolIndex& index, SphereVolumes volumes, gpu::Memory& memory) {
  const Tool& tool = index.tool();
  const FieldElements& elements = index.parts().elements(volumes);
  const SphereClusters& c = elements.clusters;
  std::vector<ElementBall> balls(c.x.size());
  std::vector<float> factors(c.x.size());
  for (std::size_t slot = 0; slot < balls.size(); ++slot) {
    balls[slot] = {c.x[slot], c.y[slot], c.z[slot], elements.radius[slot]};
    const float factor = elements.factor[slot];
    factors[slot] = elements.counted[slot] > 0 ? factor : -factor;
  }
  std::vector<Sphere> spheres(tool.spheres().size());
  for (std::size_t id = 0; id < spheres.size(); ++id) spheres[id] = felt_ball(tool, id, volumes);
  FeltTool felt{{memory.copy_of(balls), memory.copy_of(factors), memory.copy_of(c.clusters),
                 memory.copy_of(elements.largest_radius), c.num_clusters()},
                memory.copy_of(spheres),
                elements.reach,
                {},
                0};
  for (const ElementBall& ball : balls) {
    const float from_centre = norm(Vec3f{ball.x, ball.y, ball.z});
    felt.whole.reach = std::max(felt.whole.reach, 1.00001f * (from_centre + ball.radius));
    felt.largest_radius = std::max(felt.largest_radius, ball.radius);
  }
  return felt;
}

}  // namespace palpate::inline v0
