// Script and log of the fake OpenHaptics.
#pragma once

#include <array>
#include <atomic>
#include <string>

#include "tests/devices/fake_hang.h"

namespace palpate::test {

struct FakeHd {
  Hang hang;

  // The script. Times in mm, mN m and s, as the real one has them.
  std::atomic<unsigned> init_error{0};   ///< of hdInitDevice
  std::atomic<unsigned> start_error{0};  ///< of hdStartScheduler
  std::atomic<unsigned> frame_error{0};  ///< of every hdEndFrame from now on
  std::atomic<unsigned> read_error{0};   ///< of every hdGetDoublev in a frame
  std::atomic<unsigned> calibration{0x5000};
  std::atomic<unsigned> calibration_after_update{0x5000};
  std::atomic<int> calibration_style{4};
  std::atomic<int> input_dof{6}, output_dof{6};
  std::atomic<bool> knows_limits{true};
  std::atomic<double> limit_factor{1};  ///< of all limits
  std::atomic<bool> is_hanging{false};  ///< the scheduler does not call any more
  std::atomic<int> period_microseconds{1000};
  std::array<std::atomic<double>, 16> transform{};  ///< column by column
  std::array<std::atomic<double>, 3> velocity{}, angular_velocity{};
  std::atomic<int> buttons{0};

  // The log.
  std::array<std::atomic<double>, 3> force{}, torque{};  ///< of the newest frame
  std::atomic<double> largest_force{0};
  std::atomic<double> largest_step{0};  ///< up, of the force along x from one frame to the next
  std::atomic<int> num_frames{0}, num_calls{0};
  std::atomic<int> num_idle{0};       ///< times that the hanging scheduler made no call
  std::atomic<int> num_outside{0};    ///< forces set outside a frame
  std::atomic<int> num_illegal{0};    ///< second frame in one call, frames that do not match
  std::atomic<int> num_scheduled{0};  ///< callbacks that are scheduled
  std::atomic<bool> is_scheduler_on{false}, is_enabled{false};
  std::array<std::atomic<bool>, 4> capabilities{};  ///< 0x4000 and the following
  std::atomic<unsigned> updated_style{0};

  std::string opened_name;  ///< of the last hdInitDevice; "(default)" for null

  void (*reset)() = nullptr;  ///< sets script and log as at the start
};

}  // namespace palpate::test

extern "C" palpate::test::FakeHd* fake_hd();
