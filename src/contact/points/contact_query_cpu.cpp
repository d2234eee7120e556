// The query on the CPU: order of the stages, and the loops over threads.
#include "src/contact/points/contact_query_cpu.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "src/contact/field/field_contact.h"
#include "src/contact/index/sphere_clusters.h"
#include "src/contact/index/sphere_grid.h"
#include "src/contact/index/volume_scales.h"
#include "src/contact/points/donors/lenders.h"
#include "src/contact/points/donors/plane_borrowing.h"
#include "src/contact/points/edges/edge_planes.h"
#include "src/contact/points/graph/graph_rule.h"
#include "src/contact/points/graph/graph_traversal.h"
#include "src/contact/points/scan/boundary_plane.h"
#include "src/contact/points/scan/boundary_points.h"
#include "src/contact/points/scan/image_window.h"
#include "src/contact/points/scan/point_scan.h"

namespace palpate {
namespace {

struct Kernels {
  ScanPoints scan_points;
  BorrowNearest borrow_nearest;
  BorrowWeighted borrow_weighted;
};

Kernels kernels_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) {
    return {isa_avx512::scan_points, isa_avx512::borrow_nearest, isa_avx512::borrow_weighted};
  }
  if (isa == Isa::avx2) {
    return {isa_avx2::scan_points, isa_avx2::borrow_nearest, isa_avx2::borrow_weighted};
  }
#endif
  (void)isa;
  return {isa_baseline::scan_points, isa_baseline::borrow_nearest, isa_baseline::borrow_weighted};
}

class ContactQueryCpu final : public ContactQuery {
 public:
  ContactQueryCpu(const Tool& tool, const ContactCapacities& capacities)
      : tool_(&tool),
        spheres_(tool.spheres()),
        pool_(capacities.pool != nullptr ? capacities.pool : &own_pool_),
        kernels_(kernels_for(std::min(capacities.isa, best_isa()))),
        grid_(spheres_),
        clusters_(spheres_),
        own_volumes_(tool, clusters_, SphereVolumes::own),
        represented_volumes_(tool, clusters_, SphereVolumes::represented),
        traversal_(spheres_, tool.graph(), clusters_.order()),
        points_(spheres_.size(), *pool_, kernels_.scan_points),
        edges_(spheres_, clusters_),
        field_(tool, *pool_, std::min(capacities.isa, best_isa())),
        box_T_(bounds_of(spheres_)),
        lenders_(spheres_) {
    const std::size_t n = spheres_.size();
    seeds_.reserve(n);
    lender_of_seed_.reserve(n);
    touched_places_.assign(clusters_.x.size(), PlaneBorrowing::kNone);
    for (std::size_t place = 0; place < clusters_.x.size(); ++place) {
      if (clusters_.sphere_id[place] < 0) touched_places_[place] = PlaneBorrowing::kTouched;
    }
    skipped_places_ = touched_places_;
    lender_places_.assign(clusters_.x.size(), PlaneBorrowing::kNone);
    borrowed_volume_.assign(clusters_.x.size(), 0.0f);
    group_sums_.resize(static_cast<std::size_t>(clusters_.num_groups()));
    const auto num_tasks = static_cast<std::size_t>(pool_->num_threads());
    candidate_floats_.resize(8 * num_tasks * (n + Lenders::kPadding));
    candidate_lenders_.resize(2 * num_tasks * (n + Lenders::kPadding));
    borrowed_.resize(n);
    seed_moments_.reserve(n);
    numbers_.resize(n + Lenders::kPadding);
    std::iota(numbers_.begin(), numbers_.end(), 0);
    states_.assign(n, SphereState::outside);
    planes_.assign(n, Plane<float>{});
  }

  void set_cloud(const PointCloudView& cloud) noexcept override { cloud_ = cloud; }
  void set_field(const DepthFieldView& field) noexcept override { field_.set_field(field); }

