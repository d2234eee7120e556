#include "palpate/haptics/coupling.h"

#include <algorithm>

#include "src/haptics/coupling/couplings.h"
#include "src/haptics/internal/friction.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kSmallestRadius = 1e-4;  // m: a tool without extent still turns

}  // namespace

double radius_of_gyration(const MassProperties& tool) {
  const Mat3d& i = tool.inertia;
  const double squared = (i.m[0][0] + i.m[1][1] + i.m[2][2]) / (3 * tool.volume);
  return std::isfinite(squared) ? std::sqrt(std::max(squared, kSmallestRadius * kSmallestRadius))
                                : kSmallestRadius;
}

double friction_stiffness(const CouplingOptions& options, const DeviceLimits& limits) {
  const double given = options.friction.stiffness / options.motion_scale;
  if (given > 0) return given;
  const double own = make_spring(options, limits).stiffness;
  return options.kind == CouplingKind::direct ? own : kStiffer * own;
}

std::unique_ptr<Coupling> make_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                        const MassProperties& tool) {
  switch (options.kind) {
    case CouplingKind::direct: return make_direct_coupling(options, limits, tool);
    case CouplingKind::proxy: return make_proxy_coupling(options, limits, tool);
    case CouplingKind::none: return make_no_coupling(options, tool);
    case CouplingKind::virtual_coupling: break;
  }
  return make_virtual_coupling(options, limits, tool);
}

}}  // namespace palpate::v0
