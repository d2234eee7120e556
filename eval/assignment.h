// Taking planes from boundary spheres by any priority (thesis section 3.2.2, Algs. 3.3 and 3.4),
// in double and one sphere after the other: to find out which priorities are worth having.
#pragma once

#include <memory>

#include "eval/accuracy.h"

namespace palpate::eval {

/// What makes a boundary sphere a good one to take a plane from; d: distance of the centres.
enum class AssignPriority {
  distance,   ///< 1 / d: what the program calls distance
  square,     ///< 1 / d^2
  fourth,     ///< 1 / d^4
  gaussian,   ///< exp(-d^2 / 2 s^2), s a twelfth of the tool's longest side
  agreement,  ///< max(0, a) / d, a the cosine between its normal and the way to it
  along,      ///< 1 / the shortest way along the leaf graph
};
constexpr auto names_of(AssignPriority) {
  return std::array{"1 / d",
                    "1 / d²",
                    "1 / d⁴",
                    "Gaussian",
                    "agreement of the normal / d",
                    "1 / way along the graph"};
}

/// By an average over all boundary spheres (weighted), or from the best alone (simplified), with
/// the volumes that spheres represent. Tool and scene must outlive it.
Measure assignment_measure(const Tool& tool, const SeenScene& scene, AssignPriority priority,
                           bool is_average);

}  // namespace palpate::eval
