// The processors of this computer.
#pragma once

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Returns how many processors threads of this program can use, at least 1.
int num_cores();

}}  // namespace palpate::v0
