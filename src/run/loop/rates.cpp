#include "src/run/check_settings.h"

#include <algorithm>
#include <limits>

#include "src/core/internal/message_text.h"

namespace palpate { inline namespace v0 {
namespace {

/// Returns the force that the safety filter allows a hand at rest at its first touch, N.
double largest_force(const SafetyOptions& options, const DeviceInfo& device) {
  constexpr int kNumTicks = 20;
  SafetyOptions at_once = options;
  at_once.ramp_seconds = 0;
  at_once.engage_ticks = 1;
  at_once.max_slew = 1e7;
  at_once.dead_man = false;
  auto filter = SafetyFilter::create(device.limits, at_once);
  if (!filter) return std::numeric_limits<double>::infinity();
  SafetyInput input;
  input.state.is_valid = true;
  Wrench out;
  for (int k = 0; k < kNumTicks; ++k) {
    input.time = input.state.time = k / device.rate;
    const bool is_free = input.is_free = k < kNumTicks / 2;
    out = filter->filter({{0, 0, is_free ? 0 : device.limits.max_force}, {}}, input);
  }
  return norm(out.force);
}

}  // namespace

Status check_rates(const RunSettings& settings, const DeviceInfo& device) {
  const double rate = settings.contact_rate, most = settings.safety.max_contact_age;
  if (rate * most <= 1) {
    return Error{Errc::invalid_argument,
                 "at a loop.contact_rate of " + shortest_decimal(rate) +
                     " Hz contacts grow older than the safety.max_contact_age of " +
                     shortest_decimal(most) + " s; raise one of the two"};
  }
  if (settings.coupling.kind == CouplingKind::none) return Done{};
  // A tick uses the contact of the tick before.
  const double longest = std::min(most, settings.safety.max_tick);
  if (device.rate > 0 && device.rate * longest <= 1) {
    const char* const name =
        longest < settings.safety.max_tick ? "safety.max_contact_age" : "safety.max_tick";
    return Error{Errc::invalid_argument,
                 device.name + " ticks at " + number_text(device.rate) + " Hz, which the " + name +
                     " of " + shortest_decimal(longest) +
                     " s takes for a fault: there would never be a force; let it tick faster, or "
                     "raise safety.max_tick and safety.max_contact_age"};
  }
  return Done{};
}

std::vector<std::string> notes_on_rates(const RunSettings& settings, const DeviceInfo& device) {
  const double most = settings.safety.force_share * device.limits.max_force;
  if (settings.coupling.kind == CouplingKind::none || !(most > 0)) return {};
  const double force = largest_force(settings.safety, device);
  if (!(force < 0.99 * most)) return {};
  return {"at its " + number_text(device.rate) + " Hz " + device.name +
          " gets no more than about " + number_text(force) + " N at the first touch, not " +
          number_text(most) +
          " N: a larger force might give the hand more than safety.energy_tank until the next "
          "tick; let it tick faster, or raise that"};
}

}}  // namespace palpate::v0
