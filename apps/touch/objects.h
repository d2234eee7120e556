// Rigid objects beside the cloud: --object TOOL2.palp@'tx ty tz qx qy qz qw'[,friction=MU]
// [,frame=NAME][,mass=KG][,moving].
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "palpate/run/run_loop.h"

namespace palpate::apps {

/// An object of the command line.
struct ObjectOption {
  std::string file;
  Pose X_WB;          ///< in `frame`, until that is known
  std::string frame;  ///< empty: the world
  std::optional<double> friction, static_ratio, viscous;
  bool moves = false;
  double mass = 0;  ///< kg; 0: by its volume
};

/// Adds --object, one per object; `can`: objects may move.
void add_object_option(CLI::App& app, std::vector<ObjectOption>& objects, bool can_move);
/// Reads the tool files, each once. Each object has the name of its file, in letters, digits and _;
/// the second one of a name ends in _2.
Result<std::vector<SceneObject>> load_objects(const std::vector<ObjectOption>& options);

}  // namespace palpate::apps
