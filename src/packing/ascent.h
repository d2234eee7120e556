// Growing a ball in the free space until it touches obstacles on all sides.
#pragma once

#include <vector>

#include "src/packing/linear_program.h"
#include "src/packing/solid/triangle_bvh.h"
#include "src/packing/sphere_levels.h"

namespace palpate { inline namespace v0 {

struct Ball {
  Vec3d center;
  double radius = 0;
};

/// Everything that lies within `reach` of `center`.
struct Obstacles {
  Vec3d center;
  double reach = 0;
  std::vector<Sphere> spheres;
  std::vector<int> triangles;
};

/// The void to be filled: inside the mesh, outside the spheres.
struct FreeSpace {
  const TriangleBvh& mesh;
  const SphereLevels& spheres;
  double max_radius;

  /// Distance from an inside point to the nearest obstacle, or `reach` if that is less.
  double clearance(const Vec3d& p, double reach) const;

  /// The nearest obstacle not farther than `reach` from an inside point, a sphere or a point of a
  /// triangle; distance `reach` if there is none.
  struct Nearest {
    double distance = 0;
    Sphere sphere;      ///< radius 0: none
    int triangle = -1;  ///< -1: none
    Vec3d point;        ///< of the triangle
  };
  Nearest nearest(const Vec3d& p, double reach) const;

  /// About the largest ball in the free space, not larger than `radius`, that touches the point p
  /// of an obstacle's surface from the side to which the unit vector n points; radius 0 if none is
  /// found.
  Ball tangent_ball(const Vec3d& p, const Vec3d& n, double radius) const;

  /// Collects the obstacles within `reach` of p, or within less where they are more than `limit`;
  /// `clearance` is that of p. False: even just beyond the clearance they are too many.
  bool gather(const Vec3d& p, double clearance, double reach, std::size_t limit,
              Obstacles& obstacles) const;
};

/// Climbs to a local maximum of the clearance, never leaving the free space.
///
/// The clearance is a minimum of convex functions, the distances to a triangle or to a ball. The
/// tangent planes of convex functions lie below them, so maximising the minimum of the tangent
/// planes is a linear program whose solution is a lower bound of the clearance at the new place:
/// every step gains what it promised or more, and close to a ball that touches four obstacles the
/// steps converge like Newton's.
class Ascent {
 public:
  explicit Ascent(const FreeSpace& space) : space_(space) {}

  /// Keeps a ball near a place: its surface is not farther than `length` from there.
  struct Tether {
    Vec3d place;
    double length = 0;
  };

  /// From an inside point whose clearance is at most `reach`; stops where the tether ends.
  Ball climb(const Vec3d& start, double reach, const Tether* tether = nullptr);

  /// The same with obstacles known to be complete around the start; collects others only when the
  /// ball grows out of their reach.
  Ball climb(const Vec3d& start, const Obstacles& obstacles);

 private:
  bool climb_within(const Obstacles& obstacles, Ball& ball);
  double meet(const Vec3d& p, double reach);
  double measure(const Obstacles& obstacles, const Vec3d& p);

  const FreeSpace& space_;
  Obstacles obstacles_;
  std::vector<double> distance_;
  std::vector<Vec3d> away_;  ///< gradient of distance_
  LinearConstraints constraints_;
};

}}  // namespace palpate::v0
