// Rigid objects beside the cloud: --object TOOL2.palp@'tx ty tz qx qy qz qw'[,friction=MU].
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "palpate/run/settings.h"

namespace palpate::apps {

/// An object as the command line names it.
struct ObjectOption {
  std::string file;
  Pose X_WB;
  std::optional<double> friction;
};

/// --object, as often as there are objects.
void add_object_option(CLI::App& app, std::vector<ObjectOption>& objects);
/// Reads the tool files, each once.
Result<std::vector<SceneObject>> load_objects(const std::vector<ObjectOption>& options);

}  // namespace palpate::apps
