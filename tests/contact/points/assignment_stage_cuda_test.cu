// The take stage on a GPU against the CPU's kernels and against brute force in double, on random
// spheres, donors and edges.
#include "src/contact/points/donors/assignment_stage.cuh"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/points/donors/donors.h"
#include "src/contact/points/donors/plane_assignment.h"
#include "src/gpu/internal/runtime.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

struct Case {
  std::string name;
  int num_spheres = 1000;
  double donor_share = 0.2;  ///< of the spheres near the surface
  bool has_ties = false;     ///< centers on a lattice
  MethodKind method = MethodKind::simplified;
  Priority priority = Priority::distance;
  Edges edges = Edges::none;
  bool fades_in = false;
  int blocks = 3;
};

/// A lattice of spheres, shaken or not; boundary spheres and edges about z = 0.
struct Scene {
  std::vector<Sphere> spheres;
  std::vector<Donor> donors;           ///< of all boundary spheres, ascending
  std::vector<std::int32_t> boundary;  ///< their ids
  std::vector<EdgePiece> pieces;       ///< four of each boundary sphere
  std::vector<std::int32_t> piece_of;  ///< of each sphere
  std::vector<double> edge_distance;
  std::vector<EdgeSide> edge_side;
  std::vector<float> volume_scale;
  std::vector<float> paths;  ///< any numbers do
  Vec3d origin{0.003, -0.002, 0.001};
  static constexpr double kPerSquare = 1 / (2 * 0.03 * 0.03);

  Scene(const Case& c, std::uint64_t seed) {
    test::Random random(seed);
    const int side = static_cast<int>(std::ceil(std::cbrt(c.num_spheres)));
    const double pitch = 1.0 / 64;  // exact, for ties
    std::vector<int> cells(static_cast<std::size_t>(side) * side * side);
    std::iota(cells.begin(), cells.end(), 0);
    for (std::size_t i = cells.size() - 1; i > 0; --i) {
      std::swap(cells[i], cells[random.bits() % (i + 1)]);
    }
    for (int i = 0; i < c.num_spheres; ++i) {
      const int cell = cells[static_cast<std::size_t>(i)];
      const double x = cell % side, y = cell / side % side, z = cell / side / side;
      const Vec3d at = Vec3d{x - side / 2, y - side / 2, z - side / 2} * pitch;
      const Vec3d shaken = c.has_ties ? at : at + random.in_box(0.2 * pitch);
      spheres.push_back({to_float(shaken), static_cast<float>(random.uniform(0.05, 0.3) * pitch)});
      volume_scale.push_back(static_cast<float>(random.uniform(0.9, 1.4)));
    }
    for (int id = 0; id < c.num_spheres; ++id) {
      const Vec3d p = to_double(spheres[static_cast<std::size_t>(id)].center);
      const double height = 0.02 * std::sin(30 * p.x) * std::cos(20 * p.y);
      if (std::abs(p.z - height) > 0.8 * pitch || random.uniform() >= c.donor_share) continue;
      add_boundary_sphere(id, c, random);
    }
    find_edges(c, random);
    if (c.priority != Priority::path) return;
    for (std::size_t i = 0; i < spheres.size() * spheres.size(); ++i) {
      paths.push_back(static_cast<float>(random.uniform(0.01, 0.1)));
    }
  }

  PriorityRule priority_rule(const Case& c, const float* its_paths) const {
    return {c.priority, kPerSquare, its_paths, static_cast<std::int32_t>(spheres.size())};
  }
  /// Computes the weight of a donor by the definition of the priority.
  double weight(Priority by, const Donor& donor, std::size_t id, const Vec3d& d) const {
    switch (by) {
      case Priority::distance: return 1 / norm(d);
      case Priority::count: return donor.weight;
      case Priority::square: return 1 / dot(d, d);
      case Priority::gaussian: return std::exp(-std::min(40.0, kPerSquare * dot(d, d)));
      case Priority::agreement:
        return std::max(0.001, dot(donor.plane_T.normal, d) / norm(d)) / norm(d);
      case Priority::path:
        return 1 / static_cast<double>(
                       paths[static_cast<std::size_t>(donor.sphere_id) * spheres.size() + id]);
    }
    return 0;
  }

