#include "palpate/haptics/device.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "src/core/internal/triple_buffer.h"
#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kUnitWithin = 1e-3;    // of a quaternion's length
constexpr double kWorkspaceRadius = 1;  // m

Error refused(const char* format, auto... values) {
  char text[200];
  std::snprintf(text, sizeof text, format, values...);
  return {Errc::invalid_argument, text};
}

}  // namespace

struct PageHandle::Mailbox {
  TripleBuffer<Update> news;
};

PageHandle::PageHandle() : mailbox_(std::make_unique<Mailbox>()) {}
PageHandle::~PageHandle() = default;

DeviceLimits PageHandle::limits() {
  // At the largest force the spring is as long as a thumb is wide. As with other devices, damping
  // makes that stiffness passive at 1 kHz.
  return {.max_force = 10,
          .max_torque = 0.6,
          .max_stiffness = 400,
          .max_angular_stiffness = 2,
          .max_damping = 15,
          .workspace_radius = kWorkspaceRadius,
          .damping = 0.2,
          .angular_damping = 1e-3};
}

Status PageHandle::hold(PageNumber page, double now) {
  if (holder_ != 0 && holder_ != page && now - last_time_ <= kPatience) {
    return Error{Errc::unavailable, "another page holds the tool; wait until it releases it"};
  }
  holder_ = page;
  last_time_ = now;
  grip_anew();
  return Done{};
}

Status PageHandle::move(PageNumber page, const Pose& X_BH, double now) {
  if (page != holder_) {
    return Error{Errc::unavailable, holder_ == 0 ? "the tool is not held: take hold of it first"
                                                 : "another page holds the tool"};
  }
  if (const Status status = check(X_BH, now); !status) return status.error();
  sent_grip_ = grip_;
  last_time_ = now;
  last_X_BH_ = {X_BH.translation, normalized(X_BH.rotation)};
  mailbox_->news.publish({grip_, true, now, last_X_BH_});
  return Done{};
}

Status PageHandle::check(const Pose& X_BH, double now) const {
  const double length = std::hypot(std::hypot(X_BH.rotation.x, X_BH.rotation.y),
                                   std::hypot(X_BH.rotation.z, X_BH.rotation.w));
  if (!is_finite(X_BH) || !(norm(X_BH.translation) <= kFarthest)) {
    return refused("a pose of the hand must be finite and within %g m", kFarthest);
  }
  if (!(std::abs(length - 1) <= kUnitWithin)) {
    return refused("the rotation of the hand must be a unit quaternion; its length is %.4g",
                   length);
  }
  if (sent_grip_ != grip_) return Done{};
  const double seconds = std::max(now - last_time_, 0.0) + kBunch;
  const double way = norm(X_BH.translation - last_X_BH_.translation);
  const double turn = norm(rotation_between(last_X_BH_.rotation, normalized(X_BH.rotation)));
  if (way <= kFastest * seconds && turn <= kFastestTurn * seconds) return Done{};
  return refused(
      "the hand has jumped by %.3g m and %.3g rad; the limits are %g m/s and %g rad/s; continue "
      "from the previous pose",
      way, turn, kFastest, kFastestTurn);
}

void PageHandle::release(PageNumber page) {
  if (page == 0 || page != holder_) return;
  holder_ = 0;
  mailbox_->news.publish({grip_, false, last_time_, last_X_BH_});
}

const PageHandle::Update* PageHandle::newest() noexcept {
  return mailbox_->news.refresh() ? &mailbox_->news.value() : nullptr;
}

}}  // namespace palpate::v0
