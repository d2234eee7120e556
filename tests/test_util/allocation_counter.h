// Counts heap allocations of a scope.
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

}  // namespace palpate::test
