// Queries of a tool by one method after the other, for studies that compare methods.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "palpate/contact/contact.h"

namespace palpate::eval {

/// Queries on one surface or between two. A query is made when its method is first used; all share
/// an index.
class MethodQueries {
 public:
  using MakeQuery = std::function<Result<std::unique_ptr<ContactQuery>>(
      std::shared_ptr<const ToolIndex> index, const ContactMethod& method)>;

  MethodQueries(std::shared_ptr<const ToolIndex> index, MakeQuery make)
      : index_(std::move(index)),
        make_(std::move(make)),
        states_(index_->tool().spheres().size()),
        planes_(states_.size()) {}
  /// `tool` must outlive it.
  MethodQueries(Backend backend, const Tool& tool, const ExecutionOptions& execution = {})
      : MethodQueries(ToolIndex::create(tool),
                      [=](std::shared_ptr<const ToolIndex> index, const ContactMethod& method) {
                        return make_contact_query({backend}, std::move(index), method, execution);
                      }) {}
  MethodQueries(Backend, const Tool&&, const ExecutionOptions& = {}) = delete;

  void set_blend(const SurfaceBlend& blend) { blend_ = blend; }
  void set_cloud(const PointCloudView& cloud) {
    blend_.to.cloud = cloud;
    blend_.progress = 1;
  }
  void set_field(const DepthFieldView& field) {
    blend_.to.field = field;
    blend_.progress = 1;
  }

  Penetration query(const Pose& X_WT, const ContactOptions& options) {
    last_ = &by(options);
    X_WT_ = X_WT;
    return evaluate({}).penetration;
  }
  /// Stiffness of the last query, measured again; zero if the method has none.
  Stiffness stiffness() { return evaluate({.stiffness = true}).stiffness.value_or(Stiffness{}); }
  VolumeMoments moments() { return evaluate({.stiffness = true}).moments; }
  std::span<const SphereState> states() {
    evaluate({.states = states_});
    return states_;
  }
  std::span<const Plane<float>> planes() {
    evaluate({.planes = planes_});
    return planes_;
  }

  const ContactQuery& by(const ContactOptions& options) {
    for (const auto& [its_options, query] : queries_) {
      if (its_options == options) return *query;
    }
    const ContactMethod method = contact_method(options).value();
    queries_.emplace_back(options, make_(index_, method).value());
    return *queries_.back().second;
  }

 private:
  ContactResult evaluate(const ContactWants& wants) {
    return last_->measure(blend_.from, blend_.to, blend_.progress, X_WT_, wants);
  }

  std::shared_ptr<const ToolIndex> index_;
  MakeQuery make_;
  std::vector<std::pair<ContactOptions, std::unique_ptr<ContactQuery>>> queries_;
  const ContactQuery* last_ = nullptr;
  SurfaceBlend blend_;
  Pose X_WT_;
  std::vector<SphereState> states_;
  std::vector<Plane<float>> planes_;
};

}  // namespace palpate::eval
