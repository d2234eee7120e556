// Bodies that sample each other's distance fields, on a GPU: a launch per direction, a warp per
// cluster of elements.
#include "src/contact/bodies/solid_contact_cuda.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "src/contact/bodies/body_pair.h"
#include "src/contact/bodies/solid_contact.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_elements_cuda.cuh"

namespace palpate { inline namespace v0 {
namespace {

/// One direction of sampling; an argument of the kernel.
struct SolidQuery {
  ElementsView elements;
  const std::int32_t* level = nullptr;  // as in SolidSampling
  const float* rounding = nullptr;
  SolidFieldView field;
  SolidFrame frame;
};

/// Samples at p, from the corner of the grids. False if the grid has no node there.
template <class Sample>
__device__ bool sample_level(const SolidFieldView& field, const float (&p)[3], int level,
                             Sample& sample) {
  const float per_spacing = 1.0f / (field.spacing * static_cast<float>(1 << level));
  std::int32_t at = 0;
  float off[3];
  bool is_inside = true;
#pragma unroll
  for (int axis = 2; axis >= 0; --axis) {
    const std::int32_t num = field.num_nodes[axis][level];
    const float desired = p[axis] * per_spacing + static_cast<float>(SolidField::kMargin);
    const float place = fminf(fmaxf(desired, 1.0f), static_cast<float>(num - 2));
    is_inside = is_inside && place == desired;
    const auto node = static_cast<std::int32_t>(place + 0.5f);
    off[axis] = place - static_cast<float>(node);
    at = at * num + node;
  }
  const std::int32_t row = field.num_nodes[0][level], slice = row * field.num_nodes[1][level];
  const float* const first = field.values + field.first[level] + at - slice - row - 1;
  sample_spline(
      off[0], off[1], off[2], per_spacing,
      [&](int j, int k, float(&nodes)[3]) {
        const float* const from = first + k * slice + j * row;
        for (int i = 0; i < 3; ++i) nodes[i] = from[i];
      },
      sample);
  return is_inside;
}

template <class Sample>
constexpr bool kIsCurvature = std::is_same_v<Sample, SolidCurvature<float>>;
template <class Sample>
constexpr int kSolidThreads = kIsCurvature<Sample> ? 128 : 256;
template <class Sample>
constexpr std::size_t kSolidShared = kIsCurvature<Sample> ? sizeof(FinishStiffnessScratch)
                                                          : sizeof(FinishScratch);

template <class Sample>
__device__ void add_solid_element(const SolidQuery& query, int cluster, FieldShare& share,
                                  StiffnessShare& stiffness) {
  const int slot = cluster * SphereClusters::kSize + gpu::lane_id();
  const ElementBall ball = query.elements.balls[slot];
  const auto rotated = [&](const float(&row)[3]) {
    return row[0] * ball.x + row[1] * ball.y + row[2] * ball.z;
  };
  float p[3];
  for (int axis = 0; axis < 3; ++axis) {
    p[axis] = rotated(query.frame.R_FE[axis]) + query.frame.p_FC[axis];
  }
  Sample sample;
  const bool is_inside = sample_level(query.field, p, query.level[slot], sample);
  const SolidGradient<float>& g = first_of(sample);
  if (!is_inside || !(g.phi < ball.radius)) return;
  Element e;
  for (int axis = 0; axis < 3; ++axis) {
    e.lever[axis] = rotated(query.frame.R_WE[axis]);
    e.p[axis] = 0;
  }
  const float factor = query.elements.factors[slot];
  e.radius = ball.radius;
  e.factor = fabsf(factor);
  e.is_counted = __float_as_int(factor) >= 0;
  const float(&R)[3][3] = query.frame.R_WF;
  const Gradient3<float> n = turned(R, g.n);
  Symmetric<float> h{};
  if constexpr (kIsCurvature<Sample>) h = turned(R, sample.h);
  add_cut<kIsCurvature<Sample>>(e, g.phi, n, h, share, &stiffness);
}

template <class Sample>
__global__ void __launch_bounds__(kSolidThreads<Sample>, 2)
    measure_solid(const __grid_constant__ SolidQuery query,
                  const __grid_constant__ MeasureOutput out) {
  FieldShare share;
  StiffnessShare stiffness;
  const int num_warps = gpu::grid_threads() / gpu::kWarpSize;
  for (int cluster = gpu::grid_thread() / gpu::kWarpSize; cluster < query.elements.num_clusters;
       cluster += num_warps) {
    if (is_clear(query.field, query.frame, query.elements.clusters[cluster],
                 query.rounding[cluster])) {
      continue;
    }
    add_solid_element<Sample>(query, cluster, share, stiffness);
  }
  MeasureTerms mine;
  add_share(share, mine);
  if constexpr (kIsCurvature<Sample>) {
    finish_measure(out, mine, stiffness.numbers, gpu::shared_memory<FinishStiffnessScratch>());
  } else {
    finish_measure(out, mine, gpu::shared_memory<FinishScratch>());
  }
}

template <class Sample>
int solid_blocks(int gpu, int num_clusters) {
  constexpr int kThreads = kSolidThreads<Sample>;
  const int most = gpu::resident_blocks(gpu, reinterpret_cast<const void*>(measure_solid<Sample>),
                                        kThreads, kSolidShared<Sample>);
  const int desired = (num_clusters * SphereClusters::kSize + kThreads - 1) / kThreads;
  return std::clamp(desired, 1, std::max(most, 1));
}

using SolidSlope = SolidGradient<float>;
using SolidBend = SolidCurvature<float>;

/// One direction of sampling and its results.
class SolidWay {
 public:
  SolidWay(const ToolIndex& index, const SolidSampling& sampling, const SolidField& field,
           double weight, int gpu)
      : is_used_(weight > 0),
        memory_(gpu),
        answers_(gpu, solid_blocks<SolidSlope>(gpu, num_clusters(index))),
        stiffness_answers_(gpu, solid_blocks<SolidBend>(gpu, num_clusters(index)),
                           AnswerBox::kMaxNumbers) {
    if (!is_used_) return;
    query_.elements = elements_view(parts_of(index).solid_elements(), memory_);
    query_.level = memory_.copy_of(sampling.level);
    query_.rounding = memory_.copy_of(sampling.rounding);
    query_.field = view_of(field);
    query_.field.values = memory_.copy_of(field.values());
  }

