#include "palpate/devices/devices.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/devices/device_kinds.h"
#include "src/devices/internal/twist_between.h"
#include "src/devices/software/page_hand.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMaxStep = 0.02;  // s that a handle moves on between two ticks

/// v, no longer than `limit`.
Vec3d limited(const Vec3d& v, double limit) {
  const double length = norm(v);
  return length > limit ? v * (limit / length) : v;
}

/// Motion of a critically damped spring in `seconds` towards a target at `away`, and its velocity
/// then.
struct Followed {
  Vec3d way, velocity;
};
Followed followed(const Vec3d& away, const Vec3d& velocity, double fastest, double seconds) {
  constexpr double w = PageHand::kFollow;
  const Vec3d y = -limited(away, 2 * fastest / w);
  const Vec3d rate = velocity + w * y;
  const double decay = std::exp(-w * seconds);
  return {(y + rate * seconds) * decay - y, (velocity - rate * (w * seconds)) * decay};
}

}  // namespace

PageHand::PageHand(std::shared_ptr<PageHandle> handle) : handle_(std::move(handle)) {
  info_.kind = "page";
  info_.name = "a hand on the page";
  info_.limits = PageHandle::limits();
  info_.num_buttons = 1;
}

Status PageHand::begin() {
  handle_->newest();
  update_ = {};  // the previous holder has to send again
  felt_ = {};
  last_time_ = held_time_ = 0;
  return Done{};
}

bool PageHand::read(DeviceState& state) noexcept {
  const double seconds = last_time_ > 0 ? std::clamp(state.time - last_time_, 0.0, kMaxStep) : 0.0;
  last_time_ = state.time;
  if (const PageHandle::Update* news = handle_->newest()) take(*news, state.X_BH);

  const bool is_held = update_.is_held && state.time - update_.time <= kSilence;
  if (is_held) held_time_ = state.time;
  const bool gives_way = held_time_ > 0 && state.time - held_time_ <= kGivesWay;
  if (is_held) {
    follow(state, seconds);
  } else if (gives_way) {
    yield_to_spring(state, seconds);
  } else {
    state.V_BH = {};
  }
  if (const double far = norm(state.X_BH.translation), most = info_.limits.workspace_radius;
      far > most) {
    state.X_BH.translation *= most / far;
    state.V_BH.linear = {};
  }
  state.buttons = is_held || gives_way ? 1 : 0;
  state.is_valid = true;
  return true;
}

void PageHand::take(const PageHandle::Update& news, const Pose& X_BH) noexcept {
  if (news.grip != update_.grip) {
    shift_ = X_BH.translation - news.X_BH.translation;
    turn_ = normalized(X_BH.rotation * conjugate(news.X_BH.rotation));
  }
  update_ = news;
  target_ = {news.X_BH.translation + shift_, normalized(turn_ * news.X_BH.rotation)};
}

void PageHand::follow(DeviceState& state, double seconds) const noexcept {
  const auto [way, velocity] =
      followed(target_.translation - state.X_BH.translation, state.V_BH.linear, kFastest, seconds);
  const auto [turn, angular] = followed(rotation_between(state.X_BH.rotation, target_.rotation),
                                        state.V_BH.angular, kFastestTurn, seconds);
  state.X_BH = moved(state.X_BH, {way, turn}, 1);
  state.V_BH = {velocity, angular};
}

/// Moves a handle without mass: a spring that pushes it comes to rest exponentially.
void PageHand::yield_to_spring(DeviceState& state, double seconds) const noexcept {
  const DeviceLimits& limits = info_.limits;
  state.V_BH = {limited(felt_.force / (kYield * limits.max_stiffness), kFastest),
                limited(felt_.torque / (kYield * limits.max_angular_stiffness), kFastestTurn)};
  state.X_BH = moved(state.X_BH, state.V_BH, seconds);
}

bool PageHand::write(const Wrench& F_H_B) noexcept {
  felt_ = F_H_B;
  return true;
}

std::unique_ptr<HapticDevice> make_page_device(std::shared_ptr<PageHandle> handle) {
  return std::make_unique<PollingDevice>(std::make_unique<PageHand>(std::move(handle)));
}

Result<std::unique_ptr<HapticDevice>> open_page_device(std::string_view address) {
  if (!address.empty()) {
    return Error{Errc::invalid_argument, "the device page has no address; give --device page"};
  }
  return Error{
      Errc::unavailable,
      "the device page is held in the page of a live run: palpate touch ... --device page"};
}

FoundDevice find_page_device() {
  return {"page", "page", true,
          "mouse, finger or gamepad in the page of a live run; shows forces instead of giving them",
          ""};
}

}}  // namespace palpate::v0
