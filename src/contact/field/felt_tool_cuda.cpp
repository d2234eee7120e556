#include "src/contact/field/felt_tool_cuda.h"

#include <vector>

namespace palpate {

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
  return {{memory.copy_of(balls), memory.copy_of(factors), memory.copy_of(c.clusters),
           memory.copy_of(elements.largest_radius), c.num_clusters()},
          memory.copy_of(spheres),
          elements.reach};
}

}  // namespace palpate
