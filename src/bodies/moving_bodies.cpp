#include "src/bodies/internal/moving_bodies.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "src/bodies/touch_matrices.h"
#include "src/haptics/internal/surface_motion.h"
#include "src/math/internal/farthest.h"

namespace palpate { inline namespace v0 {
namespace {

/// Shares of a body's volume behind a surface at which it becomes covered (something stands between
/// it and the camera) and uncovered: a cover that goes away between two frames throws no body.
constexpr double kCoveredShare = 0.5, kUncoveredShare = 0.05;

Stiffness scaled(const Stiffness& k, double by) {
  Stiffness result;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) result.m[i][j] = by * k.m[i][j];
  }
  return result;
}

Vec3d center_of(const Tool& shape) { return shape.sphere_mass().center_of_mass; }

Result<std::shared_ptr<const Tool>> thinned(const std::shared_ptr<const Tool>& shape, int num) {
  if (num <= 0 || static_cast<std::size_t>(num) >= shape->spheres().size()) return shape;
  auto tool = shape->thinned(num);
  if (!tool) return tool.error();
  return std::make_shared<const Tool>(*std::move(tool));
}

/// True if a resting body stays at rest when the options change from a to b.
bool is_carried_alike(const BodyOptions& a, const BodyOptions& b) {
  return a.gravity_x == b.gravity_x && a.gravity_y == b.gravity_y && a.gravity_z == b.gravity_z &&
         a.friction == b.friction && a.sink == b.sink;
}

Error refused(const std::string& why) { return {Errc::invalid_argument, why}; }

}  // namespace

Result<std::unique_ptr<MovingBodies>> MovingBodies::create(const std::vector<SceneObject>& objects,
                                                           const BodyOptions& options,
                                                           const Place& place,
                                                           ThreadPool* threads) {
  if (const Status status = check_settings(options); !status) return status.error();
  std::unique_ptr<MovingBodies> bodies(new MovingBodies(options));
  if (const Status status = bodies->add(objects, place, threads); !status) return status.error();
  if (const Status status = bodies->add_pairs(place); !status) return status.error();
  bodies->forget_stored();
  return bodies;
}

Status MovingBodies::add(const std::vector<SceneObject>& objects, const Place& place,
                         ThreadPool* threads) {
  std::map<const Tool*, std::shared_ptr<const ToolIndex>> indices;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const SceneObject& object = objects[i];
    const Vec3d center = center_of(*object.shape);
    const double reach = farthest(object.shape->mesh().vertices, center);
    auto& index = indices[object.shape.get()];
    if (!object.moves) {
      const auto own = ToolIndex::create(*object.shape);
      fixtures_.push_back({i, object.shape, own, object.X_WB, object.X_WB * center, reach});
      continue;
    }
    if (!(object.mass >= 0 && object.mass <= 1000)) {
      return refused("the mass of an object that moves must be a number up to 1000 kg");
    }
    Body body;
    body.object = i;
    if (index == nullptr) {
      auto shape = thinned(object.shape, options_.num_spheres);
      if (!shape) return shape.error();
      body.shape = *shape;
      index = ToolIndex::create(**shape);
    } else {
      body.shape = std::find_if(shapes_.begin(), shapes_.end(), [&](const Body& other) {
                     return other.index == index;
                   })->shape;
    }
    body.index = index;
    auto query = make_contact_query(place, index, FieldMethod{}, {.pool = threads});
    if (!query) return query.error();
    body.cloud = *std::move(query);
    body.reach = reach;
    const MassProperties& solid = object.shape->mesh_mass();
    body.volume = solid.volume;
    bodies_.push_back(rigid_body(mass_of(object), solid, center, object.X_WB));
    Rest rest;
    rest.X_WB = object.X_WB;
    rests_.push_back(rest);
    shapes_.push_back(std::move(body));
  }
  if (num_bodies() > kMaxMovingBodies) {
    return refused("at most " + std::to_string(kMaxMovingBodies) + " objects can move, not " +
                   std::to_string(num_bodies()));
  }
  use_materials(frictions_of(objects));
  return Done{};
}

void MovingBodies::use_materials(const ObjectFrictions& frictions) {
  for (std::size_t i = 0; i < shapes_.size(); ++i) {
    Body& body = shapes_[i];
    body.friction = frictions[body.object].coefficient.value_or(options_.friction);
    // A cube of this volume lies `sink` deep with its weight on one face.
    const double area = std::pow(body.volume, 2.0 / 3);
    body.scale = bodies_[i].mass * 9.81 / (area * options_.sink);
  }
  for (Fixture& fixture : fixtures_) {
    fixture.friction = frictions[fixture.object].coefficient.value_or(options_.friction);
  }
}

