#include "src/contact/noise/measure_noise_cuda.h"

#include <algorithm>
#include <cstring>

#include "src/contact/hull/hull_cameras.cuh"
#include "src/contact/hull/hull_elements.cuh"
#include "src/contact/noise/noise_sums_cuda.cuh"

namespace palpate { inline namespace v0 {

// Cameras whose noise is summed up.
struct NoiseEyes {
  struct Eye {
    FieldLook field;
    float R_WC[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    SurfaceNoise noise;
  };
  std::int32_t num = 0;
  Eye eyes[kMaxCameras];
};

namespace {

// Warps of a block that keeps elements against one field, and of the one that sums up.
constexpr int kKeepers = 4, kSummers = 16;
// Parts of the rows, at most.
constexpr int kMaxParts = 1024;

__global__ void __launch_bounds__(kKeepers* gpu::kWarpSize)
    keep_elements(const ElementsView elements, const __grid_constant__ FieldLook field,
                  const KeptRows kept) {
  const int part = gpu::grid_thread() / gpu::kWarpSize;
  if (part >= kept.num_parts) return;
  NoiseKeeper noise(kept, part);
  FieldShare unused;
  for (int begin = part; begin < elements.num_clusters; begin += gpu::kWarpSize * kept.num_parts) {
    add_clusters<Gradient, true, true>(elements, field, 1, false, begin, kept.num_parts,
                                       kMaxTilesPerLane, unused, nullptr, noise);
  }
  noise.finish();
}

template <int kMaxViews>
using KeepScratch = ViewScratch<kMaxViews, Gradient>;

template <int kMaxViews>
__global__ void __launch_bounds__(kHullThreads, 2)
    keep_hull_elements(const __grid_constant__ HullQuery<kMaxViews> query,
                       const __grid_constant__ PosedTool<kMaxViews> tool, const KeptRows kept) {
  const int part = static_cast<int>(blockIdx.x);
  NoiseKeeper noise(kept, part);
  FieldShare unused;
  StiffnessShare none;
  add_hull_elements(query, tool, part, kept.num_parts, tool.elements.num_clusters > kept.num_parts,
                    gpu::shared_memory<KeepScratch<kMaxViews>>(), unused, none, noise);
  if (gpu::warp_id() == 0) noise.finish();
}

// Answers with the variances of MeasureNoise. One block.
__global__ void __launch_bounds__(kSummers* gpu::kWarpSize)
    sum_noise(const __grid_constant__ NoiseEyes eyes, const KeptRows kept,
              const __grid_constant__ MeasureOutput out) {
  auto& shared = gpu::shared_memory<NoiseScratch<kSummers>>();
  const int thread = static_cast<int>(threadIdx.x);
  if (thread < kNumVariances) shared.variances[thread] = 0;
  for (int k = 0; k < eyes.num; ++k) {
    const NoiseEyes::Eye& eye = eyes.eyes[k];
    add_noise(kept, k, eye.field, eye.R_WC, eye.noise, shared);
  }
  if (thread < MeasureTerms::kNum) {
    answer(out, thread, thread < kNumVariances ? shared.variances[thread] : 0.0);
  }
}

template <class Kernel>
int resident(int gpu, Kernel* kernel, int threads, std::size_t bytes) {
  return gpu::resident_blocks(gpu, reinterpret_cast<const void*>(kernel), threads, bytes);
}

int hull_parts(int gpu, int num_clusters) {
  const int few = resident(gpu, keep_hull_elements<kFewCameras>, kHullThreads,
                           sizeof(KeepScratch<kFewCameras>));
  const int most = resident(gpu, keep_hull_elements<kMaxCameras>, kHullThreads,
                            sizeof(KeepScratch<kMaxCameras>));
  return std::clamp(num_clusters, 1, std::max(1, std::min(few, most)));
}

}  // namespace

MeasureNoiseCuda::MeasureNoiseCuda(const FieldTool& tool, int gpu)
    : elements_(tool.elements),
      memory_(gpu),
      field_parts_(std::clamp(elements_.num_clusters, 1, kMaxParts)),
      hull_parts_(hull_parts(gpu, elements_.num_clusters)),
      answers_(gpu, 1) {
  (void)resident(gpu, sum_noise, kSummers * gpu::kWarpSize, sizeof(NoiseScratch<kSummers>));
  for (const int num : {field_parts_, hull_parts_}) {
    rows_.apart = std::max(rows_.apart, num * rows_of_part(elements_.num_clusters, num));
  }
  rows_.first = memory_.take<float>(kNumNoiseRows * static_cast<std::size_t>(rows_.apart));
  rows_.num = memory_.take<int>(static_cast<std::size_t>(std::max(field_parts_, hull_parts_)));
}

KeptRows MeasureNoiseCuda::kept_by(int num_parts) const {
  return {rows_, num_parts, rows_of_part(elements_.num_clusters, num_parts)};
}

std::optional<MeasureNoise> MeasureNoiseCuda::of_field(const DepthFieldView& field,
                                                       const FieldFrame& frame,
                                                       gpu::Stream& stream) noexcept {
  if (!status()) return std::nullopt;
  NoiseEyes eyes;
  eyes.num = 1;
  eyes.eyes[0].field = look_of(field, frame, 1);
  eyes.eyes[0].noise = surface_noise(field.noise);
  if (eyes.eyes[0].noise.is_known == 0) return std::nullopt;
  gpu::launch(
      stream,
      {.blocks = (field_parts_ + kKeepers - 1) / kKeepers, .threads = kKeepers * gpu::kWarpSize},
      keep_elements, elements_, eyes.eyes[0].field, kept_by(field_parts_));
  return sum(eyes, field_parts_, stream);
}

template <int kMaxViews>
void MeasureNoiseCuda::keep(const HullCameras& cameras, gpu::Stream& stream) const noexcept {
  gpu::launch(stream,
              {.blocks = hull_parts_,
               .threads = kHullThreads,
               .shared_bytes = sizeof(KeepScratch<kMaxViews>)},
              keep_hull_elements<kMaxViews>, cameras.query<kMaxViews>(),
              cameras.posed<kMaxViews>(elements_), kept_by(hull_parts_));
}

std::optional<MeasureNoise> MeasureNoiseCuda::of_cameras(const HullCameras& cameras,
                                                         gpu::Stream& stream) noexcept {
  if (!status()) return std::nullopt;
  NoiseEyes eyes;
  for (int k = 0; k < cameras.num(); ++k) {
    NoiseEyes::Eye& eye = eyes.eyes[eyes.num++];
    eye.field = cameras.eyes()[k].field[0];
    std::memcpy(eye.R_WC, cameras.eyes()[k].R_WC[0], sizeof eye.R_WC);
    eye.noise = cameras.noise(k);
    if (eye.noise.is_known == 0) return std::nullopt;
  }
  if (cameras.num() <= kFewCameras) {
    keep<kFewCameras>(cameras, stream);
  } else {
    keep<kMaxCameras>(cameras, stream);
  }
  return sum(eyes, hull_parts_, stream);
}

std::optional<MeasureNoise> MeasureNoiseCuda::sum(const NoiseEyes& eyes, int num_parts,
                                                  gpu::Stream& stream) noexcept {
  gpu::launch(
      stream,
      {.threads = kSummers * gpu::kWarpSize, .shared_bytes = sizeof(NoiseScratch<kSummers>)},
      sum_noise, eyes, kept_by(num_parts), answers_.next());
  if (!answers_.await(stream)) return std::nullopt;
  return measure_noise(answers_.numbers());
}

}}  // namespace palpate::v0
