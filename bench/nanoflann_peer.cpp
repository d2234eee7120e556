// nanoflann: a k-d tree over the points of a frame, one search per sphere that keeps no list.
#include <nanoflann.hpp>

#include "bench/peers.h"

namespace palpate::bench {
namespace {

/// Point set in the interface of nanoflann.
struct Points {
  std::vector<Vec3f> p;

  std::size_t kdtree_get_point_count() const { return p.size(); }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return axis == 0 ? p[i].x : axis == 1 ? p[i].y : p[i].z;
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3>;

/// Result set that takes the points within a radius as they are found; stops at the first one if
/// that suffices.
struct Visitor {
  const PointCloud& cloud;
  Question question;
  float squared_radius;
  SphereAnswer& answer;

  bool addPoint(float squared_distance, std::size_t i) {
    if (squared_distance > squared_radius) return true;
    if (question == Question::which) {
      answer.num_points = 1;
      return false;
    }
    answer.add(cloud, i);
    return true;
  }
  float worstDist() const { return squared_radius; }
  std::size_t size() const { return static_cast<std::size_t>(answer.num_points); }
  bool full() const { return true; }
  bool empty() const { return answer.num_points == 0; }
  void sort() const {}
};

class NanoflannTree : public BoundaryPeer {
 public:
  explicit NanoflannTree(const PointCloud& cloud) : cloud_(cloud) {
    for (std::size_t i = 0; i < cloud.size(); ++i) points_.p.push_back(cloud.point(i));
  }

  std::string name() const override { return "nanoflann"; }

  void build() override {
    constexpr std::size_t kPointsPerLeaf = 32;  // of 10, 32 and 64 the best to build and to query
    tree_ = std::make_unique<Tree>(3, points_,
                                   nanoflann::KDTreeSingleIndexAdaptorParams(kPointsPerLeaf));
  }

  void evaluate(Question question, std::span<const Sphere> spheres, const Pose& X_WT,
                std::span<SphereAnswer> answers) override {
    query_all(spheres, X_WT, answers, [&](const Vec3f& c, float radius, SphereAnswer& answer) {
      Visitor visitor{cloud_, question, radius * radius, answer};
      const float center[3] = {c.x, c.y, c.z};
      tree_->findNeighbors(visitor, center, {});
    });
  }

 private:
  const PointCloud& cloud_;
  Points points_;
  std::unique_ptr<Tree> tree_;
};

}  // namespace

std::unique_ptr<BoundaryPeer> nanoflann_tree(const PointCloud& cloud) {
  return std::make_unique<NanoflannTree>(cloud);
}

}  // namespace palpate::bench
