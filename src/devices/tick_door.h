// Keeps ticks from a thread that may hang in a driver, once nobody waits for it any more.
#pragma once

#include <atomic>
#include <chrono>
#include <thread>

namespace palpate::inline v0 {

class TickDoor {
 public:
  /// The driver's thread, around every tick. False: there must be no tick any more.
  bool enter() noexcept {
    State expected = State::open;
    return state_.compare_exchange_strong(expected, State::inside);
  }
  void leave() noexcept { state_.store(State::open); }

  /// Any other thread. Afterwards no tick runs or starts. A tick that runs is waited for: ticks
  /// never wait themselves.
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

}  // namespace palpate::inline v0
