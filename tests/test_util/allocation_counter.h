// Counts heap allocations of a scope, or refuses them.
#pragma once

#include <cstddef>

namespace palpate::test {

/// Allocations through operator new by any thread of this program so far.
std::size_t num_allocations();
/// Their sizes together, whether they were freed or not.
std::size_t num_allocated_bytes();

/// `AllocationCounter counter; work(); EXPECT_EQ(counter.count(), 0u);`
class AllocationCounter {
 public:
  AllocationCounter() : start_(num_allocations()) {}
  std::size_t count() const { return num_allocations() - start_; }

 private:
  std::size_t start_;
};

/// While it lives, every allocation of a thread that is not spared fails.
class RefusedAllocations {
 public:
  RefusedAllocations();
  ~RefusedAllocations();
  RefusedAllocations(const RefusedAllocations&) = delete;
  RefusedAllocations& operator=(const RefusedAllocations&) = delete;

  static void spare_this_thread();
};

}  // namespace palpate::test
