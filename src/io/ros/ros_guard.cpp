// Messages about a whole robot, as bytes: how far it is from what cameras see.
#include <string>

#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_messages.h"

namespace palpate { inline namespace v0 {

std::string ros_guard_message(const RosHeader& header, const RosGuard& guard) {
  constexpr std::uint64_t kSecond = 1'000'000'000;  // ns
  CdrWriter to;
  to.number(static_cast<std::int32_t>(header.time / kSecond));
  to.number(static_cast<std::uint32_t>(header.time % kSecond));
  to.text(header.frame);
  to.number(guard.state);
  to.text(guard.reason);
  to.text(guard.assumes);
  to.number(guard.clearance);
  to.text(guard.link);
  for (const double number : {guard.unseen, guard.scale, guard.depth_age}) to.number(number);
  to.number(guard.is_held);
  for (const std::span<const std::string> names : {guard.joints, std::span(guard.links)}) {
    to.number(static_cast<std::uint32_t>(names.size()));
    for (const std::string& name : names) to.text(name);
  }
  for (const auto* numbers : {&guard.clearances, &guard.rows, &guard.bounds}) {
    to.number(static_cast<std::uint32_t>(numbers->size()));
    for (const double number : *numbers) to.number(number);
  }
  return to.take();
}

std::string number_message(double number) {
  CdrWriter to;
  to.number(number);
  return to.take();
}

}}  // namespace palpate::v0
