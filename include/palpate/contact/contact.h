// One tool at one place: how much of it is inside a surface.
#pragma once

#include <memory>
#include <utility>

#include "palpate/contact/contact_batch.h"
#include "palpate/contact/contact_query.h"

namespace palpate {

/// A ContactQuery of a tool with the threads that it needs. One thread at a time.
class Contact {
 public:
  /// `tool` must outlive it. On a CPU a measurement runs on the caller's thread and on
  /// `num_threads` - 1 more (0: one per core), which pay for tools of more than about 50,000
  /// spheres. Errors: the place is not in this build or on this machine.
  static Result<Contact> create(const Tool& tool, const ContactMethod& method = FieldMethod{},
                                const Place& place = Place::cpu(), int num_threads = 1) {
    auto pool = std::make_unique<ThreadPool>(num_threads);
    auto query =
        make_contact_query(place.backend, tool, method, {best_isa(), pool.get(), place.gpu});
    if (!query) return query.error();
    return Contact(tool, place, std::move(pool), *std::move(query));
  }
  static Result<Contact> create(const Tool&&, const ContactMethod& = FieldMethod{},
                                const Place& = Place::cpu(), int = 1) = delete;

  /// As ContactQuery::measure: the tool at the pose X_WT. No allocation.
  ContactResult measure(const SurfaceView& surface, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return query_->measure(surface, X_WT, wants);
  }
  /// Between two surfaces, alpha of the way from the one to the other.
  ContactResult measure(const SurfaceView& from, const SurfaceView& to, double alpha,
                        const Pose& X_WT, const ContactWants& wants = {}) const noexcept {
    return query_->measure(from, to, alpha, X_WT, wants);
  }
  /// Against what several cameras know together, each somewhere in the world.
  ContactResult measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                        const ContactWants& wants = {}) const noexcept {
    return query_->measure(cameras, X_WT, wants);
  }
  /// As BatchQuery::measure: many poses in one call, by FieldMethod. On a CPU over all cores. The
  /// first call takes threads and memory for it.
  Status measure_batch(const SurfaceBatch& surfaces, const PoseBatch& poses,
                       const BatchAnswers& answers, std::optional<CallerStream> stream = {}) const {
    if (const Status status = make_batches(); !status) return status;
    return batches_->measure(surfaces, poses, answers, stream);
  }
  /// So that the first batch need not: memory for so many surfaces, and poses in host memory.
  Status reserve_batch(int num_surfaces, int num_poses = 0) const {
    if (const Status status = make_batches(); !status) return status;
    return batches_->reserve(num_surfaces, num_poses);
  }
  /// The share of the tool that a volume is.
  double fraction(const Penetration& penetration) const {
    return penetration.volume / full_volume_;
  }
  const ContactQuery& query() const { return *query_; }

 private:
  Contact(const Tool& tool, const Place& place, std::unique_ptr<ThreadPool> pool,
          std::unique_ptr<ContactQuery> query)
      : full_volume_(palpate::full_volume(tool, contact_options(query->method()))),
        place_(place),
        pool_(std::move(pool)),
        query_(std::move(query)) {}

  Status make_batches() const {
    if (batches_ != nullptr) return Done{};
    auto pool = std::make_unique<ThreadPool>(place_.backend == Backend::cpu ? 0 : 1);
    auto made = make_batch_query(place_.backend, query_->index(), query_->method(),
                                 {best_isa(), pool.get(), place_.gpu});
    if (!made) return made.error();
    batch_pool_ = std::move(pool);
    batches_ = *std::move(made);
    return Done{};
  }

  double full_volume_;
  Place place_;
  std::unique_ptr<ThreadPool> pool_;
  std::unique_ptr<ContactQuery> query_;
  mutable std::unique_ptr<ThreadPool> batch_pool_;
  mutable std::unique_ptr<BatchQuery> batches_;
};

}  // namespace palpate
