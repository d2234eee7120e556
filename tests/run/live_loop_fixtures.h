// Fixtures of the tests of the whole loop.
#pragma once

#include <algorithm>
#include <memory>
#include <optional>

#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "palpate/run/run_loop.h"
#include "tests/run/loop_fakes.h"
#include "tests/test_util/wait_for.h"

namespace palpate::test {

inline const Tool& box_tool() {
  static const Tool tool = Tool::pack(make_box({0.05, 0.05, 0.05}), {.max_spheres = 60}).value();
  return tool;
}

/// A tool whose mesh's distance field other bodies can sample.
inline Tool packed(TriangleMesh mesh, int num_spheres) {
  return Tool::pack(std::move(mesh), {.max_spheres = num_spheres}).value().with_solid_field();
}

/// Limits that no busy machine reaches, and the hand's base 5 cm in front of the wall.
inline RunSettings patient_settings() {
  RunSettings settings;
  settings.num_threads = 1;
  settings.wants_real_time = false;
  settings.coupling.X_WB.translation = {0, 0, 0.45};
  settings.safety.max_contact_age = settings.safety.max_sensor_age = 30;
  settings.safety.energy_tank = 100;  // late ticks give the hand energy
  settings.safety.max_device_silence = settings.safety.max_tick = 30;
  settings.safety.ramp_seconds = 0.05;
  settings.safety.engage_timeout = 0.05;
  return settings;
}

/// The box goes from 5 mm before the wall to 15 mm into it.
inline Vec3d pressing_hand(double time) { return {0, 0, 0.02 + 0.02 * std::min(1.0, 4 * time)}; }

/// Returns a timeline that makes the surfaces that a run of these settings makes.
inline SurfaceTimeline timeline_of(const DepthStreamInfo& stream, const RunSettings& settings) {
  std::optional<DepthFieldOptions> field;
  if (settings.contact.method == MethodKind::field) field = settings.field;
  return SurfaceTimeline::create(
             stream, {.surface = settings.surface, .field = field, .time = settings.time})
      .value();
}

/// Returns the query of the box that a run of these settings makes, on the CPU.
inline std::unique_ptr<ContactQuery> query_of(const RunSettings& settings) {
  return make_contact_query(Place::cpu(), box_tool(), contact_method(settings.contact).value())
      .value();
}

}  // namespace palpate::test
