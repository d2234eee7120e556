// Code that both runtimes share.
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 { namespace gpu {

Memory::Memory(Memory&& other) noexcept
    : gpu_(other.gpu_),
      blocks_(std::exchange(other.blocks_, {})),
      status_(std::move(other.status_)) {}

Memory& Memory::operator=(Memory&& other) noexcept {
  if (this != &other) {
    release();
    gpu_ = other.gpu_;
    blocks_ = std::exchange(other.blocks_, {});
    status_ = std::move(other.status_);
  }
  return *this;
}

Memory::~Memory() { release(); }

void Stream::fail(Error error) noexcept {
  if (status_) status_ = std::move(error);
}

}}}  // namespace palpate::v0::gpu
