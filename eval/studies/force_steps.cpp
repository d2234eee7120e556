#include "eval/studies/force_steps.h"

namespace palpate::eval {
namespace {

constexpr int kNumSteps = 600;
constexpr double kStart = 0.964;  // m, z of the cube's center at the start

}  // namespace

std::vector<NoisySolid> noisy_solids() {
  return {{"wall", scenes::Environment::wall(1)},
          {"ball", scenes::Environment::ball_outside(1, 0.08)}};
}

RenderedScene see_noisy(const NoisySolid& solid) {
  scenes::Scene scene = scenes::make_scene("wall").value();
  scene.environment = solid.environment;
  return see(scene, DepthNoise::gaussian);
}

Result<std::shared_ptr<const Tool>> sinking_cube(Context& context) {
  return context.tool("box", 0.06, 500);
}

std::vector<double> force_steps(const Measure& measure) {
  const Quaternion tilted = axis_angle({0.3, 1, 0.2}, 20 * kPi / 180);
  const auto force_at = [&](int k) {
    return measure.at({{0.003, 0.002, kStart + k * kSinkingStep}, tilted}).measure_W.force;
  };
  std::vector<double> steps;
  Vec3d last = force_at(0);
  for (int k = 1; k <= kNumSteps; ++k) {
    const Vec3d force = force_at(k);
    steps.push_back(norm(force - last) / measure.whole);
    last = force;
  }
  return steps;
}

}  // namespace palpate::eval
