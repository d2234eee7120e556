// Cost of removing a robot from a depth image: seven links, rendered and removed.
#include "bench/arm_setup.h"
#include "bench/latency.h"
#include "src/cameras/internal/link_image.h"

namespace palpate::bench {
namespace {

void self_filter(benchmark::State& state) {
  const std::vector<RobotLink> links = arm_of_tubes(static_cast<int>(state.range(0)));
  LinkImage image(kArmCamera, 1e-3 * static_cast<double>(state.range(1)));
  const DepthFrame wall = wall_behind_arm();
  DepthFrame frame = wall;
  int step = 0, num_removed = 0;
  Latency latency(state);
  for (auto _ : state) {
    frame.pixels = wall.pixels;
    latency.time([&] {
      const std::vector<Pose> X_CL = arm_poses(++step);
      image.begin(kArmWidth, kArmHeight);
      for (std::size_t i = 0; i < links.size(); ++i) image.add(links[i].mesh, X_CL[i]);
      image.draw();
      num_removed = image.remove_from(frame);
    });
  }
  state.counters["triangles"] = static_cast<double>(kNumLinks * links[0].mesh.triangles.size());
  state.counters["removed"] = num_removed;
}

BENCHMARK(self_filter)
    ->ArgNames({"around", "padding_mm"})
    ->Args({10, 20})
    ->Args({20, 20})
    ->Args({40, 0})
    ->Args({40, 20})
    ->Args({40, 50})
    ->Args({100, 20})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate::bench
