// The same measurement on an NVIDIA GPU, if there is one that this build of Palpate can use.
#include <cstdio>

#include "palpate/contact/contact_query.h"
#include "palpate/mesh/shapes.h"

using namespace palpate;

int main() {
  const auto gpus = find_gpus();
  const Backend backend = gpus ? Backend::cuda : Backend::cpu;
  if (gpus) {
    std::printf("on %s\n", gpus->front().name.c_str());
  } else {
    std::printf("on the processor: %s\n", gpus.error().message.c_str());
  }

  const TriangleMesh mesh = make_cylinder(0.02, 0.1, 64);
  const SpherePacking packing = pack_spheres(mesh, {.max_spheres = 20000}).value();
  const Tool tool = Tool::build(mesh, packing, GapRule::relative, "a cylinder").value();

  // Surfaces are made and asked where they are: images go to the GPU, wrenches come back.
  const DepthStreamInfo stream{.width = 640,
                               .height = 480,
                               .intrinsics = {525, 525, 319.5, 239.5},
                               .num_frames = {},
                               .name = "a wall"};
  SurfaceTimeline surfaces =
      SurfaceTimeline::create(stream, {}, DepthFieldOptions{}, {}, {.backend = backend}).value();
  const auto query = make_contact_query(backend, tool).value();

  const DepthFrame frame{.width = 640,
                         .height = 480,
                         .unit = 0.001,
                         .pixels = std::vector<std::uint16_t>(640 * 480, 500)};
  ThreadPool threads(0);
  surfaces.push(frame, 0, threads);
  const SurfaceMoment now = surfaces.at(0);
  const Pose X_WT{.translation = {0, 0, 0.5}};
  const Penetration contact = query->measure(now.to, X_WT).penetration;
  std::printf("inside: %.1f %%\n", 100 * contact.volume / tool.mesh_mass().volume);
}
