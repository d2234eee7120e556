#include "src/contact/field/field_contact_cuda.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

#include "src/contact/blend.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_contact.h"
#include "src/contact/field/unseen_by_one.cuh"
#include "src/contact/field/whole_clusters_cuda.cuh"
#include "src/field/internal/field_point.h"

namespace palpate { inline namespace v0 {
namespace {

// The argument of the kernel.
template <int kNumFields>
struct FieldQuery {
  ElementsView elements;
  int max_tiles;  // of a cluster that is left out if they are in front: pays if warps have several
  bool looks_together;  // all lanes at the tiles of a cluster: pays if many warps have one each
  FieldLook fields[kNumFields];
};

// Number of clusters that keep multiprocessors busy.
constexpr int kManyClusters = 1024;

// Shared memory of a block.
template <class Sample>
constexpr std::size_t kSharedBytes = std::is_same_v<Sample, Curvature>
                                         ? sizeof(FinishStiffnessScratch)
                                         : sizeof(FinishScratch);

// Every thread calls this last.
template <class Sample>
__device__ void finish(const MeasureOutput& out, const FieldShare& share,
                       const StiffnessShare& stiffness) {
  MeasureTerms mine;
  add_share(share, mine);
  if constexpr (std::is_same_v<Sample, Curvature>) {
    finish_measure(out, mine, stiffness.numbers, gpu::shared_memory<FinishStiffnessScratch>());
  } else {
    finish_measure(out, mine, gpu::shared_memory<FinishScratch>());
  }
}

// Three blocks of 256 threads on a multiprocessor leave each thread the registers that it needs.
template <int kNumFields, class Sample>
__global__ void __launch_bounds__(kThreadsOf<Sample>, 3)
    measure_elements(const __grid_constant__ FieldQuery<kNumFields> query,
                     const __grid_constant__ MeasureOutput out) {
  const ElementsView& elements = query.elements;
  FieldShare share;
  StiffnessShare stiffness;
  NoNoise noise;
  const int num_warps = gpu::grid_threads() / gpu::kWarpSize;
  for (int begin = gpu::grid_thread() / gpu::kWarpSize; begin < elements.num_clusters;
       begin += gpu::kWarpSize * num_warps) {
#pragma unroll
    for (int k = 0; k < kNumFields; ++k) {
      const FieldLook& field = query.fields[k];
      if (kNumFields > 1 && field.grid.last_level < 0) continue;
      if (query.looks_together &&
          is_in_front(field, elements.clusters[begin], elements.largest_radius[begin])) {
        continue;
      }
      add_clusters<Sample, true, true>(elements, field, kNumFields > 1 ? field.weight : 1.0f,
                                       k == kNumFields - 1, begin, num_warps, query.max_tiles,
                                       share, &stiffness, noise);
    }
  }
  finish<Sample>(out, share, stiffness);
}

// A tool of few clusters leaves most of a GPU idle, and what takes time is one sample after another
// of what lies deep. So a block takes one cluster, and each of its warps one of the spheres that
// its elements may need.
constexpr int kFewThreads = (kMaxDeepSteps + 1) * gpu::kWarpSize;

template <class Sample>
struct FewScratch {
  static constexpr int kNum = sizeof(Sample) / sizeof(float);

  float samples[kMaxDeepSteps + 1][kNum][gpu::kWarpSize];

