#include "src/contact/batch/field_batch_cuda.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "src/contact/batch/batch_pose.h"
#include "src/contact/batch/field_batch.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_elements_cuda.cuh"

namespace palpate { inline namespace v0 {

// The argument of the kernel.
struct BatchJob {
  FieldTool tool;
  Vec3d p_TC;
  const Pose* X_WT = nullptr;
  const std::int32_t* surface_of_pose = nullptr;
  const Pose* X_WC = nullptr;  // null: W is C
  int num_surfaces = 0;
  int first_pose = 0;  // of the batch, where the surfaces' numbers are those of the poses
  const FieldLook* table = nullptr;  // of each surface; null: the first, and others like it
  FieldLook first;
  std::ptrdiff_t pixels_apart = 0, tiles_apart = 0;
  BatchAnswers out;
};

namespace {

static_assert(sizeof(FieldLook) == 19 * sizeof(std::uint64_t), "no padding: looks are compared");

constexpr int kMaxWarps = 8;
// Clusters that a warp adds up in single precision.
constexpr int kClustersAtOnce = gpu::kWarpSize;
// Largest number of tiles from which a tool is found to be wholly in front.
constexpr int kMaxTiles = 2 * gpu::kWarpSize;
constexpr int kMaxTilesPerLane = 24;  // balls that cover more count as near

// Sums of a pose: volume, potential, force, torque, then StiffnessSums and zeros.
constexpr int kNumTerms = 8, kNumStiffness = 32;
template <class Sample>
constexpr int kNumSums = std::is_same_v<Sample, Curvature> ? kNumTerms + kNumStiffness : kNumTerms;

template <class Sample>
struct BatchScratch {
  static constexpr int kNum = kNumSums<Sample>;

