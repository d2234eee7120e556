// Brings a file to the disk while others go on writing it.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

namespace palpate::inline v0 {

/// Has a thread of its own, since a busy disk may take seconds for it. Where there is no thread to
/// be had, the caller waits.
class DiskSync {
 public:
  /// `file`: a descriptor that stays open for as long.
  explicit DiskSync(int file);
  DiskSync(const DiskSync&) = delete;
  DiskSync& operator=(const DiskSync&) = delete;
  ~DiskSync();  ///< waits for what is under way, and no more

  /// What was written until now is on the disk soon. Returns the `errno` of an earlier time, or 0.
  int request();
  /// The same, and waits for it. The last one.
  int finish();

 private:
  int sync() const;
  void serve();
  void end();

  const int file_;
  std::mutex mutex_;  // of what follows
  std::condition_variable changed_;
  bool is_requested_ = false, is_ending_ = false;
  int error_ = 0;  // of the first that failed
  std::thread thread_;
};

}  // namespace palpate::inline v0
