// Tunnelling (thesis Figs. 3.12-3.14): a box scrapes around the edge of a pillar. Seen from the
// camera, the pillar and what it hides are the solid behind its front *and* behind the plane of
// sight along its edge: a ridge, so the volume is known exactly.
#include <array>
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact_query.h"
#include "palpate/mesh/shapes.h"
#include "palpate/packing/packer.h"
#include "palpate/tool/tool.h"
#include "scenes/scene.h"
#include "scenes/truth.h"
#include "tests/accuracy/point_methods.h"

namespace palpate {
namespace {

constexpr double kSide = 0.08;        // of the box, m
constexpr double kPillarEdge = 0.11;  // x of the pillar's edges, m; its front is at z = 1 m

const Tool& box_tool() {
  static const Tool tool = [] {
    const TriangleMesh mesh = make_box({kSide, kSide, kSide});
    PackOptions options;
    options.max_spheres = 1500;
    return Tool::build(mesh, pack_spheres(mesh, options).value(), GapRule::absolute, "box").value();
  }();
  return tool;
}

// The pillar from the camera to infinity, as far as its right (+1) or left (-1) edge.
scenes::Environment seen_pillar(double side) {
  scenes::Environment environment;
  environment.kind = scenes::Environment::Kind::ridge;
  environment.a = {{0, 0, -1}, -1};
  environment.b = {normalized(Vec3d{side, 0, -kPillarEdge}), 0};
  return environment;
}

SurfaceEstimator surface_of_pillar(bool with_noise) {
  const scenes::Scene scene = scenes::make_scene("pillar").value();
  SurfaceEstimator surface =
      SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics).value();
  ThreadPool pool(1);
  if (with_noise) {
    scenes::SimulatedCameraOptions options;
    const auto camera = std::move(scenes::open_simulated_camera(scene, options)).value();
    DepthFrame frame;
    EXPECT_TRUE(camera->next(frame).value());
    surface.update(frame, pool);
  } else {
    const std::vector<float> depth = scenes::render_depth(scene, 0);
    surface.update(std::span<const float>(depth), pool);
  }
  return surface;
}

struct PathError {
  double rms = 0, worst = 0;  // shares of the tool's volume
  double largest_step = 0;    // of the volume over 0.25 mm of the way
};

// The box, tilted by 20 degrees, moves to the side until it has left the pillar.
PathError path_error(const SurfaceEstimator& surface, double side, const ContactOptions& options) {
  const Tool& tool = box_tool();
  const auto query = std::move(make_contact_query(Backend::cpu, tool)).value();
  query->set_cloud(surface.cloud());
  const PointCloudView cloud = surface.cloud();
  ThreadPool pool(1);
  DepthField field = std::move(DepthField::create(cloud.width, cloud.height)).value();
  field.update(cloud, pool);
  query->set_field(field.view());
  const scenes::Environment environment = seen_pillar(side);
  PathError result;
  double sum = 0, last = 0;
  int num = 0;
  for (double x = 0.05; x < 0.16; x += 0.00025) {
    const Pose X_WT{{side * x, -0.1, 1.005}, axis_angle({0.3, 1, 0.2}, 20 * kPi / 180)};
    const double measured = query->query(X_WT, options).volume / full_volume(tool, options);
    const double exact =
        scenes::exact_volume(tool.mesh(), X_WT, environment) / tool.mesh_mass().volume;
    const double error = measured - exact;
    sum += error * error;
    result.worst = std::max(result.worst, std::abs(error));
    if (num > 0) result.largest_step = std::max(result.largest_step, std::abs(measured - last));
    last = measured;
    ++num;
  }
  result.rms = std::sqrt(sum / num);
  return result;
}

class EdgesOfThePillar : public testing::TestWithParam<test::PointMethod> {};

// The noisy camera does not see what is left of the pillar: its projector is to the right.
TEST_P(EdgesOfThePillar, StopTunnelling) {
  const auto& [name, method, inside] = GetParam();
  for (const auto& [with_noise, side] :
       {std::pair{false, 1.0}, {true, 1.0}, {false, -1.0}, {true, -1.0}}) {
    const SurfaceEstimator surface = surface_of_pillar(with_noise);
    std::array<PathError, 4> errors;
    for (const Edges edges : {Edges::none, Edges::centre, Edges::strict, Edges::cut}) {
      ContactOptions options;
      options.method = method;
      options.inside = inside;
      options.volumes = SphereVolumes::represented;
      options.edges = edges;
      constexpr const char* kNames[] = {"none", "centre", "strict", "cut"};
      const auto which = static_cast<std::size_t>(edges);
      const PathError& error = errors[which] = path_error(surface, side, options);
      std::printf(
          "%-10s %-5s %-10s edges %-6s: rms %5.2f %%, worst %5.2f %%, largest step %5.2f %%\n",
          name, side > 0 ? "right" : "left", with_noise ? "noise" : "noise-free", kNames[which],
          100 * error.rms, 100 * error.worst, 100 * error.largest_step);
    }
    EXPECT_GT(errors[0].worst, 0.1);  // the tool tunnels
    EXPECT_LT(errors[3].worst, 0.04);
    EXPECT_LT(errors[3].largest_step, 0.03);
  }
}

// The field sees the room beside the pillar for what it is.
TEST(FieldAtThePillar, DoesNotTunnel) {
  for (const bool with_noise : {false, true}) {
    for (const double side : {1.0, -1.0}) {
      const PathError error = path_error(surface_of_pillar(with_noise), side,
                                         ContactOptions{.method = InsideMethod::field});
      std::printf("field      %-5s %-10s rms %5.2f %%, worst %5.2f %%, largest step %5.2f %%\n",
                  side > 0 ? "right" : "left", with_noise ? "noise" : "noise-free", 100 * error.rms,
                  100 * error.worst, 100 * error.largest_step);
      EXPECT_LT(error.worst, 0.1);
      EXPECT_LT(error.largest_step, 0.03);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, EdgesOfThePillar, test::point_methods(),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace palpate
