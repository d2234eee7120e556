#include "python/src/gpu_order.h"

#ifdef PALPATE_CUDA
#include "src/gpu/internal/runtime.h"
#endif

namespace palpate::python {

#ifdef PALPATE_CUDA
Status wait_for_producers(int gpu, CallerStream stream) {
  constexpr double kPatience = 600;  // s: a step of training may come first
  gpu::Stream producers(gpu);
  if (!producers.status()) return producers.status();
  producers.continue_in(stream.handle);
  return producers.wait(kPatience);
}
#else
Status wait_for_producers(int, CallerStream) { return Done{}; }  // nothing here reads its memory
#endif

}  // namespace palpate::python