  void add_boundary_sphere(int id, const Case& c, test::Random& random) {
    const Vec3d p = to_double(spheres[static_cast<std::size_t>(id)].center);
    Donor donor;
    if (boundary.size() % 7 != 3) {
      donor.sphere_id = id;
      const Vec3d n = normalized(Vec3d{0, 0, 1} + 0.5 * random.direction());
      donor.plane_T = {n, dot(n, p) + random.uniform(-1, 1) * 1e-3};
      donor.point = {p, random.uniform(0.5, 0.8)};
      donor.weight = static_cast<double>(random.bits() % 50 + 1);
      if (c.fades_in) donor.presence = random.uniform();
    }
    boundary.push_back(id);
    donors.push_back(donor);
  }

  void find_edges(const Case& c, test::Random& random) {
    const std::size_t n = spheres.size();
    pieces.resize(4 * n);
    piece_of.assign(n, -1);
    edge_distance.assign(n, 0.0);
    edge_side.assign(n, EdgeSide::behind);
    if (c.edges == Edges::none || boundary.empty()) return;
    for (std::size_t i = 0; i < boundary.size(); i += 5) {
      EdgePiece& piece = pieces[4 * i + i % 4];
      const Vec3d p = to_double(spheres[static_cast<std::size_t>(boundary[i])].center);
      const Vec3d n_T = normalized(Vec3d{1, 0.3, 0} + 0.2 * random.direction());
      piece = {0, 0, random.uniform(0.5, 0.8), {n_T, dot(n_T, p)}, false};
      for (const Donor& donor : donors) {
        piece.has_beyond |= donor.sphere_id >= 0 && piece.is_before(donor.point);
      }
    }
    for (std::size_t id = 0; id < n; ++id) {
      if (id % 3 == 0) continue;
      const std::size_t i = random.bits() % ((boundary.size() + 4) / 5) * 5;
      piece_of[id] = static_cast<std::int32_t>(4 * i + i % 4);
      const Plane<double>& plane = pieces[4 * i + i % 4].plane_T;
      edge_distance[id] = dot(plane.normal, to_double(spheres[id].center)) - plane.offset;
      edge_side[id] =
          palpate::edge_side(edge_distance[id], static_cast<double>(spheres[id].radius), c.edges);
    }
  }

  bool has_edges(const Case& c) const { return c.edges != Edges::none && !boundary.empty(); }
  EdgesView edges() const {
    return {spheres.data(), pieces.data(), piece_of.data(), edge_distance.data(), edge_side.data()};
  }
  DonorsView donors_view() const {
    return {spheres.data(), donors.data(), static_cast<std::int32_t>(donors.size())};
  }
};

/// Results of a query.
struct Found {
  MeasureSums boundary, untouched;
  std::vector<std::int32_t> donor;     ///< by sphere: boundary sphere's id or -1
  std::vector<double> volume;          ///< by sphere
  std::vector<MeasureSums> of_thread;  ///< as it came
};

Assigned scaled(const Scene& scene, std::size_t id, const Assigned& b) {
  const double scale = static_cast<double>(scene.volume_scale[id]);
  return {scale * b.volume, scale * b.force};
}
void add(MeasureSums& sums, const Scene& scene, std::size_t id, const Assigned& b) {
  sums.volume += b.volume;
  sums.force += b.force;
  sums.torque += cross(to_double(scene.spheres[id].center) - scene.origin, b.force);
}

