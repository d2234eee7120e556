// The texts of a run's folder.
#pragma once

#include <string>

#include "palpate/session/session.h"

namespace palpate {

std::string wrench_csv(const Tool& tool, const RunLog& log);
std::string timing_csv(const RunLog& log);
std::string summary_json(const Tool& tool, const RunLog& log);
/// A sentence if some frame shows hardly any surface, so that a volume of zero says nothing; else
/// empty.
std::string scarce_surface_warning(const RunLog& log);

/// Compute times in seconds.
std::vector<double> query_seconds(const RunLog& log);
std::vector<double> surface_seconds(const RunLog& log);
/// Ticks whose computation took longer than a tick lasts. The surface is not counted: live, it has
/// a thread of its own.
std::size_t num_deadline_misses(const RunLog& log);

}  // namespace palpate
