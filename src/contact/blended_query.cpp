#include "palpate/contact/blended_query.h"

#include <utility>

namespace palpate {

BlendedQuery::BlendedQuery(std::unique_ptr<ContactQuery> query) : query_(std::move(query)) {}

void BlendedQuery::set_cloud(const PointCloudView& cloud) noexcept {
  moment_.to.cloud = cloud;
  moment_.progress = 1;
}

void BlendedQuery::set_field(const DepthFieldView& field) noexcept {
  moment_.to.field = field;
  moment_.progress = 1;
}

Penetration BlendedQuery::query_one(const Surfaces& surfaces) const noexcept {
  query_->set_cloud(surfaces.cloud);
  query_->set_field(surfaces.field);
  return query_->query(X_WT_, options_);
}

Penetration BlendedQuery::query(const Pose& X_WT, const ContactOptions& options) noexcept {
  X_WT_ = X_WT;
  options_ = options;
  const double t = moment_.progress, s = 1 - t;
  is_one_query_ = true;
  if (t >= 1) return query_one(moment_.to);
  if (options.method == InsideMethod::field) {
    const auto both =
        query_->query_between(moment_.from.field, moment_.to.field, t, X_WT, options.counted());
    if (both) return *both;
  }
  is_one_query_ = false;
  const Penetration from = query_one(moment_.from);
  Penetration both = query_one(moment_.to);
  both.volume = s * from.volume + t * both.volume;
  both.potential = s * from.potential + t * both.potential;
  both.measure_W.force = s * from.measure_W.force + t * both.measure_W.force;
  both.measure_W.torque = s * from.measure_W.torque + t * both.measure_W.torque;
  both.status |= from.status;
  return both;
}

Stiffness BlendedQuery::stiffness() const noexcept {
  if (is_one_query_) return query_->stiffness();
  const double t = moment_.progress, s = 1 - t;
  query_one(moment_.from);
  const Stiffness from = query_->stiffness();
  query_one(moment_.to);  // states and planes are its again
  Stiffness both = query_->stiffness();
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      both.m[row][column] = s * from.m[row][column] + t * both.m[row][column];
    }
  }
  return both;
}

}  // namespace palpate
