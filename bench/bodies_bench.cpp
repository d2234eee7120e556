// Tree against tree: time of one measurement of two equal cubes, by number of spheres and by how
// deep one is in the other.
#include "palpate/contact/body_contact.h"

#include "bench/contact_setup.h"
#include "bench/latency.h"

namespace palpate::bench {
namespace {

/// `depth` 0..1: how far one cube is past a face of the other, in cube sizes. +-15 degrees per
/// axis, up to a tenth of the cube to the side.
std::vector<Pose> overlapping_poses(double depth, int num = 200) {
  test::Random random(1);
  std::vector<Pose> poses;
  for (int i = 0; i < num; ++i) {
    const double limit = 15 * kPi / 180, side = 0.1 * kToolSize;
    const Quaternion q = axis_angle({1, 0, 0}, random.uniform(-limit, limit)) *
                         axis_angle({0, 1, 0}, random.uniform(-limit, limit)) *
                         axis_angle({0, 0, 1}, random.uniform(-limit, limit));
    const double x = random.uniform(-side, side), y = random.uniform(-side, side);
    poses.push_back({{x, y, (1 - depth) * kToolSize}, q});
  }
  return poses;
}

void bodies(benchmark::State& state) {
  const Tool& tool = cube_tool(static_cast<int>(state.range(0)));
  const std::vector<Pose> poses = overlapping_poses(static_cast<double>(state.range(1)) / 100);
  BodyContact contact(tool, tool);
  std::size_t i = 0;
  double num_pairs = 0;
  {
    Latency latency(state);
    for (auto _ : state) {
      BodyPenetration result;
      latency.time([&] { result = contact.measure(poses[i % poses.size()], {}); });
      benchmark::DoNotOptimize(result);
      if (i < poses.size()) num_pairs += static_cast<double>(result.num_pairs);
      ++i;
    }
  }
  state.counters["pairs"] = num_pairs / static_cast<double>(std::min(i, poses.size()));
}

BENCHMARK(bodies)
    ->ArgNames({"spheres", "depth"})
    ->ArgsProduct({{1000, 5000, 17000, 100000}, {1, 10, 50, 100}})
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate::bench
