// What it costs to take a robot out of a depth image: seven links, drawn and removed.
#include <cmath>
#include <numbers>

#include "bench/latency.h"
#include "palpate/mesh/mesh.h"
#include "src/cameras/link_image.h"

namespace palpate::bench {
namespace {

constexpr int kWidth = 640, kHeight = 480, kNumLinks = 7;
constexpr double kRadius = 0.05, kLength = 0.25;  // m

/// An open tube along z.
TriangleMesh tube(int around, int along) {
  TriangleMesh mesh;
  const auto id = [&](int i, int j) { return static_cast<std::uint32_t>(j * around + i % around); };
  for (int j = 0; j <= along; ++j) {
    for (int i = 0; i < around; ++i) {
      const double angle = 2 * std::numbers::pi * i / around;
      mesh.vertices.push_back(
          {kRadius * std::cos(angle), kRadius * std::sin(angle), kLength * j / along});
    }
  }
  for (int j = 0; j < along; ++j) {
    for (int i = 0; i < around; ++i) {
      mesh.triangles.push_back({id(i, j), id(i + 1, j), id(i, j + 1)});
      mesh.triangles.push_back({id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)});
    }
  }
  return mesh;
}

void self_filter(benchmark::State& state) {
  const auto around = static_cast<int>(state.range(0));
  const TriangleMesh link = tube(around, around * 9 / 10);
  LinkImage image({525, 525, 319.5, 239.5}, 1e-3 * static_cast<double>(state.range(1)));
  DepthFrame frame;
  frame.width = kWidth;
  frame.height = kHeight;
  frame.pixels.assign(kWidth * kHeight, 1500);
  int number = 0, num_removed = 0;
  Latency latency(state);
  for (auto _ : state) {
    std::fill(frame.pixels.begin(), frame.pixels.end(), std::uint16_t(1500));
    latency.time([&] {
      // The arm curls up and stretches in front of a wall.
      const double curled = 0.4 + 0.2 * std::sin(0.1 * ++number);
      Pose X_CL{{-0.5, 0.3, 1.1}, {}};
      image.begin(kWidth, kHeight);
      for (int i = 0; i < kNumLinks; ++i) {
        X_CL = X_CL * Pose{{}, axis_angle({0.3, 1, 0.2}, curled + 0.1 * i)};
        image.add(link, X_CL);
        X_CL = X_CL * Pose{{0, 0, kLength}, {}};
      }
      image.draw();
      num_removed = image.remove_from(frame);
    });
  }
  state.counters["triangles"] = static_cast<double>(kNumLinks * link.triangles.size());
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
