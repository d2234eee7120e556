// The query on a GPU: one launch, whatever the method.
#include "src/contact/cuda/contact_query_cuda.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "src/contact/cuda/device_cloud.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_contact_cuda.h"
#include "src/contact/index/sphere_grid.h"
#include "src/contact/index/volume_scales.h"
#include "src/contact/points/donors/borrow_stage.cuh"
#include "src/contact/points/edges/edge_stage.cuh"
#include "src/contact/points/graph/graph_memory.h"
#include "src/contact/points/graph/graph_stage.cuh"
#include "src/contact/points/point_query.h"
#include "src/contact/points/scan/boundary_stage.cuh"
#include "src/contact/points/scan/scan_stage.cuh"
#include "src/gpu/runtime.h"
#include "src/gpu/team.cuh"

namespace palpate {
namespace {

// The shares of all threads, and what one of them says about the whole query.
__device__ void finish(const PointQuery& q, const MeasureOutput& out, const MeasureSums& sums,
                       int num_rounds) {
  MeasureTerms mine;
  mine.volume = sums.volume;
  for (int axis = 0; axis < 3; ++axis) {
    mine.force[axis] = sums.force[axis];
    mine.torque[axis] = sums.torque[axis];
  }
  mine.num_inside = sums.num_inside;
  if (gpu::grid_thread() == 0) {
    mine.num_boundary = *q.boundary.num;
    mine.num_points = *q.boundary.num_points;
    mine.status = *q.boundary.status;
    mine.num_rounds = num_rounds;
  }
  __syncthreads();  // shared memory has another use now
  finish_measure(out, mine, gpu::shared_memory<FinishScratch>());
}

// All stages of a query; see point_query.h.
template <InsideMethod kMethod, bool kWithEdges>
__global__ void __launch_bounds__(kQueryThreads, 1)
    point_query(const __grid_constant__ PointQuery q, const __grid_constant__ MeasureOutput out,
                unsigned long long* barrier) {
  if (gpu::grid_thread() == 0) reset_counters(q);
  scan_points(q, kWithEdges);
  gpu::grid_barrier(barrier);
  if (kWithEdges) {
    scan_edges(q);
    gpu::grid_barrier(barrier);
  }
  find_boundary(q, kWithEdges);
  gpu::grid_barrier(barrier);
  if (kWithEdges) {
    find_edges(q);
    gpu::grid_barrier(barrier);
  }
  MeasureSums sums;
  int num_rounds = 0;
  if (kMethod == InsideMethod::graph) {
    num_rounds = search_graph(q, barrier, kWithEdges);
    sums = measure_reached(q, kWithEdges);
  } else {
    sums = borrow_planes(q, kMethod, kWithEdges);
  }
  sums.add(measure_boundary_spheres(q, kMethod, kWithEdges));
  finish(q, out, sums, num_rounds);
}

using PointKernel = void (*)(PointQuery, MeasureOutput, unsigned long long*);

constexpr std::size_t kSharedBytes =
    std::max({sizeof(FinishScratch), kBoundarySharedBytes, kEdgeSharedBytes, kBorrowSharedBytes,
              kGraphSharedBytes});

constexpr PointKernel kKernels[3][2] = {
    {point_query<InsideMethod::weighted, false>, point_query<InsideMethod::weighted, true>},
    {point_query<InsideMethod::simplified, false>, point_query<InsideMethod::simplified, true>},
    {point_query<InsideMethod::graph, false>, point_query<InsideMethod::graph, true>}};

PointKernel kernel_for(InsideMethod method, bool with_edges) {
  return kKernels[static_cast<int>(method)][with_edges];
}

// Blocks of the query's grid: one on each multiprocessor.
int num_blocks(int gpu) {
  int num = 1 << 20;
  for (const auto& pair : kKernels) {
    for (const PointKernel kernel : pair) {
      num = std::min(num, gpu::resident_blocks(gpu, reinterpret_cast<const void*>(kernel),
                                               kQueryThreads, kSharedBytes));
    }
  }
  return std::max(num, 1);
}

class ContactQueryCuda final : public ContactQuery {
 public:
  ContactQueryCuda(const Tool& tool, int gpu)
      : tool_(&tool),
        memory_(gpu),
        stream_(gpu, gpu::Priority::high),
        clouds_(gpu),
        clusters_(tool.spheres()),
        box_T_(bounds_of(tool.spheres())),
        field_(tool, gpu),
        answers_(gpu, num_blocks(gpu)),
        states_(tool.spheres().size(), SphereState::outside),
        planes_(tool.spheres().size()) {
    take_tool();
    take_scratch();
  }

