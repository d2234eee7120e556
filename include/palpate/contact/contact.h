// One tool at one place: how much of it is inside a surface.
#pragma once

#include <memory>
#include <utility>

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
    return Contact(tool, std::move(pool), *std::move(query));
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
  /// The share of the tool that a volume is.
  double fraction(const Penetration& penetration) const {
    return penetration.volume / full_volume_;
  }
  const ContactQuery& query() const { return *query_; }

 private:
  Contact(const Tool& tool, std::unique_ptr<ThreadPool> pool, std::unique_ptr<ContactQuery> query)
      : full_volume_(palpate::full_volume(tool, contact_options(query->method()))),
        pool_(std::move(pool)),
        query_(std::move(query)) {}

  double full_volume_;
  std::unique_ptr<ThreadPool> pool_;
  std::unique_ptr<ContactQuery> query_;
};

}  // namespace palpate