/// Adds all pairs, and the places of all contacts: with surfaces, with the tool, with each other.
Status MovingBodies::add_pairs(const Place& place) {
  std::vector<double> masses;
  for (int turn = 0; turn < 2; ++turn) {
    for (const RigidBody& body : bodies_) masses.push_back(body.mass);
  }
  const auto add = [&](Pair pair, const std::shared_ptr<const ToolIndex>& b,
                       double mass) -> Status {
    auto query = make_body_pair_query(place, shown(pair.a).index, b);
    if (!query) return query.error();
    pair.query = *std::move(query);
    pairs_.push_back(std::move(pair));
    masses.push_back(mass);
    return Done{};
  };
  for (int a = 0; a < num_bodies(); ++a) {
    for (int b = 0; b < a; ++b) {
      const double mass = std::min(moving(a).mass, moving(b).mass);
      if (Status status = add({a, b, false, nullptr}, shown(b).index, mass); !status) return status;
    }
    for (std::size_t b = 0; b < fixtures_.size(); ++b) {
      Status status =
          add({a, static_cast<int>(b), true, nullptr}, fixtures_[b].index, moving(a).mass);
      if (!status) return status;
    }
  }
  solver_ = std::make_unique<BodySolver>(num_bodies(), masses);
  touches_.reserve(masses.size());
  groups_.resize(bodies_.size());
  return Done{};
}

void MovingBodies::add_touch(const BodyTouch& touch) {
  if (!(norm(touch.F_A_W.force) > 0)) return;
  touches_.push_back(touch);
  rest(touch.a).is_touched = true;
  if (touch.b != BodyTouch::kNoBody) rest(touch.b).is_touched = true;
}

/// Adds the contacts with surfaces. False: the backend has failed.
bool MovingBodies::touch_clouds(std::span<const SurfaceBlend> cameras) {
  for (int i = 0; i < num_bodies(); ++i) {
    const Body& body = shown(i);
    Rest& own = rest(i);
    const ContactResult result = body.cloud->measure(cameras, moving(i).X_WB, {.stiffness = true});
    const Penetration& found = result.penetration;
    if (found.status.has(StepStatus::backend_failed)) return false;
    own.is_covered =
        found.volume > (own.is_covered ? kUncoveredShare : kCoveredShare) * body.volume;
    if (found.status.is_unmeasured() || own.is_covered || !result.stiffness) continue;
    BodyTouch touch;
    touch.a = i;
    touch.F_A_W = VolumeStiffness{body.scale} * found.measure_W;
    touch.stiffness = scaled(*result.stiffness, body.scale);
    touch.patch = contact_patch(found.measure_W, found.volume, *result.stiffness, result.moments);
    touch.friction = body.friction;
    const Vec3d center = moving(i).center_W();
    const Twist V_W = surface_motion(
        cameras, {center + touch.patch.lever_W, found.measure_W.force, touch.patch.torsion_radius});
    touch.V_W = {V_W.linear - cross(V_W.angular, touch.patch.lever_W), V_W.angular};
    // Bodies on a moving surface stay awake.
    own.is_pushed = norm(V_W.linear) > kStillShift / kStillSeconds ||
                    norm(V_W.angular) > kStillTurn / kStillSeconds;
    touch.place = i;
    own.force_W += touch.F_A_W.force;
    own.stiffness = std::max(own.stiffness, largest(touch.stiffness.m));
    touch.potential = body.scale * found.potential;
    own.pressed += touch.potential;
    add_touch(touch);
  }
  return true;
}

void MovingBodies::touch_pairs() {
  for (Pair& pair : pairs_) {
    const RigidBody& a = moving(pair.a);
    const Fixture* const fixture =
        pair.is_fixture ? &fixtures_[static_cast<std::size_t>(pair.b)] : nullptr;
    const double reach = shown(pair.a).reach + (fixture ? fixture->reach : shown(pair.b).reach);
    const Vec3d apart = a.center_W() - (fixture ? fixture->center_W : moving(pair.b).center_W());
    const bool can_move = !rest(pair.a).is_asleep || (!fixture && !rest(pair.b).is_asleep);
    pair.is_near = can_move && dot(apart, apart) < reach * reach;
    if (!pair.is_near) continue;
    pair.query->start(a.X_WB, fixture ? fixture->X_WB : moving(pair.b).X_WB, true);
  }
  for (std::size_t i = 0; i < pairs_.size(); ++i) {
    Pair& pair = pairs_[i];
    if (!pair.is_near) continue;
    const BodyPenetration found = pair.query->finish();
    if (!(found.on_a.volume > 0) || !found.stiffness_a) continue;
    const Body& a = shown(pair.a);
    BodyTouch touch;
    touch.a = pair.a;
    const double other = pair.is_fixture ? fixtures_[static_cast<std::size_t>(pair.b)].friction
                                         : shown(pair.b).friction;
    double scale = a.scale;
    if (!pair.is_fixture) {
      touch.b = pair.b;
      scale = std::max(scale, shown(pair.b).scale);
    }
    touch.F_A_W = VolumeStiffness{scale} * found.on_a.measure_W;
    touch.stiffness = scaled(*found.stiffness_a, scale);
    touch.patch =
        contact_patch(found.on_a.measure_W, found.on_a.volume, *found.stiffness_a, found.moments_a);
    touch.friction = (a.friction + other) / 2;
    touch.place = 2 * num_bodies() + static_cast<int>(i);
    touch.potential = scale * found.on_a.potential;
    if (pair.is_fixture) {
      Rest& own = rest(pair.a);
      own.pressed += touch.potential;
      own.force_W += touch.F_A_W.force;
      own.stiffness = std::max(own.stiffness, largest(touch.stiffness.m));
    } else {
      for (const int body : {pair.a, pair.b}) rest(body).pressed += touch.potential / 2;
    }
    add_touch(touch);
  }
}

