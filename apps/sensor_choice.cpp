#include "apps/sensor_choice.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "apps/options.h"
#include "palpate/session/run.h"

namespace palpate::apps {

void add_sensor_option(CLI::App& app, SensorChoice& sensor) {
  const auto take = [&sensor](const std::string& text) {
    sensor = {value_named<SensorKind>(text), {}, {}};
    if (sensor.kind || text == "auto") return;
    if (std::filesystem::path(text).extension() != ".toml") {
      usage_error(
          "--sensor must be none, structured_light, active_stereo, tof, auto, or a file of "
          "palpate calibrate --noise (.toml), not '" +
          text + "'");
    }
    const auto noise = load_sensor(text);
    if (!noise) usage_error("--sensor: " + noise.error().message);
    sensor = {noise->kind, *noise, text};
  };
  app.add_option_function<std::string>(
         "--sensor", take,
         "kind of depth camera (none, structured_light, active_stereo, tof; auto: as the camera "
         "reports): selects defaults of surface settings; or a file of palpate calibrate --noise: "
         "its noise, too")
      ->type_name("KIND|SENSOR.toml");
}

Result<SensorNoise> load_sensor(const std::string& path) {
  SensorNoise sensor;
  const SettingTable table = settings_of(sensor);
  const auto keys = read_settings_file(path, table);
  if (!keys) return keys.error();
  for (const Setting& setting : table) {
    if (std::ranges::find(*keys, setting.key()) == keys->end()) {
      return Error{Errc::bad_input, path + " has no " + setting.key() +
                                        "; measure it again with palpate calibrate --noise"};
    }
  }
  return sensor;
}

void use_sensor(const SensorChoice& choice, CameraUri& uri) {
  if (choice.noise && uri.sensor && *uri.sensor != choice.noise->kind) {
    usage_error("--sensor: " + choice.file + " was measured with a camera of kind " +
                name_of(choice.noise->kind) + ", and " + uri.text + " is " + name_of(*uri.sensor) +
                "; measure this camera with palpate calibrate --noise");
  }
  if (choice.kind) uri.sensor = choice.kind;
}

Status check_mode(const SensorChoice& choice, const std::string& name, int width, int height,
                  double unit) {
  if (!choice.noise) return Done{};
  const SensorNoise& noise = *choice.noise;
  constexpr double kSame = 1e-6;  // of the unit
  if (noise.width == width && noise.height == height &&
      std::abs(noise.unit - unit) <= kSame * unit) {
    return Done{};
  }
  char text[200];
  std::snprintf(text, sizeof text,
                " was measured at %d x %d pixels of %g m, and the images are %d x %d of %g m: ",
                noise.width, noise.height, noise.unit, width, height, unit);
  return Error{Errc::bad_input,
               choice.file + text + name + "; measure this mode with palpate calibrate --noise"};
}

}  // namespace palpate::apps