/// All in double, sphere by sphere, by the definitions.
Found brute_force(const Case& c, const Scene& scene) {
  const std::size_t n = scene.spheres.size();
  const EdgesView edges = scene.edges();
  const AssignmentRule rule{c.method == MethodKind::weighted,
                            scene.priority_rule(c, scene.paths.data()),
                            scene.has_edges(c) ? &edges : nullptr};
  const DonorsView view = scene.donors_view();
  Found found;
  found.donor.assign(n, -1);
  found.volume.assign(n, 0.0);
  std::vector<std::uint8_t> is_boundary(n);
  for (std::size_t i = 0; i < scene.boundary.size(); ++i) {
    const auto id = static_cast<std::size_t>(scene.boundary[i]);
    is_boundary[id] = 1;
    AssignmentRule own = rule;
    if (c.edges != Edges::cut) own.edges = nullptr;
    const Donor& donor = scene.donors[i];
    Assigned measured;
    if (donor.sphere_id >= 0) measured = view.assign_from(donor, scene.boundary[i], own);
    if (c.fades_in) {
      const double presence = donor.sphere_id >= 0 ? donor.presence : 0;
      const Assigned state = view.assign(scene.boundary[i], rule);
      measured = {presence * measured.volume + (1 - presence) * state.volume,
                  presence * measured.force + (1 - presence) * state.force};
    }
    add(found.boundary, scene, id, scaled(scene, id, measured));
  }
  for (std::size_t id = 0; id < n; ++id) {
    if (is_boundary[id] != 0) continue;
    const auto sphere = static_cast<std::int32_t>(id);
    const Donor* best = nullptr;
    double least = 1e300;
    for (const Donor& donor : scene.donors) {
      if (donor.sphere_id < 0) continue;
      const Vec3d d = to_double(scene.spheres[static_cast<std::size_t>(donor.sphere_id)].center) -
                      to_double(scene.spheres[id].center);
      // A Gaussian's best is the nearest, also where it is cut off.
      const Priority by = c.priority == Priority::gaussian ? Priority::distance : c.priority;
      const double cost = -scene.weight(by, donor, id, d);
      if (cost < least) least = cost, best = &donor;
    }
    if (best == nullptr) continue;
    Assigned assigned;
    if (c.method == MethodKind::weighted && !scene.has_edges(c)) {
      double weights = 0;
      for (const Donor& donor : scene.donors) {
        if (donor.sphere_id < 0) continue;
        const Vec3d d = to_double(scene.spheres[static_cast<std::size_t>(donor.sphere_id)].center) -
                        to_double(scene.spheres[id].center);
        const double weight = donor.presence * scene.weight(c.priority, donor, id, d);
        const Assigned part = view.assign_from(donor, sphere, rule);
        weights += weight;
        assigned.volume += weight * part.volume;
        assigned.force += weight * part.force;
      }
      assigned = {assigned.volume / weights, assigned.force / weights};
    } else if (c.method == MethodKind::weighted || c.fades_in) {
      assigned = view.assign(sphere, rule);
    } else {
      assigned = view.assign_from(*best, sphere, rule);
    }
    if (c.method == MethodKind::simplified) found.donor[id] = best->sphere_id;
    assigned = scaled(scene, id, assigned);
    found.volume[id] = assigned.volume;
    add(found.untouched, scene, id, assigned);
    found.untouched.num_inside += assigned.volume > 0;
  }
  return found;
}

