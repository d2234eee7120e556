// --caps: the part of the tool inside the scene as a 3-D mesh.
#pragma once

#include <CLI/CLI.hpp>
#include <span>
#include <string>

#include "palpate/contact/contact.h"

namespace palpate::apps {

struct CapsOptions {
  std::string file;  ///< empty: none
  int segments = 24;
};

/// --caps and --caps-segments.
void add_caps_options(CLI::App& app, CapsOptions& options);

/// Wrong usage unless a picture can be written under this name.
void check_caps_options(const CapsOptions& options);

/// Writes the part of every sphere inside the scene, in W, as `query` measures it at `X_WT`: cut
/// spheres purple, whole ones blue (thesis Fig. 4.4). Returns the number of triangles. Error:
/// nothing is inside, or too much for a picture.
Result<std::size_t> write_caps(const CapsOptions& options, const Tool& tool,
                               const ContactQuery& query, std::span<const SurfaceBlend> cameras,
                               const Pose& X_WT);

}  // namespace palpate::apps
