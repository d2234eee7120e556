// The option --sensor: the kind of a depth camera, or the file that tells its noise.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_noise.h"
#include "palpate/core/core.h"

namespace palpate::apps {

struct SensorChoice {
  std::optional<SensorKind> kind = {};    ///< none: as the camera reports
  std::optional<SensorNoise> noise = {};  ///< of a file
  std::string file = {};
};

/// Adds --sensor KIND or SENSOR.toml. A file that cannot be read is wrong usage.
void add_sensor_option(CLI::App& app, SensorChoice& sensor);
/// Sets the kind of a camera. Wrong usage: its URI says another one than the sensor file.
void use_sensor(const SensorChoice& choice, CameraUri& uri);
/// Reads a sensor file. Errors: as of settings files; a key is missing.
Result<SensorNoise> load_sensor(const std::string& path);
/// Checks that a sensor file was measured with images like these.
Status check_mode(const SensorChoice& choice, const std::string& name, int width, int height,
                  double unit);

}  // namespace palpate::apps