/// The CPU's kernels, where they do all of it: no edges, no overlays. Untouched spheres only.
Found cpu_kernels(const Case& c, const Scene& scene) {
  const std::size_t n = scene.spheres.size();
  const SphereClusters clusters(scene.spheres);
  Donors donors(scene.spheres);
  std::vector<std::int32_t> sphere_of_donor;
  for (const Donor& donor : scene.donors) {
    if (donor.sphere_id < 0) continue;
    donors.add(donor);
    sphere_of_donor.push_back(donor.sphere_id);
  }
  donors.pad();
  std::vector<std::int32_t> numbers(n + Donors::kPadding), touched(clusters.x.size(), -1);
  std::iota(numbers.begin(), numbers.end(), 0);
  for (const std::int32_t id : scene.boundary) {
    touched[static_cast<std::size_t>(clusters.slot_of[static_cast<std::size_t>(id)])] =
        PlaneAssignment::kTouched;
  }
  std::vector<float> scale(clusters.x.size(), 1.0f), volume(clusters.x.size());
  for (std::size_t slot = 0; slot < scale.size(); ++slot) {
    const std::int32_t id = clusters.sphere_id[slot];
    if (id < 0) touched[slot] = PlaneAssignment::kTouched;
    if (id >= 0) scale[slot] = scene.volume_scale[static_cast<std::size_t>(id)];
  }
  std::vector<std::int32_t> donor(clusters.x.size(), -1);
  PlaneAssignment job;
  job.clusters = &clusters;
  job.spheres = scene.spheres.data();
  job.boundary = donors.view(c.fades_in);
  job.origin = scene.origin;
  job.priority = c.priority;
  job.doublings_per_square = static_cast<float>(kDoublings * Scene::kPerSquare);
  job.num_donors = job.boundary.num;
  if (job.priority == Priority::count) {
    job.first_donor = donors.heaviest();
    job.num_donors = 1;
  }
  job.numbers = numbers.data();
  job.touched = touched.data();
  job.volume_scale = scale.data();
  job.donor = donor.data();
  job.assigned_volume = volume.data();
  std::vector<float> floats(8 * (n + Donors::kPadding));
  std::vector<std::int32_t> ids(2 * (n + Donors::kPadding));
  const auto candidates = [&](std::size_t which) {
    const std::size_t size = n + Donors::kPadding;
    float* const f = floats.data() + which * 4 * size;
    return Candidates{0, f, f + size, f + 2 * size, f + 3 * size, ids.data() + which * size};
  };
  AssignmentScratch scratch{candidates(0), candidates(1)};
  Found found;
  for (int group = 0; group < clusters.num_groups(); ++group) {
    found.untouched.add(c.method == MethodKind::weighted
                            ? isa_baseline::assign_weighted(job, group)
                            : isa_baseline::assign_nearest(job, group, scratch));
  }
  found.donor.assign(n, -1);
  found.volume.assign(n, 0.0);
  for (std::size_t id = 0; id < n; ++id) {
    const auto slot = static_cast<std::size_t>(clusters.slot_of[id]);
    if (touched[slot] == PlaneAssignment::kTouched) continue;
    found.volume[id] = static_cast<double>(volume[slot]);
    if (c.method == MethodKind::simplified && donor[slot] >= 0) {
      found.donor[id] = sphere_of_donor[static_cast<std::size_t>(donor[slot])];
    }
  }
  return found;
}

__global__ void __launch_bounds__(kQueryThreads, 1)
    assign(const __grid_constant__ PointQuery q, MeasureSums* sums) {
  sums[2 * gpu::grid_thread()] = measure_boundary_spheres(q, q.method, true);
  sums[2 * gpu::grid_thread() + 1] = assign_planes(q, q.method, true);
}

