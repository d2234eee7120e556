#include "eval/studies/accuracy.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "scenes/scene.h"
#include "src/math/internal/farthest.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

constexpr double kDepth = 1;  // m, where every synthetic environment intersects the optical axis

/// Sets the way along z past the point (x, y), by bisection of the first contact.
void set_way(ContactCase& c, const Quaternion& rotation, double x, double y) {
  const TriangleMesh mesh = make_shape(c.tool_shape, c.tool_size).value();
  const Reach reach = reach_along_z(mesh, rotation);
  const auto at = [&](double z) { return Pose{{x, y, z}, rotation}; };
  const double whole = mass_properties(mesh).volume;
  double before = kDepth - reach.front - c.tool_size, after = kDepth + reach.rear;
  for (int i = 0; i < 60; ++i) {
    const double z = (before + after) / 2;
    (scenes::exact_volume(mesh, at(z), c.environment) > 1e-9 * whole ? after : before) = z;
  }
  c.start = at(before);
  c.end = at(kDepth + reach.rear);
}

Vec3d center_of_mass(const Tool& tool, const Pose& X_WT) {
  return X_WT * tool.sphere_mass().center_of_mass;
}

double angle_between(const Vec3d& a, const Vec3d& b) {
  return std::atan2(norm(cross(a, b)), dot(a, b));
}

/// Accumulates the root mean square and the largest of several errors.
class ErrorSum {
 public:
  void add(double error) {
    sum_ += error * error;
    worst_ = std::max(worst_, std::abs(error));
    ++num_;
  }
  double rms() const { return num_ > 0 ? std::sqrt(sum_ / num_) : 0; }
  double worst() const { return worst_; }

 private:
  double sum_ = 0, worst_ = 0;
  int num_ = 0;
};

/// Pose and twist at phase t of a loop about the pose `middle` of the tool with its center of mass
/// at `center_T`. Turns about x, then y, then z of W, all through that center.
struct LoopPoint {
  Pose X_WT;
  Twist twist;  ///< per radian of phase: of the center of mass, in W
};
LoopPoint loop_point(const Pose& middle, const Vec3d& center_T, double size, double t) {
  const double a = 0.2 * std::sin(t + 0.5), b = 0.15 * std::sin(2 * t), c = 0.25 * std::cos(t);
  const double da = 0.2 * std::cos(t + 0.5), db = 0.3 * std::cos(2 * t), dc = -0.25 * std::sin(t);
  const Vec3d moved{0.12 * std::sin(t), 0.08 * std::sin(2 * t + 1), 0.1 * std::cos(t)};
  const Vec3d speed{0.12 * std::cos(t), 0.16 * std::cos(2 * t + 1), -0.1 * std::sin(t)};
  const Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  const Quaternion about_x = axis_angle(x, a), about_xy = about_x * axis_angle(y, b);
  const Quaternion rotation = normalized(about_xy * axis_angle(z, c) * middle.rotation);
  const Vec3d center_W = middle * center_T + moved * size;
  return {{center_W - rotate(rotation, center_T), rotation},
          {speed * size, x * da + rotate(about_x, y) * db + rotate(about_xy, z) * dc}};
}

}  // namespace

std::vector<ContactCase> thesis_cases() {
  std::vector<ContactCase> cases;
  for (const scenes::ThesisExperiment& x : scenes::thesis_experiments()) {
    cases.push_back({x.scene + " " + x.tool_shape, x.scene, scenes::environment_of(x.scene).value(),
                     x.tool_shape, x.tool_size, x.start, x.end});
  }
  return cases;
}

std::vector<ContactCase> tilted_cases() {
  std::vector<ContactCase> cases;
  for (const char* name : {"wall box", "sphere-out-160 box", "sphere-in-160 box",
                           "corner-270 tetrahedron", "ridge-90 tetrahedron"}) {
    for (ContactCase c : thesis_cases()) {
      if (c.name != name) continue;
      c.name += " tilted";
      const Quaternion tilt = axis_angle({1, 2, 0.5}, 20 * kPi / 180);
      set_way(c, normalized(tilt * c.start.rotation), 0.011, -0.007);
      cases.push_back(std::move(c));
    }
  }
  return cases;
}