  const Status& status() const {
    for (const Status* status : {&memory_.status(), &answers_.status()}) {
      if (!*status) return *status;
    }
    return stiffness_answers_.status();
  }

  SolidFrame& frame() { return query_.frame; }

  void start(gpu::Stream& stream, bool wants_stiffness) {
    if (!is_used_) return;
    if (wants_stiffness) return launch<SolidBend>(stream, stiffness_answers_);
    launch<SolidSlope>(stream, answers_);
  }
  /// False if no answer came.
  bool finish(gpu::Stream& stream, bool wants_stiffness, GroupSums& sums) {
    sums = {};
    if (!is_used_) return true;
    AnswerBox& answers = wants_stiffness ? stiffness_answers_ : answers_;
    if (!answers.await(stream)) return false;
    const QueryAnswer answer = answers.answer();
    sums.measure = {answer.volume,
                    answer.potential,
                    {answer.force[0], answer.force[1], answer.force[2]},
                    {answer.torque[0], answer.torque[1], answer.torque[2]},
                    answer.num_boundary,
                    answer.num_inside,
                    0};
    if (wants_stiffness) sums.stiffness = answers.stiffness();
    return true;
  }

 private:
  static int num_clusters(const ToolIndex& index) {
    return parts_of(index).solid_elements().clusters.num_clusters();
  }
  template <class Sample>
  void launch(gpu::Stream& stream, AnswerBox& answers) {
    gpu::launch(stream,
                {.blocks = answers.num_blocks(),
                 .threads = kSolidThreads<Sample>,
                 .shared_bytes = kSolidShared<Sample>},
                measure_solid<Sample>, query_, answers.next());
  }

  bool is_used_;
  gpu::Memory memory_;
  AnswerBox answers_, stiffness_answers_;
  SolidQuery query_;
};

class SolidContactCuda final : public BodyPairQuery {
 public:
  SolidContactCuda(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b, int gpu)
      : pair_(std::move(a), std::move(b)),
        stream_(gpu, gpu::Priority::high),
        way_a_(*pair_.a, pair_.sampling_a, *pair_.field_b, pair_.weight_a, gpu),
        way_b_(*pair_.b, pair_.sampling_b, *pair_.field_a, pair_.weight_b, gpu) {}

  const Status& status() const {
    for (const Status* status : {&way_a_.status(), &way_b_.status()}) {
      if (!*status) return *status;
    }
    return stream_.status();
  }

  void start(const Pose& X_WA, const Pose& X_WB, bool wants_stiffness) noexcept override {
    X_WA_ = X_WA;
    X_WB_ = X_WB;
    wants_stiffness_ = wants_stiffness;
    nothing_ = {};
    if (is_non_finite(X_WA, X_WB, nothing_) || !status()) return;
    pair_.place(X_WA, X_WB, way_a_.frame(), way_b_.frame());
    way_a_.start(stream_, wants_stiffness);
    way_b_.start(stream_, wants_stiffness);
  }

  BodyPenetration finish() noexcept override {
    if (nothing_.on_a.status.bits != 0 || nothing_.on_b.status.bits != 0) return nothing_;
    GroupSums of_a, of_b;
    if (!status() || !way_a_.finish(stream_, wants_stiffness_, of_a) ||
        !way_b_.finish(stream_, wants_stiffness_, of_b)) {
      nothing_.on_a.status = nothing_.on_b.status = StepStatus::backend_failed;
      return nothing_;
    }
    return pair_.penetration(of_a, of_b, wants_stiffness_, X_WA_, X_WB_);
  }

 private:
  SolidPair pair_;
  gpu::Stream stream_;
  SolidWay way_a_, way_b_;
  Pose X_WA_, X_WB_;
  bool wants_stiffness_ = false;
  BodyPenetration nothing_;  // status of an impossible measurement
};

}  // namespace

Result<std::unique_ptr<BodyPairQuery>> make_solid_contact_cuda(std::shared_ptr<const ToolIndex> a,
                                                               std::shared_ptr<const ToolIndex> b,
                                                               int gpu) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto query = std::make_unique<SolidContactCuda>(std::move(a), std::move(b), gpu);
  if (!query->status()) return query->status().error();
  return std::unique_ptr<BodyPairQuery>(std::move(query));
}

}}  // namespace palpate::v0