  FieldLook field;
  BatchPose at;
  Stiffness stiffness;
  double of_warps[kMaxWarps][kNum];
  double sums[kNum];
  std::uint32_t status;
};

// Loads the field and places the tool. All threads of the block call.
template <class Scratch>
__device__ void prepare(const BatchJob& job, int pose, Scratch& shared) {
  const int surface = surface_of(job.surface_of_pose, job.num_surfaces, job.first_pose + pose);
  const int thread = static_cast<int>(threadIdx.x);
  if (surface >= 0 && job.table != nullptr) {
    constexpr int kNumWords = sizeof(FieldLook) / sizeof(std::uint64_t);
    const auto* const from = reinterpret_cast<const std::uint64_t*>(job.table + surface);
    auto* const to = reinterpret_cast<std::uint64_t*>(&shared.field);
    for (int i = thread; i < kNumWords; i += static_cast<int>(blockDim.x)) to[i] = from[i];
  } else if (thread == 0 && surface >= 0) {
    FieldLook& field = shared.field = job.first;
    const std::ptrdiff_t pixels = surface * job.pixels_apart;
    field.planes += 2 * pixels;
    field.silhouettes += 2 * pixels;
    field.near_silhouette += pixels;
    field.tiles += surface * job.tiles_apart;
  }
  if (thread == 0 && surface >= 0) {
    shared.at = pose_in_camera(job.X_WT[pose], job.X_WC != nullptr ? job.X_WC + surface : nullptr);
  }
  __syncthreads();
  if (thread == 0) {
    StepStatus status = StepStatus::ok;
    if (surface < 0 || shared.field.last_level < 0) {
      status = StepStatus::no_surface;
    } else if (!shared.at.is_finite) {
      status = StepStatus::non_finite_pose;
    } else {
      place_tool(shared.at.X_CT, job.p_TC, shared.field.frame);
    }
    shared.status = static_cast<std::uint32_t>(status);
  }
  __syncthreads();
}

// Adds the elements of this lane, each sum folded over the warp: of_warp is sum lane / 4, and
// of_stiffness number `lane`.
template <class Sample>
__device__ void add_clusters(const BatchJob& job, const FieldLook& field, double& of_warp,
                             double& of_stiffness) {
  const ElementsView& elements = job.tool.elements;
  const int num_warps = gpu::warps_per_block();
  for (int begin = gpu::warp_id(); begin < elements.num_clusters;
       begin += kClustersAtOnce * num_warps) {
    FieldShare share;
    StiffnessShare stiffness;
    const int mine = begin + gpu::lane_id() * num_warps;
    unsigned touching =
        __ballot_sync(gpu::kWholeWarp,
                      mine < elements.num_clusters &&
                          !is_before_tiles(field, elements.clusters[mine],
                                           elements.largest_radius[mine], kMaxTilesPerLane, 0, 1));
    for (; touching != 0; touching &= touching - 1) {
      const int cluster = begin + (__ffs(static_cast<int>(touching)) - 1) * num_warps;
      const Element element = element_of(elements, cluster, field.frame);
      if (cluster < elements.first_ball) {
        add_element<Sample>(field, element, share, &stiffness);
      } else {
        add_ball<Sample>(field, elements.places, elements.ball_factor[cluster], element, share,
                         &stiffness);
      }
    }
    double values[kNumTerms] = {share.volume,   share.potential, share.force[0],  share.force[1],
                                share.force[2], share.torque[0], share.torque[1], share.torque[2]};
    fold_over_warp<kNumTerms / 2, 4>(values);
    values[0] += __shfl_xor_sync(gpu::kWholeWarp, values[0], 2);
    of_warp += values[0] + __shfl_xor_sync(gpu::kWholeWarp, values[0], 1);
    if constexpr (std::is_same_v<Sample, Curvature>) {
      double numbers[kNumStiffness] = {};
#pragma unroll
      for (int k = 0; k < StiffnessSums::kNum; ++k) numbers[k] = stiffness.numbers[k];
      fold_over_warp<kNumStiffness / 2, 1>(numbers);
      of_stiffness += numbers[0];
    }
  }
}

// Adds the sums of each warp up to those of the block.
template <class Scratch>
__device__ void add_warps(double of_warp, double of_stiffness, Scratch& shared) {
  const int lane = gpu::lane_id(), thread = static_cast<int>(threadIdx.x);
  double(&mine)[Scratch::kNum] = shared.of_warps[gpu::warp_id()];
  if (lane % 4 == 0) mine[lane / 4] = of_warp;
  if constexpr (Scratch::kNum > kNumTerms) mine[kNumTerms + lane] = of_stiffness;
  __syncthreads();
  for (int k = thread; k < Scratch::kNum; k += static_cast<int>(blockDim.x)) {
    double sum = 0;
    for (int warp = 0; warp < gpu::warps_per_block(); ++warp) sum += shared.of_warps[warp][k];
    shared.sums[k] = sum;
  }
  __syncthreads();
}

__device__ inline double turned(const BatchPose& at, bool is_turned, const double* v, int axis) {
  if (!is_turned) return v[axis];
  const double(&row)[3] = at.R_WC.m[axis];
  return row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
}

template <class Scratch>
__device__ void put_stiffness(const BatchJob& job, int pose, Scratch& shared) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) {
    StiffnessSums sums;
    for (int k = 0; k < StiffnessSums::kNum; ++k) sums.numbers[k] = shared.sums[kNumTerms + k];
    shared.stiffness = sums.stiffness();
    if (job.X_WC != nullptr) rotate_stiffness(shared.at.R_WC, shared.stiffness);
  }
  __syncthreads();
  double* const to = job.out.stiffness + 36 * static_cast<std::ptrdiff_t>(pose);
  for (int i = thread; i < 36; i += static_cast<int>(blockDim.x)) {
    to[i] = shared.status == 0 ? shared.stiffness.m[i / 6][i % 6] : 0.0;
  }
}

// Smallest number of blocks of a multiprocessor: gradients have so few that no register spills.
template <class Sample>
constexpr int kBlocksOf = std::is_same_v<Sample, Curvature> ? 3 : 2;

template <class Sample>
__global__ void __launch_bounds__(kThreadsOf<Sample>, kBlocksOf<Sample>)
    measure_poses(const __grid_constant__ BatchJob job) {
  using Scratch = BatchScratch<Sample>;
  auto& shared = gpu::shared_memory<Scratch>();
  const int pose = static_cast<int>(blockIdx.x), thread = static_cast<int>(threadIdx.x);
  prepare(job, pose, shared);
  double of_warp = 0, of_stiffness = 0;
  if (shared.status == 0 &&
      !is_in_front(shared.field, job.tool.whole, job.tool.largest_radius, kMaxTiles)) {
    add_clusters<Sample>(job, shared.field, of_warp, of_stiffness);
  }
  add_warps(of_warp, of_stiffness, shared);
  const BatchAnswers& out = job.out;
  double* const sums = shared.sums;
  // As keep_bounds.
  const double scale =
      force_scale(sums[0], sqrt(sums[2] * sums[2] + sums[3] * sums[3] + sums[4] * sums[4]));
  __syncthreads();
  for (int k = thread; k < Scratch::kNum; k += static_cast<int>(blockDim.x)) {
    sums[k] = k < 2 ? (sums[k] > 0 ? sums[k] : 0.0) : scale * sums[k];
  }
  __syncthreads();
  const std::ptrdiff_t row = 3 * static_cast<std::ptrdiff_t>(pose);
  const bool is_turned = job.X_WC != nullptr && shared.status == 0;
  if (thread == 0 && out.volume != nullptr) out.volume[pose] = sums[0];
  if (thread == 1 && out.potential != nullptr) out.potential[pose] = sums[1];
  if (thread >= 2 && thread < 5 && out.force != nullptr) {
    out.force[row + thread - 2] = turned(shared.at, is_turned, sums + 2, thread - 2);
  }
  if (thread >= 5 && thread < 8 && out.torque != nullptr) {
    out.torque[row + thread - 5] = turned(shared.at, is_turned, sums + 5, thread - 5);
  }
  if (thread == 8 && out.status != nullptr) out.status[pose] = shared.status;
  if constexpr (std::is_same_v<Sample, Curvature>) put_stiffness(job, pose, shared);
}

Error refuse(std::string message) { return {Errc::invalid_argument, std::move(message)}; }

}  // namespace

