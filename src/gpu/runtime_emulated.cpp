// The runtime of the emulator: device memory is host memory, and all work is done at once.
#include <chrono>
#include <cstdlib>
#include <cstring>

#include "palpate/gpu/devices.h"
#include "src/gpu/internal/emulator.h"
#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/short_memory.h"

namespace palpate { inline namespace v0 {
namespace emulator {
namespace {

constexpr std::size_t kMemory = std::size_t{1} << 33;  // bytes
std::size_t largest = kMemory;

}  // namespace

ShortMemory::ShortMemory(std::size_t max_bytes) { largest = max_bytes; }
ShortMemory::~ShortMemory() { largest = kMemory; }
std::size_t largest_array() { return largest; }

}  // namespace emulator
namespace gpu {

void* Memory::take_bytes(std::size_t num_bytes, bool pinned) {
  constexpr std::size_t kAlignment = 256;  // bytes, as on a GPU
  void* data = nullptr;
  if (!status_) return nullptr;
  if (num_bytes > emulator::largest_array() ||
      posix_memalign(&data, kAlignment, num_bytes + 1) != 0) {
    status_ = Error{Errc::unavailable, "memory of the emulated GPU ran out"};
    return nullptr;
  }
  std::memset(data, 0, num_bytes + 1);
  blocks_.push_back({data, pinned});
  return data;
}

void Memory::upload(void* to, const void* from, std::size_t num_bytes) {
  if (num_bytes > 0) std::memcpy(to, from, num_bytes);
}

void Memory::release() {
  for (const Block& block : blocks_) std::free(block.data);
  blocks_.clear();
}

struct Graph::Impl {
  std::vector<std::function<void()>> steps;
};

Graph::Graph() = default;
Graph::Graph(Graph&&) noexcept = default;
Graph& Graph::operator=(Graph&&) noexcept = default;
Graph::~Graph() = default;

struct Stream::Impl {
  bool records = false;
  std::vector<std::function<void()>> steps;
  std::chrono::steady_clock::time_point start;
  Impl* other = nullptr;  // a queue that this one goes on in

  Impl& queue() { return other != nullptr ? *other : *this; }
  void take(std::function<void()> step) {
    Impl& to = queue();
    to.records ? to.steps.push_back(std::move(step)) : step();
  }
};

Stream::Stream(int gpu, Priority) : gpu_(gpu), impl_(std::make_unique<Impl>()) {}
Stream::Stream(Stream&&) noexcept = default;
Stream& Stream::operator=(Stream&&) noexcept = default;
Stream::~Stream() = default;

Stream::Stream(int gpu) : gpu_(gpu), impl_(std::make_unique<Impl>()) {}
Stream::Stream(int gpu, void* handle) : Stream(gpu) { impl_->other = static_cast<Impl*>(handle); }
void Stream::continue_in(void* handle) noexcept {
  impl_->other = static_cast<Impl*>(handle);
  status_ = Done{};
}
void* Stream::handle() const noexcept { return impl_.get(); }
bool Stream::is_recording() noexcept { return impl_->queue().records; }

void Stream::copy(void* to, const void* from, std::size_t num_bytes) noexcept {
  if (num_bytes > 0) impl_->take([=] { std::memcpy(to, from, num_bytes); });
}
void Stream::clear(void* data, std::size_t num_bytes) noexcept {
  if (num_bytes > 0) impl_->take([=] { std::memset(data, 0, num_bytes); });
}
const Status& Stream::wait(double) noexcept { return status_; }
bool Stream::is_idle() noexcept { return true; }

void Stream::begin_recording() noexcept { impl_->records = true; }
Graph Stream::end_recording() noexcept {
  Graph graph;
  impl_->records = false;
  graph.impl_ = std::make_unique<Graph::Impl>(Graph::Impl{std::move(impl_->steps)});
  impl_->steps.clear();
  return graph;
}
void Stream::launch(const Graph& graph) noexcept {
  for (const auto& step : graph.impl_->steps) step();
}

void Stream::launch_kernel(const LaunchShape&, const void*, void**) noexcept { std::abort(); }
void Stream::run_emulated(const LaunchShape& shape, std::function<void()> kernel) {
  if (!status_) return;
  impl_->take([shape, num = num_repeats_, kernel = std::move(kernel)] {
    for (int i = 0; i < num; ++i) {
      emulator::run_grid(shape.blocks, shape.threads, shape.shared_bytes, shape.cooperative,
                         kernel);
    }
  });
}

void Stream::mark() noexcept { impl_->start = std::chrono::steady_clock::now(); }
double Stream::lap() noexcept {
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - impl_->start)
      .count();
}

int resident_blocks(int, const void*, int, std::size_t) { return 2; }
std::size_t free_memory(int) { return emulator::largest_array(); }
Status check_gpu(int) { return Done{}; }

}  // namespace gpu
}}  // namespace palpate::v0

#if defined(PALPATE_CUDA)  // the backend of a whole build
namespace palpate { inline namespace v0 {
Result<std::vector<GpuInfo>> find_gpus() {
  return std::vector<GpuInfo>{{0, "emulator", std::size_t{1} << 34, 2, 9, 0}};
}
}}  // namespace palpate::v0
#endif
