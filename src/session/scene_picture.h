// Pictures of tool and surface, drawn in software.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/contact/contact_query.h"

namespace palpate {

/// A point on the picture.
struct ScreenPoint {
  double x = 0, y = 0;          ///< pixels
  double depth = 0;             ///< metres along the view direction
  double pixels_per_metre = 0;  ///< at this depth
};

/// How W is seen: by the depth camera itself, or without perspective from somewhere else.
struct View {
  Vec3d right, down, forward;  ///< unit axes of the picture in W
  Vec3d centre_W;              ///< at the middle of the picture
  double scale = 0;            ///< pixels per metre; with perspective, focal length in pixels
  bool perspective = false;    ///< then the eye is at the origin of W
  double slab = 0;             ///< without perspective: draw only points within +-slab of centre_W
  int width = 600, height = 450;

  ScreenPoint to_screen(const Vec3d& p_W) const;
};

/// The camera's own view, zoomed to show a ball.
View camera_view(const Vec3d& centre_W, double radius);
/// From above: x to the right, z (away from the camera) up.
View birds_eye_view(const Vec3d& centre_W, double radius);
/// From the side: z (away from the camera) to the right, y down.
View side_view(const Vec3d& centre_W, double radius);

/// The surface shaded by its normals and, as if it were a veil, over the tool's spheres: blue
/// inside, purple boundary, red outside (the thesis' colours). PNG file bytes; the background is
/// transparent.
std::string draw_scene_png(const View& view, const PointCloudView& cloud,
                           std::span<const Sphere> spheres, std::span<const SphereState> states,
                           const Pose& X_WT);

/// PNG file bytes; empty if there is no memory for them.
std::string encode_png(const std::vector<std::uint8_t>& rgba, int width, int height);

}  // namespace palpate
