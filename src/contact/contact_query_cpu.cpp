// The query on the CPU: order of the stages, and the loops over threads.
#include "src/contact/contact_query_cpu.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "src/contact/graph_traversal.h"
#include "src/contact/image_window.h"
#include "src/contact/plane_borrowing.h"
#include "src/contact/point_scan.h"
#include "src/contact/sphere_clusters.h"
#include "src/contact/sphere_grid.h"

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

Bounds bounds_of(std::span<const Sphere> spheres) {
  Bounds box{{1e300, 1e300, 1e300}, {-1e300, -1e300, -1e300}};
  for (const Sphere& s : spheres) {
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], static_cast<double>(s.centre[axis]) - s.radius);
      box.high[axis] = std::max(box.high[axis], static_cast<double>(s.centre[axis]) + s.radius);
    }
  }
  return box;
}

bool is_finite(const Pose& X) {
  const Vec3d& t = X.translation;
  const Quaternion& q = X.rotation;
  return std::isfinite(t.x + t.y + t.z + q.x + q.y + q.z + q.w);
}

// Points of one task, merged into the first task's sums afterwards.
struct PointTask {
  std::vector<PointSums> sums;        // one per sphere
  std::vector<std::uint8_t> touched;  // one per sphere, and up to a multiple of eight
};

class ContactQueryCpu final : public ContactQuery {
 public:
  ContactQueryCpu(const Tool& tool, const ContactCapacities& capacities)
      : tool_(&tool),
        spheres_(tool.spheres()),
        pool_(capacities.pool != nullptr ? capacities.pool : &own_pool_),
        kernels_(kernels_for(std::min(capacities.isa, best_isa()))),
        grid_(spheres_),
        clusters_(spheres_),
        traversal_(spheres_, tool.graph(), clusters_.order()),
        box_T_(bounds_of(spheres_)) {
    const std::size_t n = spheres_.size();
    tasks_.resize(static_cast<std::size_t>(pool_->num_threads()));
    for (PointTask& task : tasks_) {
      task.sums.resize(n);
      task.touched.assign((n + 7) / 8 * 8, 0);
    }
    seeds_.reserve(n);
    lender_of_seed_.reserve(n);
    lender_ids_.reserve(n);
    lender_planes_.reserve(n);
    for (std::vector<float>& channel : lender_floats_) channel.reserve(n + kLenderPadding);
    touched_places_.assign(clusters_.x.size(), PlaneBorrowing::kNone);
    for (std::size_t place = 0; place < clusters_.x.size(); ++place) {
      if (clusters_.sphere_id[place] < 0) touched_places_[place] = PlaneBorrowing::kTouched;
    }
    lender_places_.assign(clusters_.x.size(), PlaneBorrowing::kNone);
    borrowed_volume_.assign(clusters_.x.size(), 0.0f);
    group_sums_.resize(static_cast<std::size_t>(clusters_.num_groups()));
    candidate_floats_.resize(8 * tasks_.size() * (n + kLenderPadding));
    candidate_lenders_.resize(2 * tasks_.size() * (n + kLenderPadding));
    seed_moments_.reserve(n);
    numbers_.resize(n + kLenderPadding);
    std::iota(numbers_.begin(), numbers_.end(), 0);
    states_.assign(n, SphereState::outside);
    planes_.assign(n, Plane<float>{});
  }

  void set_cloud(const PointCloudView& cloud) noexcept override { cloud_ = cloud; }

  Penetration query(const Pose& X_WT, const ContactOptions& options) noexcept override {
    Penetration result;
    options_ = options;
    forget_last_query();
    if (!is_finite(X_WT)) {
      result.status |= static_cast<std::uint32_t>(StepStatus::non_finite_pose);
      return result;
    }
    const Pose X{X_WT.translation, normalized(X_WT.rotation)};
    find_boundary_points(X);
    result = find_boundary_planes(X);
    MeasureSums sums = measure_boundary_spheres();
    sums.add(options.method == InsideMethod::graph ? measure_along_graph()
                                                   : measure_by_borrowing());
    result.volume = sums.volume;
    result.num_inside_spheres = sums.num_inside;
    result.measure_W = {rotate(X.rotation, sums.force), rotate(X.rotation, sums.torque)};
    return result;
  }

