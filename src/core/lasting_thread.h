// A thread that lives until the program ends, for libraries that remember the threads which have
// called them.
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

namespace palpate::inline v0 {

/// Executes its tasks one after the other; those from itself at once. It lives in memory that is
/// never freed:
///
///   static LastingThread& reader = *new LastingThread;
///   const int status = reader.call([&] { return library_wait(stream); });
class LastingThread {
 public:
  LastingThread();

  /// Waits for earlier requests, and then for the result. What the work throws is thrown here.
  template <class Work>
  auto call(const Work& work) {
    std::optional<decltype(work())> answer;
    run([&] { answer.emplace(work()); });
    return *std::move(answer);
  }

 private:
  void run(std::function<void()> work);
  void serve();

  std::mutex one_at_a_time_;
  std::mutex mutex_;  // of what follows
  std::condition_variable changed_;
  std::function<void()> work_;  // empty: done
  std::exception_ptr thrown_;   // by the last one
  bool has_thread_ = false;
  std::thread::id id_;
};

}  // namespace palpate::inline v0
