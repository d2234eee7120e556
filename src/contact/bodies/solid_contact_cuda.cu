// Bodies that sample each other's distance fields, on a GPU: a launch per direction, a warp per
// cluster of elements.
#include "src/contact/backends.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "src/contact/bodies/body_pair.h"
#include "src/contact/bodies/solid_elements.cuh"
#include "src/contact/cuda/finish_measure.cuh"

namespace palpate { inline namespace v0 {
namespace {

template <class Sample>
constexpr int kSolidThreads = kIsCurvature<Sample> ? 128 : 256;
template <class Sample>
constexpr std::size_t kSolidShared = kIsCurvature<Sample> ? sizeof(FinishStiffnessScratch)
                                                          : sizeof(FinishScratch);

template <class Sample>
__global__ void __launch_bounds__(kSolidThreads<Sample>, 2)
    measure_solid(const __grid_constant__ SolidWay way, const __grid_constant__ SolidFrame frame,
                  const __grid_constant__ MeasureOutput out) {
  FieldShare share;
  StiffnessShare stiffness;
  add_solid_elements<Sample>(way, frame, gpu::grid_thread() / gpu::kWarpSize,
                             gpu::grid_threads() / gpu::kWarpSize, share, stiffness);
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

/// One direction of sampling and its results.
class MeasuredWay {
 public:
  MeasuredWay(const ToolIndex& index, const SolidSampling& sampling, const SolidField& field,
              double weight, int gpu)
      : is_used_(weight > 0),
        memory_(gpu),
        answers_(gpu, solid_blocks<SolidSlope>(gpu, num_clusters(index))),
        stiffness_answers_(gpu, solid_blocks<SolidBend>(gpu, num_clusters(index)),
                           AnswerBox::kMaxNumbers) {
    if (!is_used_) return;
    way_ = way_on_gpu(parts_of(index).solid_elements(), sampling, field, memory_);
  }

  const Status& status() const {
    for (const Status* status : {&memory_.status(), &answers_.status()}) {
      if (!*status) return *status;
    }
    return stiffness_answers_.status();
  }

  SolidFrame& frame() { return frame_; }

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
                measure_solid<Sample>, way_, frame_, answers.next());
  }

  bool is_used_;
  gpu::Memory memory_;
  AnswerBox answers_, stiffness_answers_;
  SolidWay way_;
  SolidFrame frame_;
};

class SolidContactCuda final : public BodyPairQuery {
 public:
  SolidContactCuda(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b, int gpu)
      : pair_(std::move(a), std::move(b)),
        stream_(gpu, gpu::Priority::high),
        way_a_(*pair_.a, pair_.sampling_a, *pair_.field_b, pair_.weights.a, gpu),
        way_b_(*pair_.b, pair_.sampling_b, *pair_.field_a, pair_.weights.b, gpu) {}

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
  MeasuredWay way_a_, way_b_;
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