  std::span<const SphereState> states() const noexcept override;
  std::span<const Plane<float>> planes() const noexcept override;

 private:
  static constexpr std::size_t kLenderPadding = 16;
  enum LenderChannel { kX, kY, kZ, kNx, kNy, kNz, kOffset, kCount, kNumChannels };

  void forget_last_query();
  void find_boundary_points(const Pose& X_WT);
  Penetration find_boundary_planes(const Pose& X_WT);
  void add_lender(const Sphere& sphere, std::int32_t id, const Plane<double>& plane,
                  std::int64_t num_points);
  MeasureSums measure_boundary_spheres();
  MeasureSums measure_by_borrowing();
  MeasureSums measure_along_graph();
  Candidates candidates(int which);
  double reached_volume(const GraphTraversal::Visit& visit) const;
  const Vec3d& origin() const { return tool_->sphere_mass().centre_of_mass; }

  const Tool* tool_;
  std::span<const Sphere> spheres_;
  ThreadPool own_pool_{1};
  ThreadPool* pool_;
  Kernels kernels_;
  SphereGrid grid_;
  SphereClusters clusters_;
  GraphTraversal traversal_;
  Bounds box_T_;
  PointCloudView cloud_;

  // Boundary spheres of the last query.
  std::vector<PointTask> tasks_;
  std::vector<GraphTraversal::Seed> seeds_;   // all, ascending; zero normal: no plane
  std::vector<std::int32_t> lender_of_seed_;  // index into the lenders, or -1
  struct SeedMoment {
    double volume = 0;
    Vec3d first;  // sum of V_s (c_s - C)
  };
  std::vector<SeedMoment> seed_moments_;  // graph: of the spheres that a seed reached
  // Those with a plane, as the plane stage wants them.
  std::vector<std::int32_t> lender_ids_;
  std::vector<Plane<double>> lender_planes_;
  std::vector<float> lender_floats_[kNumChannels];
  // Per place of clusters_.
  std::vector<std::int32_t> touched_places_, lender_places_;
  std::vector<float> borrowed_volume_;
  std::vector<MeasureSums> group_sums_;
  std::vector<float> candidate_floats_;
  std::vector<std::int32_t> candidate_lenders_;
  std::vector<std::int32_t> numbers_;  // 0, 1, 2, ...

  std::span<const GraphTraversal::Visit> reached_;  // graph
  ContactOptions options_;                          // of the last query
  mutable std::vector<SphereState> states_;
  mutable std::vector<Plane<float>> planes_;
};

void ContactQueryCpu::forget_last_query() {
  for (const GraphTraversal::Seed& seed : seeds_) {
    const auto id = static_cast<std::size_t>(seed.sphere_id);
    tasks_[0].sums[id] = PointSums{};
    touched_places_[static_cast<std::size_t>(clusters_.place_of[id])] = PlaneBorrowing::kNone;
  }
  seeds_.clear();
  lender_of_seed_.clear();
  lender_ids_.clear();
  lender_planes_.clear();
  for (std::vector<float>& channel : lender_floats_) channel.clear();
  reached_ = {};
}

// Stage 1: which points are in which spheres. Rows (or runs of an unorganised cloud) are shared
// out; the sums are whole numbers, so merging them in any order gives the same bits.
void ContactQueryCpu::find_boundary_points(const Pose& X_WT) {
  const ImageWindow window = image_window(cloud_, box_T_, X_WT);
  PointScan scan;
  scan.cloud = cloud_;
  scan.grid = grid_.view();
  scan.spheres = spheres_.data();
  scan.R_TW = rotation_matrix(conjugate(X_WT.rotation));
  scan.translation_W = X_WT.translation;

  const int num_tasks = static_cast<int>(tasks_.size());
  const bool by_rows = cloud_.height > 1;
  const int begin = by_rows ? window.row_begin : window.column_begin;
  const int end = by_rows ? window.row_end : window.column_end;
  pool_->parallel_for(num_tasks, [&](int t) {
    const int from =
        begin + static_cast<int>(static_cast<std::int64_t>(end - begin) * t / num_tasks);
    const int to =
        begin + static_cast<int>(static_cast<std::int64_t>(end - begin) * (t + 1) / num_tasks);
    PointTask& task = tasks_[static_cast<std::size_t>(t)];
    if (by_rows) {
      kernels_.scan_points(scan, from, to, window.column_begin, window.column_end, task.sums.data(),
                           task.touched.data());
    } else {
      kernels_.scan_points(scan, window.row_begin, window.row_end, from, to, task.sums.data(),
                           task.touched.data());
    }
  });

  PointTask& all = tasks_[0];
  for (std::size_t t = 1; t < tasks_.size(); ++t) {
    take_touched(tasks_[t].touched, [&](std::size_t id) {
      all.sums[id].add(tasks_[t].sums[id]);
      tasks_[t].sums[id] = PointSums{};
      all.touched[id] = 1;
    });
  }
}

