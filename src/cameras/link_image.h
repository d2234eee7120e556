// From which depth on the pixels of a depth image show meshes with poses, or what these hide.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/mesh/mesh.h"

namespace palpate::inline v0 {

/// Draws meshes into an image of inverse depth, wider by a padding on all sides, and takes from
/// depth frames what they show of these meshes and what lies behind them. Every mesh is drawn, open
/// ones and those of any winding too. The same bits on every machine.
class LinkImage {
 public:
  /// `padding`: m, around the meshes; a pixel more is always added.
  LinkImage(const Intrinsics& intrinsics, double padding);

  /// Begins an image of that size.
  void begin(int width, int height);
  /// A mesh in frame L. O(triangles); parts nearer than kNearest are left out.
  void add(const TriangleMesh& mesh, const Pose& X_CL);
  /// Once all are added: draws them. O(triangles and the pixels around them).
  void draw();

  /// Sets what the meshes cover, or hide, to no measurement; returns how many pixels that are.
  int remove_from(DepthFrame& frame) const;
  /// m: pixels as deep as that or deeper are removed; infinite where nothing is drawn.
  double limit_at(int u, int v) const;

  /// m. Nearer things are drawn by no camera, and one that is mounted in a housing looks out of it.
  static constexpr double kNearest = 0.05;

 private:
  struct Corner {
    float u = 0, v = 0, w = 0;  // pixels, 1 / m
  };
  struct Triangle {
    Corner corners[3];
  };
  /// Triangles whose nearest corner has a depth in a range of at most 1 : 1.25.
  struct Shell {
    std::vector<Triangle> triangles;
    float nearest = 0;  // 1 / m
  };
  /// Columns and rows from `left` and `top` on, before `right` and `bottom`.
  struct Window {
    int left = 0, top = 0, right = 0, bottom = 0;
    int width() const { return right - left; }
    int height() const { return bottom - top; }
    bool is_empty() const { return right <= left || bottom <= top; }
  };

  void add_clipped(const Vec3d (&p_C)[3]);
  void add_triangle(const Triangle& triangle);
  double reach_of(double w) const;
  Corner corner_of(const Vec3d& p_C) const;
  void draw_shell(const Shell& shell);
  static std::pair<Triangle, Triangle> halves_of(const Triangle& triangle);
  void draw_triangle(const Triangle& triangle, const Window& canvas);
  void widen_rows(const Window& drawn, int radius);
  void widen_columns(int width, int height, int radius);

  const Intrinsics intrinsics_;
  const double padding_;
  double widest_ = 1;  // of directions in the image: 1 / cosine to the optical axis
  int width_ = 0, height_ = 0;
  std::vector<Vec3d> points_;         // of a mesh, in C
  std::vector<Shell> shells_;         // from near to far
  std::vector<float> canvas_, wide_;  // of a shell, 1 / m
  std::vector<float> row_, other_row_;
  std::vector<float> front_;  // 1 / m; 0: nothing
  Window covered_;            // of the image
};

}  // namespace palpate::inline v0
