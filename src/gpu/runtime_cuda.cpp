// The CUDA runtime.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <string>
#include <thread>

#include "palpate/gpu/devices.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {
namespace gpu {
namespace {

std::string version_text(int version) {
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

Error failure(cudaError_t code, const std::string& what, int gpu) {
  return {Errc::unavailable, "GPU " + std::to_string(gpu) + " failed " + what + ": " +
                                 cudaGetErrorString(code) +
                                 "; check it with nvidia-smi, or use the CPU (--backend cpu)"};
}

/// Returns the number of GPUs, at least 1. Error: there is none, and why.
Result<int> count_gpus() {
  const std::string otherwise = "; use the CPU (--backend cpu or auto)";
  int driver = 0, runtime = 0, num = 0;
  cudaRuntimeGetVersion(&runtime);
  if (cudaDriverGetVersion(&driver) != cudaSuccess || driver == 0) {
    return Error{Errc::unavailable,
                 "there is no NVIDIA driver on this machine: install one that knows CUDA " +
                     version_text(runtime) + otherwise};
  }
  const cudaError_t code = cudaGetDeviceCount(&num);
  if (code == cudaErrorInsufficientDriver) {
    return Error{Errc::unavailable, "the NVIDIA driver knows CUDA " + version_text(driver) +
                                        " and this build needs " + version_text(runtime) +
                                        ": update the driver" + otherwise};
  }
  if (code != cudaSuccess || num == 0) {
    return Error{Errc::unavailable,
                 std::string("no NVIDIA GPU was found (") +
                     (code == cudaSuccess ? "none is visible" : cudaGetErrorString(code)) +
                     "): check with nvidia-smi" + otherwise};
  }
  return num;
}

}  // namespace

void* Memory::take_bytes(std::size_t num_bytes, bool pinned) {
  if (!status_) return nullptr;
  num_bytes = std::max<std::size_t>(num_bytes, 16);
  void* data = nullptr;
  cudaError_t code = cudaSetDevice(gpu_);
  if (code == cudaSuccess) {
    code = pinned ? cudaHostAlloc(&data, num_bytes, cudaHostAllocMapped | cudaHostAllocPortable)
                  : cudaMalloc(&data, num_bytes);
  }
  if (code != cudaSuccess) {
    cudaGetLastError();
    std::size_t free = 0, total = 0;
    cudaMemGetInfo(&free, &total);
    status_ = Error{Errc::unavailable,
                    (pinned ? "page-locked host memory for GPU " : "memory of GPU ") +
                        std::to_string(gpu_) + " ran out: " + std::to_string(num_bytes >> 10) +
                        " KiB more are needed and " + std::to_string(free >> 20) + " of " +
                        std::to_string(total >> 20) + " MiB are free (" + cudaGetErrorString(code) +
                        "); close other programs, or use fewer spheres or the CPU (--backend cpu)"};
    return nullptr;
  }
  blocks_.push_back({data, pinned});
  if (pinned) {
    std::memset(data, 0, num_bytes);
  } else if (cudaMemset(data, 0, num_bytes) != cudaSuccess ||
             cudaStreamSynchronize(nullptr) != cudaSuccess) {
    status_ = failure(cudaGetLastError(), "to clear memory", gpu_);
    return nullptr;
  }
  return data;
}

void Memory::upload(void* to, const void* from, std::size_t num_bytes) {
  if (num_bytes == 0) return;
  // The call may return while the last bytes are still on their way, and streams that do not wait
  // for the default one would overtake them.
  cudaError_t code = cudaMemcpy(to, from, num_bytes, cudaMemcpyHostToDevice);
  if (code == cudaSuccess) code = cudaStreamSynchronize(nullptr);
  if (code != cudaSuccess) status_ = failure(code, "to take a copy", gpu_);
}

void Memory::release() {
  if (blocks_.empty()) return;
  cudaSetDevice(gpu_);
  for (const Block& block : blocks_) {
    if (block.pinned) {
      cudaFreeHost(block.data);
    } else {
      cudaFree(block.data);
    }
  }
  blocks_.clear();
}

struct Graph::Impl {
  cudaGraphExec_t graph = nullptr;
  ~Impl() {
    if (graph != nullptr) cudaGraphExecDestroy(graph);
  }
};
Graph::Graph() = default;
Graph::Graph(Graph&&) noexcept = default;
Graph& Graph::operator=(Graph&&) noexcept = default;
Graph::~Graph() = default;

struct Stream::Impl {
  int gpu = 0;
  cudaStream_t stream = nullptr;
  cudaEvent_t start = nullptr, end = nullptr;
  bool is_own = true;
  int before = -1;  // device to go back to

