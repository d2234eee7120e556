// The query on a GPU: one launch, whatever the method.
#include "src/contact/backends.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/cuda/gpu_cloud.h"
#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_contact_cuda.h"
#include "src/contact/index/tool_parts.h"
#include "src/contact/points/donors/assignment_stage.cuh"
#include "src/contact/points/edges/edge_stage.cuh"
#include "src/contact/points/graph/graph_memory.h"
#include "src/contact/points/graph/graph_stage.cuh"
#include "src/contact/points/point_contact_of.h"
#include "src/contact/points/point_query.h"
#include "src/contact/points/scan/boundary_stage.cuh"
#include "src/contact/points/scan/scan_stage.cuh"
#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace {

// Adds up the shares of all threads; one of them adds the numbers of the whole query.
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
  __syncthreads();  // shared memory is used anew from here
  finish_measure(out, mine, gpu::shared_memory<FinishScratch>());
}

// All stages of a query; see point_query.h.
template <MethodKind kMethod, bool kWithEdges>
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
  if (kMethod == MethodKind::graph) {
    num_rounds = search_graph(q, barrier, kWithEdges);
    sums = measure_reached(q, kWithEdges);
  } else {
    sums = assign_planes(q, kMethod, kWithEdges);
  }
  sums.add(measure_boundary_spheres(q, kMethod, kWithEdges));
  finish(q, out, sums, num_rounds);
}

using PointKernel = void (*)(PointQuery, MeasureOutput, unsigned long long*);

constexpr std::size_t kSharedBytes =
    std::max({sizeof(FinishScratch), kBoundarySharedBytes, kEdgeSharedBytes, kAssignmentSharedBytes,
              kGraphSharedBytes});

constexpr PointKernel kKernels[3][2] = {
    {point_query<MethodKind::weighted, false>, point_query<MethodKind::weighted, true>},
    {point_query<MethodKind::simplified, false>, point_query<MethodKind::simplified, true>},
    {point_query<MethodKind::graph, false>, point_query<MethodKind::graph, true>}};

