#include "src/contact/field/field_tool_cuda.h"

#include <algorithm>
#include <vector>

#include "src/contact/internal/ball_parts.h"

namespace palpate { inline namespace v0 {

ElementsView elements_view(const FieldElements& elements, gpu::Memory& memory) {
  const SphereClusters& c = elements.clusters;
  std::vector<ElementBall> balls(c.x.size());
  std::vector<float> factors(c.x.size());
  for (std::size_t slot = 0; slot < balls.size(); ++slot) {
    balls[slot] = {c.x[slot], c.y[slot], c.z[slot], elements.radius[slot]};
    const float factor = elements.factor[slot];
    factors[slot] = elements.counted[slot] > 0 ? factor : -factor;
  }
  const auto& rows = ball_places().rows;
  const std::vector<float> places(&rows[0][0], &rows[0][0] + sizeof rows / sizeof(float));
  const WholeClusters& w = elements.wholes;
  std::vector<ElementBall> wholes(w.x.size());
  for (std::size_t slot = 0; slot < wholes.size(); ++slot) {
    wholes[slot] = {w.x[slot], w.y[slot], w.z[slot], w.radius[slot]};
  }
  return {memory.copy_of(balls),      memory.copy_of(factors),
          memory.copy_of(c.clusters), memory.copy_of(elements.largest_radius),
          c.num_clusters(),           memory.copy_of(elements.ball_factor),
          elements.first_ball(),      memory.copy_of(places),
          memory.copy_of(wholes),     memory.copy_of(w.factor),
          memory.copy_of(w.depth),    memory.copy_of(w.counted),
          memory.copy_of(w.polar)};
}

FieldTool make_field_tool(const ToolIndex& index, SphereVolumes volumes, gpu::Memory& memory) {
  const Tool& tool = index.tool();
  const FieldElements& elements = parts_of(index).elements(volumes);
  std::vector<Sphere> spheres(tool.spheres().size());
  for (std::size_t id = 0; id < spheres.size(); ++id) spheres[id] = field_ball(tool, id, volumes);
  FieldTool made{elements_view(elements, memory), memory.copy_of(spheres), elements.reach, {}, 0};
  const SphereClusters& c = elements.clusters;
  for (std::size_t slot = 0; slot < c.x.size(); ++slot) {
    const float from_center = norm(Vec3f{c.x[slot], c.y[slot], c.z[slot]});
    made.whole.reach = std::max(made.whole.reach, 1.00001f * (from_center + elements.radius[slot]));
  }
  made.largest_radius = *std::ranges::max_element(elements.largest_radius);
  return made;
}

}}  // namespace palpate::v0
