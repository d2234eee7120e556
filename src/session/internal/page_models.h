// 3-D models for pages: a tool cut open, and a tool in what cameras see.
#pragma once

#include <nlohmann/json.hpp>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/contact/body_contact.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Largest numbers of spheres and triangles on a page.
inline constexpr std::size_t kMaxPageSpheres = 200000, kMaxPageTriangles = 200000;

/// The mesh of a tool, or null where it is too large, and spheres in its frame: its own, or others.
nlohmann::ordered_json solid_json(const Tool& tool, std::span<const Sphere> spheres);

/// A tool at X_WT among the images of cameras, each sphere with its state; where `planes` are
/// given, those that are cut by one. Images without pixels are left out, large ones are thinned.
nlohmann::ordered_json seen_tool_json(const Tool& tool, const Pose& X_WT,
                                      std::span<const DepthStreamInfo> streams,
                                      std::span<const DepthFrame> images,
                                      std::span<const SphereState> states,
                                      std::span<const Plane<float>> planes);

/// Lists objects at their poses, each with its mesh, or null where those before it leave no room.
nlohmann::ordered_json seen_objects_json(std::span<const SceneObject> objects,
                                         std::span<const Pose> X_WB);

}}  // namespace palpate::v0
