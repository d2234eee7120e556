// Contact queries of one tool by any options, for tests that compare methods.
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"

namespace palpate::test {

/// Queries by one method after the other, which share an index.
class ContactQueries {
 public:
  using Make = std::function<Result<std::unique_ptr<ContactQuery>>(
      std::shared_ptr<const ToolIndex> index, const ContactMethod& method)>;

  /// `tool` must outlive it.
  ContactQueries(const Tool& tool, Make make)
      : index_(ToolIndex::create(tool)), make_(std::move(make)) {}
  /// On the CPU.
  explicit ContactQueries(const Tool& tool, const ExecutionOptions& execution = {})
      : ContactQueries(
            tool, [=](std::shared_ptr<const ToolIndex> index, const ContactMethod& method) {
              return make_contact_query(Place::cpu(), std::move(index), method, execution);
            }) {}
  ContactQueries(const Tool&&, Make) = delete;
  explicit ContactQueries(const Tool&&, const ExecutionOptions& = {}) = delete;

  /// Returns the query by these options. The first call makes it.
  const ContactQuery& by(const ContactOptions& options) {
    for (const auto& [its_options, query] : queries_) {
      if (its_options == options) return *query;
    }
    queries_.emplace_back(options, make_(index_, contact_method(options).value()).value());
    return *queries_.back().second;
  }
  Penetration measure(const SurfaceView& surface, const Pose& X_WT, const ContactOptions& options) {
    return by(options).measure(surface, X_WT).penetration;
  }

 private:
  std::shared_ptr<const ToolIndex> index_;
  Make make_;
  std::vector<std::pair<ContactOptions, std::unique_ptr<ContactQuery>>> queries_;
};

/// A contact with stiffness, states and planes.
struct WholeContact : ContactResult {
  std::vector<SphereState> states;
  std::vector<Plane<float>> planes;
};

inline WholeContact whole_contact(const ContactQuery& query, const SurfaceView& from,
                                  const SurfaceView& to, double alpha, const Pose& X_WT) {
  WholeContact whole;
  whole.states.resize(query.index()->tool().spheres().size());
  whole.planes.resize(whole.states.size());
  static_cast<ContactResult&>(whole) = query.measure(
      from, to, alpha, X_WT, {.stiffness = true, .states = whole.states, .planes = whole.planes});
  return whole;
}

inline WholeContact whole_contact(const ContactQuery& query, const SurfaceView& surface,
                                  const Pose& X_WT) {
  return whole_contact(query, surface, surface, 1, X_WT);
}

}  // namespace palpate::test
