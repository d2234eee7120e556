// Finds places for the next spheres around a sphere that was just inserted.
#pragma once

#include <vector>

#include "src/packing/ascent.h"

namespace palpate { inline namespace v0 {

/// The holes that a new sphere creates all touch it: any other local maximum of the clearance was
/// there before. So it is enough to look around it: for each of some hundred directions the largest
/// ball that touches the sphere there is known in closed form, and from the directions that beat
/// their neighbors an ascent finishes the work.
class HoleSearch {
 public:
  explicit HoleSearch(const FreeSpace& space) : space_(space), ascent_(space) {}

  /// Appends the maximal balls of at least `min_radius` around `sphere`, which is in the space.
  void find(const Sphere& sphere, double min_radius, std::vector<Ball>& holes);

  Ascent& ascent() { return ascent_; }

 private:
  bool measure_directions(const Sphere& sphere);
  void probe_directions(const Sphere& sphere);
  void touch_sphere(const Sphere& sphere, const Sphere& obstacle);
  void touch_triangle(const Sphere& sphere, const Triangle& triangle);

  const FreeSpace& space_;
  Ascent ascent_;
  Obstacles obstacles_;
  std::vector<float> radius_;  ///< of the touching ball per direction, the sphere's radius being 1
};

}}  // namespace palpate::v0
