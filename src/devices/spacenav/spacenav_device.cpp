// A 6-DOF mouse (SpaceNavigator and relatives) by way of spacenavd: how far its cap is pushed is
// how fast the handle moves. It pushes nobody back.
#include <algorithm>
#include <string>
#include <utility>

#include "src/devices/device_kinds.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/internal/twist_between.h"
#include "src/devices/spacenav/spacenav_connection.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kDeadZone = 10,
                 kFullScale = 350;      // counts of a cap that is not touched, and pushed
constexpr double kFastest = 0.1;        // m/s at full scale
constexpr double kFastestTurn = 1;      // rad/s
constexpr double kWorkspaceRadius = 1;  // m, so that the handle is not lost
// A cap that is held trembles, so the daemon has something to say all the time. It may be silent at
// the very end of its way; there its setting repeat-interval = 250 helps.
constexpr double kMaxSilence = 0.5;  // s until the handle stands still
constexpr double kMaxStep = 0.02;    // s that a handle moves on between two ticks
constexpr int kMaxEvents = 64;       // per tick

/// Share of the full scale, -1..1, without a step at the edge of the dead zone.
double share(std::int32_t counts) {
  const double size = std::abs(static_cast<double>(counts));
  const double rest = std::clamp((size - kDeadZone) / (kFullScale - kDeadZone), 0.0, 1.0);
  return counts < 0 ? -rest : rest;
}

/// The daemon's axes are x right, y up, z away from the user, and turns are about x, y and -z of
/// the right-handed x right, y up, z to the user, which is B (libspnav, spnav_posrot_moveobj).
Twist twist_of(const SpacenavConnection::Event& motion) {
  const auto axis = [&motion](int i) { return share(motion[static_cast<std::size_t>(i)]); };
  return {kFastest * Vec3d{axis(1), axis(2), -axis(3)},
          kFastestTurn * Vec3d{axis(4), axis(5), -axis(6)}};
}

class Spacenav final : public PolledDevice {
 public:
  Spacenav(std::string path, SpacenavConnection connection)
      : path_(std::move(path)), connection_(std::move(connection)) {
    info_.kind = "spacenav";
    info_.name = "6-DOF mouse at " + path_;
    info_.limits = input_only_limits();
    info_.limits.workspace_radius = kWorkspaceRadius;
    info_.num_buttons = 2;
  }

  Status begin() override {
    if (!connection_.is_open()) {
      auto connection = SpacenavConnection::open(path_);
      if (!connection) return connection.error();
      connection_ = std::move(*connection);
    }
    last_time_ = last_event_time_ = 0;
    answer_ = SpacenavConnection::Answer::nothing_yet;
    return Done{};
  }

  bool read(DeviceState& state) noexcept override {
    if (last_time_ > 0) move(state, std::min(state.time - last_time_, kMaxStep));
    last_time_ = state.time;

    SpacenavConnection::Event event;
    for (int i = 0; i < kMaxEvents; ++i) {
      answer_ = connection_.next(event);
      if (answer_ != SpacenavConnection::Answer::event) break;
      last_event_time_ = state.time;
      if (event[0] == SpacenavConnection::kMotion) {
        state.V_BH = twist_of(event);
      } else if (event[1] >= 0 && event[1] < 32) {
        const std::uint32_t button = std::uint32_t{1} << event[1];
        if (event[0] == SpacenavConnection::kPress)
          state.buttons |= button;
        else
          state.buttons &= ~button;
      }
    }
    if (state.time - last_event_time_ > kMaxSilence) state.V_BH = {};
    state.is_valid = true;
    return answer_ == SpacenavConnection::Answer::event ||
           answer_ == SpacenavConnection::Answer::nothing_yet;
  }

  bool write(const Wrench&) noexcept override { return true; }
  void end() noexcept override { connection_ = SpacenavConnection(); }

  Error trouble() const override {
    if (answer_ == SpacenavConnection::Answer::not_understood)
      return {Errc::bad_input,
              "the server at " + path_ + " is not spacenavd; check the socket's path"};
    return {Errc::io_failure,
            "spacenavd at " + path_ +
                " has closed the connection; see whether it runs and the mouse is "
                "plugged in, then start again"};
  }

 private:
  static void move(DeviceState& state, double seconds) {
    state.X_BH = moved(state.X_BH, state.V_BH, seconds);
    const double distance = norm(state.X_BH.translation);
    if (distance > kWorkspaceRadius) state.X_BH.translation *= kWorkspaceRadius / distance;
  }

  std::string path_;
  SpacenavConnection connection_;
  double last_time_ = 0, last_event_time_ = 0;
  SpacenavConnection::Answer answer_ = SpacenavConnection::Answer::nothing_yet;
};

}  // namespace

Result<std::unique_ptr<HapticDevice>> open_spacenav_device(std::string_view address) {
  std::string path = spacenav_socket_path(address);
  auto connection = SpacenavConnection::open(path);
  if (!connection) return connection.error();
  return std::unique_ptr<HapticDevice>(std::make_unique<PollingDevice>(
      std::make_unique<Spacenav>(std::move(path), std::move(*connection))));
}

FoundDevice find_spacenav_device() {
  const std::string path = spacenav_socket_path("");
  const auto connection = SpacenavConnection::open(path);
  if (connection) return {"spacenav:" + path, "spacenav", true, "spacenavd listens at " + path, ""};
  return {"spacenav", "spacenav", false, "no spacenavd at " + path,
          "install and start spacenavd and plug a 6-DOF mouse in, or give spacenav:SOCKET"};
}

}}  // namespace palpate::v0
