// Script and log of the fake Force Dimension SDK.
#pragma once

#include <array>
#include <atomic>

#include "tests/devices/fake_hang.h"

namespace palpate::test {

struct FakeDhd {
  Hang hang;

  // The script.
  std::atomic<int> version_major{3}, version_minor{17};
  std::atomic<int> num_devices{1}, num_available{1};
  std::atomic<int> first_free{0};  ///< devices before this one are in use
  std::atomic<int> system_type{104};
  std::atomic<bool> is_initialized{true}, has_wrist{true}, has_active_wrist{true};
  std::atomic<int> read_result{0}, write_result{0}, status_result{0}, enable_result{0};
  std::atomic<bool> takes_force{true};  ///< false: reports that the force is off
  std::atomic<int> force_off_cause{0};
  std::array<std::atomic<double>, 3> position{}, velocity{}, angular_velocity{};
  std::array<std::atomic<double>, 9> rotation{};  ///< row by row
  std::atomic<unsigned> buttons{0};

  // The log.
  std::array<std::atomic<double>, 7> wrench{};  ///< force, torque, gripper: sent last
  std::atomic<double> largest_force{0}, max_force{0}, max_torque{0};
  std::atomic<double> largest_step{0};  ///< up, of the force along x from one write to the next
  std::atomic<int> gravity{0};
  std::atomic<bool> is_force_enabled{false};
  std::atomic<int> num_writes{0}, num_forces_while_off{0};
  std::atomic<int> num_open{0}, last_opened{-1};
  std::atomic<int> num_forbidden{0};  ///< calls that move it or change factory settings

  void (*reset)() = nullptr;  ///< sets script and log as at the start
};

}  // namespace palpate::test

extern "C" palpate::test::FakeDhd* fake_dhd();