  /// The first failure to get what a query needs.
  Status status() const {
    for (const Status* status : {&memory_.status(), &stream_.status(), &answers_.status()}) {
      if (!*status) return *status;
    }
    return field_.status();
  }

  void set_cloud(const PointCloudView& cloud) noexcept override { cloud_ = cloud; }
  void set_field(const DepthFieldView& field) noexcept override { field_.set_field(field); }

  Penetration query(const Pose& X_WT, const ContactOptions& options) noexcept override;
  std::optional<Penetration> query_between(const DepthFieldView& from, const DepthFieldView& to,
                                           double t, const Pose& X_WT,
                                           SphereVolumes volumes) noexcept override;
  Stiffness stiffness() const noexcept override {
    return options_.method == InsideMethod::field && is_measured_ ? field_.stiffness()
                                                                  : Stiffness{};
  }
  std::span<const SphereState> states() const noexcept override {
    describe();
    return states_;
  }
  std::span<const Plane<float>> planes() const noexcept override {
    describe();
    return planes_;
  }

 private:
  static Penetration not_finite() {
    Penetration nothing;
    nothing.status = StepStatus::non_finite_pose;
    return nothing;
  }
  // Notes whether a query by `field` has been answered.
  Penetration taken(const Penetration& result) {
    is_measured_ = !result.status.is_unmeasured();
    return result;
  }
  void take_tool();
  void take_scratch();
  void take_edge_candidates(std::size_t num_points);
  void ask(const Pose& X_WT);
  void describe() const noexcept;
  template <class T>
  std::vector<T> fetch(const T* from, std::size_t num) const;

  const Tool* tool_;
  gpu::Memory memory_;
  mutable gpu::Stream stream_;
  DeviceClouds clouds_;
  SphereClusters clusters_;
  Bounds box_T_;
  mutable FieldContactCuda field_;
  AnswerBox answers_;
  PointCloudView cloud_;

  PointQuery query_;  // of the last query, or what all have in common
  SphereGridView grid_;
  const float *own_scales_ = nullptr, *represented_scales_ = nullptr;
  unsigned long long* barrier_ = nullptr;
  std::optional<gpu::Memory> candidate_memory_;
  std::size_t max_edge_candidates_ = 0;

