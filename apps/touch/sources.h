// Options for the sources of depth frames.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "apps/options.h"
#include "apps/sensor_choice.h"
#include "palpate/cameras/cameras.h"
#include "palpate/core/core.h"

namespace palpate::apps {

/// Options --camera, and shorter ones for the most common cameras.
struct SourceOptions {
  std::vector<std::string> cameras;  ///< as open_camera takes them
  std::string rig;                   ///< file of several
  std::string depth_sequence, scene;
  CameraOptions camera;  ///< of the sequence
  double rate = 30;      ///< of the sequence, Hz
  bool noise = true;     ///< of the scene
  std::uint64_t seed = 1;
  SensorChoice sensor;
};
void add_source_options(CLI::App& app, SourceOptions& options);

/// Returns the cameras of the options except those of a rig, as URIs for open_camera. Wrong usage:
/// sources of more than one kind, or options that do not match them. `verb` is for messages.
std::vector<CameraUri> cameras_of(const SourceOptions& options, const std::string& verb);

/// Warns of cameras that are the same one at the same pose: each of its measurements counts twice.
void warn_of_twins(std::span<const CameraUri> cameras);

/// Returns the options to open a camera, which print on stderr what a camera waits for.
CameraOpening opening(bool in_real_time = true, std::optional<double> duration = {});

/// Finds the only plugged-in depth camera. Errors: there is none, or several, which are named.
Result<CameraUri> connected_camera();
/// Finds the only connected haptic device, except simulated ones. Errors: as above.
Result<std::string> connected_device();

}  // namespace palpate::apps
