// Keeps ticks from a thread that may hang in a driver, once it has been given up.
#pragma once

#include <atomic>
#include <chrono>
#include <thread>

namespace palpate { inline namespace v0 {

class TickDoor {
 public:
  /// Called by the driver's thread before every tick. False: no tick may run any more.
  bool enter() noexcept {
    State expected = State::open;
    return state_.compare_exchange_strong(expected, State::inside);
  }
  void leave() noexcept { state_.store(State::open); }

  /// Called by any other thread. Afterwards no tick runs or starts. Waits for a tick that runs:
  /// ticks never wait themselves.
  void close() noexcept {
    for (State expected = State::open;
         !state_.compare_exchange_strong(expected, State::closed) && expected != State::closed;
         expected = State::open) {
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
  }
  bool is_closed() const noexcept { return state_.load() == State::closed; }

 private:
  enum class State { open, inside, closed };
  std::atomic<State> state_ = State::open;
};

}}  // namespace palpate::v0
