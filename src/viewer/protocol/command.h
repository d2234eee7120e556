// A command of a page or script.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

// NOLINTNEXTLINE(bugprone-exception-escape): moving JSON throws nothing, whatever the check sees
class ViewCommand {
 public:
  /// Error: not a JSON object with the name of a command.
  static Result<ViewCommand> parse(std::string_view json);

  const std::string& name() const { return name_; }
  /// A member, which may be absent (null).
  const nlohmann::ordered_json& operator[](const char* member) const;
  /// Error: absent or out of range; a missing one is `preset` if there is one.
  Result<double> number(const char* member, double low, double high,
                        std::optional<double> preset = std::nullopt) const;
  /// Error: absent, empty or longer.
  Result<std::string> text(const char* member, std::size_t max_length) const;
  /// Returns the error for a command that is not among those known here.
  Error unknown(std::string_view known) const;

 private:
  nlohmann::ordered_json json_;
  std::string name_;
};

}}  // namespace palpate::v0
