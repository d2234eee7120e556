// Contact queries held to brute force in double, whatever runs them.
#pragma once

#include <cstring>
#include <map>
#include <vector>

#include <gtest/gtest.h>

#include "tests/test_util/contact_queries.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/contact_truth.h"

namespace palpate::test {

/// Returns options of each priority beyond those of the thesis, also with edges and fading donors.
inline std::vector<ContactOptions> all_other_priorities() {
  std::vector<ContactOptions> all;
  for (const MethodKind method : {MethodKind::weighted, MethodKind::simplified}) {
    for (const Priority priority :
         {Priority::square, Priority::gaussian, Priority::agreement, Priority::path}) {
      ContactOptions options{.method = method, .priority = priority};
      all.push_back(options);
      options.volumes = SphereVolumes::represented;
      options.edges = Edges::cut;
      all.push_back(options);
      options.continuity = Continuity::both;
      all.push_back(options);
    }
  }
  return all;
}

inline std::vector<ContactOptions> all_options() {
  std::vector<ContactOptions> all;
  for (SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
    for (MethodKind method : {MethodKind::weighted, MethodKind::simplified}) {
      all.push_back({method, Priority::distance, InsideVolume::full, volumes});
      all.push_back({method, Priority::count, InsideVolume::full, volumes});
    }
    all.push_back({MethodKind::graph, Priority::distance, InsideVolume::full, volumes});
    all.push_back({MethodKind::graph, Priority::distance, InsideVolume::cap, volumes});
  }
  return all;
}

inline std::vector<ContactOptions> all_options_with_edges() {
  std::vector<ContactOptions> all;
  for (Edges edges : {Edges::center, Edges::strict, Edges::cut}) {
    for (ContactOptions options : all_options()) {
      options.edges = edges;
      all.push_back(options);
    }
  }
  return all;
}

// Every way to smooth, with and without edges.
inline std::vector<ContactOptions> all_continuities() {
  std::vector<ContactOptions> all;
  for (Continuity continuity : {Continuity::kernel, Continuity::entry, Continuity::both}) {
    for (Edges edges : {Edges::none, Edges::strict, Edges::cut}) {
      for (ContactOptions options : all_options()) {
        options.edges = edges;
        options.continuity = continuity;
        all.push_back(options);
      }
    }
  }
  return all;
}

// A foreground of the shape of an L, so that edges look in all directions and turn both ways.
inline CloudWithEdges l_shape(double noise, std::uint64_t seed) {
  return stepped_wall(160, 120, 140, 0.6, 0.12, noise, seed, [](int u, int v) {
    return u > 50 && v > 30 && (u < 80 || v > 65) && u + v < 190;
  });
}

// A pose that puts the tool into the wall by a random share of its size.
inline Pose random_pose(Random& random, double wall_depth, double half_side) {
  const Quaternion q = random.rotation(3.0);
  const double x = random.uniform(-0.1, 0.1), y = random.uniform(-0.1, 0.1);
  const double z = wall_depth + random.uniform(-1.7, 1.7) * half_side;
  return {{x, y, z}, q};
}

inline void expect_near_relative(double got, double want, double scale, const char* what) {
  EXPECT_NEAR(got, want, 1e-5 * scale) << what;
}

inline void expect_equals_truth(const Truth& truth, const ContactQuery& query,
                                const SurfaceView& surface, const Pose& X_WT) {
  const Penetration got = query.measure(surface, X_WT).penetration;
  const Penetration& want = truth.penetration;
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
  EXPECT_EQ(got.num_points, want.num_points);
  EXPECT_EQ(got.num_inside_spheres, want.num_inside_spheres);
  expect_near_relative(got.volume, want.volume, want.volume, "volume");
  const double force = norm(want.measure_W.force), torque = norm(want.measure_W.torque);
  // A torque may cancel out; then its scale is that of its parts.
  const double torque_scale = std::max(torque, want.volume * 1e-2);
  const double force_scale = std::max(force, want.volume * 1e-1);
  for (int axis = 0; axis < 3; ++axis) {
    expect_near_relative(got.measure_W.force[axis], want.measure_W.force[axis], force_scale,
                         "force");
    expect_near_relative(got.measure_W.torque[axis], want.measure_W.torque[axis], torque_scale,
                         "torque");
  }
  const std::vector<SphereState> states = whole_contact(query, surface, X_WT).states;
  int num_wrong = 0;
  for (std::size_t s = 0; s < states.size(); ++s) num_wrong += states[s] != truth.states[s];
  EXPECT_EQ(num_wrong, 0);
}

inline void expect_equals_truth(const Tool& tool, const PointCloudView& cloud, const Pose& X_WT,
                                ContactQueries& queries,
                                const std::vector<ContactOptions>& all = all_options()) {
  const ToolTruth tool_truth(tool);
  std::map<Continuity, BoundaryTruth> touched;
  for (const ContactOptions& options : all) {
    SCOPED_TRACE(testing::Message() << "method " << static_cast<int>(options.method)
                                    << ", priority " << static_cast<int>(options.priority)
                                    << ", inside " << static_cast<int>(options.inside)
                                    << ", volumes " << static_cast<int>(options.counted())
                                    << ", edges " << static_cast<int>(options.edges)
                                    << ", continuity " << static_cast<int>(options.continuity));
    if (!touched.contains(options.continuity)) {
      touched[options.continuity] =
          boundary_truth(tool_truth.spheres, cloud, X_WT, options.continuity);
    }
    expect_equals_truth(contact_truth(tool_truth, touched[options.continuity], X_WT, options),
                        queries.by(options), {cloud}, X_WT);
  }
}

inline bool same_bits(const Penetration& a, const Penetration& b) {
  return std::memcmp(&a.volume, &b.volume, sizeof a.volume) == 0 &&
         std::memcmp(&a.measure_W, &b.measure_W, sizeof a.measure_W) == 0 &&
         a.num_boundary_spheres == b.num_boundary_spheres &&
         a.num_inside_spheres == b.num_inside_spheres && a.num_points == b.num_points;
}

}  // namespace palpate::test
