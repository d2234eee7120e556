// The graph stage on a GPU against GraphTraversal, on packings of concave and real solids.
#include "src/contact/points/graph/graph_stage.cuh"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "src/contact/points/graph/graph_memory.h"
#include "src/contact/points/graph/graph_traversal.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/scan_mesh.h"

namespace palpate {
namespace {

using test::Random;

__global__ void __launch_bounds__(kQueryThreads, 1)
    graph_query(const __grid_constant__ PointQuery q, MeasureSums* sums, int* num_rounds,
                unsigned long long* barrier) {
  // As the boundary stage leaves it.
  for (std::int32_t i = gpu::grid_thread(); i < *q.boundary.num; i += gpu::grid_threads()) {
    q.search.slots[q.clusters.slot_of[q.boundary.sphere_id[i]]].round = q.search.first_round;
  }
  gpu::grid_barrier(barrier);
  const int rounds = search_graph(q, barrier);
  sums[gpu::grid_thread()] = measure_reached(q);
  if (gpu::grid_thread() == 0) *num_rounds = rounds;
}

/// State of a query when the graph stage begins, in host memory.
struct Scene {
  std::vector<GraphTraversal::Seed> seeds;  // ascending
  std::vector<EdgePiece> pieces;
  std::vector<std::int32_t> piece_of;
  std::vector<double> distance;
  std::vector<EdgeSide> side;
};

struct Found {
  std::vector<std::int32_t> seed;  // of each sphere; -1: not reached
  std::vector<double> path_length;
  std::vector<float> volume;  // V_s
  MeasureSums sums;
};

template <class T>
bool same_bits(const T& a, const T& b) {
  return std::memcmp(&a, &b, sizeof(T)) == 0;
}
template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

/// A packing with its graph, and the search on both sides.
class Searched {
 public:
  Searched(std::vector<Sphere> spheres, LeafGraph graph)
      : spheres_(std::move(spheres)),
        graph_(std::move(graph)),
        clusters_(spheres_),
        sorted_(std::make_unique<const SortedGraph>(graph_, clusters_.sphere_id)),
        traversal_(spheres_, *sorted_),
        scales_(spheres_.size()) {
    for (std::size_t i = 0; i < scales_.size(); ++i) {
      scales_[i] = 1 + 0.25f * static_cast<float>(i % 7);
    }
    const auto num_slots = clusters_.x.size();
    job_.scan.spheres = memory_.copy_of(spheres_);
    job_.method = MethodKind::graph;
    job_.origin = {0.01, -0.02, 0.03};
    job_.volume_scale = memory_.copy_of(scales_);
    job_.num_spheres = static_cast<std::int32_t>(spheres_.size());
    job_.clusters.sphere_id = memory_.copy_of(clusters_.sphere_id);
    job_.clusters.slot_of = memory_.copy_of(clusters_.slot_of);
    job_.clusters.num_clusters = clusters_.num_clusters();
    job_.graph = sorted_graph_on_gpu(memory_, *sorted_, clusters_);
    job_.search = graph_search_on_gpu(memory_, job_.graph, num_slots, graph_.neighbors().size());
    job_.donor = memory_.take<std::int32_t>(num_slots);
    job_.assigned_volume = memory_.take<float>(num_slots);
    barrier_ = memory_.take<unsigned long long>(1);
    sums_ = memory_.take_pinned<MeasureSums>(kBlocks * kQueryThreads);
    num_rounds_ = memory_.take_pinned<int>(1);
  }

  std::span<const Sphere> spheres() const { return spheres_; }