  ~Impl() {
    if (before < 0) cudaSetDevice(gpu);
    if (stream != nullptr && is_own) cudaStreamDestroy(stream);
    if (start != nullptr) cudaEventDestroy(start);
    if (end != nullptr) cudaEventDestroy(end);
    if (before >= 0 && before != gpu) cudaSetDevice(before);
  }
};
Stream::Stream(Stream&&) noexcept = default;
Stream& Stream::operator=(Stream&&) noexcept = default;
Stream::~Stream() = default;

Stream::Stream(int gpu, Priority priority) : gpu_(gpu), impl_(std::make_unique<Impl>()) {
  impl_->gpu = gpu;
  int least = 0, greatest = 0;
  cudaError_t code = cudaSetDevice(gpu);
  if (code == cudaSuccess) code = cudaDeviceGetStreamPriorityRange(&least, &greatest);
  if (code == cudaSuccess) {
    code = cudaStreamCreateWithPriority(&impl_->stream, cudaStreamNonBlocking,
                                        priority == Priority::high ? greatest : least);
  }
  if (code == cudaSuccess) code = cudaEventCreate(&impl_->start);
  if (code == cudaSuccess) code = cudaEventCreate(&impl_->end);
  if (code != cudaSuccess) fail(failure(code, "to make a stream", gpu));
}

Stream::Stream(int gpu) : gpu_(gpu), impl_(std::make_unique<Impl>()) {
  impl_->gpu = gpu;
  impl_->is_own = false;
  cudaError_t code = cudaSetDevice(gpu);
  if (code == cudaSuccess) code = cudaEventCreate(&impl_->start);
  if (code == cudaSuccess) code = cudaEventCreate(&impl_->end);
  if (code != cudaSuccess) fail(failure(code, "to make events", gpu));
}

Stream::Stream(int gpu, void* handle) : gpu_(gpu), impl_(std::make_unique<Impl>()) {
  impl_->gpu = gpu;
  impl_->is_own = false;
  impl_->stream = static_cast<cudaStream_t>(handle);
  const cudaError_t code = cudaGetDevice(&impl_->before);
  if (code != cudaSuccess) fail(failure(code, "to tell the current device", gpu));
}

void Stream::continue_in(void* handle) noexcept {
  impl_->stream = static_cast<cudaStream_t>(handle);
  status_ = Done{};
  if (is_recording()) return;
  const cudaError_t code = cudaStreamWaitEvent(impl_->stream, impl_->start);
  if (code != cudaSuccess) fail(failure(code, "to wait for other work", gpu_));
}
void* Stream::handle() const noexcept { return impl_->stream; }

bool Stream::is_recording() noexcept {
  cudaStreamCaptureStatus capture = cudaStreamCaptureStatusNone;
  return cudaStreamIsCapturing(impl_->stream, &capture) == cudaSuccess &&
         capture != cudaStreamCaptureStatusNone;
}

void Stream::copy(void* to, const void* from, std::size_t num_bytes) noexcept {
  if (!status_ || num_bytes == 0) return;
  const cudaError_t code = cudaMemcpyAsync(to, from, num_bytes, cudaMemcpyDefault, impl_->stream);
  if (code != cudaSuccess) fail(failure(code, "to copy", gpu_));
}

void Stream::clear(void* data, std::size_t num_bytes) noexcept {
  if (!status_ || num_bytes == 0) return;
  const cudaError_t code = cudaMemsetAsync(data, 0, num_bytes, impl_->stream);
  if (code != cudaSuccess) fail(failure(code, "to clear memory", gpu_));
}

bool Stream::is_idle() noexcept {
  if (!status_) return true;
  const cudaError_t code = cudaStreamQuery(impl_->stream);
  if (code == cudaErrorNotReady) return false;
  if (code != cudaSuccess) fail(failure(code, "in its work", gpu_));
  return true;
}

const Status& Stream::wait(double seconds) noexcept {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  const Clock::time_point deadline =
      start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  while (!is_idle()) {
    const Clock::time_point now = Clock::now();
    if (now > deadline) {
      fail({Errc::unavailable, "GPU " + std::to_string(gpu_) + " has not finished its work in " +
                                   std::to_string(static_cast<int>(seconds)) +
                                   " s; check it with nvidia-smi, or use the CPU (--backend cpu)"});
    } else if (now > start + std::chrono::milliseconds(1)) {
      std::this_thread::yield();
    }
  }
  return status_;
}

void Stream::begin_recording() noexcept {
  if (!status_) return;
  const cudaError_t code = cudaStreamBeginCapture(impl_->stream, cudaStreamCaptureModeThreadLocal);
  if (code != cudaSuccess) fail(failure(code, "to record", gpu_));
}

Graph Stream::end_recording() noexcept {
  Graph result;
  if (!status_) return result;
  result.impl_ = std::make_unique<Graph::Impl>();
  cudaGraph_t graph = nullptr;
  cudaError_t code = cudaStreamEndCapture(impl_->stream, &graph);
  if (code == cudaSuccess) code = cudaGraphInstantiate(&result.impl_->graph, graph, 0);
  if (code == cudaSuccess) code = cudaGraphUpload(result.impl_->graph, impl_->stream);
  if (graph != nullptr) cudaGraphDestroy(graph);
  if (code != cudaSuccess) fail(failure(code, "to record", gpu_));
  return result;
}

void Stream::launch(const Graph& graph) noexcept {
  if (!status_ || graph.impl_ == nullptr) return;
  const cudaError_t code = cudaGraphLaunch(graph.impl_->graph, impl_->stream);
  if (code != cudaSuccess) fail(failure(code, "to launch a graph", gpu_));
}

void Stream::launch_kernel(const LaunchShape& shape, const void* kernel,
                           void** arguments) noexcept {
  if (!status_) return;
  cudaSetDevice(gpu_);
  cudaLaunchAttribute cooperative{};
  cooperative.id = cudaLaunchAttributeCooperative;
  cooperative.val.cooperative = 1;
  cudaLaunchConfig_t config{};
  config.gridDim = dim3(static_cast<unsigned>(shape.blocks));
  config.blockDim = dim3(static_cast<unsigned>(shape.threads));
  config.dynamicSmemBytes = shape.shared_bytes;
  config.stream = impl_->stream;
  config.attrs = &cooperative;
  config.numAttrs = shape.cooperative ? 1 : 0;
  cudaError_t code = cudaSuccess;
  for (int i = 0; i < num_repeats_ && code == cudaSuccess; ++i) {
    code = cudaLaunchKernelExC(&config, kernel, arguments);
  }
  if (code != cudaSuccess) {
    cudaGetLastError();
    fail(failure(code, "to launch a kernel", gpu_));
  }
}

void Stream::mark() noexcept {
  if (!status_ || is_recording()) return;
  cudaSetDevice(gpu_);
  const cudaError_t code = cudaEventRecord(impl_->start, impl_->stream);
  if (code != cudaSuccess) fail(failure(code, "to mark a time", gpu_));
}

double Stream::lap() noexcept {
  if (!status_) return 0;
  cudaSetDevice(gpu_);
  float milliseconds = 0;
  cudaError_t code = cudaEventRecord(impl_->end, impl_->stream);
  if (code == cudaSuccess && wait()) {
    code = cudaEventElapsedTime(&milliseconds, impl_->start, impl_->end);
  }
  if (code != cudaSuccess) fail(failure(code, "to read a time", gpu_));
  return 1e3 * static_cast<double>(milliseconds);
}

int resident_blocks(int gpu, const void* kernel, int threads, std::size_t shared_bytes) {
  int per_multiprocessor = 0, multiprocessors = 0;
  const int bytes = static_cast<int>(shared_bytes);
  cudaFuncAttributes now{};
  if (cudaSetDevice(gpu) != cudaSuccess || cudaFuncGetAttributes(&now, kernel) != cudaSuccess ||
      // Others may launch the same kernel with more.
      (now.maxDynamicSharedSizeBytes < bytes &&
       cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, bytes) !=
           cudaSuccess) ||
      cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_multiprocessor, kernel, threads,
                                                    shared_bytes) != cudaSuccess ||
      cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, gpu) !=
          cudaSuccess) {
    cudaGetLastError();
    return 0;
  }
  return per_multiprocessor * multiprocessors;
}

