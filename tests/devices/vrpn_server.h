// A VRPN server with one Falcon, as far as a client can tell, over real sockets: its positions, its
// smoothing of force fields, a virtual hand, and faults.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate::test {

struct VrpnServerOptions {
  std::string device = "Falcon0";
  std::string cookie = "vrpn: ver. 07.35  0";
  double smoothing = 0.9;    ///< of the field's parameters, per report
  double velocity_unit = 1;  ///< what velocities are multiplied by; a real Falcon's: 1e-6
  bool reports_velocity = true;
  int rate = 1000;  ///< reports per second
};

/// The force law of NovintFalcon's server: parameters are smoothed at every report, and the radius
/// begins at zero again with every message.
class FalconField {
 public:
  explicit FalconField(double smoothing) : smoothing_(smoothing) {}
  /// origin, force, jacobian, radius, as on the wire
  void set(const std::array<float, 16>& field) {
    desired_ = field;
    current_[15] = 0;
    is_active_ = true;
  }
  Vec3d force_at(const Vec3d& position);

 private:
  double smoothing_;
  bool is_active_ = false;
  std::array<float, 16> desired_{};
  std::array<double, 16> current_{};
};

class VrpnServer {
 public:
  explicit VrpnServer(const VrpnServerOptions& options = {});
  ~VrpnServer();

  int port() const { return port_; }

  std::atomic<bool> is_silent = false;      ///< sends nothing
  std::atomic<bool> sends_garbage = false;  ///< instead of reports
  std::atomic<bool> sends_huge_length = false;
  std::atomic<bool> stops_in_message = false;  ///< half a message, then nothing
  std::atomic<bool> closes = false;
  std::atomic<bool> dribbles = false;         ///< every message in two parts
  std::atomic<bool> has_no_clock = false;     ///< all stamps are zero
  std::atomic<bool> ends_velocities = false;  ///< one of 1 m/s along x, then no more
  std::atomic<bool> trembles = false;         ///< no two positions are the same
  std::atomic<bool> is_wild = false;          ///< positions and rotations that cannot be
  std::atomic<int> force_error = 4;           ///< 4: none
  std::atomic<std::uint32_t> buttons = 0;

  void set_target(const Vec3d& target, const Quaternion& rotation = {});
  Vec3d hand_position() const;
  Vec3d hand_force() const;
  std::vector<std::array<float, 16>> fields() const;
  std::vector<std::string> names() const;  ///< types that clients have said to send
  int num_bad_messages() const { return num_bad_messages_; }

 private:
  void accept();
  void serve(int socket);
  bool report(int socket, int number);
  bool send(int socket, std::int32_t sender, std::int32_t type, const std::string& payload);
  void take(std::string& received);

  const VrpnServerOptions options_;
  int listener_ = -1, port_ = 0;
  std::atomic<bool> is_stopping_ = false;
  std::atomic<int> num_bad_messages_ = 0;

  mutable std::mutex mutex_;
  Vec3d target_, position_, velocity_, force_;
  Quaternion rotation_;
  FalconField field_;
  bool have_ended_ = false;
  std::vector<std::array<float, 16>> fields_;
  std::vector<std::string> names_;
  std::int32_t field_type_ = -100, last_sequence_ = -1;
  std::uint32_t reported_buttons_ = 0;
  std::chrono::steady_clock::time_point last_report_ = std::chrono::steady_clock::now();
  std::thread thread_;
};

}  // namespace palpate::test