struct FieldBatchCuda::Table {
  std::optional<gpu::Memory> memory;
  int num = 0;  // there is room for
  FieldLook* on_gpu = nullptr;
  Pose* X_WC = nullptr;          // copied from host memory
  std::vector<FieldLook> known;  // in the table
  std::vector<FieldLook> desired;
  std::vector<GpuFields> copies;  // of surfaces in host memory, by their numbers
};

FieldBatchCuda::FieldBatchCuda(std::shared_ptr<const ToolIndex> index, const FieldMethod& method,
                               int gpu, int num_warps, int max_staged)
    : index_(std::move(index)),
      gpu_(gpu),
      max_staged_(max_staged),
      memory_(gpu),
      field_tool_(make_field_tool(*index_, method.volumes, memory_)),
      p_TC_(index_->tool().sphere_mass().center_of_mass),
      own_stream_(gpu, gpu::Priority::low),
      caller_stream_(gpu),
      table_(std::make_unique<Table>()) {
  // Fewer warps share less work, more of them finish sooner.
  const int num_clusters = field_tool_.elements.num_clusters;
  const int fitting = num_clusters <= 8 ? 1 : (num_clusters <= 96 ? 4 : 8);
  for (int& warps : num_warps_) warps = num_warps > 0 ? num_warps : fitting;
  num_warps_[1] = std::min(num_warps_[1], kThreadsOf<Curvature> / gpu::kWarpSize);
  num_warps_[0] = std::min(num_warps_[0], kThreadsOf<Gradient> / gpu::kWarpSize);
}

FieldBatchCuda::~FieldBatchCuda() = default;

const Status& FieldBatchCuda::status() const {
  return memory_.status() ? own_stream_.status() : memory_.status();
}

Status FieldBatchCuda::check(const SurfaceBatch& surfaces, const PoseBatch& poses,
                             const BatchAnswers& answers) const {
  if (const Status status = check_batch(surfaces, poses); !status) return status;
  const auto is_readable = [&](int gpu) { return gpu == kHostMemory || gpu == gpu_; };
  for (const int gpu : {poses.gpu, answers.gpu}) {
    if (!is_readable(gpu)) {
      return refuse("poses or answers in the memory of GPU " + std::to_string(gpu) +
                    " were given to a batch on GPU " + std::to_string(gpu_) +
                    "; create the contact with Place::cuda(" + std::to_string(gpu) + ")");
    }
  }
  for (int i = 0; i < surfaces.size(); ++i) {
    const DepthFieldView field = surfaces[i].field;
    if (field.num_levels > 0 &&
        !field.requested.has_all(field.levels[0].width, field.levels[0].height)) {
      return refuse("surface " + std::to_string(i) +
                    " of a batch on a GPU was made for a window of its image only; make it of the "
                    "whole image");
    }
    if (surfaces.is_even()) break;
  }
  return Done{};
}

Status FieldBatchCuda::grow_table(int num_surfaces) const {
  Table& table = *table_;
  if (num_surfaces <= table.num) return Done{};
  own_stream_.wait();
  gpu::Memory memory(gpu_);
  table.on_gpu = memory.take<FieldLook>(static_cast<std::size_t>(num_surfaces));
  table.X_WC = memory.take<Pose>(static_cast<std::size_t>(num_surfaces));
  table.known.clear();
  table.num = 0;
  table.memory.reset();
  if (!memory.status()) return memory.status();
  table.memory = std::move(memory);
  table.num = num_surfaces;
  table.known.reserve(static_cast<std::size_t>(num_surfaces));
  table.desired.reserve(static_cast<std::size_t>(num_surfaces));
  return Done{};
}