  Penetration query(const Pose& X_WT, const ContactOptions& options) noexcept override {
    Penetration result;
    options_ = options;
    scales_ = options.counted() == SphereVolumes::own ? &own_volumes_ : &represented_volumes_;
    forget_last_query();
    if (!is_finite(X_WT)) {
      result.status |= StepStatus::non_finite_pose;
      return result;
    }
    const Pose X{X_WT.translation, normalized(X_WT.rotation)};
    if (options.method == InsideMethod::field) return field_.measure(X, options.counted());
    if (cloud_.size() == 0) {
      result.status |= StepStatus::no_surface;
      return result;
    }
    find_boundary_points(X);
    result = find_boundary_planes(X);
    if (options.edges != Edges::none && !uses_edges()) result.status |= StepStatus::no_edge_vectors;
    MeasureSums sums = measure_boundary_spheres();
    sums.add(options.method == InsideMethod::graph ? measure_along_graph()
                                                   : measure_by_borrowing());
    result.volume = sums.volume;
    result.num_inside_spheres = sums.num_inside;
    result.measure_W = {rotate(X.rotation, sums.force), rotate(X.rotation, sums.torque)};
    return result;
  }

  Stiffness stiffness() const noexcept override {
    return options_.method == InsideMethod::field ? field_.stiffness() : Stiffness{};
  }
  std::span<const SphereState> states() const noexcept override;
  std::span<const Plane<float>> planes() const noexcept override;

 private:
  void forget_last_query();
  void describe_field() const noexcept;
  void find_boundary_points(const Pose& X_WT);
  Penetration find_boundary_planes(const Pose& X_WT);
  MeasureSums measure_boundary_spheres();
  MeasureSums measure_by_borrowing();
  MeasureSums measure_one_by_one();
  MeasureSums measure_along_graph();
  Candidates candidates(int which);
  double reached_volume(const GraphTraversal::Visit& visit) const;
  double volume_scale(std::int32_t id) const {
    return static_cast<double>(scales_->of_sphere[static_cast<std::size_t>(id)]);
  }
  bool uses_edges() const { return options_.edges != Edges::none && cloud_.edge_x != nullptr; }
  bool fades_in() const {
    return options_.continuity == Continuity::entry || options_.continuity == Continuity::both;
  }
  // Whether the spheres that no point touches lay lenders over each other.
  bool overlays() const { return fades_in() && options_.method == InsideMethod::simplified; }
  BorrowRule borrow_rule() const {
    return {options_.method == InsideMethod::weighted, options_.priority == Priority::count,
            found_edges()};
  }
  const EdgesView* found_edges() const { return edges_.empty() ? nullptr : &edges_view_; }
  const Vec3d& origin() const { return tool_->sphere_mass().centre_of_mass; }

  const Tool* tool_;
  std::span<const Sphere> spheres_;
  ThreadPool own_pool_{1};
  ThreadPool* pool_;
  Kernels kernels_;
  SphereGrid grid_;
  SphereClusters clusters_;
  VolumeScales own_volumes_, represented_volumes_;
  const VolumeScales* scales_ = &own_volumes_;  // of the last query
  GraphTraversal traversal_;
  BoundaryPoints points_;
  EdgePlanes edges_;
  EdgesView edges_view_;
  FieldContact field_;
  Bounds box_T_;
  PointCloudView cloud_;
  double sum_scale_ = 1;  // of the last query

  // Boundary spheres of the last query.
  std::vector<GraphTraversal::Seed> seeds_;   // all, ascending; zero normal: no plane
  std::vector<std::int32_t> lender_of_seed_;  // index into the lenders, or -1
  struct SeedMoment {
    double volume = 0;
    Vec3d first;  // sum of V_s (c_s - C)
  };
  std::vector<SeedMoment> seed_moments_;  // graph: of the spheres that a seed reached
  Lenders lenders_;                       // those with a plane
  // Per place of clusters_.
  std::vector<std::int32_t> touched_places_, skipped_places_, lender_places_;
  std::vector<float> borrowed_volume_;
  std::vector<MeasureSums> group_sums_;
  std::vector<float> candidate_floats_;
  std::vector<std::int32_t> candidate_lenders_;
  std::vector<std::int32_t> numbers_;  // 0, 1, 2, ...
  std::vector<Borrowed> borrowed_;     // of spheres that are measured one by one

  std::span<const GraphTraversal::Visit> reached_;  // graph
  ContactOptions options_;                          // of the last query
  mutable std::vector<SphereState> states_;
  mutable std::vector<Plane<float>> planes_;
  mutable bool is_field_described_ = false;  // both of them, by the last query
};