// Stage 2: mean point and unit mean normal of each boundary sphere (eq. 3.3), in the tool frame.
Penetration ContactQueryCpu::find_boundary_planes(const Pose& X_WT) {
  Penetration result;
  const Mat3d R_TW = rotation_matrix(conjugate(X_WT.rotation));
  PointTask& all = tasks_[0];
  take_touched(all.touched, [&](std::size_t id) {
    const PointSums& sums = all.sums[id];
    const double scale = 1.0 / (PointSums::kScale * static_cast<double>(sums.num_points()));
    const auto mean = [&](const std::int64_t(&sum)[4]) {
      return Vec3d{static_cast<double>(sum[0]), static_cast<double>(sum[1]),
                   static_cast<double>(sum[2])} *
             scale;
    };
    const Vec3d p_T = R_TW * mean(sums.offset_W);
    const Vec3d mean_normal = mean(sums.normal_W);
    const double length = norm(mean_normal);
    if (length < 0.5) {
      result.status |= static_cast<std::uint32_t>(StepStatus::ambiguous_normals);
    }
    // Normals that cancel out say nothing: such a sphere has no plane.
    const bool has_plane = length > 1e-6;
    const Vec3d n_T = has_plane ? R_TW * (mean_normal / length) : Vec3d{};
    seeds_.push_back({static_cast<std::int32_t>(id), n_T});
    lender_of_seed_.push_back(has_plane ? static_cast<std::int32_t>(lender_ids_.size()) : -1);
    if (has_plane) {
      add_lender(spheres_[id], static_cast<std::int32_t>(id), {n_T, dot(n_T, p_T)},
                 sums.num_points());
    }
    touched_places_[static_cast<std::size_t>(clusters_.place_of[id])] = PlaneBorrowing::kTouched;
    result.num_points += static_cast<int>(sums.num_points());
  });
  result.num_boundary_spheres = static_cast<int>(seeds_.size());
  // Padding for whole vectors: far away, no weight.
  for (std::size_t i = 0; i < kLenderPadding; ++i) {
    for (int channel = 0; channel < kNumChannels; ++channel) {
      lender_floats_[channel].push_back(channel <= kZ ? 1e12f : 0.0f);
    }
  }
  return result;
}

void ContactQueryCpu::add_lender(const Sphere& sphere, std::int32_t id, const Plane<double>& plane,
                                 std::int64_t num_points) {
  lender_ids_.push_back(id);
  lender_planes_.push_back(plane);
  const float values[kNumChannels] = {sphere.centre.x,
                                      sphere.centre.y,
                                      sphere.centre.z,
                                      static_cast<float>(plane.normal.x),
                                      static_cast<float>(plane.normal.y),
                                      static_cast<float>(plane.normal.z),
                                      static_cast<float>(plane.offset),
                                      static_cast<float>(num_points)};
  for (int channel = 0; channel < kNumChannels; ++channel) {
    lender_floats_[channel].push_back(values[channel]);
  }
}

// V_s n_s of the boundary spheres, each cut by its own plane (Alg. 3.1); the lever is the centre.
MeasureSums ContactQueryCpu::measure_boundary_spheres() {
  MeasureSums sums;
  for (std::size_t l = 0; l < lender_ids_.size(); ++l) {
    const Plane<double>& plane = lender_planes_[l];
    const Sphere& sphere = spheres_[static_cast<std::size_t>(lender_ids_[l])];
    const Vec3d c = to_double(sphere.centre);
    const double volume =
        cap_volume(static_cast<double>(sphere.radius), dot(plane.normal, c) - plane.offset);
    sums.volume += volume;
    sums.force += volume * plane.normal;
    sums.torque += cross(c - origin(), volume * plane.normal);
  }
  return sums;
}