Found on_gpu(const Case& c, const Scene& scene) {
  const std::size_t n = scene.spheres.size(), num = scene.boundary.size();
  const SphereClusters clusters(scene.spheres);
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::high);
  PointQuery q;
  q.scan.spheres = memory.copy_of(scene.spheres);
  q.origin = scene.origin;
  q.method = c.method;
  q.priority = scene.priority_rule(c, memory.copy_of(scene.paths));
  q.edges = c.edges;
  q.plane_rule.fades_in = c.fades_in;
  q.volume_scale = memory.copy_of(scene.volume_scale);
  q.num_spheres = static_cast<std::int32_t>(n);
  q.clusters = {memory.copy_of(clusters.x),
                memory.copy_of(clusters.y),
                memory.copy_of(clusters.z),
                memory.copy_of(clusters.radius),
                memory.copy_of(clusters.volume),
                memory.copy_of(clusters.sphere_id),
                memory.copy_of(clusters.slot_of),
                memory.copy_of(clusters.clusters),
                memory.copy_of(clusters.groups),
                clusters.num_clusters(),
                clusters.num_groups()};

  // As the boundary stage leaves it.
  std::vector<float> channels[9];
  unsigned long long heaviest = 0;
  std::int32_t num_donors = 0;
  for (std::size_t i = 0; i < num; ++i) {
    const Donor& donor = scene.donors[i];
    const bool lends = donor.sphere_id >= 0;
    const Vec3f far{1e12f, 1e12f, 1e12f};
    const Vec3f p = lends ? scene.spheres[static_cast<std::size_t>(donor.sphere_id)].center : far;
    const Vec3f normal = to_float(donor.plane_T.normal);
    const float weight = lends ? static_cast<float>(donor.weight) : 0.0f;
    const float values[9] = {p.x,
                             p.y,
                             p.z,
                             normal.x,
                             normal.y,
                             normal.z,
                             static_cast<float>(donor.plane_T.offset),
                             weight,
                             lends ? static_cast<float>(donor.presence) : 0.0f};
    for (int k = 0; k < 9; ++k) channels[k].push_back(values[k]);
    num_donors += lends;
    std::uint32_t bits;
    std::memcpy(&bits, &weight, sizeof bits);
    if (lends) {
      heaviest = std::max(heaviest, static_cast<unsigned long long>(bits) << 32 |
                                        (0xffffffffu - static_cast<std::uint32_t>(i)));
    }
  }
  BoundaryList& list = q.boundary;
  list.num = memory.copy_of(std::vector<std::int32_t>{static_cast<std::int32_t>(num)});
  list.num_donors = memory.copy_of(std::vector<std::int32_t>{num_donors});
  list.sphere_id = memory.copy_of(scene.boundary);
  list.donors = memory.copy_of(scene.donors);
  float** const arrays[9] = {&list.x,  &list.y,      &list.z,      &list.nx,      &list.ny,
                             &list.nz, &list.offset, &list.weight, &list.presence};
  for (int k = 0; k < 9; ++k) *arrays[k] = memory.copy_of(channels[k]);
  list.heaviest = memory.copy_of(std::vector<unsigned long long>{heaviest});
  q.pieces = memory.copy_of(scene.pieces);
  q.num_pieces = memory.copy_of(std::vector<std::int32_t>{scene.has_edges(c) ? 1 : 0});
  q.piece_of = memory.copy_of(scene.piece_of);
  q.edge_distance = memory.copy_of(scene.edge_distance);
  q.edge_side = memory.copy_of(scene.edge_side);

  // Untouched slots hold anything from earlier queries.
  test::Random random(17);
  std::vector<std::int32_t> donor(clusters.x.size());
  std::vector<float> volume(clusters.x.size(), 123.0f);
  for (std::int32_t& l : donor) {
    l = static_cast<std::int32_t>(random.bits() % (2 * num + 5)) - 2;
  }
  std::vector<std::uint32_t> touched((n + 31) / 32);
  for (std::size_t i = 0; i < num; ++i) {
    const auto id = static_cast<std::size_t>(scene.boundary[i]);
    const auto slot = static_cast<std::size_t>(clusters.slot_of[id]);
    donor[slot] = scene.donors[i].sphere_id >= 0 ? static_cast<std::int32_t>(i) : -1;
    volume[slot] = 0;
    touched[id / 32] |= 1u << id % 32;
  }
  q.touched = memory.copy_of(touched);
  q.donor = memory.copy_of(donor);
  q.assigned_volume = memory.copy_of(volume);
  const std::size_t num_threads = static_cast<std::size_t>(c.blocks) * kQueryThreads;
  MeasureSums* const sums = memory.take<MeasureSums>(2 * num_threads);
  EXPECT_GE(gpu::resident_blocks(0, reinterpret_cast<const void*>(assign), kQueryThreads,
                                 kAssignmentSharedBytes),
            1);
  gpu::launch(
      stream,
      {.blocks = c.blocks, .threads = kQueryThreads, .shared_bytes = kAssignmentSharedBytes},
      assign, q, sums);

  Found found;
  found.of_thread.resize(2 * num_threads);
  stream.copy(found.of_thread.data(), sums, found.of_thread.size() * sizeof(MeasureSums));
  stream.copy(donor.data(), q.donor, donor.size() * sizeof(donor[0]));
  stream.copy(volume.data(), q.assigned_volume, volume.size() * sizeof(volume[0]));
  EXPECT_TRUE(stream.wait()) << stream.status().error().message;
  for (std::size_t thread = 0; thread < num_threads; ++thread) {
    found.boundary.add(found.of_thread[2 * thread]);
    found.untouched.add(found.of_thread[2 * thread + 1]);
  }
  found.donor.assign(n, -1);
  found.volume.assign(n, 0.0);
  std::vector<std::int32_t> own(n, -1);
  std::vector<std::uint8_t> is_boundary(n);
  for (std::size_t i = 0; i < num; ++i) {
    own[static_cast<std::size_t>(scene.boundary[i])] =
        scene.donors[i].sphere_id >= 0 ? static_cast<std::int32_t>(i) : -1;
    is_boundary[static_cast<std::size_t>(scene.boundary[i])] = 1;
  }
  for (std::size_t id = 0; id < n; ++id) {
    const auto slot = static_cast<std::size_t>(clusters.slot_of[id]);
    found.volume[id] = static_cast<double>(volume[slot]);
    const std::int32_t l = donor[slot];
    if (is_boundary[id] != 0) {
      EXPECT_EQ(l, own[id]) << "a boundary sphere keeps its own";
      EXPECT_EQ(volume[slot], 0);
    } else if (l >= 0) {
      EXPECT_LT(l, static_cast<std::int32_t>(num)) << "left over from an earlier query";
      if (l >= static_cast<std::int32_t>(num)) continue;
      found.donor[id] = scene.donors[static_cast<std::size_t>(l)].sphere_id;
      EXPECT_GE(found.donor[id], 0) << "lends without a plane";
    }
  }
  return found;
}

