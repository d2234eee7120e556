// Which GPUs the CUDA backend can use on this machine.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "palpate/core/core.h"

namespace palpate::inline v0 {

/// A cudaStream_t; null is CUDA's default stream. What is asked for in it is done in its order and
/// not waited for, and may be captured in a CUDA graph.
struct CallerStream {
  void* handle = nullptr;
};

/// Where work is done.
enum class Backend { cpu, cuda };
constexpr auto names_of(Backend) { return std::array{"cpu", "cuda"}; }

/// Where surfaces are made and queries computed, and where their arrays are.
struct Place {
  Backend backend = Backend::cpu;
  int gpu = 0;  ///< of the CUDA backend: GpuInfo::index

  static constexpr Place cpu() { return {}; }
  static constexpr Place cuda(int gpu = 0) { return {Backend::cuda, gpu}; }
  friend constexpr bool operator==(const Place&, const Place&) = default;
};

/// Where arrays are: in host memory, or in that of a GPU.
inline constexpr int kHostMemory = -1;

/// One GPU, known everywhere by its index.
struct GpuInfo {
  int index = 0;
  std::string name;
  std::size_t memory_bytes = 0;
  int num_multiprocessors = 0;
  int compute_major = 0, compute_minor = 0;  ///< 9, 0 for Hopper
};

/// At least one. Errors (unavailable): this build has no CUDA backend; no driver; a driver that is
/// too old for this build; no GPU.
Result<std::vector<GpuInfo>> find_gpus();

}  // namespace palpate::inline v0
