// Meshes as the bytes of a GLB file.
#pragma once

#include <span>
#include <string>

#include "palpate/core/core.h"
#include "palpate/io/formats.h"

namespace palpate { inline namespace v0 {

/// A node and a material for each part; `parts` are not empty, nor is any of them, and faces use
/// vertices that exist. The error is the rest of a sentence.
Result<std::string> glb_content(std::span<const ColoredMesh* const> parts);

}}  // namespace palpate::v0