void expect_alike(const MeasureSums& got, const MeasureSums& want) {
  constexpr double kTolerance = 1e-6;
  EXPECT_NEAR(got.volume, want.volume, kTolerance * want.volume);
  EXPECT_NEAR(norm(got.force - want.force), 0, kTolerance * want.volume);
  EXPECT_NEAR(norm(got.torque - want.torque), 0, kTolerance * 0.1 * want.volume);
}
// `ball` is the volume of the largest sphere.
void expect_alike(const Found& got, const Found& want, double ball) {
  expect_alike(got.untouched, want.untouched);
  std::size_t num_different = 0, num_wrong_volumes = 0, num_wrong_states = 0;
  for (std::size_t id = 0; id < want.volume.size(); ++id) {
    // The donor of a sphere wholly in front of its plane may be left out.
    const bool left_out = want.volume[id] == 0 && (got.donor[id] < 0 || want.donor[id] < 0);
    num_different += got.donor[id] != want.donor[id] && !left_out;
    num_wrong_volumes +=
        std::abs(got.volume[id] - want.volume[id]) > 1e-6 * want.volume[id] + 1e-6 * ball;
    num_wrong_states +=
        (got.volume[id] > 0) != (want.volume[id] > 0) && want.volume[id] > 1e-9 * ball;
  }
  EXPECT_EQ(num_different, 0u);
  EXPECT_EQ(num_wrong_volumes, 0u);
  EXPECT_EQ(num_wrong_states, 0u);
}

void check(const Case& c) {
  SCOPED_TRACE(c.name);
  const Scene scene(c, 5);
  double ball = 0;
  for (const Sphere& s : scene.spheres) {
    ball = std::max(ball, sphere_volume(static_cast<double>(s.radius)));
  }
  const Found got = on_gpu(c, scene), want = brute_force(c, scene);
  expect_alike(got.boundary, want.boundary);
  expect_alike(got, want, ball);
  if (scene.donors.empty() || scene.has_edges(c)) return;
  if (c.method == MethodKind::simplified && c.fades_in) return;
  if (scene.priority_rule(c, nullptr).compares_all(c.method == MethodKind::weighted)) return;
  expect_alike(got, cpu_kernels(c, scene), ball);
}

constexpr Priority kPriorities[] = {Priority::distance, Priority::count,     Priority::square,
                                    Priority::gaussian, Priority::agreement, Priority::path};