std::vector<ContactCase> accuracy_cases() {
  std::vector<ContactCase> cases = thesis_cases();
  for (ContactCase& c : tilted_cases()) cases.push_back(std::move(c));
  return cases;
}

ContactCase at_the_wall(const ContactCase& original) {
  ContactCase c = original;
  c.scene = "wall";
  c.environment = scenes::environment_of(c.scene).value();
  set_way(c, original.start.rotation, original.start.translation.x, original.start.translation.y);
  return c;
}

Reach reach_along_z(const TriangleMesh& mesh, const Quaternion& rotation) {
  Reach reach;
  for (const Vec3d& p : mesh.vertices) {
    const double z = rotate(rotation, p).z;
    reach.front = std::max(reach.front, z);
    reach.rear = std::max(reach.rear, -z);
  }
  return reach;
}

Tool packed_tool(const ContactCase& contact_case, int num_spheres) {
  return Tool::pack(make_shape(contact_case.tool_shape, contact_case.tool_size).value(),
                    {.max_spheres = num_spheres},
                    {.gap_rule = GapRule::absolute, .source = contact_case.tool_shape})
      .value();
}

RenderedScene see(const ContactCase& contact_case, DepthNoise noise) {
  return see(scenes::make_scene(contact_case.scene).value(), noise);
}

RenderedScene see(const scenes::Scene& scene, DepthNoise noise) {
  RenderedScene seen{SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics).value(),
                     DepthField::create(scene.width, scene.height).value()};
  ThreadPool pool(1);
  if (noise == DepthNoise::kinect) {
    DepthFrame frame;
    const auto camera = std::move(scenes::open_simulated_camera(scene, {})).value();
    (void)camera->next(frame).value();
    seen.surface.update(frame, pool);
  } else {
    std::vector<float> depth = scenes::render_depth(scene, 0);
    Random random(1);
    if (noise == DepthNoise::gaussian) {
      for (float& z : depth) z += static_cast<float>(0.0015 * random.normal());
    }
    seen.surface.update(std::span<const float>(depth), pool);
  }
  seen.field.update(seen.surface.cloud(), pool);
  return seen;
}

Measure query_measure(const Tool& tool, const RenderedScene& scene, const ContactOptions& options,
                      ThreadPool* pool) {
  ExecutionOptions execution;
  execution.pool = pool;
  const ContactMethod method = contact_method(options).value();
  const std::shared_ptr<const ContactQuery> query =
      make_contact_query(Place::cpu(), tool, method, execution).value();
  const SurfaceView surface{scene.surface.cloud(), scene.field.view()};
  return {full_volume(tool, options),
          [query, surface](const Pose& X_WT) { return query->measure(surface, X_WT).penetration; }};
}

Measure distance_measure(const Tool& tool, SphereVolumes volumes,
                         std::function<scenes::SignedDistance(const Vec3d&)> distance_at) {
  const auto at = [&tool, volumes, distance_at = std::move(distance_at)](const Pose& X_WT) {
    Penetration sum;
    const Mat3d R_WT = rotation_matrix(X_WT.rotation);
    const Vec3d center = center_of_mass(tool, X_WT);
    for (std::size_t i = 0; i < tool.spheres().size(); ++i) {
      const Sphere& sphere = tool.spheres()[i];
      const double radius = sphere.radius;
      const Vec3d c = R_WT * to_double(sphere.center) + X_WT.translation;
      const scenes::SignedDistance surface = distance_at(c);
      const double stands_for =
          volumes == SphereVolumes::own ? 1 : tool.represented_volumes()[i] / sphere_volume(radius);
      const double volume = stands_for * cap_volume(radius, surface.distance);
      sum.volume += volume;
      sum.measure_W.force += surface.gradient * volume;
      sum.measure_W.torque += cross(c - center, surface.gradient * volume);
    }
    return sum;
  };
  return {full_volume(tool, volumes), at};
}

Measure oracle_measure(const Tool& tool, const scenes::Environment& environment,
                       SphereVolumes volumes) {
  return distance_measure(tool, volumes, [environment](const Vec3d& p) {
    return scenes::signed_distance(environment, p);
  });
}

