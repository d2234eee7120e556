// The figures of the recorded cube that have files of their own.
#pragma once

#include "eval/context.h"
#include "eval/figure.h"

namespace palpate::eval {

Result<FigureResult> moving_cube_figure(Context& context);   ///< cube-world
Result<FigureResult> tracked_cube_figure(Context& context);  ///< cube-tracked

}  // namespace palpate::eval
