#include "src/contact/batch/field_batch_cuda.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "src/contact/batch/batch_noise.cuh"
#include "src/contact/batch/field_batch.h"
#include "src/contact/batch/staged_answers.h"

namespace palpate { inline namespace v0 {
namespace {

static_assert(sizeof(FieldLook) == 21 * sizeof(std::uint64_t), "no padding: looks are compared");

Error refuse(std::string message) { return {Errc::invalid_argument, std::move(message)}; }

}  // namespace

struct FieldBatchCuda::Table {
  std::optional<gpu::Memory> memory;
  int num = 0;  // there is room for
  FieldLook* on_gpu = nullptr;
  SurfaceNoise* noise = nullptr;
  Pose* X_WC = nullptr;          // of cameras
  std::vector<Pose> known_X_WC;  // that lie there
  std::vector<FieldLook> known;  // in the table
  std::vector<FieldLook> desired;
  std::vector<SurfaceNoise> known_noise, desired_noise;
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
  const int fitting = num_clusters <= 8 ? 1 : (num_clusters <= 256 ? 2 : 4);
  num_warps_ = std::min(num_warps > 0 ? num_warps : fitting, kBatchThreads / gpu::kWarpSize);
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
  table.noise = memory.take<SurfaceNoise>(static_cast<std::size_t>(num_surfaces));
  table.X_WC = memory.take<Pose>(static_cast<std::size_t>(num_surfaces));
  table.known.clear();
  table.known_noise.clear();
  table.known_X_WC.clear();
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
    made.answers = take_answers(memory, size);
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

/// Takes the noise of all surfaces; the table has room for them.
Status FieldBatchCuda::look_at_noise(const SurfaceBatch& surfaces, gpu::Stream& stream,
                                     BatchNoiseJob& job) const {
  const bool is_recording = stream.is_recording();
  if (!noise_rows_.is_taken()) {
    if (is_recording) {
      return refuse(
          "standard deviations were captured in a graph before their memory was there; measure "
          "them once before");
    }
    const int num_clusters = field_tool_.elements.num_clusters;
    int resident = 1 << 20;
    for (const auto kernel : {measure_deviations<true>, measure_deviations<false>}) {
      resident =
          std::min(resident, gpu::resident_blocks(gpu_, reinterpret_cast<const void*>(kernel),
                                                  kNoiseThreads, sizeof(BatchNoiseScratch)));
    }
    const Status status = noise_rows_.take(gpu_, num_clusters, kNoiseWarps, resident);
    if (!status) return status;
  }
  job.kept = noise_rows_.rows();
  job.learned = surfaces.noises();
  if (surfaces.size() > 0) job.first = surface_noise(surfaces[0].field.noise);
  if (surfaces.is_even() || surfaces.size() <= 1) return Done{};
  Table& table = *table_;
  table.desired_noise.clear();
  for (int i = 0; i < surfaces.size(); ++i) {
    table.desired_noise.push_back(surface_noise(surfaces[i].field.noise));
  }
  if (table.known_noise != table.desired_noise) {
    if (is_recording) {
      return refuse(
          "standard deviations were captured in a graph with surfaces of another noise than "
          "before; measure them once before");
    }
    stream.copy(table.noise, table.desired_noise.data(),
                table.desired_noise.size() * sizeof(SurfaceNoise));
    if (!stream.wait()) return stream.status();
    table.known_noise = table.desired_noise;
  }
  job.table = table.noise;
  return Done{};
}

/// Copies the poses of several cameras, if they are not those of the last batch.
Status FieldBatchCuda::place_cameras(std::span<const Pose> X_WC, gpu::Stream& stream,
                                     BatchJob& job) const {
  if (X_WC.empty()) return Done{};
  job.is_placed = true;
  job.first_X_WC = X_WC[0];
  if (X_WC.size() == 1) return Done{};
  Table& table = *table_;
  if (!std::ranges::equal(table.known_X_WC, X_WC)) {
    if (stream.is_recording()) {
      return refuse(
          "a batch was captured in a graph with cameras at other poses than before; measure it "
          "once before");
    }
    if (const Status status = grow_table(static_cast<int>(X_WC.size())); !status) return status;
    stream.copy(table.X_WC, X_WC.data(), X_WC.size_bytes());
    if (!stream.wait()) return stream.status();
    table.known_X_WC.assign(X_WC.begin(), X_WC.end());
  }
  job.X_WC = table.X_WC;
  return Done{};
}

void FieldBatchCuda::launch(const BatchJob& job, int num_poses, gpu::Stream& stream) const {
  const auto kernel = [&](auto has_wholes) {
    return job.out.stiffness != nullptr ? measure_poses<Curvature, has_wholes>
                                        : measure_poses<Gradient, has_wholes>;
  };
  const bool has_wholes = field_tool_.elements.first_ball >= kMinWholes;
  const gpu::LaunchShape shape{.blocks = num_poses,
                               .threads = num_warps_ * gpu::kWarpSize,
                               .shared_bytes = job.out.stiffness != nullptr
                                                   ? sizeof(BatchScratch<Curvature>)
                                                   : sizeof(BatchScratch<Gradient>)};
  gpu::launch(stream, shape, has_wholes ? kernel(std::true_type{}) : kernel(std::false_type{}),
              job);
}

void FieldBatchCuda::launch_noise(BatchNoiseJob& job, int num_poses, gpu::Stream& stream) const {
  job.num_poses = num_poses;
  const bool has_wholes = field_tool_.elements.first_ball >= kMinWholes;
  gpu::launch(stream,
              {.blocks = std::min(num_poses, noise_rows_.num_blocks()),
               .threads = kNoiseThreads,
               .shared_bytes = sizeof(BatchNoiseScratch)},
              has_wholes ? measure_deviations<true> : measure_deviations<false>, job);
}

void FieldBatchCuda::measure_part(const PoseBatch& poses, const BatchAnswers& answers, int first,
                                  int num, BatchNoiseJob& with_noise, gpu::Stream& stream) const {
  BatchJob& job = with_noise.batch;
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
  const bool is_staged = answers.gpu != gpu_;
  for_answers(answers, staged_.answers, job.out,
              [&](auto* requested, auto* staged, std::size_t each, auto*& to) {
                to = requested == nullptr ? nullptr
                                          : (is_staged ? staged : requested + each * begin);
              });
  launch(job, num, stream);
  if (answers.want_noise()) launch_noise(with_noise, num, stream);
  if (is_staged) copy_answers(answers, staged_.answers, begin, size, stream);
}

Status FieldBatchCuda::measure(const SurfaceBatch& surfaces, const PoseBatch& poses,
                               const BatchAnswers& answers,
                               std::optional<CallerStream> requested_stream) const {
  if (!status()) return status();
  if (const Status status = check(surfaces, poses, answers); !status) return status;
  if (poses.X_WT.empty()) return Done{};
  const int num = static_cast<int>(poses.X_WT.size());
  caller_stream_.continue_in(requested_stream ? requested_stream->handle : own_stream_.handle());
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
  }
  BatchNoiseJob with_noise;
  BatchJob& job = with_noise.batch;
  job.tool = field_tool_;
  job.p_TC = p_TC_;
  if (const Status status = place_cameras(poses.X_WC, stream, job); !status) return status;
  if (const Status status = look_at(surfaces, stream, job); !status) return status;
  if (answers.want_noise()) {
    const Status status = look_at_noise(surfaces, stream, with_noise);
    if (!status) return status;
  }
  const int at_once = is_staged ? staged_.num_poses : num;
  for (int first = 0; first < num; first += at_once) {
    measure_part(poses, answers, first, std::min(at_once, num - first), with_noise, stream);
  }
  if (requested_stream && !is_staged) {
    stream.mark();
    return stream.status();
  }
  // Far more time than it takes.
  constexpr double kSlowest = 1e8;  // elements/s
  const double elements = 32.0 * field_tool_.elements.num_clusters;
  const double slowdown = answers.want_noise() ? noise_rows_.slowdown() : 1;
  return stream.wait(2 + slowdown * elements * num / kSlowest);
}

Result<std::unique_ptr<BatchQuery>> make_batch_query_cuda(std::shared_ptr<const ToolIndex> index,
                                                          const FieldMethod& method, int gpu) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto query = std::make_unique<FieldBatchCuda>(std::move(index), method, gpu);
  if (const Status status = query->status(); !status) return status.error();
  return std::unique_ptr<BatchQuery>(std::move(query));
}

}}  // namespace palpate::v0
