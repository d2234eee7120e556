// The fixed measurements of golden.txt and their hashes, for the test and for the program in other
// machines (golden_program.cpp).
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"
#include "tests/test_util/contact_queries.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::golden {

inline constexpr int kWidth = 160, kHeight = 120;
inline const Intrinsics kCamera{140, 140, 79.5, 59.5};

/// A near surface of the shape of an L before a wall, as a depth camera sees it.
inline DepthFrame frame_of(int shift) {
  DepthFrame frame{kWidth, kHeight, 0.001, {}, 0};
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const bool is_near = u > 50 && v > 30 && (u < 80 || v > 65) && u + v < 190;
      const int bump = (u * u / 37 + v * v / 53 + u * v / 71) % 12;
      const bool is_hole = (u * 31 + v * 17) % 97 == 0;
      const int depth = (is_near ? 560 : 680) + bump - shift;
      frame.pixels.push_back(static_cast<std::uint16_t>(is_hole ? 0 : depth));
    }
  }
  return frame;
}

class Seen {
 public:
  explicit Seen(int shift)
      : estimator_(SurfaceEstimator::create(kWidth, kHeight, kCamera, with_edges()).value()),
        field_(DepthField::create(kWidth, kHeight).value()) {
    ThreadPool pool(1);
    estimator_.update(frame_of(shift), pool);
    field_.update(estimator_.cloud(), pool);
  }
  SurfaceView surfaces() const { return {estimator_.cloud(), field_.view()}; }

 private:
  static SurfaceOptions with_edges() {
    SurfaceOptions options;
    options.depth_change.enabled = true;
    return options;
  }

  SurfaceEstimator estimator_;
  DepthField field_;
};

inline std::vector<Pose> poses() {
  test::Random random(11);
  std::vector<Pose> all;
  for (int i = 0; i < 24; ++i) {
    const double x = random.uniform(-0.06, 0.06), y = random.uniform(-0.05, 0.05);
    all.push_back({{x, y, random.uniform(0.53, 0.6)}, random.rotation(3.0)});
  }
  return all;
}

/// FNV-1a hash of the bits of a sequence of numbers.
struct Hash {
  std::uint64_t value = 0xcbf29ce484222325;

  void add(double number) {
    const auto bytes = std::bit_cast<std::array<unsigned char, sizeof number>>(number);
    for (const unsigned char byte : bytes) value = (value ^ byte) * 0x100000001b3;
  }
  void add(const Vec3d& v) {
    for (int axis = 0; axis < 3; ++axis) add(v[axis]);
  }
};

/// Hash of all results of a run, and two numbers that show how far they moved if it differs.
struct Result {
  std::string hash;
  double volume = 0, force = 0;
};

struct Case {
  std::string name;
  ContactOptions options;
  bool is_blended = false;
  bool is_large = false;  ///< a tool whose clusters count as one ball each where they lie deep
};

inline std::vector<Case> cases() {
  using enum MethodKind;
  std::vector<Case> all{
      {"weighted", {.method = weighted}},
      {"weighted-count", {.method = weighted, .priority = Priority::count}},
      {"weighted-square", {.method = weighted, .priority = Priority::square}},
      {"weighted-gaussian", {.method = weighted, .priority = Priority::gaussian}},
      {"weighted-agreement", {.method = weighted, .priority = Priority::agreement}},
      {"weighted-path", {.method = weighted, .priority = Priority::path}},
      {"weighted-represented", {.method = weighted, .volumes = SphereVolumes::represented}},
      {"simplified", {.method = simplified}},
      {"simplified-count", {.method = simplified, .priority = Priority::count}},
      {"simplified-agreement", {.method = simplified, .priority = Priority::agreement}},
      {"simplified-path", {.method = simplified, .priority = Priority::path}},
      {"graph-full", {.method = graph}},
      {"graph-cap", {.method = graph, .inside = InsideVolume::cap}},
      {"field", {.method = field}},
      {"field-own", {.method = field, .volumes = SphereVolumes::own}},
      {"blended-weighted", {.method = weighted}, true},
      {"blended-simplified", {.method = simplified}, true},
      {"blended-graph", {.method = graph}, true},
      {"blended-field", {.method = field}, true},
      {"field-large", {.method = field}, false, true},
      {"blended-field-large", {.method = field}, true, true},
  };
  const std::pair<const char*, MethodKind> methods[] = {
      {"weighted", weighted}, {"simplified", simplified}, {"graph", graph}};
  for (const auto& [name, method] : methods) {
    for (const auto& [ending, edges] :
         {std::pair{"center", Edges::center}, {"strict", Edges::strict}, {"cut", Edges::cut}}) {
      all.push_back({name + std::string("-edges-") + ending, {.method = method, .edges = edges}});
    }
    for (const auto& [ending, continuity] : {std::pair{"kernel", Continuity::kernel},
                                             {"entry", Continuity::entry},
                                             {"both", Continuity::both}}) {
      all.push_back({name + std::string("-") + ending,
                     {.method = method, .edges = Edges::cut, .continuity = continuity}});
    }
  }
  return all;
}

inline Result run(const Case& c) {
  static const Tool small = test::random_tool(300, 0.03, 5), large = test::grid_tool();
  const Tool& tool = c.is_large ? large : small;
  static const Seen from(0), to(6);
  const auto query =
      make_contact_query(Place::cpu(), tool, contact_method(c.options).value()).value();
  const double alpha = c.is_blended ? 0.3 : 1.0;
  Result result;
  Hash hash;
  for (const Pose& X_WT : poses()) {
    const Penetration p = query->measure(from.surfaces(), to.surfaces(), alpha, X_WT).penetration;
    const test::WholeContact contact =
        test::whole_contact(*query, from.surfaces(), to.surfaces(), alpha, X_WT);
    hash.add(p.volume);
    hash.add(p.measure_W.force);
    hash.add(p.measure_W.torque);
    hash.add(p.potential);
    for (const int count : {p.num_boundary_spheres, p.num_inside_spheres, p.num_points}) {
      hash.add(count);
    }
    hash.add(p.status.bits);
    for (const SphereState state : contact.states) hash.add(static_cast<int>(state));
    for (const Plane<float>& plane : contact.planes) {
      hash.add(to_double(plane.normal));
      hash.add(static_cast<double>(plane.offset));
    }
    const Stiffness stiffness = contact.stiffness.value_or(Stiffness{});
    for (const auto& row : stiffness.m) {
      for (const double k : row) hash.add(k);
    }
    result.volume += p.volume;
    result.force += norm(p.measure_W.force);
  }
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash.value));
  result.hash = text;
  return result;
}

}  // namespace palpate::golden
