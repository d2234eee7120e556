// A packed tool cut open, drawn in software.
#pragma once

#include <span>
#include <string>

#include "palpate/math/sphere.h"
#include "palpate/mesh/triangle_mesh.h"
#include "src/session/scene_picture.h"

namespace palpate {

/// What lies in front of a plane is taken away; the view, without perspective, looks at the cut
/// obliquely.
struct Cut {
  View view;
  Vec3d through;  ///< a point of the plane
  Vec3d normal;   ///< unit; points to the half that is taken away, towards the eye
};

/// The cut across `axis` (0, 1, 2) through the middle of the mesh' box, its longer side to the
/// right, in a picture so many pixels wide and as high as it takes.
Cut cut_across(const TriangleMesh& mesh, int axis, int width);

/// Whole spheres blue, cut ones with a yellow face, the wall of the mesh as a line around the cut
/// and from inside or outside behind it. PNG file bytes; the background is transparent.
std::string draw_cut_png(const Cut& cut, const TriangleMesh& mesh, std::span<const Sphere> spheres);

}  // namespace palpate