PointKernel kernel_for(MethodKind method, bool with_edges) {
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

// Successive measurements by points, each with the memory of the one before.
class PointMeasurementCuda {
 public:
  PointMeasurementCuda(const ToolIndex& index, const ContactOptions& options, int gpu)
      : index_(index),
        options_(options),
        clusters_(parts_of(index).clusters()),
        box_T_(parts_of(index).box_T),
        memory_(gpu),
        stream_(gpu, gpu::Priority::high),
        clouds_(gpu),
        answers_(gpu, num_blocks(gpu)) {
    take_tool();
    take_scratch();
  }

  /// Returns the first failed allocation or stream.
  Status status() const {
    for (const Status* status : {&memory_.status(), &answers_.status()}) {
      if (!*status) return *status;
    }
    return stream_.status();
  }

  /// `X_WT` is finite, its quaternion unit.
  Penetration measure(const PointCloudView& cloud, const Pose& X_WT) noexcept;
  /// Describes the last measurement, like the CPU.
  void describe(const ContactWants& wants) noexcept;

 private:
  void take_tool();
  void take_scratch();
  void take_edge_candidates(std::size_t num_points);
  void launch(const PointCloudView& cloud, const Pose& X_WT);
  bool wants_edges() const { return options_.edges != Edges::none; }
  template <class T>
  std::vector<T> fetch(const T* from, std::size_t num);

  const ToolIndex& index_;
  const ContactOptions options_;
  const SphereClusters& clusters_;
  const Bounds& box_T_;
  gpu::Memory memory_;
  gpu::Stream stream_;
  GpuClouds clouds_;
  AnswerBox answers_;

  PointQuery query_;  // of the last query, or what all have in common
  SphereGridView grid_;
  unsigned long long* barrier_ = nullptr;
  std::optional<gpu::Memory> candidate_memory_;
  std::size_t max_edge_candidates_ = 0;
  bool is_measured_ = false;  // by the last query
};

// Copies the constant data of the tool.
void PointMeasurementCuda::take_tool() {
  const ToolParts& parts = parts_of(index_);
  const Tool& tool = index_.tool();
  const SphereGrid& grid = parts.grid();
  grid_ = grid.view();
  grid_.tags = memory_.copy_of(grid.tags());
  grid_.blocks = memory_.copy_of(grid.blocks());
  query_.scan.spheres = memory_.copy_of(tool.spheres());
  query_.num_spheres = static_cast<std::int32_t>(tool.spheres().size());
  query_.origin = tool.sphere_mass().center_of_mass;
  const SphereClusters& c = clusters_;
  query_.clusters = {memory_.copy_of(c.x),
                     memory_.copy_of(c.y),
                     memory_.copy_of(c.z),
                     memory_.copy_of(c.radius),
                     memory_.copy_of(c.volume),
                     memory_.copy_of(c.sphere_id),
                     memory_.copy_of(c.slot_of),
                     memory_.copy_of(c.clusters),
                     memory_.copy_of(c.groups),
                     c.num_clusters(),
                     c.num_groups()};
  query_.volume_scale = memory_.copy_of(parts.scales(options_.counted()).of_sphere);
  query_.method = options_.method;
  const float* paths = nullptr;
  if (options_.priority == Priority::path) paths = memory_.copy_of(parts.paths().lengths);
  query_.priority = parts.priority_rule(options_.priority, paths);
  query_.inside = options_.inside;
}

void PointMeasurementCuda::take_scratch() {
  const std::size_t n = index_.tool().spheres().size(), num_slots = clusters_.x.size();
  PointQuery& q = query_;
  q.sums = memory_.take<PointSums>(n);
  q.touched = memory_.take<std::uint32_t>((n + 31) / 32);
  q.touched_before = memory_.take<std::uint32_t>((n + 31) / 32);
  BoundaryList& b = q.boundary;
  b.num = memory_.take<std::int32_t>(1);
  b.num_donors = memory_.take<std::int32_t>(1);
  b.num_points = memory_.take<std::int32_t>(1);
  b.status = memory_.take<std::uint32_t>(1);
  b.heaviest = memory_.take<unsigned long long>(1);
  b.sphere_id = memory_.take<std::int32_t>(n);
  b.donors = memory_.take<Donor>(n);
  for (float** channel :
       {&b.x, &b.y, &b.z, &b.nx, &b.ny, &b.nz, &b.offset, &b.weight, &b.presence}) {
    *channel = memory_.take<float>(n);
  }
  if (wants_edges()) {
    const std::size_t max_pieces = EdgeSums::kDirections * n;
    q.edge_sums = memory_.take<EdgeSums>(n);
    q.pieces = memory_.take<EdgePiece>(max_pieces);
    q.seen_pieces = {memory_.take<double>(max_pieces), memory_.take<double>(max_pieces),
                     memory_.take<std::int32_t>(max_pieces)};
    q.piece_of = memory_.take<std::int32_t>(n);
    q.edge_distance = memory_.take<double>(n);
    q.edge_side = memory_.take<EdgeSide>(n);
  }
  q.num_pieces = memory_.take<std::int32_t>(1);
  q.num_edge_candidates = memory_.take<std::int32_t>(1);
  if (options_.method == MethodKind::graph) {
    const SortedGraph& graph = parts_of(index_).graph();
    q.graph = sorted_graph_on_gpu(memory_, graph, clusters_);
    q.search = graph_search_on_gpu(memory_, q.graph, num_slots, graph.neighbors.size());
  }
  q.donor = memory_.take<std::int32_t>(num_slots);
  q.assigned_volume = memory_.take<float>(num_slots);
  barrier_ = memory_.take<unsigned long long>(1);
}

// Allocates memory for candidates; grows with the first cloud of its size that has edges.
void PointMeasurementCuda::take_edge_candidates(std::size_t num_points) {
  if (num_points <= max_edge_candidates_) return;
  max_edge_candidates_ = 0;
  candidate_memory_.emplace(memory_.gpu());
  query_.edge_candidates = candidate_memory_->take<EdgeCandidate>(num_points);
  if (const Status& status = candidate_memory_->status(); !status) {
    return stream_.fail(status.error());
  }
  max_edge_candidates_ = num_points;
}

Penetration PointMeasurementCuda::measure(const PointCloudView& cloud, const Pose& X_WT) noexcept {
  is_measured_ = false;
  Penetration result;
  if (cloud.size() == 0) {
    result.status = StepStatus::no_surface;
    return result;
  }
  launch(cloud, X_WT);
  is_measured_ = answers_.await(stream_);
  if (!is_measured_) {
    result.status = StepStatus::backend_failed;
    return result;
  }
  result = answers_.answer().penetration();
  result.measure_W = {rotate(X_WT.rotation, result.measure_W.force),
                      rotate(X_WT.rotation, result.measure_W.torque)};
  if (options_.edges != query_.edges) result.status |= StepStatus::no_edge_vectors;
  query_.search.first_round += static_cast<int>(answers_.answer().num_rounds) + 1;
  return result;
}

void PointMeasurementCuda::launch(const PointCloudView& seen, const Pose& X_WT) {
  const PointCloudView cloud = clouds_.on_gpu(seen, stream_);
  const Continuity continuity = options_.continuity;
  const bool fades_in = continuity == Continuity::entry || continuity == Continuity::both;
  PointQuery& q = query_;
  q.edges = cloud.edge_x != nullptr ? options_.edges : Edges::none;
  q.plane_rule = {continuity == Continuity::kernel || continuity == Continuity::both, fades_in,
                  q.edges != Edges::none};
  q.R_WT = rotation_matrix(X_WT.rotation);
  q.window = image_window(seen, box_T_, X_WT);
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
  if (q.search.slots != nullptr && q.search.first_round > (1 << 30)) {
    stream_.clear(q.search.slots, clusters_.x.size() * sizeof *q.search.slots);
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
std::vector<T> PointMeasurementCuda::fetch(const T* from, std::size_t num) {
  std::vector<T> values(num);
  stream_.copy(values.data(), from, num * sizeof(T));
  stream_.wait();
  return values;
}

void PointMeasurementCuda::describe(const ContactWants& wants) noexcept {
  if (wants.states.empty() && wants.planes.empty()) return;
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  if (!is_measured_) return;
  const auto num_boundary =
      static_cast<std::size_t>(answers_.answer().penetration().num_boundary_spheres);
  const auto donors = fetch(query_.boundary.donors, num_boundary);
  const auto boundary_ids = fetch(query_.boundary.sphere_id, num_boundary);
  const auto donor_of_slot = fetch(query_.donor, clusters_.x.size());
  const auto volumes = fetch(query_.assigned_volume, clusters_.x.size());
  const bool has_references =
      options_.method == MethodKind::graph ||
      (options_.method == MethodKind::simplified && !query_.plane_rule.fades_in);
  const auto set_state = [&](std::int32_t id, SphereState state) {
    if (!wants.states.empty()) wants.states[static_cast<std::size_t>(id)] = state;
  };
  const auto set_plane = [&](std::int32_t id, const Donor& donor) {
    if (wants.planes.empty() || donor.sphere_id < 0) return;
    wants.planes[static_cast<std::size_t>(id)] = {to_float(donor.plane_T.normal),
                                                  static_cast<float>(donor.plane_T.offset)};
  };
  for (std::size_t slot = 0; slot < volumes.size(); ++slot) {
    const std::int32_t id = clusters_.sphere_id[slot], donor = donor_of_slot[slot];
    if (id < 0 || num_boundary == 0 || !(volumes[slot] > 0)) continue;
    set_state(id, SphereState::inside);
    if (has_references && donor >= 0) set_plane(id, donors[static_cast<std::size_t>(donor)]);
  }
  for (std::size_t b = 0; b < num_boundary; ++b) {
    set_state(boundary_ids[b], SphereState::boundary);
    if (!wants.planes.empty()) wants.planes[static_cast<std::size_t>(boundary_ids[b])] = {};
    set_plane(boundary_ids[b], donors[b]);
  }
}

}  // namespace

Result<std::unique_ptr<ContactQuery>> make_contact_query_cuda(
    std::shared_ptr<const ToolIndex> index, const ContactMethod& method, int gpu,
    bool reserves_noise) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  if (const auto* field = std::get_if<FieldMethod>(&method)) {
    auto query =
        std::make_unique<FieldContactCuda>(std::move(index), *field, gpu, 0, reserves_noise);
    if (const Status status = query->status(); !status) return status.error();
    return std::unique_ptr<ContactQuery>(std::move(query));
  }
  auto measurement = std::make_unique<PointMeasurementCuda>(*index, contact_options(method), gpu);
  if (const Status status = measurement->status(); !status) return status.error();
  return std::unique_ptr<ContactQuery>(std::make_unique<PointContactOf<PointMeasurementCuda>>(
      std::move(index), method, std::move(measurement)));
}

}}  // namespace palpate::v0
