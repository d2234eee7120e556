// The page that shows a run to people.
#pragma once

#include <string>

#include "palpate/core/result.h"
#include "palpate/session/session.h"

namespace palpate {

/// One self-contained HTML page: settings, headline numbers, plots over time, and pictures of the
/// tool in the scene at the deepest moment. Error: the log's settings cannot be used (backend
/// gone).
Result<std::string> make_report(const Tool& tool, const RunLog& log);

}  // namespace palpate