Candidates ContactQueryCpu::candidates(int which) {
  const std::size_t size = spheres_.size() + kLenderPadding;
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
  if (lender_ids_.empty()) return sums;
  PlaneBorrowing job;
  job.clusters = &clusters_;
  job.spheres = spheres_.data();
  job.boundary = {static_cast<int>(lender_ids_.size()),
                  lender_ids_.data(),
                  lender_floats_[kX].data(),
                  lender_floats_[kY].data(),
                  lender_floats_[kZ].data(),
                  lender_floats_[kNx].data(),
                  lender_floats_[kNy].data(),
                  lender_floats_[kNz].data(),
                  lender_floats_[kOffset].data(),
                  lender_floats_[kCount].data(),
                  lender_planes_.data()};
  job.origin = origin();
  job.by_count = options_.priority == Priority::count;
  job.num_lenders = job.boundary.num;
  if (job.by_count) {
    // One lender for all: most points, ties to the lowest sphere id.
    const std::vector<float>& count = lender_floats_[kCount];
    job.first_lender = static_cast<std::int32_t>(
        std::max_element(count.begin(), count.begin() + job.boundary.num) - count.begin());
    job.num_lenders = 1;
  }
  job.numbers = numbers_.data();
  job.touched = touched_places_.data();
  job.lender = lender_places_.data();
  job.borrowed_volume = borrowed_volume_.data();

  const int num_groups = clusters_.num_groups();
  const int num_tasks = static_cast<int>(tasks_.size());
  pool_->parallel_for(num_tasks, [&](int t) {
    BorrowingScratch scratch{candidates(2 * t), candidates(2 * t + 1)};
    for (int group = t; group < num_groups; group += num_tasks) {
      group_sums_[static_cast<std::size_t>(group)] =
          options_.method == InsideMethod::weighted ? kernels_.borrow_weighted(job, group)
                                                    : kernels_.borrow_nearest(job, group, scratch);
    }
  });
  for (const MeasureSums& group : group_sums_) sums.add(group);
  return sums;
}

// V_s of a sphere that the graph reached: whole (Alg. 3.7) or cut by its reference's plane
// (footnote).
double ContactQueryCpu::reached_volume(const GraphTraversal::Visit& visit) const {
  const Sphere& sphere = spheres_[static_cast<std::size_t>(visit.sphere_id)];
  const double r = sphere.radius;
  if (options_.inside == InsideVolume::full) return sphere_volume(r);
  const std::int32_t lender = lender_of_seed_[static_cast<std::size_t>(visit.seed)];
  const Plane<double>& plane = lender_planes_[static_cast<std::size_t>(lender)];
  return cap_volume(r, dot(plane.normal, to_double(sphere.centre)) - plane.offset);
}

// All spheres with one reference push along one normal: their volumes and first moments are added
// up first.
MeasureSums ContactQueryCpu::measure_along_graph() {
  MeasureSums sums;
  reached_ = traversal_.run(seeds_);
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
  std::fill(states_.begin(), states_.end(), SphereState::outside);
  if (options_.method == InsideMethod::graph) {
    for (const GraphTraversal::Visit& visit : reached_) {
      if (reached_volume(visit) > 0) {
        states_[static_cast<std::size_t>(visit.sphere_id)] = SphereState::inside;
      }
    }
  } else if (!lender_ids_.empty()) {
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
  std::fill(planes_.begin(), planes_.end(), Plane<float>{});
  const auto set = [&](std::int32_t id, std::int32_t lender) {
    if (lender < 0) return;
    const Plane<double>& plane = lender_planes_[static_cast<std::size_t>(lender)];
    planes_[static_cast<std::size_t>(id)] = {to_float(plane.normal),
                                             static_cast<float>(plane.offset)};
  };
  if (options_.method == InsideMethod::simplified && !lender_ids_.empty()) {
    for (std::size_t id = 0; id < planes_.size(); ++id) {
      set(static_cast<std::int32_t>(id),
          lender_places_[static_cast<std::size_t>(clusters_.place_of[id])]);
    }
  }
  for (const GraphTraversal::Visit& visit : reached_) {
    set(visit.sphere_id, lender_of_seed_[static_cast<std::size_t>(visit.seed)]);
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
