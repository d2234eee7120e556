// Rows of an image as tasks of a thread pool.
#pragma once

#include <algorithm>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Calls `row(v)` for rows [begin, end), in parallel. Rows must not depend on each other.
template <class Row>
void for_rows(ThreadPool& pool, int begin, int end, const Row& row) {
  constexpr int kRowsPerTask = 16;
  pool.parallel_for((end - begin + kRowsPerTask - 1) / kRowsPerTask, [&](int task) {
    const int first = begin + task * kRowsPerTask;
    for (int v = first; v < std::min(end, first + kRowsPerTask); ++v) row(v);
  });
}

}}  // namespace palpate::v0