class AssignmentStage : public testing::TestWithParam<MethodKind> {};

TEST_P(AssignmentStage, EqualsCpuAndBruteForce) {
  PALPATE_GPU_OR_SKIP();
  for (const int num : {100, 1000, 5000}) {
    for (const Priority priority : kPriorities) {
      if (priority == Priority::path && num > 1000) continue;
      check({.name = std::to_string(num) + " by " + name_of(priority),
             .num_spheres = num,
             .method = GetParam(),
             .priority = priority,
             .blocks = num == 1000 ? 2 : 3});
    }
  }
}

TEST_P(AssignmentStage, WithEdgesAndPresence) {
  PALPATE_GPU_OR_SKIP();
  for (const Edges edges : {Edges::none, Edges::center, Edges::strict, Edges::cut}) {
    for (const bool fades_in : {false, true}) {
      for (const Priority priority : kPriorities) {
        check({.name = "edges " + std::to_string(static_cast<int>(edges)) +
                       (fades_in ? " fades in by " : " by ") + name_of(priority),
               .num_spheres = 700,
               .method = GetParam(),
               .priority = priority,
               .edges = edges,
               .fades_in = fades_in,
               .blocks = 2});
      }
    }
  }
}

TEST_P(AssignmentStage, NoDonorOneDonorAllDonorsAndTies) {
  PALPATE_GPU_OR_SKIP();
  const MethodKind method = GetParam();
  for (const bool fades_in : {false, true}) {
    check({.name = "none", .donor_share = 0, .method = method, .fades_in = fades_in, .blocks = 2});
    check({.name = "few",
           .num_spheres = 40,
           .donor_share = 0.1,
           .method = method,
           .fades_in = fades_in,
           .blocks = 1});
    check({.name = "all", .donor_share = 1, .method = method, .fades_in = fades_in, .blocks = 2});
    // Five clusters for a block: three warps for each, and one has nothing to do.
    check({.name = "uneven",
           .num_spheres = 300,
           .donor_share = 0.3,
           .method = method,
           .fades_in = fades_in,
           .blocks = 2});
    check({.name = "ties",
           .num_spheres = 2197,
           .donor_share = 0.3,
           .has_ties = true,
           .method = method,
           .fades_in = fades_in,
           .blocks = 2});
    check({.name = "many tiles",
           .num_spheres = 5000,
           .donor_share = 0.5,
           .method = method,
           .blocks = 1});
  }
}

TEST_P(AssignmentStage, SameBitsInAnyOrderOfThreads) {
  PALPATE_GPU_OR_SKIP();
  for (const bool fades_in : {false, true}) {
    const Case c{.name = "",
                 .num_spheres = 1500,
                 .has_ties = true,
                 .method = GetParam(),
                 .fades_in = fades_in,
                 .blocks = 3};
    const Scene scene(c, 9);
    const Found want = on_gpu(c, scene);
    for (const std::uint32_t seed : {1u, 2u, 3u}) {
#if defined(PALPATE_EMULATE_CUDA)
      emulator::set_order(seed);
#endif
      const Found got = on_gpu(c, scene);
      EXPECT_EQ(got.donor, want.donor) << seed;
      EXPECT_EQ(got.volume, want.volume) << seed;
      std::size_t num_different = 0;
      for (std::size_t i = 0; i < want.of_thread.size(); ++i) {
        const MeasureSums &a = got.of_thread[i], &b = want.of_thread[i];
        num_different += !(a.volume == b.volume && a.force == b.force && a.torque == b.torque &&
                           a.num_inside == b.num_inside);
      }
      EXPECT_EQ(num_different, 0u) << seed;
    }
#if defined(PALPATE_EMULATE_CUDA)
    emulator::set_order(0);
#endif
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, AssignmentStage,
                         testing::Values(MethodKind::simplified, MethodKind::weighted),
                         [](const auto& method) {
                           return method.param == MethodKind::weighted ? "weighted" : "simplified";
                         });

}  // namespace
}  // namespace palpate
