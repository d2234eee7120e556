// Studies of options of the contact query that are in separate files.
#pragma once

#include "eval/context.h"
#include "eval/figure.h"

namespace palpate::eval {

Result<FigureResult> figure_bodies(Context& context);      ///< two packings that overlap
Result<FigureResult> figure_priorities(Context& context);  ///< selection of donors
Result<FigureResult> figure_fill(Context& context);        ///< fill of packings
Result<FigureResult> figure_graphs(Context& context);      ///< packings that favor the graph
Result<FigureResult> figure_eighth(Context& context);      ///< the thesis' advice on stiffness
Result<FigureResult> figure_others(Context& context);      ///< other methods
Result<FigureResult> figure_corners(Context& context);     ///< several edges at once

}  // namespace palpate::eval
