// Many poses of one tool against bodies that stay: queries of pairs, one for each thread and shape.
#include <algorithm>
#include <atomic>
#include <string>
#include <utility>

#include "palpate/contact/body_contact.h"
#include "src/contact/batch/batch_pose.h"
#include "src/contact/batch/field_batch.h"
#include "src/contact/batch/scene_batch.h"
#include "src/contact/hull/camera_seats.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kPosesAtATime = 64;

Error refused(const std::string& message) { return {Errc::invalid_argument, message}; }

class BodyBatch final : public BodyBatchQuery {
 public:
  /// `shape_of_body`: the pair of each body; `pairs`: for each thread, one of each shape.
  BodyBatch(std::vector<Pose> X_WB, std::vector<std::size_t> shape_of_body,
            std::vector<std::vector<std::unique_ptr<BodyPairQuery>>> pairs, ThreadPool* pool)
      : X_WB_(std::move(X_WB)),
        shape_of_body_(std::move(shape_of_body)),
        pairs_(std::move(pairs)),
        pool_(pool != nullptr ? pool : &own_pool_) {}

  Status measure(std::span<const Pose> X_WT, std::span<const std::int32_t> body_of_pose,
                 const BatchAnswers& answers) const override {
    const std::size_t num = X_WT.size(), num_bodies = X_WB_.size();
    if (const Status s = check_body_batch(num, body_of_pose.size(), num_bodies); !s) return s;
    if (answers.gpu != kHostMemory) {
      return refused("an array for answers in the memory of GPU " + std::to_string(answers.gpu) +
                     " was given to a batch against bodies, which is measured on the CPU; take "
                     "one in host memory");
    }
    const auto* const numbers = body_of_pose.empty() ? nullptr : body_of_pose.data();
    std::atomic<std::size_t> next = 0;
    pool_->parallel_for(static_cast<int>(pairs_.size()), [&](int thread) {
      const auto& pairs = pairs_[static_cast<std::size_t>(thread)];
      for (std::size_t first = next.fetch_add(kPosesAtATime); first < num;
           first = next.fetch_add(kPosesAtATime)) {
        for (std::size_t i = first; i < std::min(num, first + kPosesAtATime); ++i) {
          const int body = surface_of(numbers, static_cast<int>(num_bodies), static_cast<int>(i));
          BodyPenetration measured;
          if (body < 0) {
            measured.on_a.status = StepStatus::no_surface;
          } else {
            const auto b = static_cast<std::size_t>(body);
            measured =
                pairs[shape_of_body_[b]]->measure(X_WT[i], X_WB_[b], answers.stiffness != nullptr);
            measured.on_a.status.bits |= measured.on_b.status.bits;
          }
          // A CAD model has no noise.
          put_answers(i, {measured.on_a, measured.stiffness_a, {}, MeasureNoise{}}, answers);
        }
      }
    });
    return Done{};
  }

 private:
  std::vector<Pose> X_WB_;
  std::vector<std::size_t> shape_of_body_;
  std::vector<std::vector<std::unique_ptr<BodyPairQuery>>> pairs_;
  mutable ThreadPool own_pool_{1};
  ThreadPool* pool_;
};

}  // namespace

Status check_body_batch(std::size_t num_poses, std::size_t num_numbers, std::size_t num_bodies) {
  if (num_numbers == 0 && num_poses > 0 && num_bodies != 1 && num_bodies != num_poses) {
    return refused("a batch of " + std::to_string(num_poses) + " poses was given " +
                   std::to_string(num_bodies) +
                   " bodies; say in body_of_pose which one each is measured against");
  }
  if (num_numbers != 0 && num_numbers != num_poses) {
    return refused("a batch of " + std::to_string(num_poses) + " poses was given body_of_pose of " +
                   std::to_string(num_numbers) + "; give one number for each pose");
  }
  return Done{};
}

bool is_for_batch(std::span<const SurfaceView> surfaces) {
  const bool is_lone = surfaces.size() == 1;
  bool is_seeing = surfaces.empty();
  for (const SurfaceView& surface : surfaces) {
    const DepthFieldView& field = surface.field;
    if (field.num_levels == 0) continue;
    if (!has_fields_of_role(surface) || !has_fields(surface, is_lone)) return false;
    if (!field.requested.has_all(field.levels[0].width, field.levels[0].height)) return false;
    is_seeing |= is_seen(surface, is_lone);
  }
  return is_seeing;
}

Result<std::unique_ptr<BodyBatchQuery>> make_body_batch_query(
    const Place& place, const std::shared_ptr<const ToolIndex>& tool,
    const std::vector<PlacedBody>& bodies, const BodyPairOptions& options, ThreadPool* pool) {
  if (bodies.empty()) return refused("a batch was given no body; give one or more");
  std::vector<std::shared_ptr<const ToolIndex>> shapes;
  std::vector<std::size_t> shape_of_body;
  std::vector<Pose> X_WB;
  for (const PlacedBody& body : bodies) {
    if (body.shape == nullptr) {
      return refused("body " + std::to_string(X_WB.size()) + " of a batch has no shape");
    }
    const auto found = std::find(shapes.begin(), shapes.end(), body.shape);
    shape_of_body.push_back(static_cast<std::size_t>(found - shapes.begin()));
    if (found == shapes.end()) shapes.push_back(body.shape);
    X_WB.push_back(body.X_WB);
  }
  if (place.backend == Backend::cuda) {
    if (options.method != BodyMethod::field) {
      return Error{
          Errc::unavailable,
          "batches against bodies by their spheres are measured on the CPU alone: make the "
          "query with Place::cpu(), or with BodyMethod::field"};
    }
#if defined(PALPATE_CUDA)
    return make_body_batch_query_cuda(tool, bodies, place.gpu);
#else
    return find_gpus().error();
#endif
  }
  std::vector<std::vector<std::unique_ptr<BodyPairQuery>>> pairs(
      static_cast<std::size_t>(pool != nullptr ? pool->num_threads() : 1));
  for (auto& of_thread : pairs) {
    for (const auto& shape : shapes) {
      auto made = make_body_pair_query(place, tool, shape, options);
      if (!made) return made.error();
      of_thread.push_back(*std::move(made));
    }
  }
  return std::unique_ptr<BodyBatchQuery>(std::make_unique<BodyBatch>(
      std::move(X_WB), std::move(shape_of_body), std::move(pairs), pool));
}

}}  // namespace palpate::v0
