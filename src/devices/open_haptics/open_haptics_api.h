// The functions of OpenHaptics' HDAPI that Palpate calls. Declarations of our own after its
// documentation (hd.h, hdDefines.h, hdScheduler.h, 3.0 to 3.5): its headers are not needed.
#pragma once

#include <string>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

using HdHandle = unsigned int;                         // HHD
using HdEnum = unsigned int;                           // HDenum, HDerror
using HdScheduled = unsigned long;                     // HDSchedulerHandle
using HdCallback = unsigned int (*)(void* user_data);  // HDSchedulerCallback

struct HdErrorInfo {
  HdEnum code;
  int internal_code;
  HdHandle device;
};

struct OpenHapticsApi {
  std::string path;  ///< of the library

  HdHandle (*hdInitDevice)(const char* name);  ///< null: the default one
  void (*hdDisableDevice)(HdHandle device);
  void (*hdMakeCurrentDevice)(HdHandle device);
  void (*hdBeginFrame)(HdHandle device);
  void (*hdEndFrame)(HdHandle device);
  void (*hdEnable)(HdEnum capability);
  void (*hdDisable)(HdEnum capability);
  void (*hdGetDoublev)(HdEnum what, double* values);
  void (*hdGetIntegerv)(HdEnum what, int* values);
  const char* (*hdGetString)(HdEnum what);
  void (*hdSetDoublev)(HdEnum what, const double* values);
  HdErrorInfo (*hdGetError)();  ///< takes the newest one from a stack
  const char* (*hdGetErrorString)(HdEnum code);
  HdEnum (*hdCheckCalibration)();
  void (*hdUpdateCalibration)(HdEnum style);
  HdScheduled (*hdScheduleAsynchronous)(HdCallback callback, void* user_data,
                                        unsigned short priority);
  void (*hdUnschedule)(HdScheduled callback);
  void (*hdStartScheduler)();
  void (*hdStopScheduler)();

  /// The oldest error that has not been taken yet; takes them all. Code 0: none.
  HdErrorInfo take_errors() const noexcept;
};

inline constexpr HdHandle kHdNoDevice = 0xFFFFFFFF;
inline constexpr unsigned kHdCallbackDone = 0, kHdCallbackContinue = 1;
inline constexpr unsigned short kHdMaxPriority = 0xFFFF;

// hdGetDoublev, hdGetIntegerv, hdGetString, hdSetDoublev. Lengths in mm, torques in mN m.
inline constexpr HdEnum kHdButtons = 0x2000, kHdVelocity = 0x2051, kHdTransform = 0x2052,
                        kHdAngularVelocity = 0x2053, kHdForce = 0x2700, kHdTorque = 0x2701,
                        kHdModelType = 0x2501, kHdSerialNumber = 0x2504,
                        kHdUsableWorkspace = 0x2551, kHdInputDof = 0x2553, kHdOutputDof = 0x2554,
                        kHdCalibrationStyle = 0x2555, kHdMaxStiffness = 0x2602,
                        kHdMaxForce = 0x2603, kHdMaxDamping = 0x2609,
                        kHdMaxTorqueStiffness = 0x2620, kHdMaxTorque = 0x2622;
// hdEnable, hdDisable.
inline constexpr HdEnum kHdForceOutput = 0x4000, kHdMaxForceClamping = 0x4001,
                        kHdForceRamping = 0x4002, kHdSoftwareForceLimit = 0x4003;
// hdCheckCalibration, hdUpdateCalibration.
inline constexpr HdEnum kHdCalibrationOk = 0x5000, kHdCalibrationNeedsUpdate = 0x5001;
inline constexpr HdEnum kHdCalibrateByMoving = 2, kHdCalibrateInInkwell = 4;
// Errors.
inline constexpr HdEnum kHdWarmMotors = 0x200, kHdLastForceError = 0x204,
                        kHdAlreadyInitiated = 0x301;

/// Warm motors, too much force, too fast, and the like: the driver itself takes the force away for
/// a moment and brings it back slowly (HD_FORCE_RAMPING). All other errors are the end.
constexpr bool is_force_error(HdEnum code) {
  return code >= kHdWarmMotors && code <= kHdLastForceError;
}

/// Finds and loads the library. Errors: not found, and every path tried; not usable, and why.
Result<OpenHapticsApi> load_open_haptics();

}}  // namespace palpate::v0
