// Images of the depth of meshes with poses, which mask the pixels that show them or lie behind.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/mesh/mesh.h"
#include "src/cameras/internal/link_draw.h"

namespace palpate { inline namespace v0 {

/// For images of this size.
inline LinkCamera link_camera(const Intrinsics& k, int width, int height, double padding) {
  const double x = std::max(std::abs(k.cx), std::abs(width - 1 - k.cx)) / k.fx,
               y = std::max(std::abs(k.cy), std::abs(height - 1 - k.cy)) / k.fy;
  return {k.fx, k.fy, k.cx, k.cy, padding, std::sqrt(1 + x * x + y * y)};
}

/// Draws meshes into an image of inverse depth, wider by a padding on all sides, and takes from
/// depth frames what they show of these meshes and what lies behind them. Every mesh is drawn, open
/// ones and those of any winding too. The same bits on every machine.
class LinkImage {
 public:
  /// `padding`: m, around the meshes; a pixel more is always added.
  LinkImage(const Intrinsics& intrinsics, double padding);

  /// Begins an image of that size.
  void begin(int width, int height);
  /// A mesh in frame L. O(triangles); parts nearer than kNearestLink are left out.
  void add(const TriangleMesh& mesh, const Pose& X_CL);
  /// Once all are added: draws them. O(triangles and the pixels around them).
  void draw();

  /// Sets what the meshes cover, or hide, to no measurement; returns how many pixels that are.
  int remove_from(DepthFrame& frame) const;
  /// m: pixels as deep as that or deeper are removed; infinite where nothing is drawn.
  double limit_at(int u, int v) const;

 private:
  struct Shell {
    std::vector<LinkTriangle> triangles;
    float nearest = 0;  // 1 / m
  };

  void add_triangle(const LinkTriangle& triangle);
  void draw_shell(const Shell& shell);
  void draw_triangle(const LinkTriangle& triangle, const LinkWindow& canvas);
  void widen_rows(const LinkWindow& drawn, int radius);
  void widen_columns(int width, int height, int radius);

  const Intrinsics intrinsics_;
  const double padding_;
  LinkCamera camera_;
  int width_ = 0, height_ = 0;
  std::vector<LinkVertex> vertices_;  // of a mesh
  std::vector<Shell> shells_;         // from near to far
  std::vector<float> canvas_, wide_;  // of a shell, 1 / m
  std::vector<float> row_, other_row_;
  std::vector<float> front_;  // 1 / m; 0: nothing
  LinkWindow covered_;        // of the image
};

}}  // namespace palpate::v0