Status FieldBatchCuda::grow_staged(int num_poses) const {
  num_poses = std::min(num_poses, max_staged_);
  if (num_poses <= staged_.num_poses) return Done{};
  staged_ = {};
  // Halves the number at a time where memory is short.
  constexpr int kMinPoses = 1024;
  for (int num = num_poses;; num /= 2) {
    const auto size = static_cast<std::size_t>(num);
    Staged made;
    made.num_poses = num;
    gpu::Memory& memory = made.memory.emplace(gpu_);
    made.X_WT = memory.take<Pose>(size);
    made.surface = memory.take<std::int32_t>(size);
    made.answers = {memory.take<double>(size),
                    memory.take<double>(size),
                    memory.take<double>(3 * size),
                    memory.take<double>(3 * size),
                    memory.take<double>(36 * size),
                    memory.take<std::uint32_t>(size),
                    gpu_};
    if (memory.status()) {
      staged_ = std::move(made);
      return Done{};
    }
    if (num <= kMinPoses) return memory.status();
  }
}

Status FieldBatchCuda::reserve(int num_surfaces, int num_poses) const {
  if (const Status status = grow_table(num_surfaces); !status) return status;
  return grow_staged(num_poses);
}

Status FieldBatchCuda::look_at(const SurfaceBatch& surfaces, gpu::Stream& stream,
                               BatchJob& job) const {
  job.num_surfaces = surfaces.size();
  Table& table = *table_;
  const bool is_recording = stream.is_recording();
  const auto look = [&](int i) {
    DepthFieldView field = surfaces[i].field;
    if (field.num_levels > 0 && field.gpu != gpu_) {
      const auto place = static_cast<std::size_t>(i);
      while (table.copies.size() <= place) table.copies.emplace_back(gpu_);
      field = table.copies[place].on_gpu(field, stream);
    }
    return look_of(field, frame_of(field.intrinsics, {}, {}), 1);
  };
  if (is_recording) {
    for (int i = 0; i < surfaces.size(); ++i) {
      if (const int gpu = surfaces[i].field.gpu; surfaces[i].field.num_levels > 0 && gpu != gpu_) {
        return refuse("surface " + std::to_string(i) +
                      " of a batch that is captured in a graph is not in the memory of GPU " +
                      std::to_string(gpu_) + "; make it there");
      }
      if (surfaces.is_even()) break;
    }
  }
  if (surfaces.is_even() || surfaces.size() <= 1) {
    if (surfaces.size() > 0) job.first = look(0);
    job.pixels_apart = surfaces.pixels_apart();
    job.tiles_apart = surfaces.tiles_apart();
    return stream.status();
  }
  if (surfaces.size() > table.num) {
    if (is_recording) {
      return refuse(
          "a batch was captured in a graph before its memory was there; call "
          "reserve_batch, or measure it once before");
    }
    if (const Status status = grow_table(surfaces.size()); !status) return status;
  }
  table.desired.clear();
  for (int i = 0; i < surfaces.size(); ++i) table.desired.push_back(look(i));
  const std::size_t num_bytes = table.desired.size() * sizeof(FieldLook);
  const bool is_known = table.known.size() >= table.desired.size() &&
                        std::memcmp(table.known.data(), table.desired.data(), num_bytes) == 0;
  if (!is_known) {
    if (is_recording) {
      return refuse(
          "a batch was captured in a graph with surfaces that it has not seen; measure "
          "it once before");
    }
    stream.copy(table.on_gpu, table.desired.data(), num_bytes);
    if (!stream.wait()) return stream.status();
    table.known = table.desired;
  }
  job.table = table.on_gpu;
  return stream.status();
}

void FieldBatchCuda::launch(const BatchJob& job, int num_poses, gpu::Stream& stream) const {
  const bool with_stiffness = job.out.stiffness != nullptr;
  const gpu::LaunchShape shape{.blocks = num_poses,
                               .threads = num_warps_[with_stiffness] * gpu::kWarpSize,
                               .shared_bytes = with_stiffness ? sizeof(BatchScratch<Curvature>)
                                                              : sizeof(BatchScratch<Gradient>)};
  gpu::launch(stream, shape, with_stiffness ? measure_poses<Curvature> : measure_poses<Gradient>,
              job);
}

