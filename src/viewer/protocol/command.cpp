#include "src/viewer/protocol/command.h"

#include <utility>

#include "src/io/internal/json_shape.h"

namespace palpate { inline namespace v0 {

using Json = nlohmann::ordered_json;

Result<ViewCommand> ViewCommand::parse(std::string_view json) {
  constexpr std::size_t kMaxDepth = 16, kMaxMembers = 64;
  if (const std::string fault = JsonShape::fault_of(json, kMaxDepth, kMaxMembers); !fault.empty()) {
    return Error{Errc::invalid_argument, "a command " + fault.substr(0, 80) +
                                             "; docs/viewer-protocol.md lists what commands have"};
  }
  ViewCommand command;
  command.json_ = Json::parse(json, nullptr, false);
  const Json& name = command["command"];
  if (!name.is_string()) {
    return Error{Errc::invalid_argument,
                 R"(a command is a JSON object like {"command": "pause"}; docs/viewer-protocol.md )"
                 "lists all"};
  }
  command.name_ = name.get<std::string>();
  return command;
}

const Json& ViewCommand::operator[](const char* member) const {
  static const Json kNull;
  if (!json_.is_object()) return kNull;
  const auto found = json_.find(member);
  return found == json_.end() ? kNull : *found;
}

Result<double> ViewCommand::number(const char* member, double low, double high,
                                   std::optional<double> preset) const {
  const Json& value = (*this)[member];
  if (value.is_null() && preset) return *preset;
  const double number = value.is_number() ? value.get<double>() : low - 1;
  if (number >= low && number <= high) return number;
  return Error{Errc::invalid_argument, name_ + " needs \"" + member + "\", a number from " +
                                           Json(low).dump() + " to " + Json(high).dump()};
}

Result<std::string> ViewCommand::text(const char* member, std::size_t max_length) const {
  const Json& value = (*this)[member];
  if (value.is_string()) {
    auto text = value.get<std::string>();
    if (!text.empty() && text.size() <= max_length) return text;
  }
  return Error{Errc::invalid_argument, name_ + " needs \"" + member + "\", a text of 1 to " +
                                           std::to_string(max_length) + " bytes"};
}

Error ViewCommand::unknown(std::string_view known) const {
  return {Errc::invalid_argument, "there is no command '" + name_.substr(0, 80) +
                                      "' here; there are " + std::string(known)};
}

}}  // namespace palpate::v0
