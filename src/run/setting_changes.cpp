#include "src/run/check_settings.h"

#include <algorithm>
#include <iterator>

namespace palpate { inline namespace v0 {
namespace {

/// Sections and settings that a running loop keeps.
constexpr std::string_view kFixed[] = {
    "safety",           "window",         "loop.threads",           "loop.sensing_gpu",
    "loop.contact_gpu", "loop.real_time", "loop.thin_out",          "loop.std",
    "bodies.spheres",   "output",         "coupling.base_in_scene", "coupling.tool_in_hand"};

/// True if the objects are the same except for settings that can change.
bool has_same_objects(const std::vector<SceneObject>& before,
                      const std::vector<SceneObject>& after) {
  return std::ranges::equal(before, after, [](const SceneObject& a, const SceneObject& b) {
    return a.shape == b.shape && a.X_WB == b.X_WB && a.moves == b.moves && a.mass == b.mass &&
           a.name == b.name;
  });
}

bool has_field(const RunSettings& settings) { return settings.contact.method == MethodKind::field; }

}  // namespace

bool has_moving_objects(const RunSettings& settings) {
  return std::any_of(settings.objects.begin(), settings.objects.end(),
                     [](const SceneObject& object) { return object.moves; });
}

bool has_friction(const RunSettings& settings) {
  const FrictionOptions& friction = settings.coupling.friction;
  return friction.coefficient > 0 || friction.contact_damping > 0 ||
         std::any_of(settings.objects.begin(), settings.objects.end(),
                     [](const SceneObject& object) {
                       return object.friction.value_or(0) > 0 || object.viscous.value_or(0) > 0;
                     }) ||
         !settings.regions.empty();
}

bool needs_depth_change(const RunSettings& settings) {
  return !has_field(settings) && settings.contact.edges != Edges::none;
}

bool is_fixed_while_running(const Setting& setting) {
  return std::any_of(std::begin(kFixed), std::end(kFixed), [&](std::string_view fixed) {
    return fixed == setting.section || fixed == setting.key();
  });
}

Status check_change(const RunSettings& before, const RunSettings& after) {
  if (!has_same_objects(before.objects, after.objects)) {
    return Error{Errc::invalid_argument,
                 "objects stay what they are while the loop runs, but for their friction; end it "
                 "and start again"};
  }
  const SettingTable now = settings_of(after);
  for (const Setting& setting : settings_of(before)) {
    if (!is_fixed_while_running(setting) || setting.get() == now.find(setting.key())->get()) {
      continue;
    }
    return Error{Errc::invalid_argument, setting.key() +
                                             " cannot change while the loop runs; end it and "
                                             "start again"};
  }
  return Done{};
}

bool keeps_surfaces(const RunSettings& before, const RunSettings& after) {
  return before.backend == after.backend && before.binning == after.binning &&
         has_field(before) == has_field(after) &&
         needs_depth_change(before) == needs_depth_change(after) &&
         has_same_settings(before.surface, after.surface) &&
         has_same_settings(before.time, after.time) &&
         (!has_field(after) || has_same_settings(before.field, after.field));
}

bool keeps_coupling(const RunSettings& before, const RunSettings& after) {
  return has_same_settings(before.coupling, after.coupling);
}

}}  // namespace palpate::v0
