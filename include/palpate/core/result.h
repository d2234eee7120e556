// Errors at set-up travel as values. Members are named as in std::expected, so that it can take
// this class' place once every compiler we support has it.
#pragma once

#include <string>
#include <utility>
#include <variant>

#include "palpate/core/assert.h"

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

/// Either a value or an Error. Check `has_value()` before `*`.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}
  Result(Error error) : state_(std::move(error)) {}

  bool has_value() const { return state_.index() == 0; }
  explicit operator bool() const { return has_value(); }

  T& value() & { return PALPATE_ASSERT(has_value()), std::get<0>(state_); }
  const T& value() const& { return PALPATE_ASSERT(has_value()), std::get<0>(state_); }
  T&& value() && { return PALPATE_ASSERT(has_value()), std::get<0>(std::move(state_)); }

  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const { return PALPATE_ASSERT(!has_value()), std::get<1>(state_); }

 private:
  std::variant<T, Error> state_;
};

/// For operations that only succeed or fail: `return Done{};`.
struct Done {};
using Status = Result<Done>;

}  // namespace palpate
