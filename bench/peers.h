// Other libraries at the work of our boundary stage and of our surface estimation. Each lies in its
// own file; bench_peers compares and times them.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/math/geometry.h"

namespace palpate::bench {

[[noreturn]] inline void fail(const std::string& message) {
  std::fprintf(stderr, "bench_peers: %s\n", message.c_str());
  std::exit(1);
}

/// What is computed for every sphere.
enum class Question {
  which,  ///< does it hold a point?
  sums,   ///< what do its points and their normals add up to?
};

/// The answer. To `which`, only whether there are points.
struct SphereAnswer {
  int num_points = 0;
  Vec3d points, normals;

  /// Point i of the cloud lies in the sphere.
  void add(const PointCloud& cloud, std::size_t i) {
    ++num_points;
    points += to_double(cloud.point(i));
    normals += to_double(cloud.normal(i));
  }
};

/// A library that looks for points near a place. The cloud is copied to what the library reads
/// before anything is timed.
class BoundaryPeer {
 public:
  virtual ~BoundaryPeer() = default;
  virtual std::string name() const = 0;
  /// Makes the library's structure over the points: a camera's are new in every frame.
  virtual void build() = 0;
  /// Evaluates every sphere of a tool at X_WT. `answers`: one per sphere.
  virtual void evaluate(Question question, std::span<const Sphere> spheres, const Pose& X_WT,
                        std::span<SphereAnswer> answers) = 0;
};

/// The loop of every BoundaryPeer: ask_one(centre in W, radius, answer).
template <class AskOne>
void query_all(std::span<const Sphere> spheres, const Pose& X_WT, std::span<SphereAnswer> answers,
               AskOne&& evaluate_one) {
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  for (std::size_t k = 0; k < spheres.size(); ++k) {
    answers[k] = SphereAnswer{};
    evaluate_one(to_float(R_WT * to_double(spheres[k].centre) + X_WT.translation),
                 spheres[k].radius, answers[k]);
  }
}

/// The cloud must outlive them.
std::unique_ptr<BoundaryPeer> pcl_organized_neighbor(const PointCloud& cloud);
std::unique_ptr<BoundaryPeer> nanoflann_tree(const PointCloud& cloud);
enum class EmbreeTree { fast_to_query, fast_to_build };
std::unique_ptr<BoundaryPeer> embree_tree(const PointCloud& cloud, EmbreeTree kind);

/// A library that estimates normals.
class NormalsPeer {
 public:
  virtual ~NormalsPeer() = default;
  virtual std::string name() const = 0;
  virtual void run() = 0;
  virtual Vec3d normal(std::size_t i) const = 0;  ///< of pixel i; not finite: none
};

/// Those of an organised cloud of a pinhole camera.
std::vector<std::unique_ptr<NormalsPeer>> pcl_normals(const PointCloud& cloud);
std::unique_ptr<NormalsPeer> opencv_normals(const PointCloud& cloud, const Intrinsics& intrinsics);

/// A bilateral filter of depth.
class FilterPeer {
 public:
  virtual ~FilterPeer() = default;
  virtual std::string name() const = 0;
  virtual void run() = 0;
  virtual float depth(std::size_t i) const = 0;
};
/// With our default window and widths, but one similarity width for all depths and no notion of
/// pixels without depth.
std::unique_ptr<FilterPeer> opencv_bilateral(std::span<const float> depth, int width, int height);

}  // namespace palpate::bench
