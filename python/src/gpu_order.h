// In which order a GPU does the work of others and ours.
#pragma once

namespace palpate::python {

/// Waits for whoever writes an array on a GPU: DLPack has made CUDA's default stream wait for them,
/// and this waits for it. Does nothing where there is no CUDA.
void wait_for_producers();

}  // namespace palpate::python
