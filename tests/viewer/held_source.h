// A scripted thing to look at whose tool pages can hold.
#pragma once

#include <atomic>
#include <mutex>
#include <vector>

#include "palpate/haptics/device.h"
#include "tests/viewer/scripted_source.h"

namespace palpate::test {

/// A thing to look at whose tool can be held; B is W.
class HeldSource final : public ScriptedSource {
 public:
  using ScriptedSource::ScriptedSource;

  Status hold(std::uint64_t page) override { return handle_.hold(page, monotonic_now()); }
  Status move(std::uint64_t page, const Pose& X_WT) override {
    const Status status = handle_.move(page, X_WT, monotonic_now());
    const std::lock_guard lock(mutex_);
    if (status) poses_.push_back(X_WT);
    return status;
  }
  void release(std::uint64_t page) override {
    handle_.release(page);
    is_held_ = handle_.is_held();
  }

  bool is_held() const { return is_held_; }
  std::vector<Pose> poses() const {
    const std::lock_guard lock(mutex_);
    return poses_;
  }

 private:
  PageHandle handle_;
  std::atomic<bool> is_held_ = true;  // until somebody lets go
  mutable std::mutex mutex_;
  std::vector<Pose> poses_;
};

}  // namespace palpate::test