void FieldBatchCuda::measure_part(const PoseBatch& poses, const BatchAnswers& answers, int first,
                                  int num, BatchJob& job, gpu::Stream& stream) const {
  const auto begin = static_cast<std::size_t>(first), size = static_cast<std::size_t>(num);
  job.first_pose = 0;
  job.X_WT = poses.X_WT.data() + begin;
  job.surface_of_pose =
      poses.surface_of_pose.empty() ? nullptr : poses.surface_of_pose.data() + begin;
  if (job.surface_of_pose == nullptr) job.first_pose = first;
  if (poses.gpu != gpu_) {
    stream.copy(staged_.X_WT, job.X_WT, size * sizeof(Pose));
    job.X_WT = staged_.X_WT;
    if (job.surface_of_pose != nullptr) {
      stream.copy(staged_.surface, job.surface_of_pose, size * sizeof(std::int32_t));
      job.surface_of_pose = staged_.surface;
    }
  }
  // Calls f(array of the caller, staged array, values a pose, array of the job).
  BatchAnswers& out = job.out;
  const auto for_answers = [&](const auto& f) {
    f(answers.volume, staged_.answers.volume, 1u, out.volume);
    f(answers.potential, staged_.answers.potential, 1u, out.potential);
    f(answers.force, staged_.answers.force, 3u, out.force);
    f(answers.torque, staged_.answers.torque, 3u, out.torque);
    f(answers.stiffness, staged_.answers.stiffness, 36u, out.stiffness);
    f(answers.status, staged_.answers.status, 1u, out.status);
  };
  const bool is_staged = answers.gpu != gpu_;
  for_answers([&](auto* requested, auto* staged, std::size_t each, auto*& to) {
    to = requested == nullptr ? nullptr : (is_staged ? staged : requested + each * begin);
  });
  launch(job, num, stream);
  if (!is_staged) return;
  for_answers([&](auto* requested, auto* staged, std::size_t each, auto*&) {
    if (requested != nullptr)
      stream.copy(requested + each * begin, staged, each * size * sizeof *requested);
  });
}

Status FieldBatchCuda::measure(const SurfaceBatch& surfaces, const PoseBatch& poses,
                               const BatchAnswers& answers,
                               std::optional<CallerStream> requested_stream) const {
  if (!status()) return status();
  if (const Status status = check(surfaces, poses, answers); !status) return status;
  if (poses.X_WT.empty()) return Done{};
  const int num = static_cast<int>(poses.X_WT.size());
  if (requested_stream) caller_stream_.continue_in(requested_stream->handle);
  gpu::Stream& stream = requested_stream ? caller_stream_ : own_stream_;
  const bool is_staged = poses.gpu != gpu_ || answers.gpu != gpu_;
  if (is_staged) {
    if (stream.is_recording()) {
      return refuse(
          "a batch with poses or answers in host memory cannot be captured in a graph; "
          "give arrays on GPU " +
          std::to_string(gpu_));
    }
    if (const Status status = grow_staged(num); !status) return status;
    const int num_cameras = static_cast<int>(poses.X_WC.size());
    if (const Status status = grow_table(num_cameras); !status) return status;
  }
  BatchJob job;
  job.tool = field_tool_;
  job.p_TC = p_TC_;
  if (const Status status = look_at(surfaces, stream, job); !status) return status;
  if (!poses.X_WC.empty()) {
    job.X_WC = poses.X_WC.data();
    if (poses.gpu != gpu_) {
      stream.copy(table_->X_WC, job.X_WC, poses.X_WC.size_bytes());
      job.X_WC = table_->X_WC;
    }
  }
  const int at_once = is_staged ? staged_.num_poses : num;
  for (int first = 0; first < num; first += at_once) {
    measure_part(poses, answers, first, std::min(at_once, num - first), job, stream);
  }
  if (requested_stream && !is_staged) return stream.status();
  // Far more time than it takes.
  constexpr double kSlowest = 1e8;  // elements/s
  const double elements = 32.0 * field_tool_.elements.num_clusters;
  return stream.wait(2 + elements * num / kSlowest);
}

Result<std::unique_ptr<BatchQuery>> make_batch_query_cuda(std::shared_ptr<const ToolIndex> index,
                                                          const FieldMethod& method, int gpu) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto query = std::make_unique<FieldBatchCuda>(std::move(index), method, gpu);
  if (const Status status = query->status(); !status) return status.error();
  return std::unique_ptr<BatchQuery>(std::move(query));
}

}}  // namespace palpate::v0
