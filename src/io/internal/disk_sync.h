// Brings a file to the disk while others go on writing it.
#pragma once

#include <cstdint>
#include <memory>

namespace palpate { inline namespace v0 {

/// Has a thread of its own, since a busy disk may take seconds for it, or for ever: only `wait`
/// waits. If the system starts no thread, the caller does it.
class DiskSync {
 public:
  /// Closes `file`, a descriptor, in the end.
  explicit DiskSync(int file);
  DiskSync(const DiskSync&) = delete;
  DiskSync& operator=(const DiskSync&) = delete;
  ~DiskSync();  ///< waits for nothing: requested bytes come to the disk all the same

  /// Requests that the `size` bytes written until now come to the disk soon.
  void request(std::uint64_t size);
  /// True while requested bytes are still on their way.
  bool is_busy() const;
  /// Waits until they have arrived. Signals are handled meanwhile.
  void wait() const;
  /// The `errno` of the first time that failed, or 0.
  int error() const;
  /// Bytes that are on the disk for certain; after an error they grow no more.
  std::uint64_t size_on_disk() const;

 private:
  struct Work;
  const std::shared_ptr<Work> work_;
};

}}  // namespace palpate::v0