  Found on_cpu(const Scene& scene, InsideVolume inside) {
    const std::size_t n = spheres_.size();
    Found found{
        std::vector<std::int32_t>(n, -1), std::vector<double>(n), std::vector<float>(n), {}};
    const std::vector<Donor> donors = donors_of(scene);
    const EdgesView edges{spheres_.data(), scene.pieces.data(), scene.piece_of.data(),
                          scene.distance.data(), scene.side.data()};
    const EdgesView* const used = scene.pieces.empty() ? nullptr : &edges;
    const DonorsView view{spheres_.data(), donors.data(), static_cast<std::int32_t>(donors.size())};
    for (const GraphTraversal::Visit& visit : traversal_.run(scene.seeds, used)) {
      const auto id = static_cast<std::size_t>(visit.sphere_id);
      const Donor& donor = donors[static_cast<std::size_t>(visit.seed)];
      const double volume = static_cast<double>(scales_[id]) *
                            reached_volume(view, donor, visit.sphere_id, inside, used);
      found.seed[id] = visit.seed;
      found.path_length[id] = visit.path_length;
      found.volume[id] = static_cast<float>(volume);
      found.sums.volume += volume;
      found.sums.force += volume * donor.plane_T.normal;
      found.sums.torque +=
          cross(to_double(spheres_[id].center) - job_.origin, volume * donor.plane_T.normal);
      found.sums.num_inside += volume > 0;
    }
    return found;
  }

  Found on_gpu(const Scene& scene, InsideVolume inside) {
    gpu::Memory memory(0);  // of this scene
    PointQuery q = job_;
    q.inside = inside;
    q.search.first_round = first_round_;
    std::vector<std::int32_t> ids;
    std::vector<std::int32_t> boundary_donor(clusters_.x.size(), 1000000);  // of earlier queries
    for (const GraphTraversal::Seed& seed : scene.seeds) {
      const auto slot = clusters_.slot_of[static_cast<std::size_t>(seed.sphere_id)];
      boundary_donor[static_cast<std::size_t>(slot)] =
          norm(seed.normal) > 0 ? static_cast<std::int32_t>(ids.size()) : -1;
      ids.push_back(seed.sphere_id);
    }
    stream_.copy(q.donor, boundary_donor.data(), boundary_donor.size() * sizeof(std::int32_t));
    q.boundary.num = memory.copy_of(std::vector{static_cast<std::int32_t>(ids.size())});
    q.boundary.sphere_id = memory.copy_of(ids);
    q.boundary.donors = memory.copy_of(donors_of(scene));
    if (!scene.pieces.empty()) {
      q.edges = Edges::cut;
      q.pieces = memory.copy_of(scene.pieces);
      q.num_pieces = memory.copy_of(std::vector{static_cast<std::int32_t>(scene.pieces.size())});
      q.piece_of = memory.copy_of(scene.piece_of);
      q.edge_distance = memory.copy_of(scene.distance);
      q.edge_side = memory.copy_of(scene.side);
    }
    gpu::launch(stream_,
                {.blocks = kBlocks,
                 .threads = kQueryThreads,
                 .shared_bytes = kGraphSharedBytes,
                 .cooperative = true},
                graph_query, q, sums_, num_rounds_, barrier_);
    const auto num_slots = static_cast<std::size_t>(q.clusters.num_slots());
    std::vector<SlotState> slots(num_slots);
    std::vector<double> path_length(num_slots);
    std::vector<std::int32_t> donor(num_slots), num_listed(3);
    std::vector<float> volume(num_slots);
    stream_.copy(slots.data(), q.search.slots, num_slots * sizeof(SlotState));
    stream_.copy(path_length.data(), q.search.path_length, num_slots * sizeof(double));
    stream_.copy(donor.data(), q.donor, num_slots * sizeof(std::int32_t));
    stream_.copy(volume.data(), q.assigned_volume, num_slots * sizeof(float));
    stream_.copy(num_listed.data(), q.search.num_listed, 3 * sizeof(std::int32_t));
    EXPECT_TRUE(stream_.wait()) << stream_.status().error().message;
    EXPECT_EQ(num_listed, std::vector<std::int32_t>(3)) << "for the next query";

    const std::size_t n = spheres_.size();
    Found found{
        std::vector<std::int32_t>(n, -1), std::vector<double>(n), std::vector<float>(n), {}};
    for (std::size_t slot = 0; slot < num_slots; ++slot) {
      const SlotState& state = slots[slot];
      EXPECT_EQ(state.num_offers, 0) << "for the next query";
      EXPECT_LE(state.round, first_round_ + *num_rounds_);
      if (state.round == first_round_) {
        EXPECT_EQ(donor[slot], boundary_donor[slot]);
        EXPECT_EQ(volume[slot], 0);
      } else if (state.round < first_round_) {
        EXPECT_EQ(donor[slot], -1);
        EXPECT_EQ(volume[slot], 0);
      } else {
        const auto id = static_cast<std::size_t>(clusters_.sphere_id[slot]);
        found.seed[id] = donor[slot];
        found.path_length[id] = path_length[slot];
        found.volume[id] = volume[slot];
      }
    }
    for (int i = 0; i < kBlocks * kQueryThreads; ++i) found.sums.add(sums_[i]);
    first_round_ += *num_rounds_ + 1;
    return found;
  }

