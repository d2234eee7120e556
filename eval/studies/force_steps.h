// Force steps of a tool that moves by 0.05 mm, a tick at 50 mm/s: a cube of 6 cm, tilted by 20
// degrees, sinks 3 cm into a solid with depth noise of 1.5 mm. Shared by the study and
// tests/accuracy/continuity_test.cpp.
#pragma once

#include <memory>
#include <vector>

#include "eval/context.h"
#include "eval/studies/accuracy.h"

namespace palpate::eval {

/// Solid that the cube sinks into; its surface intersects the optical axis at 1 m.
struct NoisySolid {
  const char* name;
  scenes::Environment environment;
};
std::vector<NoisySolid> noisy_solids();  ///< a wall and a ball of 8 cm radius
RenderedScene see_noisy(const NoisySolid& solid);

/// Returns the cube with 500 spheres.
Result<std::shared_ptr<const Tool>> sinking_cube(Context& context);

inline constexpr double kSinkingStep = 0.00005;  ///< m

/// Returns |F_k+1 - F_k| along the way, as shares of `measure.whole`.
std::vector<double> force_steps(const Measure& measure);

}  // namespace palpate::eval