void ContactQueryCpu::forget_last_query() {
  for (const GraphTraversal::Seed& seed : seeds_) {
    const auto id = static_cast<std::size_t>(seed.sphere_id);
    touched_places_[static_cast<std::size_t>(clusters_.place_of[id])] = PlaneBorrowing::kNone;
  }
  seeds_.clear();
  lender_of_seed_.clear();
  edges_.clear();
  lenders_.clear();
  reached_ = {};
  is_field_described_ = false;
}

/// States and planes come together: whoever asks for both pays once.
void ContactQueryCpu::describe_field() const noexcept {
  if (!is_field_described_) field_.describe(states_, planes_);
  is_field_described_ = true;
}

// Stage 1: which points are in which spheres.
void ContactQueryCpu::find_boundary_points(const Pose& X_WT) {
  PointScan scan;
  scan.cloud = cloud_;
  scan.grid = grid_.view();
  scan.spheres = spheres_.data();
  scan.R_TW = rotation_matrix(conjugate(X_WT.rotation));
  scan.translation_W = X_WT.translation;
  scan.sum_scale = sum_scale_ = finest_sum_scale(cloud_.size(), reach_of_sums(box_T_));
  scan.weights = options_.continuity == Continuity::none    ? PointWeights::none
                 : options_.continuity == Continuity::entry ? PointWeights::beside
                                                            : PointWeights::in_sums;
  points_.collect(scan, image_window(cloud_, box_T_, X_WT), uses_edges());
}

// Stage 2: mean point and unit mean normal of each boundary sphere (eq. 3.3), in the tool frame.
Penetration ContactQueryCpu::find_boundary_planes(const Pose& X_WT) {
  Penetration result;
  const Mat3d R_TW = rotation_matrix(conjugate(X_WT.rotation));
  const BoundaryPlaneRule rule{
      options_.continuity == Continuity::kernel || options_.continuity == Continuity::both,
      fades_in(), uses_edges()};
  points_.take([&](std::size_t id, const PointSums& sums, const EdgeSums& edge_sums) {
    const BoundarySphere sphere = boundary_sphere(static_cast<std::int32_t>(id), sums, sum_scale_,
                                                  rule, R_TW, X_WT.translation);
    if (sphere.is_ambiguous) {
      result.status |= StepStatus::ambiguous_normals;
    }
    const Lender& lender = sphere.lender;
    seeds_.push_back({sphere.sphere_id, lender.plane_T.normal, lender.point});
    lender_of_seed_.push_back(sphere.has_plane() ? lenders_.size() : -1);
    if (sphere.has_plane()) lenders_.add(lender);
    touched_places_[static_cast<std::size_t>(clusters_.place_of[id])] = PlaneBorrowing::kTouched;
    if (uses_edges()) edges_.add_pieces(edge_sums, sum_scale_, R_TW, X_WT.translation);
    result.num_points += sphere.num_points;
  });
  edges_.find_nearest(X_WT, options_.edges);
  for (std::int32_t l = 0; l < lenders_.size(); ++l) edges_.note(lenders_[l].point);
  edges_view_ = edges_.view();
  lenders_.pad();
  result.num_boundary_spheres = static_cast<int>(seeds_.size());
  return result;
}

// V_s n_s of the boundary spheres, each cut by its own plane (Alg. 3.1) and, by `cut`, by its edge;
// the lever is the centre. A sphere that a point has just entered is still measured as if it were
// untouched: V = (1 - presence) V_state + presence V_cap.
MeasureSums ContactQueryCpu::measure_boundary_spheres() {
  MeasureSums sums;
  BorrowRule own_rule = borrow_rule();
  if (options_.edges != Edges::cut) own_rule.edges = nullptr;
  for (std::size_t s = 0; s < seeds_.size(); ++s) {
    const std::int32_t id = seeds_[s].sphere_id, l = lender_of_seed_[s];
    Borrowed measured;
    if (l >= 0) measured = lenders_.lenders().borrow_from(lenders_[l], id, own_rule);
    if (fades_in()) {
      const double presence = l >= 0 ? lenders_[l].presence : 0;
      const Borrowed state = lenders_.lenders().borrow(id, borrow_rule());
      measured.volume = presence * measured.volume + (1 - presence) * state.volume;
      measured.force = presence * measured.force + (1 - presence) * state.force;
    }
    const double volume = volume_scale(id) * measured.volume;
    const Vec3d force = volume_scale(id) * measured.force;
    sums.volume += volume;
    sums.force += force;
    sums.torque +=
        cross(to_double(spheres_[static_cast<std::size_t>(id)].centre) - origin(), force);
  }
  return sums;
}

