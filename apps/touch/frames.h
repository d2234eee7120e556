// Named frames, and the options that are given or reported in them.
#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "apps/options.h"
#include "apps/touch/objects.h"
#include "palpate/cameras/cameras.h"

namespace palpate::apps {

/// The frame options of a verb, by name. An empty name is the world.
struct FrameOptions {
  std::string path = "world";  ///< of the poses of a path; "base": those of the handle there
  std::string base;            ///< of coupling.base_in_scene
  std::string wrench;          ///< of the reported wrench, or "auto"
};

/// --wrench-frame, --wrench-point and --tcp; they end up in `settings`.
void add_output_options(CLI::App& app, FrameOptions& options, RunSettings& settings);

/// Named frames that are fixed in the world.
class NamedFrames {
 public:
  /// Names `cameras` camera, camera_2, ... Errors: of the files of their poses.
  static Result<NamedFrames> of(std::span<const CameraUri> cameras);
  /// Adds the cameras by their names in the rig, and the rig's own frames. Errors: a name twice, or
  /// one that is a word of the options (tool, device, base, auto, named).
  Status add(const CameraRig& rig);
  Status add(const std::string& name, const Pose& X_WF);

  /// Returns X_WF. Error: no frame has this name, or it moves; with the names of all frames.
  Result<Pose> find(const std::string& name) const;

 private:
  Status add_of_rig(const std::string& name, const std::optional<Pose>& X_WF);

  std::map<std::string, std::optional<Pose>> frames_{{"world", Pose{}}};  // none: it moves
};

/// Transforms settings that are given in other frames into the world, and sets the pose of the
/// named frame of reported wrenches. Error: as of NamedFrames::find.
Status put_in_world(const NamedFrames& frames, const FrameOptions& options, RunSettings& settings);
Status put_in_world(const NamedFrames& frames, std::vector<ObjectOption>& objects);

}  // namespace palpate::apps
