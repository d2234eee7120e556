// The kinds behind make_coupling.
#pragma once

#include "src/haptics/held_contact.h"
#include "src/haptics/spring.h"

namespace palpate::inline v0 {

/// Longest time that one step covers, s: a tick that comes later than this is taken as this late.
inline constexpr double kMaxStep = 0.02;

/// What sticks to a surface is so many times as stiff as the coupling: little gives way, and the
/// hand feels the coupling. Where there is none the hand feels it itself, and it is as stiff.
inline constexpr double kStiffer = 10;

/// Between 0 and kMaxStep, whatever the clock says.
inline double step_length(double dt) { return dt > 0 ? (dt < kMaxStep ? dt : kMaxStep) : 0; }

std::unique_ptr<Coupling> make_virtual_coupling(const CouplingOptions& options,
                                                const DeviceLimits& limits,
                                                const MassProperties& tool);
std::unique_ptr<Coupling> make_direct_coupling(const CouplingOptions& options,
                                               const DeviceLimits& limits,
                                               const MassProperties& tool);
std::unique_ptr<Coupling> make_no_coupling(const CouplingOptions& options,
                                           const MassProperties& tool);
std::unique_ptr<Coupling> make_proxy_coupling(const CouplingOptions& options,
                                              const DeviceLimits& limits,
                                              const MassProperties& tool);

/// Of the tool, m: what a radian of it counts as.
double radius_of_gyration(const MassProperties& tool);

}  // namespace palpate::inline v0
