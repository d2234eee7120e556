// Checks which settings differ that a running loop cannot change.
#pragma once

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// Error: a setting that differs and cannot change, by its name in a settings file.
Status check_change(const RunSettings& before, const RunSettings& after);

}}  // namespace palpate::v0
