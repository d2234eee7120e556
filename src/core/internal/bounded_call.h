// Calls into libraries that may never come back, or that remember the threads which call them.
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <queue>
#include <thread>
#include <utility>

namespace palpate { inline namespace v0 {

/// Runs `work`, which must own all that it needs, on a thread of its own; in the calling thread if
/// the system starts none.
class BoundedCall {
 public:
  explicit BoundedCall(std::function<void()> work);
  /// To be called once. Waits for the work, but no longer than `patience` seconds in which this
  /// program runs. False: it has not returned; should it do so later, nobody waits for it. An
  /// exception that it throws in time is thrown here.
  bool returns_within(double patience);

 private:
  friend class LibraryThread;
  class Call;

  std::shared_ptr<Call> call_;
};

inline bool returns_within(double patience, std::function<void()> work) {
  return BoundedCall(std::move(work)).returns_within(patience);
}

/// One thread that lasts until the program ends and makes all calls, one after the other, for
/// libraries that remember the threads which have called them. It lives in memory that is never
/// freed. Calls from itself run at once.
///
///   static LibraryThread& reader = *new LibraryThread;
///   const int status = reader.call([&] { return library_wait(stream); });
class LibraryThread {
 public:
  /// Like returns_within: `work` must own all that it needs.
  bool returns_within(double patience, std::function<void()> work);
  /// Waits for the result, however long. What the work throws is thrown here.
  template <class Work>
  auto call(const Work& work) {
    std::optional<decltype(work())> answer;
    wait_for([&] { answer.emplace(work()); });
    return *std::move(answer);
  }

 private:
  std::shared_ptr<BoundedCall::Call> start(std::function<void()> work);
  bool hand_over(std::function<void()> call);
  void wait_for(std::function<void()> work);
  void serve();

  std::mutex mutex_;  // guards the members below
  std::condition_variable changed_;
  std::queue<std::function<void()>> calls_;
  std::thread::id id_;  // none: there is no thread yet
};

/// True while any call that was given up has not returned. The program must then end by _exit:
/// libraries may wait for that call at an ordinary end.
bool is_any_call_hung() noexcept;
/// Counts calls of other kinds: 1 when one is given up, -1 if it does come back.
void count_hung_calls(int change) noexcept;

}}  // namespace palpate::v0
