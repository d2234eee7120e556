// 3-D models for pages: a tool cut open, and a tool in a depth image.
#pragma once

#include <nlohmann/json.hpp>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/contact/contact.h"
#include "palpate/tool/tool.h"

namespace palpate::inline v0 {

/// What a page holds at most.
inline constexpr std::size_t kMaxPageSpheres = 200000, kMaxPageTriangles = 200000;

/// The mesh of a tool, or null where it is too large, and spheres in its frame: its own, or others.
nlohmann::ordered_json solid_json(const Tool& tool, std::span<const Sphere> spheres);

/// A tool at X_CT in the image of a camera, each sphere with its state; where `planes` are given,
/// those that are cut by one. Large images are thinned.
nlohmann::ordered_json seen_tool_json(const Tool& tool, const Pose& X_CT,
                                      const DepthStreamInfo& stream, const DepthFrame& image,
                                      std::span<const SphereState> states,
                                      std::span<const Plane<float>> planes);

}  // namespace palpate::inline v0
