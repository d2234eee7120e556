#include <algorithm>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "src/cloud/internal/frame_noise.h"
#include "src/field/timeline/batch_frames.h"

namespace palpate { inline namespace v0 {
namespace {

/// Fields on the CPU: each image is processed by one thread.
class BatchFramesCpu final : public BatchFrames {
 public:
  explicit BatchFramesCpu(const SlotSettings& settings) : settings_(settings) {}

  Status reserve(int num_images) override {
#if defined(__cpp_exceptions)
    try {
      return make_room(static_cast<std::size_t>(num_images));
    } catch (const std::bad_alloc&) {
      return Error{Errc::unavailable, "there is memory for " + std::to_string(fields_.size()) +
                                          " of " + std::to_string(num_images) +
                                          " images of a batch; give fewer at a time"};
    }
#else
    return make_room(static_cast<std::size_t>(num_images));
#endif
  }

  Result<SurfaceBatch> update(const DepthImageView& first, int num, std::optional<CallerStream>,
                              ThreadPool& pool) override {
    if (const Status status = reserve(num); !status) return status.error();
    while (static_cast<int>(workers_.size()) < pool.num_threads()) {
      auto made = SurfaceEstimator::create(settings_.stream.width, settings_.stream.height,
                                           settings_.stream.intrinsics, settings_.surface,
                                           best_isa(), settings_.stream.distortion);
      if (!made) return made.error();
      workers_.push_back({*std::move(made), std::make_unique<ThreadPool>(1)});
    }
    const int num_tasks = std::min(pool.num_threads(), num);
    pool.parallel_for(num_tasks, [&](int task) {
      for (int i = task; i < num; i += num_tasks)
        make(first, i, workers_[static_cast<std::size_t>(task)]);
    });
    return SurfaceBatch(std::span(surfaces_).first(static_cast<std::size_t>(num)));
  }

 private:
  Status make_room(std::size_t num) {
    fields_.reserve(num);
    while (fields_.size() < num) {
      auto made =
          DepthField::create(settings_.stream.width, settings_.stream.height, *settings_.field);
      if (!made) return made.error();
      fields_.push_back(*std::move(made));
    }
    surfaces_.resize(num);
    noises_.resize(num);
    return Done{};
  }

  struct Worker {
    SurfaceEstimator estimator;
    std::unique_ptr<ThreadPool> pool;
  };

  void make(const DepthImageView& first, int number, Worker& worker) {
    const auto i = static_cast<std::size_t>(number);
    DepthImageView image = first;
    if (image.counts != nullptr) image.counts += i * image.num_pixels();
    if (image.meters != nullptr) image.meters += i * image.num_pixels();
    worker.estimator.update(image, *worker.pool, {{}, false});
    fields_[i].update(worker.estimator.cloud(), *worker.pool);
    noises_[i] = *worker.estimator.cloud().noise;
    surfaces_[i].field = fields_[i].view();
    surfaces_[i].field.noise = &noises_[i];
  }

  SlotSettings settings_;
  std::vector<Worker> workers_;
  std::vector<DepthField> fields_;
  std::vector<SurfaceView> surfaces_;
  std::vector<FrameNoise> noises_;
};

}  // namespace

Result<std::unique_ptr<BatchFrames>> make_batch_frames_cpu(const SlotSettings& settings) {
  return std::unique_ptr<BatchFrames>(std::make_unique<BatchFramesCpu>(settings));
}

}}  // namespace palpate::v0
