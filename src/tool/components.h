// Connected components under growing sets of edges.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace palpate { inline namespace v0 {

/// Union-find with path halving; the lowest index of a component names it.
class Components {
 public:
  explicit Components(std::size_t size) : parent_(size), count_(static_cast<int>(size)) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }

  std::int32_t find(std::int32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  /// False if a and b were in one component already.
  bool join(std::int32_t a, std::int32_t b) {
    a = find(a);
    b = find(b);
    if (a == b) return false;
    parent_[std::max(a, b)] = std::min(a, b);
    --count_;
    return true;
  }

  int count() const { return count_; }

 private:
  std::vector<std::int32_t> parent_;
  int count_;
};

}}  // namespace palpate::v0
