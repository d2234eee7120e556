// Materials by region of the image: --labels FILE.png --material LABEL=MATERIAL.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/haptics/local_contact.h"

namespace palpate::apps {

struct MaterialOptions {
  std::vector<std::string> labels;                 ///< files, of each camera
  std::vector<std::optional<Material>> materials;  ///< by label
};

void add_material_options(CLI::App& app, MaterialOptions& options);
/// Wrong usage if one is given without the other.
void check_materials(const MaterialOptions& options);
/// Reads the labels. Errors: a file that is no label image.
Result<std::vector<std::shared_ptr<const MaterialRegions>>> load_regions(
    const MaterialOptions& options);

}  // namespace palpate::apps
