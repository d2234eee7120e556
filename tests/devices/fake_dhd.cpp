// A shared library that looks like Force Dimension's libdrd: the same names and the same C
// interface, written down here a second time from its documentation.
#include "tests/devices/fake_dhd.h"

#include <cmath>

namespace {

palpate::test::FakeDhd g_fake;

int fill(const std::array<std::atomic<double>, 3>& from, double* x, double* y, double* z) {
  *x = from[0];
  *y = from[1];
  *z = from[2];
  return g_fake.read_result;
}

int forbidden() {
  ++g_fake.num_forbidden;
  return 0;
}

void reset() {
  g_fake.hang.in = nullptr;
  g_fake.version_major = 3;
  g_fake.version_minor = 17;
  g_fake.num_devices = g_fake.num_available = 1;
  g_fake.first_free = 0;
  g_fake.system_type = 104;
  g_fake.is_initialized = g_fake.has_wrist = g_fake.has_active_wrist = g_fake.takes_force = true;
  g_fake.read_result = g_fake.write_result = g_fake.status_result = g_fake.enable_result =
      g_fake.force_off_cause = 0;
  for (int i = 0; i < 3; ++i) {
    g_fake.position[i] = g_fake.velocity[i] = g_fake.angular_velocity[i] = 0;
    for (int j = 0; j < 3; ++j) g_fake.rotation[3 * i + j] = i == j;
  }
  g_fake.buttons = 0;
  for (auto& part : g_fake.wrench) part = 0;
  g_fake.largest_force = g_fake.largest_step = g_fake.max_force = g_fake.max_torque = 0;
  g_fake.gravity = g_fake.num_writes = g_fake.num_forces_while_off = g_fake.num_forbidden = 0;
  g_fake.is_force_enabled = false;
  g_fake.last_opened = -1;
}

[[maybe_unused]] const bool g_is_ready = (reset(), true);

}  // namespace

using uchar = unsigned char;
using uint = unsigned int;

#define CALL() g_fake.hang.pass(__func__)

extern "C" {

palpate::test::FakeDhd* fake_dhd() {
  g_fake.reset = reset;
  return &g_fake;
}

void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  CALL();
  *major = g_fake.version_major;
  *minor = g_fake.version_minor;
  *release = 1;
  *revision = 99;
}
const char* dhdErrorGetLastStr() {
  CALL();
  return "communication error";
}
int dhdGetDeviceCount() {
  CALL();
  return g_fake.num_devices;
}
int dhdGetAvailableCount() {
  CALL();
  return g_fake.num_available;
}
int drdOpenID(char ID) {
  CALL();
  if (ID < g_fake.first_free || ID >= g_fake.num_devices) return -1;
  ++g_fake.num_open;
  g_fake.last_opened = ID;
  return ID;
}
int drdClose(char) {
  CALL();
  --g_fake.num_open;
  return 0;
}
int dhdGetSystemType(char) {
  CALL();
  return g_fake.system_type;
}
const char* dhdGetSystemName(char) {
  CALL();
  return "sigma.7";
}
bool dhdHasWrist(char) {
  CALL();
  return g_fake.has_wrist;
}
bool dhdHasActiveWrist(char) {
  CALL();
  return g_fake.has_active_wrist;
}
int dhdGetPositionAndOrientationFrame(double* px, double* py, double* pz, double matrix[3][3],
                                      char) {
  CALL();
  for (int i = 0; i < 9; ++i) matrix[i / 3][i % 3] = g_fake.rotation[i];
  return fill(g_fake.position, px, py, pz);
}
int dhdGetLinearVelocity(double* vx, double* vy, double* vz, char) {
  CALL();
  return fill(g_fake.velocity, vx, vy, vz);
}
int dhdGetAngularVelocityRad(double* wx, double* wy, double* wz, char) {
  CALL();
  if (!g_fake.has_wrist) return -1;
  return fill(g_fake.angular_velocity, wx, wy, wz);
}
uint dhdGetButtonMask(char) {
  CALL();
  return g_fake.buttons;
}
int dhdSetForceAndTorqueAndGripperForce(double fx, double fy, double fz, double tx, double ty,
                                        double tz, double f, char) {
  CALL();
  const double parts[7] = {fx, fy, fz, tx, ty, tz, f};
  if (fx - g_fake.wrench[0] > g_fake.largest_step) g_fake.largest_step = fx - g_fake.wrench[0];
  for (int i = 0; i < 7; ++i) g_fake.wrench[i] = parts[i];
  const double force = std::hypot(fx, fy, fz);
  if (!(force <= g_fake.largest_force)) g_fake.largest_force = force;
  if (force != 0 && !g_fake.is_force_enabled) ++g_fake.num_forces_while_off;
  ++g_fake.num_writes;
  return g_fake.write_result;
}
int dhdEnableForce(uchar val, char) {
  CALL();
  g_fake.is_force_enabled = val != 0;
  return g_fake.enable_result;
}
int dhdSetGravityCompensation(int val, char) {
  CALL();
  g_fake.gravity = val;
  return 0;
}
int dhdGetStatus(int status[17], char) {
  CALL();
  for (int i = 0; i < 17; ++i) status[i] = 0;
  status[0] = status[1] = status[2] = status[3] = 1;
  status[5] = g_fake.is_force_enabled && g_fake.takes_force;
  status[14] = g_fake.force_off_cause;
  return g_fake.status_result;
}

#if !defined(FAKE_DHD_IS_INCOMPLETE)
bool drdIsInitialized(char) {
  CALL();
  return g_fake.is_initialized;
}
int dhdSetMaxForce(double limit, char) {
  CALL();
  g_fake.max_force = limit;
  return 0;
}
int dhdSetMaxTorque(double limit, char) {
  CALL();
  g_fake.max_torque = limit;
  return 0;
}
#endif

// Functions that must never be called.
int drdAutoInit(char) {
  CALL();
  return forbidden();
}
int drdStart(char) {
  CALL();
  return forbidden();
}
int drdMoveToPos(double, double, double, bool, char) {
  CALL();
  return forbidden();
}
int dhdReset(char) {
  CALL();
  return forbidden();
}
int dhdEnableExpertMode() {
  CALL();
  return forbidden();
}
int dhdSetVelocityThreshold(uint, char) {
  CALL();
  return forbidden();
}
int dhdSetWatchdog(uchar, char) {
  CALL();
  return forbidden();
}

}  // extern "C"
