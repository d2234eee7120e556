// The kinds behind make_coupling.
#pragma once

#include "src/haptics/coupling/spring.h"
#include "src/haptics/held_contact.h"

namespace palpate { inline namespace v0 {

/// Longest time that one step covers, s; later ticks count as this late.
inline constexpr double kMaxStep = 0.02;

/// Stiffness of sticking friction over that of the coupling: little gives way, and the hand feels
/// the coupling. With direct coupling the hand feels the friction itself, and the ratio is 1.
inline constexpr double kStiffer = 10;

/// Returns dt clamped to 0 to kMaxStep; 0 for NaN.
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

/// Returns the tool's radius of gyration, m: the length that a radian counts as.
double radius_of_gyration(const MassProperties& tool);

}}  // namespace palpate::v0
