#include "eval/studies/pillar.h"

#include <algorithm>
#include <cmath>

#include "eval/studies/interaction.h"
#include "scenes/truth.h"

namespace palpate::eval {
namespace {

constexpr double kBox = 0.08;  // m

double sign_of(PillarSide side) { return side == PillarSide::right ? 1 : -1; }

/// Returns the pillar from the camera to infinity, with only one of its edges.
scenes::Environment pillar_solid(PillarSide side) {
  scenes::Environment environment;
  environment.kind = scenes::Environment::Kind::ridge;
  environment.a = {{0, 0, -1}, -1};
  environment.b = {normalized(Vec3d{sign_of(side), 0, -kPillarEdge}), 0};
  return environment;
}

}  // namespace

const char* name_of(PillarSide side) { return side == PillarSide::right ? "right" : "left"; }

Result<FrozenFrame> seen_pillar(Context& context, bool with_noise) {
  const auto scene = scenes::make_scene("pillar");
  if (!scene) return scene.error();
  return seen_scene(context, *scene, with_noise);
}

Result<std::shared_ptr<const Tool>> pillar_box(Context& context, int num_spheres, GapRule rule) {
  return context.tool("box", kBox, num_spheres, rule);
}

std::vector<Pose> pillar_way(PillarSide side, double step) {
  const Quaternion tilted = axis_angle({0.3, 1, 0.2}, 20 * kPi / 180);
  std::vector<Pose> X_WT;
  for (double x = 0.05; x < 0.16; x += step) {
    X_WT.push_back({{sign_of(side) * x, -0.1, 1.005}, tilted});
  }
  return X_WT;
}

std::vector<double> exact_volumes(const Tool& tool, PillarSide side,
                                  const std::vector<Pose>& X_WT) {
  const scenes::Environment solid = pillar_solid(side);
  std::vector<double> volumes;
  for (const Pose& X : X_WT) {
    volumes.push_back(scenes::exact_volume(tool.mesh(), X, solid) / tool.mesh_mass().volume);
  }
  return volumes;
}

std::vector<double> measured_volumes(MethodQueries& query, const Tool& tool,
                                     const std::vector<Pose>& X_WT, const ContactOptions& options) {
  const double whole = full_volume(tool, options);
  std::vector<double> volumes;
  for (const Pose& X : X_WT) volumes.push_back(query.query(X, options).volume / whole);
  return volumes;
}

WayError way_error(const std::vector<double>& measured, const std::vector<double>& exact) {
  WayError result;
  double sum = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    const double error = measured[i] - exact[i];
    sum += error * error;
    result.worst = std::max(result.worst, std::abs(error));
    if (i == 0) continue;
    result.largest_step = std::max(result.largest_step, std::abs(measured[i] - measured[i - 1]));
  }
  result.rms = std::sqrt(sum / static_cast<double>(exact.size()));
  return result;
}

}  // namespace palpate::eval
