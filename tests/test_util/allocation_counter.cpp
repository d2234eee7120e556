#include "tests/test_util/allocation_counter.h"

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

std::atomic<std::size_t> g_num_allocations{0}, g_num_bytes{0};
std::atomic<bool> g_is_refused{false};
thread_local bool t_is_spared = false;

void* counted(std::size_t size, std::size_t alignment) {
  g_num_allocations.fetch_add(1, std::memory_order_relaxed);
  g_num_bytes.fetch_add(size, std::memory_order_relaxed);
  void* memory = alignment > alignof(std::max_align_t)
                     ? std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment)
                     : std::malloc(size);
  if (memory == nullptr || (g_is_refused.load(std::memory_order_relaxed) && !t_is_spared)) {
    std::free(memory);
    throw std::bad_alloc();
  }
  return memory;
}

void* counted_or_null(std::size_t size, std::size_t alignment) noexcept {
  try {
    return counted(size, alignment);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}

}  // namespace

void* operator new(std::size_t size) { return counted(size, 0); }
void* operator new[](std::size_t size) { return counted(size, 0); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
// The library's call those above; a sanitizer's do not, and then ours may not free what they give.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return counted_or_null(size, 0);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return counted_or_null(size, 0);
}
void* operator new(std::size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
  return counted_or_null(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
  return counted_or_null(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

namespace palpate::test {

std::size_t num_allocations() { return g_num_allocations.load(std::memory_order_relaxed); }

RefusedAllocations::RefusedAllocations() { g_is_refused = true; }
RefusedAllocations::~RefusedAllocations() { g_is_refused = false; }
void RefusedAllocations::spare_this_thread() { t_is_spared = true; }

std::size_t num_allocated_bytes() { return g_num_bytes.load(std::memory_order_relaxed); }

}  // namespace palpate::test
