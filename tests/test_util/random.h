// Random numbers that are the same everywhere.
#pragma once

#include "src/math/internal/random.h"

namespace palpate::test {

using palpate::Random;

}  // namespace palpate::test
