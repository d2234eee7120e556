// The end of a tool that goes first when it probes.
#pragma once

#include <string>

#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

struct LeadEnd {
  Vec3d direction_T;  ///< unit: the tool is moved along it
  Vec3d tip_T;        ///< its foremost point
  std::string why;    ///< for humans
};

/// The thinnest end of the tool: of both ends of its principal axes and of the axes of its frame,
/// the one with the least volume of spheres in its first tenth (of the tool's length). Ends that
/// are about as thin as the thinnest count as equal: then the principal axes (those with a moment
/// of inertia of their own) go before the axes of the frame, z before x before y, and the negative
/// end before the positive one.
LeadEnd thinnest_end(const Tool& tool);

/// Returns the end at a point of the tool: away from the center of mass. Errors: a point farther
/// from the tool than a tenth of its length; the center of mass, from which no end is nearer.
Result<LeadEnd> end_at(const Tool& tool, const Vec3d& tip_T);

}}  // namespace palpate::v0
