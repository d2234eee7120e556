// The studies of options of the contact query that have files of their own.
#pragma once

#include "eval/context.h"
#include "eval/figure.h"

namespace palpate::eval {

Result<FigureResult> figure_bodies(Context& context);      ///< two packings that overlap
Result<FigureResult> figure_priorities(Context& context);  ///< what makes a good donor
Result<FigureResult> figure_fill(Context& context);        ///< how full a packing is
Result<FigureResult> figure_graphs(Context& context);      ///< which packings favour the graph
Result<FigureResult> figure_eighth(Context& context);      ///< the thesis' advice on stiffness
Result<FigureResult> figure_others(Context& context);      ///< what else one would use
Result<FigureResult> figure_corners(Context& context);     ///< more than one edge at once

}  // namespace palpate::eval
