// Random numbers that are the same everywhere.
#pragma once

#include "eval/studies/random.h"

namespace palpate::test {

using eval::Random;

}  // namespace palpate::test
