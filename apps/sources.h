// The options that say where depth frames come from.
#pragma once

#include <string>
#include <vector>

#include "apps/options.h"
#include "palpate/cameras/cameras.h"

namespace palpate::apps {

/// --camera, and what is shorter for the commonest ones.
struct SourceOptions {
  std::vector<std::string> cameras;  ///< as open_camera takes them
  std::string rig;                   ///< file of several
  std::string depth_sequence, scene;
  CameraOptions camera;  ///< of the sequence
  double rate = 30;      ///< of the sequence, Hz
  bool noise = true;     ///< of the scene
  std::uint64_t seed = 1;
  std::optional<SensorKind> sensor;
};
void add_source_options(CLI::App& app, SourceOptions& options);

/// What they name but for a rig, all in the one way that open_camera takes. Wrong usage: sources of
/// more than one kind, or what does not go with them. `verb` is for messages.
std::vector<CameraUri> cameras_of(const SourceOptions& options, const std::string& verb);

/// How they are opened: on stderr, people hear at once what is waited for.
CameraOpening opening(bool in_real_time = true, std::optional<double> duration = {});

}  // namespace palpate::apps
