// palpate calibrate --noise: measures the noise of a camera in scenes at rest.
#pragma once

#include <string>
#include <vector>

#include "palpate/core/core.h"

namespace palpate::apps {

struct NoiseOptions {
  std::vector<std::string> cameras;  ///< as open_camera takes them: one camera, scene by scene
  std::string output;
  int num_frames = 0;  ///< of each scene, at most
  bool json = false;
};

/// Writes the sensor file and prints what was measured. Errors: a scene that cannot be read, moves,
/// is too short, or has another mode than the first one; nothing is written then.
Status calibrate_noise(const NoiseOptions& options);

}  // namespace palpate::apps
