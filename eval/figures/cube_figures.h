// Figures of the recorded cube that are in separate files.
#pragma once

#include "eval/context.h"
#include "eval/figure.h"

namespace palpate::eval {

Result<FigureResult> moving_cube_figure(Context& context);   ///< cube-world
Result<FigureResult> tracked_cube_figure(Context& context);  ///< cube-tracked

}  // namespace palpate::eval