std::size_t free_memory(int gpu) {
  std::size_t free = 0, total = 0;
  if (cudaSetDevice(gpu) != cudaSuccess || cudaMemGetInfo(&free, &total) != cudaSuccess) {
    cudaGetLastError();
    return 0;
  }
  return free;
}

Status check_gpu(int gpu) {
  const auto num = count_gpus();
  if (!num) return num.error();
  if (gpu < 0 || gpu >= *num) {
    return Error{Errc::unavailable, "there is no GPU " + std::to_string(gpu) +
                                        "; this machine has " + std::to_string(*num) +
                                        ", counted from 0"};
  }
  return Done{};
}

}  // namespace gpu

Result<std::vector<GpuInfo>> find_gpus() {
  const auto num = gpu::count_gpus();
  if (!num) return num.error();
  std::vector<GpuInfo> gpus;
  for (int index = 0; index < *num; ++index) {
    cudaDeviceProp properties;
    const cudaError_t code = cudaGetDeviceProperties(&properties, index);
    if (code != cudaSuccess) return gpu::failure(code, "to say what it is", index);
    gpus.push_back({index, properties.name, properties.totalGlobalMem,
                    properties.multiProcessorCount, properties.major, properties.minor});
  }
  return gpus;
}

}}  // namespace palpate::v0
