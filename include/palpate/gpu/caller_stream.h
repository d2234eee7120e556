// Work on a GPU in a queue of the caller's.
#pragma once

namespace palpate {

/// A cudaStream_t; null is CUDA's default stream. What is asked for in it is done in its order and
/// not waited for, and may be captured in a CUDA graph.
struct CallerStream {
  void* handle = nullptr;
};

}  // namespace palpate