  /// Same visits, references, path lengths and volumes, to the bit; returns how many.
  std::ptrdiff_t expect_same(const Scene& scene, InsideVolume inside) {
    const Found want = on_cpu(scene, inside), got = on_gpu(scene, inside);
    EXPECT_EQ(got.seed, want.seed);
    EXPECT_TRUE(same_bits(got.path_length, want.path_length));
    EXPECT_TRUE(same_bits(got.volume, want.volume));
    const double scale = 1e-12 * (want.sums.volume + 1e-12);
    EXPECT_NEAR(got.sums.volume, want.sums.volume, scale);
    EXPECT_LE(norm(got.sums.force - want.sums.force), scale);
    EXPECT_LE(norm(got.sums.torque - want.sums.torque), scale);
    EXPECT_EQ(got.sums.num_inside, want.sums.num_inside);
    return std::count_if(want.seed.begin(), want.seed.end(), [](int seed) { return seed >= 0; });
  }

 private:
  static constexpr int kBlocks = 2;

  static std::vector<Donor> donors_of(const Scene& scene) {
    std::vector<Donor> donors;
    for (const GraphTraversal::Seed& seed : scene.seeds) {
      Donor donor;
      if (norm(seed.normal) > 0) {
        donor = {seed.sphere_id, {seed.normal, dot(seed.normal, seed.point.p_T)}, seed.point};
      }
      donors.push_back(donor);
    }
    return donors;
  }

