// Comparison of a record with its repetition, number by number.
#include <algorithm>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "src/session/internal/run_fields.h"
#include "src/session/internal/run_messages.h"
#include "src/session/recording/message_codec.h"
#include "src/session/report/text.h"

namespace palpate { inline namespace v0 {
namespace {

using messages::message_of;
using messages::Scalar;

/// Collects every number with its place.
struct Flattener {
  std::vector<std::pair<std::string, std::string>>& values;
  std::string place;

  template <class T>
  void operator()(const char* name, const T& value) const {
    const std::string at = place + (place.empty() ? "" : "/") + name;
    if constexpr (Scalar<T>) {
      put(at, value);
    } else if constexpr (std::same_as<T, CameraBlends>) {
      for (std::uint32_t k = 0; k < value.num && k < kMaxCameras; ++k) {
        visit_fields(value.of[k], Flattener{values, at + "/" + std::to_string(k)});
      }
    } else if constexpr (std::same_as<T, BodyPoses>) {
      for (std::uint32_t k = 0; k < value.num && k < kMaxMovingBodies; ++k) {
        visit_fields(value.of[k], Flattener{values, at + "/" + std::to_string(k)});
      }
    } else if constexpr (std::same_as<T, messages::Noise>) {
      if (value) visit_fields(*value, Flattener{values, at});
    } else if constexpr (std::same_as<T, Stiffness>) {
      for (int i = 0; i < 36; ++i) put(at + "/" + std::to_string(i), value.m[i / 6][i % 6]);
    } else {
      visit_fields(value, Flattener{values, at});
    }
  }
  template <class T>
  void put(const std::string& at, T value) const {
    std::string text;
    if constexpr (std::is_enum_v<T> || std::same_as<T, bool>) {
      append_number(text, static_cast<int>(value));
    } else {
      append_number(text, value);
    }
    values.emplace_back(at, text);
  }
};

template <class T>
std::string difference_of(const T& recorded, const T& repeated) {
  if (message_of(recorded) == message_of(repeated)) return {};
  std::vector<std::pair<std::string, std::string>> a, b;
  visit_fields(recorded, Flattener{a, ""});
  visit_fields(repeated, Flattener{b, ""});
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    if (a[i] == b[i]) continue;
    return a[i].first + ": recorded " + a[i].second + ", repeated " + b[i].second;
  }
  if (a.size() != b.size()) {
    const auto& longer = a.size() > b.size() ? a : b;
    return longer[std::min(a.size(), b.size())].first + " is " +
           (a.size() > b.size() ? "recorded, not repeated" : "repeated, not recorded");
  }
  return "a number differs in bits that are not written";
}

}  // namespace

std::string difference(const ContactRecord& recorded, const ContactRecord& repeated) {
  return difference_of(recorded, repeated);
}
std::string difference(const TickRecord& recorded, const TickRecord& repeated) {
  return difference_of(recorded, repeated);
}

}}  // namespace palpate::v0
