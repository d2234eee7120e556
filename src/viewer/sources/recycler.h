// Reuses large objects instead of allocating them each time.
#pragma once

#include <array>
#include <memory>

namespace palpate { inline namespace v0 {

/// Pool of large objects. It and all holders of its objects use one thread.
template <class T>
class Recycler {
 public:
  /// Returns an object that nobody holds any more, with its old contents.
  std::shared_ptr<T> take() {
    for (std::shared_ptr<T>& kept : kept_) {
      if (kept == nullptr) kept = std::make_shared<T>();
      if (kept.use_count() == 1) return kept;
    }
    return std::make_shared<T>();
  }

 private:
  std::array<std::shared_ptr<T>, 3> kept_;
};

}}  // namespace palpate::v0