  std::vector<Sphere> spheres_;
  LeafGraph graph_;
  SphereClusters clusters_;
  std::unique_ptr<const SortedGraph> sorted_;  // stays where it is when this is moved
  GraphTraversal traversal_;
  std::vector<float> scales_;
  gpu::Memory memory_{0};
  gpu::Stream stream_{0, gpu::Priority::high};
  PointQuery job_;
  unsigned long long* barrier_;
  MeasureSums* sums_;
  int* num_rounds_;
  std::int32_t first_round_ = 1;
};

Searched packed(const TriangleMesh& mesh, int num, GapRule rule) {
  PackOptions options;
  options.max_spheres = num;
  std::vector<Sphere> spheres = pack_spheres(mesh, options).value().spheres;
  LeafGraph graph(spheres, rule);
  return {std::move(spheres), std::move(graph)};
}

/// The spheres that a wavy surface cuts; normals lean by up to `bumps`, and some are zero.
Scene cut_by_surface(std::span<const Sphere> spheres, double share, double bumps, Random& random) {
  double low = 1e300, high = -1e300;
  for (const Sphere& s : spheres) {
    low = std::min(low, static_cast<double>(s.center.z - s.radius));
    high = std::max(high, static_cast<double>(s.center.z + s.radius));
  }
  const double size = high - low, wave = 0.05 * bumps * size, level = low + share * size;
  Scene scene;
  for (std::size_t id = 0; id < spheres.size(); ++id) {
    const Vec3d c = to_double(spheres[id].center);
    const double z = level + wave * std::sin(20 * c.x / size) * std::cos(17 * c.y / size);
    if (std::abs(c.z - z) >= static_cast<double>(spheres[id].radius)) continue;
    const Vec3d normal = normalized(Vec3d{0, 0, -1} + bumps * random.direction());
    const bool is_silent = bumps > 0 && random.uniform() < 0.05;
    scene.seeds.push_back({static_cast<std::int32_t>(id),
                           is_silent ? Vec3d{} : normal,
                           {{c.x, c.y, z}, 0.5 + 0.1 * random.uniform()}});
  }
  return scene;
}

/// Pieces of edges anywhere, so that every rule has its case.
void add_edges(std::size_t num_spheres, Random& random, Scene& scene) {
  for (int i = 0; i < 12; ++i) {
    const Plane<double> plane{random.direction(), random.uniform(-0.03, 0.03)};
    scene.pieces.push_back({0, 0, random.uniform(0.4, 0.6), plane, true});
  }
  for (std::size_t id = 0; id < num_spheres; ++id) {
    const double distance = random.uniform(-0.01, 0.01);
    scene.piece_of.push_back(static_cast<std::int32_t>(random.bits() % scene.pieces.size()));
    scene.distance.push_back(distance);
    scene.side.push_back(edge_side(distance, 0.008, Edges::cut));
  }
}

class GraphStageTest : public testing::Test {
 protected:
  void SetUp() override {
    PALPATE_GPU_OR_SKIP();
    const TriangleMesh torus = make_torus(0.07, 0.03, 24, 16);
    solids_.push_back(packed(make_spiral(0.06, 0.02, 0.05, 2, 24, 12), 500, GapRule::absolute));
    solids_.push_back(packed(torus, 600, GapRule::relative));
  }