Candidates ContactQueryCpu::candidates(int which) {
  const std::size_t size = spheres_.size() + Lenders::kPadding;
  float* floats = candidate_floats_.data() + static_cast<std::size_t>(which) * 4 * size;
  return {0,
          floats,
          floats + size,
          floats + 2 * size,
          floats + 3 * size,
          candidate_lenders_.data() + static_cast<std::size_t>(which) * size};
}

// Weighted and simplified: groups of clusters in any order, added up in group order.
MeasureSums ContactQueryCpu::measure_by_borrowing() {
  MeasureSums sums;
  if (lenders_.empty()) return sums;
  PlaneBorrowing job;
  job.clusters = &clusters_;
  job.spheres = spheres_.data();
  job.boundary = lenders_.view(fades_in());
  job.origin = origin();
  job.by_count = options_.priority == Priority::count;
  job.num_lenders = job.boundary.num;
  if (job.by_count) {
    // One lender for all: most points, ties to the lowest sphere id.
    job.first_lender = lenders_.heaviest();
    job.num_lenders = 1;
  }
  job.numbers = numbers_.data();
  job.touched = touched_places_.data();
  const bool one_by_one = overlays() || !edges_.empty();
  if (one_by_one) {
    skipped_places_ = touched_places_;
    for (std::size_t id = 0; id < spheres_.size(); ++id) {
      if (overlays() || edges_view_.concerns(static_cast<std::int32_t>(id))) {
        skipped_places_[static_cast<std::size_t>(clusters_.place_of[id])] =
            PlaneBorrowing::kTouched;
      }
    }
    job.touched = skipped_places_.data();
  }
  job.volume_scale = scales_->of_place.data();
  job.lender = lender_places_.data();
  job.borrowed_volume = borrowed_volume_.data();

  const int num_groups = clusters_.num_groups();
  const int num_tasks = pool_->num_threads();
  pool_->parallel_for(num_tasks, [&](int t) {
    BorrowingScratch scratch{candidates(2 * t), candidates(2 * t + 1)};
    for (int group = t; group < num_groups; group += num_tasks) {
      group_sums_[static_cast<std::size_t>(group)] =
          options_.method == InsideMethod::weighted ? kernels_.borrow_weighted(job, group)
                                                    : kernels_.borrow_nearest(job, group, scratch);
    }
  });
  for (const MeasureSums& group : group_sums_) sums.add(group);
  if (one_by_one) sums.add(measure_one_by_one());
  return sums;
}

// Untouched spheres that an edge concerns, or that lay lenders over each other: those that the
// kernels left out.
MeasureSums ContactQueryCpu::measure_one_by_one() {
  const BorrowRule rule = borrow_rule();
  const bool from_nearest = options_.method == InsideMethod::simplified && !overlays();
  const auto is_one_of_them = [&](std::size_t place) {
    return touched_places_[place] != PlaneBorrowing::kTouched &&
           skipped_places_[place] == PlaneBorrowing::kTouched;
  };
  const int num_tasks = pool_->num_threads();
  pool_->parallel_for(num_tasks, [&](int t) {
    // Every so many: spheres that need it lie together.
    const auto num = static_cast<std::size_t>(num_tasks);
    for (auto place = static_cast<std::size_t>(t); place < touched_places_.size(); place += num) {
      if (!is_one_of_them(place)) continue;
      const std::int32_t id = clusters_.sphere_id[place], nearest = lender_places_[place];
      Borrowed& borrowed = borrowed_[static_cast<std::size_t>(id)];
      if (!from_nearest) {
        borrowed = lenders_.lenders().borrow(id, rule);
      } else {
        borrowed =
            nearest < 0 ? Borrowed{} : lenders_.lenders().borrow_from(lenders_[nearest], id, rule);
      }
    }
  });
  MeasureSums sums;
  for (std::size_t id = 0; id < spheres_.size(); ++id) {
    const auto place = static_cast<std::size_t>(clusters_.place_of[id]);
    if (!is_one_of_them(place)) continue;
    const double scale = volume_scale(static_cast<std::int32_t>(id));
    const double volume = scale * borrowed_[id].volume;
    const Vec3d force = scale * borrowed_[id].force;
    borrowed_volume_[place] = static_cast<float>(volume);
    sums.volume += volume;
    sums.force += force;
    sums.torque += cross(to_double(spheres_[id].centre) - origin(), force);
    sums.num_inside += volume > 0;
  }
  return sums;
}

