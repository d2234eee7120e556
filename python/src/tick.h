// palpate.Tick: one tick of a run as Python sees it.
#pragma once

#include "palpate/run/records.h"

namespace palpate::python {

struct PyTick {
  TickRecord record;
};

}  // namespace palpate::python
