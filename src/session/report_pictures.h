// The report's pictures of the deepest moment.
#pragma once

#include <string>

#include "src/session/run_report.h"

namespace palpate {

/// Measures the deepest tick once more, to have the surface and the state of every sphere, and
/// draws it from three sides with scale and force.
Result<std::string> deepest_moment_html(const Tool& tool, const RunLog& log);

}  // namespace palpate
