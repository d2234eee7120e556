// A shared library that looks like OpenHaptics' libHD: the same names and the same C interface,
// written down here a second time from its documentation; with a scheduler thread of its own.
#include "tests/devices/fake_hd.h"

#include <chrono>
#include <cmath>
#include <cstring>
#include <mutex>
#include <thread>
#include <vector>

namespace {

using HDuint = unsigned int;
using HDenum = unsigned int;
using HDerror = unsigned int;
using HHD = unsigned int;
using HDushort = unsigned short;
using HDSchedulerHandle = unsigned long;
using HDCallbackCode = unsigned int;
using HDSchedulerCallback = HDCallbackCode (*)(void*);

struct HDErrorInfo {
  HDerror errorCode;
  int internalErrorCode;
  HHD hHD;
};

constexpr HHD kDevice = 7;
constexpr HDSchedulerHandle kHandle = 0x100000001;  // longer than an int

palpate::test::FakeHd g_fake;
std::mutex g_mutex;  // of the errors and the call back
std::vector<HDErrorInfo> g_errors;
HDSchedulerCallback g_callback = nullptr;
void* g_user_data = nullptr;
struct Scheduler {
  std::thread thread;
  void stop() {
    g_fake.is_scheduler_on = false;
    if (thread.joinable()) thread.join();
  }
  ~Scheduler() { stop(); }
} g_scheduler;

bool g_is_in_frame = false;      // of the scheduler's thread
int g_num_frames_this_call = 0;  // likewise
double g_force[3], g_torque[3];  // likewise

void raise(HDerror code) {
  if (code == 0) return;
  const std::lock_guard lock(g_mutex);
  g_errors.push_back({code, 11, kDevice});
}

void call() {
  HDSchedulerCallback callback;
  void* user_data;
  {
    const std::lock_guard lock(g_mutex);
    callback = g_callback;
    user_data = g_user_data;
  }
  if (callback == nullptr) return;
  g_num_frames_this_call = 0;
  ++g_fake.num_calls;
  if (callback(user_data) == 1) return;
  const std::lock_guard lock(g_mutex);
  g_callback = nullptr;
  --g_fake.num_scheduled;
}

void schedule() {
  while (g_fake.is_scheduler_on) {
    if (g_fake.is_hanging) {
      ++g_fake.num_idle;
    } else {
      call();
    }
    std::this_thread::sleep_for(std::chrono::microseconds(g_fake.period_microseconds));
  }
}

void reset() {
  g_fake.hang.in = nullptr;
  g_fake.init_error = g_fake.start_error = g_fake.frame_error = g_fake.read_error = 0;
  g_fake.calibration = g_fake.calibration_after_update = 0x5000;
  g_fake.calibration_style = 4;
  g_fake.input_dof = g_fake.output_dof = 6;
  g_fake.knows_limits = true;
  g_fake.limit_factor = 1;
  g_fake.is_hanging = false;
  g_fake.period_microseconds = 1000;
  for (int i = 0; i < 16; ++i) g_fake.transform[i] = i % 5 == 0;
  for (int i = 0; i < 3; ++i)
    g_fake.velocity[i] = g_fake.angular_velocity[i] = g_fake.force[i] = g_fake.torque[i] = 0;
  g_fake.buttons = 0;
  g_fake.largest_force = g_fake.largest_step = 0;
  g_fake.num_frames = g_fake.num_calls = g_fake.num_idle = g_fake.num_outside = g_fake.num_illegal =
      0;
  for (auto& capability : g_fake.capabilities) capability = false;
  g_fake.updated_style = 0;
  g_fake.opened_name.clear();
  const std::lock_guard lock(g_mutex);
  g_errors.clear();
}

[[maybe_unused]] const bool g_is_ready = (reset(), true);

}  // namespace

#define CALL() g_fake.hang.pass(__func__)

