// Report of two runs, laid over each other.
#pragma once

#include <filesystem>
#include <string>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Returns one self-contained HTML page that compares the reports in the folders of two runs.
/// Errors: a folder holds no run, or no report that this program can read; this build has no pages.
Result<std::string> two_runs_page(const std::filesystem::path& a, const std::filesystem::path& b);

}}  // namespace palpate::v0
