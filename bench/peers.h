// Adapters of other libraries to our boundary stage and surface estimation. Each lies in its
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

/// Output for every sphere.
enum class Question {
  which,  ///< whether it holds a point
  sums,   ///< sums of its points and of their normals
};

/// Result for a sphere. For `which`, only the presence of points.
struct SphereAnswer {
  int num_points = 0;
  Vec3d points, normals;

  /// Adds point i of the cloud, which lies in the sphere.
  void add(const PointCloud& cloud, std::size_t i) {
    ++num_points;
    points += to_double(cloud.point(i));
    normals += to_double(cloud.normal(i));
  }
};

/// A library for point queries. The cloud is converted to the library's format before anything is
/// timed.
class BoundaryPeer {
 public:
  virtual ~BoundaryPeer() = default;
  virtual std::string name() const = 0;
  /// Builds the library's structure over the points, which a camera renews in every frame.
  virtual void build() = 0;
  /// Evaluates every sphere of a tool at X_WT. `answers`: one per sphere.
  virtual void evaluate(Question question, std::span<const Sphere> spheres, const Pose& X_WT,
                        std::span<SphereAnswer> answers) = 0;
};

/// Loop of every BoundaryPeer: ask_one(center in W, radius, answer).
template <class AskOne>
void query_all(std::span<const Sphere> spheres, const Pose& X_WT, std::span<SphereAnswer> answers,
               AskOne&& evaluate_one) {
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  for (std::size_t k = 0; k < spheres.size(); ++k) {
    answers[k] = SphereAnswer{};
    evaluate_one(to_float(R_WT * to_double(spheres[k].center) + X_WT.translation),
                 spheres[k].radius, answers[k]);
  }
}

/// The cloud must outlive the peers.
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

/// Normals of an organized cloud of a pinhole camera.
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