void MovingBodies::touch_tool(std::span<const Push> pushes) {
  for (int i = 0; i < num_bodies() && static_cast<std::size_t>(i) < pushes.size(); ++i) {
    const Push& push = pushes[static_cast<std::size_t>(i)];
    BodyTouch touch;
    touch.a = i;
    touch.F_A_W = push.F_B_W;
    touch.stiffness = push.stiffness;
    touch.patch = push.patch;
    touch.friction = push.friction;
    touch.grip = push.grip;
    touch.V_W = push.V_W;
    touch.place = num_bodies() + i;
    rest(i).is_pushed = rest(i).is_pushed || norm(push.F_B_W.force) > 0;
    add_touch(touch);
  }
}

bool MovingBodies::step(std::span<const SurfaceBlend> cameras, std::span<const Push> pushes,
                        double dt) noexcept {
  touches_.clear();
  for (Rest& rest : rests_) {
    rest.force_W = {};
    rest.stiffness = rest.pressed = 0;
    rest.is_touched = rest.is_pushed = false;
  }
  const bool has_surfaces =
      !cameras.empty() && std::all_of(cameras.begin(), cameras.end(), [](const SurfaceBlend& one) {
        return one.to.field.num_levels > 0;
      });
  if (!has_surfaces || !(dt > 0)) return true;
  if (!touch_clouds(cameras)) return false;
  touch_tool(pushes);
  touch_pairs();
  wake(dt);
  solver_->collect(bodies_, touches_);
  add_energy();
  add_stored();
  solver_->step(bodies_, touches_, {gravity(), options_.damping}, dt);
  fall_asleep(dt);
  return true;
}

void MovingBodies::use(const BodyOptions& options, const ObjectFrictions& frictions) noexcept {
  const Vec3d gravity_before = gravity();
  const auto has_changed = [&](const auto& one) {
    return one.friction != frictions[one.object].coefficient.value_or(options.friction);
  };
  const bool wakes_all = !options.may_sleep || !is_carried_alike(options_, options) ||
                         std::ranges::any_of(fixtures_, has_changed);
  for (std::size_t i = 0; i < rests_.size(); ++i) {
    if (!wakes_all && !has_changed(shapes_[i])) continue;
    rests_[i].is_asleep = false;
    rests_[i].seconds = 0;
  }
  options_.gravity_x = options.gravity_x;
  options_.gravity_y = options.gravity_y;
  options_.gravity_z = options.gravity_z;
  options_.damping = options.damping;
  options_.may_sleep = options.may_sleep;
  options_.friction = options.friction;
  options_.sink = options.sink;
  use_materials(frictions);
  if (gravity() != gravity_before) forget_stored();
}

void MovingBodies::take_over(const MovingBodies& other) noexcept {
  const bool wakes_all =
      !options_.may_sleep || !is_carried_alike(other.options_, options_) ||
      !std::ranges::equal(fixtures_, other.fixtures_, {}, &Fixture::friction, &Fixture::friction);
  for (std::size_t i = 0; i < bodies_.size() && i < other.bodies_.size(); ++i) {
    const RigidBody& from = other.bodies_[i];
    bodies_[i].X_WB = from.X_WB;
    bodies_[i].V_W = from.V_W;
    bodies_[i].is_asleep = from.is_asleep;
    rests_[i] = other.rests_[i];
    if (!wakes_all && shapes_[i].friction == other.shapes_[i].friction) continue;
    bodies_[i].is_asleep = rests_[i].is_asleep = false;
    rests_[i].seconds = 0;
  }
  solver_->take_over(*other.solver_);
  if (gravity() != other.gravity()) forget_stored();
}

}}  // namespace palpate::v0
