// Reads TOML files of users, with line numbers in errors.
#pragma once

#define TOML_EXCEPTIONS 0
#include <toml++/impl/preprocessor.h>
// The parser asserts on, or relies on, conditions that a damaged file may break (`[1,}`), before
// its checks find the error: only these checks are to decide.
#undef TOML_ASSERT
#undef TOML_ASSERT_ASSUME
#define TOML_ASSERT(expression) static_assert(true)
#define TOML_ASSERT_ASSUME(expression) static_assert(true)
#include <toml++/toml.h>

#include <filesystem>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Outside of strings, letters beyond ASCII become '?'. Errors: no such file, too large, not TOML,
/// with the line.
Result<toml::table> read_toml(const std::filesystem::path& path);

/// Returns the value of a node that is a number. toml++ gives no double for integers beyond 2^53.
inline double number_of(const toml::node& number) {
  const auto* const whole = number.as_integer();
  return whole != nullptr ? static_cast<double>(whole->get()) : number.as_floating_point()->get();
}

}}  // namespace palpate::v0