Measure exact_measure(const Tool& tool, const scenes::Environment& environment) {
  return {tool.mesh_mass().volume, [&tool, environment](const Pose& X_WT) {
            const scenes::ExactPenetration exact = scenes::exact_penetration(
                tool.mesh(), X_WT, center_of_mass(tool, X_WT), environment);
            Penetration result;
            result.volume = exact.volume;
            result.measure_W = exact.measure_C_W;
            return result;
          }};
}

std::vector<ExactStep> exact_steps(const ContactCase& contact_case, const Tool& tool, double from,
                                   double to, int num_steps) {
  std::vector<ExactStep> steps;
  for (int i = 0; i <= num_steps; ++i) {
    const double depth = from + (to - from) * i / num_steps;
    const Pose X_WT = interpolate(contact_case.start, contact_case.end, depth);
    steps.push_back({X_WT, depth,
                     scenes::exact_penetration(tool.mesh(), X_WT, center_of_mass(tool, X_WT),
                                               contact_case.environment)});
  }
  return steps;
}

int num_steps_over(const ContactCase& contact_case, double share, double length) {
  const double travel = norm(contact_case.end.translation - contact_case.start.translation);
  return static_cast<int>(std::lround(share * travel / length));
}

VolumeError volume_error(const Tool& tool, const std::vector<ExactStep>& steps,
                         const Measure& measure) {
  VolumeError result;
  ErrorSum errors;
  int num_lost = 0;
  for (const ExactStep& step : steps) {
    const double measured = measure.at(step.X_WT).volume / measure.whole;
    const double exact = step.exact.volume / tool.mesh_mass().volume;
    if (measured == 0 && exact > 0.01) {
      ++num_lost;
      result.worst_lost = std::max(result.worst_lost, std::min(exact, 1 - exact));
    } else {
      errors.add(measured - exact);
    }
  }
  result.rms = errors.rms();
  result.worst = errors.worst();
  result.lost = static_cast<double>(num_lost) / static_cast<double>(steps.size());
  return result;
}

WrenchError wrench_error(const Tool& tool, const std::vector<ExactStep>& steps,
                         const Measure& measure) {
  constexpr double kMinShare = 0.005;
  const double mesh_volume = tool.mesh_mass().volume,
               radius = farthest(tool.mesh().vertices, tool.sphere_mass().center_of_mass);
  ErrorSum difference, direction, torque;
  WrenchError result;
  Vec3d force_before, exact_before;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const VolumeWrench measured = measure.at(steps[i].X_WT).measure_W;
    const VolumeWrench& exact = steps[i].exact.measure_C_W;
    const Vec3d force = measured.force / measure.whole, exact_force = exact.force / mesh_volume;
    if (i > 0) {
      result.jump = std::max(result.jump, norm(force - force_before));
      result.exact_jump = std::max(result.exact_jump, norm(exact_force - exact_before));
    }
    force_before = force;
    exact_before = exact_force;
    if (steps[i].exact.volume < kMinShare * mesh_volume || force == Vec3d{}) continue;
    difference.add(norm(force - exact_force));
    direction.add(angle_between(force, exact_force));
    torque.add(norm(measured.torque / measure.whole - exact.torque / mesh_volume) /
               (norm(exact_force) * radius));
  }
  result.force_rms = difference.rms();
  result.direction_rms = direction.rms();
  result.direction_worst = direction.worst();
  result.torque_rms = torque.rms();
  result.torque_worst = torque.worst();
  return result;
}

double loop_work(const ContactCase& contact_case, const Tool& tool, const Measure& measure,
                 int num_steps) {
  const Pose middle = interpolate(contact_case.start, contact_case.end, 0.35);
  double net = 0, total = 0;
  for (int i = 0; i < num_steps; ++i) {
    const LoopPoint point = loop_point(middle, tool.sphere_mass().center_of_mass,
                                       contact_case.tool_size, 2 * kPi * i / num_steps);
    const VolumeWrench wrench = measure.at(point.X_WT).measure_W;
    const double power =
        dot(wrench.force, point.twist.linear) + dot(wrench.torque, point.twist.angular);
    net += power;
    total += std::abs(power);
  }
  return total > 0 ? std::abs(net) / total : 0;
}

}  // namespace palpate::eval