  ContactOptions options_;  // of the last query
  bool is_measured_ = false;
  mutable bool is_described_ = false;  // by the two that follow
  mutable std::vector<SphereState> states_;
  mutable std::vector<Plane<float>> planes_;
};

// What never changes.
void ContactQueryCuda::take_tool() {
  const SphereGrid grid(tool_->spheres());
  grid_ = grid.view();
  grid_.tags = memory_.copy_of(grid.tags());
  grid_.blocks = memory_.copy_of(grid.blocks());
  query_.scan.spheres = memory_.copy_of(tool_->spheres());
  query_.num_spheres = static_cast<std::int32_t>(tool_->spheres().size());
  query_.origin = tool_->sphere_mass().centre_of_mass;
  const SphereClusters& c = clusters_;
  query_.clusters = {memory_.copy_of(c.x),
                     memory_.copy_of(c.y),
                     memory_.copy_of(c.z),
                     memory_.copy_of(c.radius),
                     memory_.copy_of(c.volume),
                     memory_.copy_of(c.sphere_id),
                     memory_.copy_of(c.place_of),
                     memory_.copy_of(c.clusters),
                     memory_.copy_of(c.groups),
                     c.num_clusters(),
                     c.num_groups()};
  own_scales_ = memory_.copy_of(VolumeScales(*tool_, c, SphereVolumes::own).of_sphere);
  represented_scales_ =
      memory_.copy_of(VolumeScales(*tool_, c, SphereVolumes::represented).of_sphere);
  query_.graph = place_graph_on_gpu(memory_, tool_->graph(), c);
}

void ContactQueryCuda::take_scratch() {
  const std::size_t n = tool_->spheres().size(), num_places = clusters_.x.size();
  PointQuery& q = query_;
  q.sums = memory_.take<PointSums>(n);
  q.edge_sums = memory_.take<EdgeSums>(n);
  q.touched = memory_.take<std::uint32_t>((n + 31) / 32);
  q.touched_before = memory_.take<std::uint32_t>((n + 31) / 32);
  q.num_edge_candidates = memory_.take<std::int32_t>(1);
  BoundaryList& b = q.boundary;
  b.num = memory_.take<std::int32_t>(1);
  b.num_lenders = memory_.take<std::int32_t>(1);
  b.num_points = memory_.take<std::int32_t>(1);
  b.status = memory_.take<std::uint32_t>(1);
  b.heaviest = memory_.take<unsigned long long>(1);
  b.sphere_id = memory_.take<std::int32_t>(n);
  b.lenders = memory_.take<Lender>(n);
  for (float** channel :
       {&b.x, &b.y, &b.z, &b.nx, &b.ny, &b.nz, &b.offset, &b.weight, &b.presence}) {
    *channel = memory_.take<float>(n);
  }
  const std::size_t max_pieces = EdgeSums::kDirections * n;
  q.pieces = memory_.take<EdgePiece>(max_pieces);
  q.num_pieces = memory_.take<std::int32_t>(1);
  q.seen_pieces = {memory_.take<double>(max_pieces), memory_.take<double>(max_pieces),
                   memory_.take<std::int32_t>(max_pieces)};
  q.piece_of = memory_.take<std::int32_t>(n);
  q.edge_distance = memory_.take<double>(n);
  q.edge_side = memory_.take<EdgeSide>(n);
  q.search = graph_search_on_gpu(memory_, q.graph, num_places, tool_->graph().neighbours().size());
  q.lender = memory_.take<std::int32_t>(num_places);
  q.borrowed_volume = memory_.take<float>(num_places);
  barrier_ = memory_.take<unsigned long long>(1);
}

// Grows with the first cloud of its size that has edges.
void ContactQueryCuda::take_edge_candidates(std::size_t num_points) {
  if (num_points <= max_edge_candidates_) return;
  max_edge_candidates_ = 0;
  candidate_memory_.emplace(memory_.gpu());
  query_.edge_candidates = candidate_memory_->take<EdgeCandidate>(num_points);
  if (const Status& status = candidate_memory_->status(); !status) {
    return stream_.fail(status.error());
  }
  max_edge_candidates_ = num_points;
}

Penetration ContactQueryCuda::query(const Pose& X_WT, const ContactOptions& options) noexcept {
  options_ = options;
  is_measured_ = is_described_ = false;
  if (!is_finite(X_WT)) return not_finite();
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  if (options.method == InsideMethod::field) {
    return taken(field_.measure(X, options.counted()));
  }
  Penetration result;
  if (cloud_.size() == 0) {
    result.status = StepStatus::no_surface;
    return result;
  }
  ask(X);
  is_measured_ = answers_.await(stream_);
  if (!is_measured_) {
    result.status |= StepStatus::backend_failed;
    return result;
  }
  result = answers_.answer().penetration();
  result.measure_W = {rotate(X.rotation, result.measure_W.force),
                      rotate(X.rotation, result.measure_W.torque)};
  if (options.edges != query_.edges) result.status |= StepStatus::no_edge_vectors;
  query_.search.first_round += static_cast<int>(answers_.answer().num_rounds) + 1;
  return result;
}

std::optional<Penetration> ContactQueryCuda::query_between(const DepthFieldView& from,
                                                           const DepthFieldView& to, double t,
                                                           const Pose& X_WT,
                                                           SphereVolumes volumes) noexcept {
  options_ = {.method = InsideMethod::field, .volumes = volumes};
  is_measured_ = is_described_ = false;
  if (!is_finite(X_WT)) return not_finite();
  const Pose X{X_WT.translation, normalized(X_WT.rotation)};
  return taken(field_.measure(X, volumes, from, to, t));
}

// Launches the kernel for a pose and the options of this query.
void ContactQueryCuda::ask(const Pose& X_WT) {
  const PointCloudView cloud = clouds_.on_gpu(cloud_, stream_);
  const Continuity continuity = options_.continuity;
  const bool fades_in = continuity == Continuity::entry || continuity == Continuity::both;
  PointQuery& q = query_;
  q.method = options_.method;
  q.priority = options_.priority;
  q.inside = options_.inside;
  q.edges = cloud.edge_x != nullptr ? options_.edges : Edges::none;
  q.plane_rule = {continuity == Continuity::kernel || continuity == Continuity::both, fades_in,
                  q.edges != Edges::none};
  q.volume_scale = options_.counted() == SphereVolumes::own ? own_scales_ : represented_scales_;
  q.R_WT = rotation_matrix(X_WT.rotation);
  q.window = image_window(cloud_, box_T_, X_WT);
  q.scan.cloud = cloud;
  q.scan.sum_scale = finest_sum_scale(cloud.size(), reach_of_sums(box_T_));
  q.scan.grid = grid_;
  q.scan.R_TW = rotation_matrix(conjugate(X_WT.rotation));
  q.scan.translation_W = X_WT.translation;
  q.scan.weights = continuity == Continuity::none    ? PointWeights::none
                   : continuity == Continuity::entry ? PointWeights::beside
                                                     : PointWeights::in_sums;
  q.to_grid = grid_transform(q.scan);
  q.scan.edges = q.edges != Edges::none ? q.edge_sums : nullptr;
  if (q.edges != Edges::none) take_edge_candidates(cloud.size());
  if (q.search.first_round > (1 << 30)) {
    stream_.clear(q.search.places, clusters_.x.size() * sizeof *q.search.places);
    q.search.first_round = 1;
  }
  std::swap(q.touched, q.touched_before);
  gpu::launch(stream_,
              {.blocks = answers_.num_blocks(),
               .threads = kQueryThreads,
               .shared_bytes = kSharedBytes,
               .cooperative = true},
              kernel_for(q.method, q.edges != Edges::none), q, answers_.next(), barrier_);
}

template <class T>
std::vector<T> ContactQueryCuda::fetch(const T* from, std::size_t num) const {
  std::vector<T> values(num);
  stream_.copy(values.data(), from, num * sizeof(T));
  stream_.wait();
  return values;
}

// States and planes of the last query, as the CPU tells them; once for whoever asks for both.
void ContactQueryCuda::describe() const noexcept {
  if (std::exchange(is_described_, true)) return;
  std::fill(states_.begin(), states_.end(), SphereState::outside);
  std::fill(planes_.begin(), planes_.end(), Plane<float>{});
  if (!is_measured_) return;
  if (options_.method == InsideMethod::field) return field_.describe(states_, planes_);
  const std::size_t num_boundary =
      static_cast<std::size_t>(answers_.answer().penetration().num_boundary_spheres);
  const auto lenders = fetch(query_.boundary.lenders, num_boundary);
  const auto boundary_ids = fetch(query_.boundary.sphere_id, num_boundary);
  const auto lender_of_place = fetch(query_.lender, clusters_.x.size());
  const auto volumes = fetch(query_.borrowed_volume, clusters_.x.size());
  const bool tells_planes =
      options_.method == InsideMethod::graph ||
      (options_.method == InsideMethod::simplified && !query_.plane_rule.fades_in);
  const auto set_plane = [&](std::size_t id, const Lender& lender) {
    if (lender.sphere_id < 0) return;
    planes_[id] = {to_float(lender.plane_T.normal), static_cast<float>(lender.plane_T.offset)};
  };
  for (std::size_t place = 0; place < volumes.size(); ++place) {
    if (clusters_.sphere_id[place] < 0 || num_boundary == 0) continue;
    const auto id = static_cast<std::size_t>(clusters_.sphere_id[place]);
    if (!(volumes[place] > 0)) continue;
    states_[id] = SphereState::inside;
    const std::int32_t lender = lender_of_place[place];
    if (tells_planes && lender >= 0) set_plane(id, lenders[static_cast<std::size_t>(lender)]);
  }
  for (std::size_t b = 0; b < num_boundary; ++b) {
    const auto id = static_cast<std::size_t>(boundary_ids[b]);
    states_[id] = SphereState::boundary;
    planes_[id] = {};
    set_plane(id, lenders[b]);
  }
}

}  // namespace

Result<std::unique_ptr<ContactQuery>> make_contact_query_cuda(const Tool& tool,
                                                              const ContactCapacities& capacities) {
  if (const Status status = gpu::check_gpu(capacities.gpu); !status) return status.error();
  auto query = std::make_unique<ContactQueryCuda>(tool, capacities.gpu);
  if (const Status status = query->status(); !status) return status.error();
  return std::unique_ptr<ContactQuery>(std::move(query));
}

}  // namespace palpate
