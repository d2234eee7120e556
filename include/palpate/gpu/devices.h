// The GPUs that the CUDA backend can use on this machine.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// A cudaStream_t; null is CUDA's default stream. Work is enqueued in order and not waited for, and
/// a CUDA graph may capture it.
struct CallerStream {
  void* handle = nullptr;
};

/// Processor of a computation.
enum class Backend { cpu, cuda };
constexpr auto names_of(Backend) { return std::array{"cpu", "cuda"}; }

/// Processor that computes surfaces and queries and holds their arrays.
struct Place {
  Backend backend = Backend::cpu;
  int gpu = 0;  ///< of the CUDA backend: GpuInfo::index

  static constexpr Place cpu() { return {}; }
  static constexpr Place cuda(int gpu = 0) { return {Backend::cuda, gpu}; }
  friend constexpr bool operator==(const Place&, const Place&) = default;
};

/// Memory of an array: host memory, or the index of a GPU.
inline constexpr int kHostMemory = -1;

/// One GPU, identified by its index.
struct GpuInfo {
  int index = 0;
  std::string name;
  std::size_t memory_bytes = 0;
  int num_multiprocessors = 0;
  int compute_major = 0, compute_minor = 0;  ///< 9, 0 for Hopper
};

/// Finds all usable GPUs, at least one. Errors (unavailable): this build has no CUDA backend; there
/// is no driver; the driver is too old; there is no GPU.
Result<std::vector<GpuInfo>> find_gpus();

}}  // namespace palpate::v0
