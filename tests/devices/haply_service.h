// Haply's Inverse Service as far as a client can tell, over real sockets: a virtual Inverse3 in a
// virtual hand, and the faults of real ones.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate::test {

struct HaplyServiceOptions {
  std::string version = R"({"version":"3.5.2"})";  ///< body of GET /version; empty: 404
  bool accepts_vector = true, accepts_values = true;
  bool echoes_forces = true;        ///< states tell current_cursor_force at all
  std::string grip = "verse_grip";  ///< its kind; empty: none
  std::string preset = "defaults";  ///< of the arm's mount; empty: it does not say
  bool has_arm = true;
  bool has_events = true;
  double force_timeout = 0.01;  ///< s without a message, then the force is forgotten
};

class HaplyService {
 public:
  explicit HaplyService(const HaplyServiceOptions& options = {});
  ~HaplyService();

  int port() const;
  int event_port() const;

  /// Faults of the service from now on; may be set at any time.
  struct Faults {
    std::atomic<int> reply_delay = 0;  ///< ms
    std::atomic<bool> is_silent = false;
    std::atomic<bool> says_garbage = false;
    std::atomic<bool> leaves_fields_out = false;
    std::atomic<bool> is_calibrated = true;
    std::atomic<bool> has_vanished = false;
    std::atomic<bool> closes_in_message = false;
    std::atomic<bool> fragments_messages = false;
    std::atomic<bool> pings = false;
    std::atomic<bool> is_grip_connected = true;
  };
  Faults faults;

  std::atomic<std::uint32_t> buttons = 0;
  /// Sets the position that the hand moves to; it starts there.
  void set_target(const Vec3d& target);
  void set_orientation(const Quaternion& orientation);
  void push_event(std::string_view json);

  /// Observations so far. Forces: one per message that set one, in order.
  std::vector<Vec3d> forces() const;
  Vec3d last_force() const;  ///< zero if there was none
  std::vector<std::string> messages() const;
  Vec3d hand_position() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate::test