double ContactQueryCpu::reached_volume(const GraphTraversal::Visit& visit) const {
  const std::int32_t l = lender_of_seed_[static_cast<std::size_t>(visit.seed)];
  return volume_scale(visit.sphere_id) * palpate::reached_volume(lenders_.lenders(), lenders_[l],
                                                                 visit.sphere_id, options_.inside,
                                                                 found_edges());
}

// All spheres with one reference push along one normal: their volumes and first moments are added
// up first.
MeasureSums ContactQueryCpu::measure_along_graph() {
  MeasureSums sums;
  reached_ = traversal_.run(seeds_, found_edges());
  seed_moments_.assign(seeds_.size(), SeedMoment{});
  for (const GraphTraversal::Visit& visit : reached_) {
    const double volume = reached_volume(visit);
    const Vec3d c = to_double(spheres_[static_cast<std::size_t>(visit.sphere_id)].centre);
    SeedMoment& moment = seed_moments_[static_cast<std::size_t>(visit.seed)];
    moment.volume += volume;
    moment.first += volume * (c - origin());
    sums.num_inside += volume > 0;
  }
  for (std::size_t s = 0; s < seeds_.size(); ++s) {
    sums.volume += seed_moments_[s].volume;
    sums.force += seed_moments_[s].volume * seeds_[s].normal;
    sums.torque += cross(seed_moments_[s].first, seeds_[s].normal);
  }
  return sums;
}

std::span<const SphereState> ContactQueryCpu::states() const noexcept {
  if (options_.method == InsideMethod::field) {
    describe_field();
    return states_;
  }
  std::fill(states_.begin(), states_.end(), SphereState::outside);
  if (options_.method == InsideMethod::graph) {
    for (const GraphTraversal::Visit& visit : reached_) {
      if (reached_volume(visit) > 0) {
        states_[static_cast<std::size_t>(visit.sphere_id)] = SphereState::inside;
      }
    }
  } else if (!lenders_.empty()) {
    for (std::size_t id = 0; id < states_.size(); ++id) {
      if (borrowed_volume_[static_cast<std::size_t>(clusters_.place_of[id])] > 0) {
        states_[id] = SphereState::inside;
      }
    }
  }
  for (const GraphTraversal::Seed& seed : seeds_) {
    states_[static_cast<std::size_t>(seed.sphere_id)] = SphereState::boundary;
  }
  return states_;
}

std::span<const Plane<float>> ContactQueryCpu::planes() const noexcept {
  if (options_.method == InsideMethod::field) {
    describe_field();
    return planes_;
  }
  std::fill(planes_.begin(), planes_.end(), Plane<float>{});
  const auto set = [&](std::int32_t id, std::int32_t lender) {
    if (lender < 0) return;
    const Plane<double>& plane = lenders_[lender].plane_T;
    planes_[static_cast<std::size_t>(id)] = {to_float(plane.normal),
                                             static_cast<float>(plane.offset)};
  };
  if (options_.method == InsideMethod::simplified && !overlays() && !lenders_.empty()) {
    for (std::size_t id = 0; id < planes_.size(); ++id) {
      const auto place = static_cast<std::size_t>(clusters_.place_of[id]);
      if (borrowed_volume_[place] > 0) set(static_cast<std::int32_t>(id), lender_places_[place]);
    }
  }
  for (const GraphTraversal::Visit& visit : reached_) {
    if (reached_volume(visit) > 0) {
      set(visit.sphere_id, lender_of_seed_[static_cast<std::size_t>(visit.seed)]);
    }
  }
  for (std::size_t s = 0; s < seeds_.size(); ++s) set(seeds_[s].sphere_id, lender_of_seed_[s]);
  return planes_;
}

}  // namespace

std::unique_ptr<ContactQuery> make_contact_query_cpu(const Tool& tool,
                                                     const ContactCapacities& capacities) {
  return std::make_unique<ContactQueryCpu>(tool, capacities);
}

}  // namespace palpate
