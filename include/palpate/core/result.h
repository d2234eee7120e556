// Errors at set-up travel as values. Members are named as in std::expected, so that it can take
// this class' place once every compiler we support has it.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>
#include <variant>

namespace palpate {

/// What kind of thing went wrong; the message says the rest.
enum class Errc {
  invalid_argument,  ///< a parameter is out of its documented range
  not_found,         ///< a file, scene or device does not exist
  bad_input,         ///< a file or mesh was read and is not acceptable
  io_failure,        ///< reading or writing failed (disk full, permission)
  unavailable,       ///< this build or machine cannot do it
  cancelled,         ///< the caller asked to stop
};

/// One error: its kind, and one sentence that says what, where, and what to do next.
struct Error {
  Errc code = Errc::bad_input;
  std::string message;
};

/// Ends the program: somebody took the value of an error without looking, or the other way round.
[[noreturn]] inline void end_for_wrong_result(const char* wanted, const char* message) {
  std::fprintf(stderr, "palpate: a Result was asked for its %s, but has none: %s\n", wanted,
               message);
  std::abort();
}

/// Either a value or an Error. Check `has_value()` before `*`: asking for what is not there ends
/// the program with a message, in every build type.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}
  Result(Error error) : state_(std::move(error)) {}

  bool has_value() const { return state_.index() == 0; }
  explicit operator bool() const { return has_value(); }

  T& value() & { return check_value(), *std::get_if<0>(&state_); }
  const T& value() const& { return check_value(), *std::get_if<0>(&state_); }
  T&& value() && { return check_value(), std::move(*std::get_if<0>(&state_)); }

  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const {
    if (has_value()) end_for_wrong_result("error", "it is a value");
    return *std::get_if<1>(&state_);
  }

 private:
  void check_value() const {
    if (!has_value()) end_for_wrong_result("value", std::get_if<1>(&state_)->message.c_str());
  }

  std::variant<T, Error> state_;
};

/// For operations that only succeed or fail: `return Done{};`.
struct Done {};
using Status = Result<Done>;

}  // namespace palpate