  std::vector<Searched> solids_;
};

TEST_F(GraphStageTest, EqualsTheCpu) {
  Random random(1);
  std::ptrdiff_t num_visits = 0;
  for (Searched& solid : solids_) {
    for (const double bumps : {0.0, 0.5, 20.0}) {  // the last: any direction
      for (const double share : {0.1, 0.6}) {
        const Scene scene = cut_by_surface(solid.spheres(), share, bumps, random);
        num_visits += solid.expect_same(scene, InsideVolume::full);
        num_visits += solid.expect_same(scene, InsideVolume::cap);
      }
    }
  }
  EXPECT_GT(num_visits, 1500);
}

TEST_F(GraphStageTest, EqualsTheCpuAtEdges) {
  Random random(2);
  std::ptrdiff_t num_visits = 0, num_without = 0;
  for (Searched& solid : solids_) {
    for (const double bumps : {0.0, 0.5}) {
      Scene scene = cut_by_surface(solid.spheres(), 0.3, bumps, random);
      num_without += solid.expect_same(scene, InsideVolume::cap);
      add_edges(solid.spheres().size(), random, scene);
      num_visits += solid.expect_same(scene, InsideVolume::cap);
      solid.expect_same(scene, InsideVolume::full);
    }
  }
  EXPECT_GT(num_visits, 100);
  EXPECT_LT(num_visits, num_without);
}

TEST_F(GraphStageTest, AnyNumberOfSeeds) {
  Searched& solid = solids_[1];
  EXPECT_EQ(solid.expect_same({}, InsideVolume::full), 0);
  Scene scene;
  scene.seeds.push_back({17, normalized(Vec3d{1, 2, -3}), {}});
  EXPECT_GT(solid.expect_same(scene, InsideVolume::full), 10);
  scene.seeds[0].normal = {};
  EXPECT_EQ(solid.expect_same(scene, InsideVolume::full), 0) << "a zero normal starts no search";
  Random random(3);
  Scene all, half;
  for (std::size_t id = 0; id < solid.spheres().size(); ++id) {
    all.seeds.push_back({static_cast<std::int32_t>(id), random.direction(), {}});
    if (random.uniform() < 0.5) half.seeds.push_back(all.seeds.back());
  }
  EXPECT_EQ(solid.expect_same(all, InsideVolume::full), 0);
  EXPECT_GT(solid.expect_same(half, InsideVolume::full), 10);
  EXPECT_EQ(solid.expect_same({}, InsideVolume::full), 0) << "nothing is left of earlier queries";
}

PALPATE_ON_SCANS(GraphStageOfScans);

TEST_P(GraphStageOfScans, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  PALPATE_SCAN_OR_SKIP(mesh);
  Searched scan = packed(mesh, 1200, GapRule::relative);
  Random random(4);
  for (const double share : {0.1, 0.9}) {
    const Scene scene = cut_by_surface(scan.spheres(), share, 0.3, random);
    EXPECT_GT(scan.expect_same(scene, InsideVolume::full), 10);
  }
}

// A hub with more neighbors than the lanes of a warp have bits for, and paths of equal length.
TEST(GraphStage, HubsAndTies) {
  PALPATE_GPU_OR_SKIP();
  std::vector<Sphere> spheres = {{{0, 0, 0}, 1}};
  std::vector<std::pair<int, int>> edges;
  Random random(5);
  for (int i = 1; i < 1600; ++i) {
    const double x = i % 2 == 0 ? 10 : -10;
    spheres.push_back({to_float({x, random.uniform(-5, 5), i < 40 ? -1.0 : 1.0}), 0.01f});
    edges.emplace_back(0, i);
  }
  for (int i = 40; i + 40 < 1600; ++i) edges.emplace_back(i, i + 40);
  std::sort(edges.begin(), edges.end());
  LeafGraph graph(spheres.size(), edges, 0, 1);
  Searched searched(std::move(spheres), std::move(graph));
  Scene scene;
  for (const int id : {1, 2, 3, 39}) scene.seeds.push_back({id, {0, 0, -1}, {}});
  EXPECT_EQ(searched.expect_same(scene, InsideVolume::full), 1 + 1560);
  scene.seeds = {{0, {0, 0, -1}, {}}};
  EXPECT_EQ(searched.expect_same(scene, InsideVolume::full), 1560);

  // Both ways to the last sphere are equally long: the lower seed has it.
  LeafGraph cross(3, std::vector<std::pair<int, int>>{{0, 2}, {1, 2}}, 0, 1);
  Searched tie({{{-1, 0, 0}, 0.5f}, {{1, 0, 0}, 0.5f}, {{0, 0, 1}, 0.5f}}, std::move(cross));
  Scene two;
  two.seeds = {{0, {0, 0, -1}, {}}, {1, {0, 0, -1}, {}}};
  EXPECT_EQ(tie.expect_same(two, InsideVolume::full), 1);
  EXPECT_EQ(tie.on_gpu(two, InsideVolume::full).seed[2], 0);
}

#if defined(PALPATE_EMULATE_CUDA)
TEST_F(GraphStageTest, SameBitsInAnyOrderOfThreads) {
  Random random(6);
  const Scene scene = cut_by_surface(solids_[0].spheres(), 0.3, 0.5, random);
  const Found want = solids_[0].on_gpu(scene, InsideVolume::cap);
  for (const std::uint32_t order : {1u, 2u, 3u}) {
    emulator::set_order(order);
    const Found got = solids_[0].on_gpu(scene, InsideVolume::cap);
    emulator::set_order(0);
    EXPECT_EQ(got.seed, want.seed);
    EXPECT_TRUE(same_bits(got.path_length, want.path_length));
    EXPECT_TRUE(same_bits(got.volume, want.volume));
    EXPECT_EQ(got.sums.volume, want.sums.volume);
    EXPECT_TRUE(got.sums.force == want.sums.force && got.sums.torque == want.sums.torque);
  }
}
#endif

}  // namespace
}  // namespace palpate