extern "C" {

palpate::test::FakeHd* fake_hd() {
  g_fake.reset = reset;
  return &g_fake;
}

HHD hdInitDevice(const char* name) {
  CALL();
  g_fake.opened_name = name == nullptr ? "(default)" : name;
  raise(g_fake.init_error);
  if (g_fake.init_error != 0) return 0xFFFFFFFF;
  g_fake.is_enabled = true;
  return kDevice;
}
void hdDisableDevice(HHD) {
  CALL();
  g_fake.is_enabled = false;
}
void hdMakeCurrentDevice(HHD) { CALL(); }
void hdBeginFrame(HHD) {
  CALL();
  if (g_is_in_frame || ++g_num_frames_this_call > 1) ++g_fake.num_illegal;
  g_is_in_frame = true;
  std::memset(g_force, 0, sizeof g_force);
  std::memset(g_torque, 0, sizeof g_torque);
}
void hdEndFrame(HHD) {
  CALL();
  if (!g_is_in_frame) ++g_fake.num_illegal;
  g_is_in_frame = false;
  if (g_force[0] - g_fake.force[0] > g_fake.largest_step)
    g_fake.largest_step = g_force[0] - g_fake.force[0];
  for (int i = 0; i < 3; ++i) {
    g_fake.force[i] = g_force[i];
    g_fake.torque[i] = g_torque[i];
  }
  const double force = std::hypot(g_force[0], g_force[1], g_force[2]);
  if (!(force <= g_fake.largest_force)) g_fake.largest_force = force;
  ++g_fake.num_frames;
  raise(g_fake.frame_error);
}
void hdEnable(HDenum capability) {
  CALL();
  g_fake.capabilities.at(capability - 0x4000) = true;
}
void hdDisable(HDenum capability) {
  CALL();
  g_fake.capabilities.at(capability - 0x4000) = false;
}
void hdGetDoublev(HDenum what, double* values) {
  CALL();
  switch (what) {
    case 0x2052:
      for (int i = 0; i < 16; ++i) values[i] = g_fake.transform[i];
      return raise(g_fake.read_error);
    case 0x2051:
      for (int i = 0; i < 3; ++i) values[i] = g_fake.velocity[i];
      return;
    case 0x2053:
      for (int i = 0; i < 3; ++i) values[i] = g_fake.angular_velocity[i];
      return;
    default: break;
  }
  if (!g_fake.knows_limits) return raise(0x100);
  const double factor = g_fake.limit_factor;
  switch (what) {
    case 0x2602: values[0] = factor * 0.8; return;    // N/mm
    case 0x2603: values[0] = factor * 8.5; return;    // N
    case 0x2609: values[0] = factor * 0.005; return;  // N s/mm
    case 0x2620: values[0] = factor * 300; return;    // mN m/rad
    case 0x2622: values[0] = factor * 188; return;    // mN m
    case 0x2551:
      for (int i = 0; i < 3; ++i) {
        values[i] = factor * (-80 + 10 * i);
        values[3 + i] = factor * 80;
      }
      return;
    default: return raise(0x100);
  }
}
void hdGetIntegerv(HDenum what, int* values) {
  CALL();
  switch (what) {
    case 0x2000: *values = g_fake.buttons; return;
    case 0x2553: *values = g_fake.input_dof; return;
    case 0x2554: *values = g_fake.output_dof; return;
    case 0x2555: *values = g_fake.calibration_style; return;
    default: return raise(0x100);
  }
}
const char* hdGetString(HDenum what) {
  CALL();
  return what == 0x2501 ? "PHANTOM Premium" : "012345";
}
void hdSetDoublev(HDenum what, const double* values) {
  CALL();
  if (!g_is_in_frame) ++g_fake.num_outside;
  std::memcpy(what == 0x2700 ? g_force : g_torque, values, sizeof g_force);
}
HDErrorInfo hdGetError() {
  CALL();
  const std::lock_guard lock(g_mutex);
  if (g_errors.empty()) return {};
  const HDErrorInfo error = g_errors.back();
  g_errors.pop_back();
  return error;
}
const char* hdGetErrorString(HDerror code) {
  CALL();
  return code == 0x200 ? "HD_WARM_MOTORS" : code == 0x302 ? "HD_COMM_ERROR" : "HD_ERROR";
}
HDenum hdCheckCalibration() {
  CALL();
  return g_fake.calibration;
}
void hdUpdateCalibration(HDenum style) {
  CALL();
  g_fake.updated_style = style;
  g_fake.calibration = g_fake.calibration_after_update.load();
}
HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback callback, void* user_data, HDushort) {
  CALL();
  const std::lock_guard lock(g_mutex);
  g_callback = callback;
  g_user_data = user_data;
  ++g_fake.num_scheduled;
  return kHandle;
}
void hdStartScheduler() {
  CALL();
  raise(g_fake.start_error);
  if (g_fake.start_error != 0 || g_fake.is_scheduler_on) return;
  g_scheduler.stop();
  g_fake.is_scheduler_on = true;
  g_scheduler.thread = std::thread(schedule);
}
void hdStopScheduler() {
  CALL();
  g_scheduler.stop();
}

#if !defined(FAKE_HD_IS_INCOMPLETE)
void hdUnschedule(HDSchedulerHandle handle) {
  CALL();
  const std::lock_guard lock(g_mutex);
  if (handle != kHandle || g_callback == nullptr) return;
  g_callback = nullptr;
  --g_fake.num_scheduled;
}
#endif

}  // extern "C"
