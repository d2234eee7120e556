// The functions of the Force Dimension SDK that Palpate calls. Declarations of our own after the
// SDK's documentation (dhdc.h and drdc.h, 3.7 to 3.17): its headers are not needed.
#pragma once

#include <string>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Results below zero are errors. Positive ones are not: 1, queried again sooner than the device
/// refreshes (DHD_TIMEGUARD); 2, a motor gives all it has (DHD_MOTOR_SATURATED).
/// None of these moves the device but the forces. Factory settings (watchdog, velocity threshold)
/// are left alone, as the vendor recommends: they protect the hand when this program hangs.
struct ForceDimensionApi {
  std::string path;  ///< of the library
  std::string version;

  void (*dhdGetSDKVersion)(int* major, int* minor, int* release, int* revision);
  const char* (*dhdErrorGetLastStr)();
  int (*dhdGetDeviceCount)();
  int (*dhdGetAvailableCount)();  ///< of those that no other program uses
  int (*drdOpenID)(char id);
  int (*drdClose)(char id);
  bool (*drdIsInitialized)(char id);  ///< false: positions are not valid yet
  int (*dhdGetSystemType)(char id);
  const char* (*dhdGetSystemName)(char id);
  bool (*dhdHasWrist)(char id);
  bool (*dhdHasActiveWrist)(char id);
  int (*dhdGetPositionAndOrientationFrame)(double* x, double* y, double* z, double matrix[3][3],
                                           char id);
  int (*dhdGetLinearVelocity)(double* x, double* y, double* z, char id);
  int (*dhdGetAngularVelocityRad)(double* x, double* y, double* z, char id);
  unsigned int (*dhdGetButtonMask)(char id);
  int (*dhdSetForceAndTorqueAndGripperForce)(double fx, double fy, double fz, double tx, double ty,
                                             double tz, double gripper, char id);
  int (*dhdEnableForce)(unsigned char on, char id);
  int (*dhdSetGravityCompensation)(int on, char id);
  int (*dhdGetStatus)(int* status, char id);

  // Functions of newer releases; may be null.
  int (*dhdSetMaxForce)(double newtons, char id);
  int (*dhdSetMaxTorque)(double newton_meters, char id);
};

/// dhdGetStatus fills 13 to 17 numbers, depending on the release.
inline constexpr int kDhdStatusCapacity = 32, kDhdStatusForce = 5, kDhdStatusForceOffCause = 14;

/// Finds and loads the library. Errors: not found, and every path tried; not usable, and why.
Result<ForceDimensionApi> load_force_dimension();

}}  // namespace palpate::v0
