// A contact query between two frames.
#pragma once

#include <memory>

#include "palpate/contact/contact_query.h"
#include "palpate/field/surface_timeline.h"

namespace palpate {

/// Measures against both surfaces of a moment at the tool's pose, and weighs the two. The force so
/// goes from the one to the other over the frame, whatever changed between them and by any method,
/// and with `field` it is at every instant the exact gradient of one potential,
/// (1 - progress) U_from + progress U_to. Takes twice the time of a query, except at
/// progress 1 and by `field` on a GPU.
///
/// Counts, states and planes are those of the newer surface.
class BlendedQuery final : public ContactQuery {
 public:
  explicit BlendedQuery(std::unique_ptr<ContactQuery> query);

  /// What the next queries look at. The views must stay valid. O(1).
  void set_moment(const SurfaceMoment& moment) noexcept { moment_ = moment; }
  /// These leave nothing to blend.
  void set_cloud(const PointCloudView& cloud) noexcept override;
  void set_field(const DepthFieldView& field) noexcept override;

  Penetration query(const Pose& X_WT, const ContactOptions& options) noexcept override;
  Stiffness stiffness() const noexcept override;
  std::span<const SphereState> states() const noexcept override { return query_->states(); }
  std::span<const Plane<float>> planes() const noexcept override { return query_->planes(); }

 private:
  Penetration query_one(const Surfaces& surfaces) const noexcept;

  std::unique_ptr<ContactQuery> query_;
  SurfaceMoment moment_;
  Pose X_WT_;  // of the last query, as what follows
  ContactOptions options_;
  bool is_one_query_ = true;  // of the wrapped one
};

}  // namespace palpate
