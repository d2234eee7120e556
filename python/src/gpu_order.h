// Order of the work of other libraries and ours on a GPU.
#pragma once

#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"

namespace palpate::python {

/// Waits for the work in a stream of a GPU: DLPack has made it wait for whoever writes an array
/// (array_on_gpu). Without the GIL. Error: the GPU has failed, or has not finished in ten minutes.
Status wait_for_producers(int gpu, CallerStream stream);

}  // namespace palpate::python