  __device__ void store(int step, const Sample& sample) {
    float numbers[kNum];
    memcpy(numbers, &sample, sizeof sample);
    for (int i = 0; i < kNum; ++i) samples[step][i][gpu::lane_id()] = numbers[i];
  }
  __device__ Sample load(int step) const {
    float numbers[kNum];
    for (int i = 0; i < kNum; ++i) numbers[i] = samples[step][i][gpu::lane_id()];
    Sample sample;
    memcpy(&sample, numbers, sizeof sample);
    return sample;
  }
};

template <class Sample>
constexpr std::size_t kFewBytes = std::max(kSharedBytes<Sample>, sizeof(FewScratch<Sample>));

// Adds a cluster against one field. The whole block calls.
template <class Sample>
__device__ void add_together(const ElementsView& elements, const FieldLook& field, float weight,
                             bool counted, int cluster, FieldShare& share, StiffnessShare* sums) {
  auto& shared = gpu::shared_memory<FewScratch<Sample>>();
  Element e = element_of(elements, cluster, field.frame);
  e.factor *= weight;
  e.is_counted = e.is_counted && counted;
  const ElementLook at = look_before(field.frame, e);
  LevelSteps<OneLane<float>, float> steps(field.grid, e.radius, at.inverse_depth);
  steps.go_on(field.grid, gpu::warp_id());
  shared.store(gpu::warp_id(), query_steps<Sample>(field.grid, field.pixels, at.u, at.v, at.depth,
                                                   at.inverse_depth, steps));
  __syncthreads();
  if (gpu::warp_id() == 0) {
    const auto sample = deepest<Sample>(e.radius, [&](int step) { return shared.load(step); });
    NoNoise noise;
    if (cluster >= elements.first_ball) {
      add_ball(field, elements.places, elements.ball_factor[cluster] * weight, e, at, sample, share,
               sums, noise);
    } else if (e.p[2] > kMinDepth) {
      add_sample(field, e, at, sample, share, sums, noise);
    }
  }
  __syncthreads();
}

template <int kNumFields, class Sample>
__global__ void __launch_bounds__(kFewThreads)
    measure_few(const __grid_constant__ FieldQuery<kNumFields> query,
                const __grid_constant__ MeasureOutput out) {
  FieldShare share;
  StiffnessShare stiffness;
#pragma unroll
  for (int k = 0; k < kNumFields; ++k) {
    const FieldLook& field = query.fields[k];
    if (kNumFields > 1 && field.grid.last_level < 0) continue;
    add_together<Sample>(query.elements, field, kNumFields > 1 ? field.weight : 1.0f,
                         k == kNumFields - 1, static_cast<int>(blockIdx.x), share, &stiffness);
  }
  finish<Sample>(out, share, stiffness);
}

/// State of a sphere and the plane that it is cut by, in T.
struct SphereCut {
  SphereState state = SphereState::outside;
  Plane<float> plane;
};
__device__ SphereCut cut_of(const DepthFieldView& field, const Pose& X_WT, const Sphere& sphere) {
  const double radius = sphere.radius;
  const Vec3d c_T = to_double(sphere.center);
  const FieldSample<double> at = sample_field(field, X_WT * c_T, radius);
  if (at.phi >= radius) return {};
  const Vec3d n_T = normalized(rotate(conjugate(X_WT.rotation), at.gradient));
  return {at.phi > -radius ? SphereState::boundary : SphereState::inside,
          {to_float(n_T), static_cast<float>(dot(n_T, c_T) - at.phi)}};
}

__global__ void describe_spheres(const __grid_constant__ DepthFieldView field, const Pose X_WT,
                                 const Sphere* spheres, int num, SphereState* states,
                                 Plane<float>* planes) {
  for (int id = gpu::grid_thread(); id < num; id += gpu::grid_threads()) {
    const SphereCut cut = cut_of(field, X_WT, spheres[id]);
    states[id] = cut.state;
    planes[id] = cut.plane;
  }
}

constexpr int kUnseenThreads = 256;

struct UnseenScratch {
  double of_warp[kUnseenThreads / gpu::kWarpSize];
};

// Writes the unseen volume of a tool, by one block.
__global__ void sum_unseen(const __grid_constant__ OneCamera camera, const FieldFrame frame,
                           const ElementsView elements, double* to) {
  auto& shared = gpu::shared_memory<UnseenScratch>();
  constexpr int kNum = kUnseenThreads / gpu::kWarpSize;
  const double mine = gpu::warp_sum(unseen_volume(camera, elements, frame, gpu::warp_id(), kNum));
  if (gpu::lane_id() == 0) shared.of_warp[gpu::warp_id()] = mine;
  __syncthreads();
  if (threadIdx.x != 0) return;
  double sum = 0;
  for (int warp = 0; warp < kNum; ++warp) sum += shared.of_warp[warp];
  *to = sum;
}

__global__ void mark_unseen(const __grid_constant__ OneCamera camera, const FieldFrame frame,
                            const Vec3f p_TC, const Sphere* spheres, int num,
                            std::uint8_t* unseen) {
  for (int id = gpu::grid_thread(); id < num; id += gpu::grid_threads()) {
    const Vec3f c = spheres[id].center - p_TC;
    float p[3];
    for (int row = 0; row < 3; ++row) {
      const float(&r)[3] = frame.R_WT[row];
      p[row] = r[0] * c.x + r[1] * c.y + r[2] * c.z + frame.p_WC[row];
    }
    unseen[id] = is_seen_by(camera, frame, p) ? 0 : 1;
  }
}

// Returns the number of blocks for so many threads, but not more than run at once.
int blocks_for(int num_threads, int threads, int most) {
  return std::max(1, std::min((num_threads + threads - 1) / threads, most));
}

template <int kNumFields, class Sample>
int max_blocks(int gpu) {
  const auto* kernel = reinterpret_cast<const void*>(&measure_elements<kNumFields, Sample>);
  return gpu::resident_blocks(gpu, kernel, kThreadsOf<Sample>, kSharedBytes<Sample>);
}

bool are_few(int num_clusters) { return num_clusters < kMinWholes; }

template <class Sample>
int measure_blocks(int gpu, int num_clusters, int num_blocks) {
  if (are_few(num_clusters)) return num_clusters;
  if (num_blocks == 0) {
    num_blocks = std::min(max_blocks<1, Sample>(gpu), max_blocks<2, Sample>(gpu));
  }
  return blocks_for(num_clusters * SphereClusters::kSize, kThreadsOf<Sample>, num_blocks);
}

}  // namespace

FieldContactCuda::FieldContactCuda(std::shared_ptr<const ToolIndex> index,
                                   const FieldMethod& method, int gpu, int num_blocks,
                                   bool reserves_noise)
    : ContactQuery(std::move(index), method),
      center_of_mass_(this->index()->tool().sphere_mass().center_of_mass),
      num_spheres_(static_cast<int>(this->index()->tool().spheres().size())),
      memory_(gpu),
      field_tool_(make_field_tool(*this->index(), method.volumes, memory_)),
      stream_(gpu, gpu::Priority::high),
      fields_(gpu),
      in_front_(gpu),
      answers_(gpu, measure_blocks<Gradient>(gpu, field_tool_.elements.num_clusters, num_blocks)),
      stiffness_answers_(
          gpu, measure_blocks<Curvature>(gpu, field_tool_.elements.num_clusters, num_blocks),
          AnswerBox::kMaxNumbers),
      states_(memory_.take<SphereState>(static_cast<std::size_t>(num_spheres_))),
      planes_(memory_.take<Plane<float>>(static_cast<std::size_t>(num_spheres_))),
      deciders_(memory_.take<std::int8_t>(static_cast<std::size_t>(num_spheres_))),
      unseen_(memory_.take<std::uint8_t>(static_cast<std::size_t>(num_spheres_))),
      unseen_volume_(memory_.take_pinned<double>(1)),
      hull_(std::make_unique<DepthHullCuda>(field_tool_, center_of_mass_, num_spheres_, gpu,
                                            num_blocks)) {
  if (reserves_noise) noise_ = std::make_unique<MeasureNoiseCuda>(field_tool_, gpu);
}

ContactResult FieldContactCuda::measure_hull(std::span<const SurfaceBlend> cameras,
                                             const Pose& X_WT,
                                             const ContactWants& wants) const noexcept {
  if (!status()) return unmeasured(StepStatus::backend_failed, wants, true);
  ContactResult result =
      hull_->measure(cameras, X_WT, wants, {states_, planes_, deciders_, unseen_}, stream_);
  if (wants.noise && !result.penetration.status.is_unmeasured()) {
    if (has_noise()) result.noise = noise_->of_cameras(hull_->cameras(), stream_);
    if (noise_ == nullptr || !status()) return unmeasured(StepStatus::backend_failed, wants, true);
  }
  return result;
}

std::optional<MeasureNoise> FieldContactCuda::noise_against(const FieldQuestion& question,
                                                            int field) const noexcept {
  const DepthFieldView& of = question.fields[field];
  if (of.num_levels == 0) return MeasureNoise{};
  return noise_->of_field(of, frame_of(of.intrinsics, question.X_WT, center_of_mass_), stream_);
}

double FieldContactCuda::unseen_by_one(const SurfaceView& surface, const Pose& X_CT,
                                       std::span<std::uint8_t> unseen) const noexcept {
  if (surface.field.num_levels == 0 || !status()) return 0;
  const bool is_memory = surface.role == SurfaceRole::with_memory;
  const OneCamera camera{
      {fields_.on_gpu(surface.field, stream_), in_front_.on_gpu(surface.in_front, stream_)},
      is_memory ? 2 : 1};
  const FieldFrame frame = frame_of(surface.field.intrinsics, X_CT, center_of_mass_);
  gpu::launch(stream_, {.threads = kUnseenThreads, .shared_bytes = sizeof(UnseenScratch)},
              sum_unseen, camera, frame, field_tool_.elements, unseen_volume_);
  if (!unseen.empty()) {
    gpu::launch(
        stream_,
        {.blocks = (num_spheres_ + kUnseenThreads - 1) / kUnseenThreads, .threads = kUnseenThreads},
        mark_unseen, camera, frame, to_float(center_of_mass_), field_tool_.spheres, num_spheres_,
        unseen_);
    stream_.copy(unseen.data(), unseen_, unseen.size_bytes());
  }
  return stream_.wait() ? *unseen_volume_ : 0;
}

const Status& FieldContactCuda::status() const {
  for (const Status* status :
       {&memory_.status(), &answers_.status(), &stiffness_answers_.status(), &hull_->status()}) {
    if (!*status) return *status;
  }
  if (noise_ != nullptr && !noise_->status()) return noise_->status();
  return stream_.status();
}

ContactResult FieldContactCuda::measure_one(const SurfaceView& from, const SurfaceView& to,
                                            double alpha, const Pose& X_WT,
                                            const ContactWants& wants) const noexcept {
  if (!is_finite(X_WT)) return unmeasured(StepStatus::non_finite_pose, wants, true);
  FieldQuestion question;
  question.X_WT = {X_WT.translation, normalized(X_WT.rotation)};
  if (is_outside_window(from, to, alpha, question.X_WT * center_of_mass_, field_tool_.reach)) {
    return unmeasured(StepStatus::outside_window, wants, true);
  }
  ContactResult result;
  if (alpha < 1) {
    question.fields[0] = fields_.on_gpu(from.field, stream_);
    question.fields[1] = fields_.on_gpu(to.field, stream_);
    question.weights[0] = 1 - alpha;
    question.weights[1] = alpha;
    result = wants.stiffness ? evaluate<2, Curvature>(question, stiffness_answers_)
                             : evaluate<2, Gradient>(question, answers_);
  } else {
    question.fields[0] = fields_.on_gpu(to.field, stream_);
    question.weights[0] = 1;
    result = wants.stiffness ? evaluate<1, Curvature>(question, stiffness_answers_)
                             : evaluate<1, Gradient>(question, answers_);
  }
  describe(question.fields[alpha < 1 ? 1 : 0], question.X_WT, wants);
  if (wants.noise) {
    if (!has_noise()) return unmeasured(StepStatus::backend_failed, wants, true);
    result.noise = alpha < 1 ? blend(noise_against(question, 0), noise_against(question, 1), alpha)
                             : noise_against(question, 0);
    if (!status()) return unmeasured(StepStatus::backend_failed, wants, true);
  }
  return result;
}

template <int kNumFields, class Sample>
ContactResult FieldContactCuda::evaluate(const FieldQuestion& question,
                                         AnswerBox& answers) const noexcept {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const ContactWants wants{.stiffness = kWithStiffness};
  if (!status()) return unmeasured(StepStatus::backend_failed, wants, true);
  FieldQuery<kNumFields> query;
  int num_missing = 0;
  for (int k = 0; k < kNumFields; ++k) {
    const DepthFieldView& field = question.fields[k];
    const FieldFrame frame = frame_of(field.intrinsics, question.X_WT, center_of_mass_);
    query.fields[k] = look_of(field, frame, question.weights[k]);
    num_missing += field.num_levels == 0;
  }
  if (num_missing == kNumFields) return unmeasured(StepStatus::no_surface, wants, true);
  query.elements = field_tool_.elements;
  const int num_clusters = query.elements.num_clusters, num_blocks = answers.num_blocks();
  if (are_few(num_clusters)) {
    gpu::launch(stream_,
                {.blocks = num_blocks, .threads = kFewThreads, .shared_bytes = kFewBytes<Sample>},
                measure_few<kNumFields, Sample>, query, answers.next());
  } else {
    constexpr int kThreads = kThreadsOf<Sample>;
    const int num_warps = num_blocks * kThreads / gpu::kWarpSize;
    query.max_tiles = num_clusters > num_warps ? kMaxTilesPerLane : 0;
    query.looks_together = num_clusters <= num_warps && num_clusters >= kManyClusters;
    gpu::launch(stream_,
                {.blocks = num_blocks, .threads = kThreads, .shared_bytes = kSharedBytes<Sample>},
                measure_elements<kNumFields, Sample>, query, answers.next());
  }
  if (!answers.await(stream_)) return unmeasured(StepStatus::backend_failed, wants, true);
  ContactResult result{answers.answer().penetration(), {}, {}};
  if (num_missing > 0) result.penetration.status |= StepStatus::no_surface;
  if (kWithStiffness) {
    const StiffnessSums sums = answers.stiffness();
    result.stiffness = sums.stiffness();
    result.moments = sums.moments();
  }
  keep_bounds(result);
  return result;
}

void FieldContactCuda::describe(const DepthFieldView& field, const Pose& X_WT,
                                const ContactWants& wants) const noexcept {
  if (wants.states.empty() && wants.planes.empty()) return;
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  if (!status() || field.num_levels == 0) return;
  constexpr int kDescribeThreads = 128, kMaxBlocks = 1024;
  gpu::launch(stream_,
              {.blocks = blocks_for(num_spheres_, kDescribeThreads, kMaxBlocks),
               .threads = kDescribeThreads},
              describe_spheres, field, X_WT, field_tool_.spheres, num_spheres_, states_, planes_);
  if (!wants.states.empty()) stream_.copy(wants.states.data(), states_, wants.states.size_bytes());
  if (!wants.planes.empty()) stream_.copy(wants.planes.data(), planes_, wants.planes.size_bytes());
  stream_.wait();
}

}}  // namespace palpate::v0
