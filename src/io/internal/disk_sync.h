// Brings a file to the disk while others go on writing it.
#pragma once

#include <cstdint>
#include <memory>

namespace palpate::inline v0 {

/// Has a thread of its own, since a busy disk may take seconds for it, or for ever: nobody waits
/// but who wants to. Where there is no thread to be had, the caller does it.
class DiskSync {
 public:
  /// Closes `file`, a descriptor, in the end.
  explicit DiskSync(int file);
  DiskSync(const DiskSync&) = delete;
  DiskSync& operator=(const DiskSync&) = delete;
  ~DiskSync();  ///< waits for nothing: what was requested comes to the disk all the same

  /// What was written until now, `size` bytes, is on the disk soon.
  void request(std::uint64_t size);
  /// Whether something that was requested is still on its way.
  bool is_busy() const;
  /// Until it is not. Signals are handled meanwhile.
  void wait() const;
  /// The `errno` of the first time that failed, or 0.
  int error() const;
  /// bytes that are on the disk for certain; after an error no more are
  std::uint64_t size_on_disk() const;

 private:
  struct Work;
  const std::shared_ptr<Work> work_;
};

}  // namespace palpate::inline v0
