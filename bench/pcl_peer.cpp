// The Point Cloud Library. OrganizedNeighbor is the best off-the-shelf point-in-sphere query
// without a tree: it looks at the pixels that a sphere can cover.
#include <pcl/features/integral_image_normal.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/organized.h>
#include <pcl/search/impl/organized.hpp>

#include "bench/peers.h"

namespace palpate::bench {
namespace {

using PclCloud = pcl::PointCloud<pcl::PointXYZ>;

PclCloud::Ptr to_pcl(const PointCloud& cloud) {
  PclCloud::Ptr result(new PclCloud(static_cast<std::uint32_t>(cloud.width()),
                                    static_cast<std::uint32_t>(cloud.height())));
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f p = cloud.point(i);
    (*result)[i] = pcl::PointXYZ(p.x, p.y, p.z);
  }
  return result;
}

class OrganizedNeighbor : public BoundaryPeer {
 public:
  explicit OrganizedNeighbor(const PointCloud& cloud) : cloud_(cloud), points_(to_pcl(cloud)) {}

  std::string name() const override { return "PCL organized"; }

  void build() override { search_.setInputCloud(points_); }

  void evaluate(Question question, std::span<const Sphere> spheres, const Pose& X_WT,
                std::span<SphereAnswer> answers) override {
    const unsigned max_points = question == Question::which ? 1 : 0;  // 0: all
    query_all(spheres, X_WT, answers, [&](const Vec3f& c, float radius, SphereAnswer& answer) {
      const int num =
          search_.radiusSearch(pcl::PointXYZ(c.x, c.y, c.z), static_cast<double>(radius), indices_,
                               distances_, max_points);
      if (question == Question::which) {
        answer.num_points = num;
      } else {
        for (const int i : indices_) answer.add(cloud_, static_cast<std::size_t>(i));
      }
    });
  }

 private:
  const PointCloud& cloud_;
  PclCloud::Ptr points_;
  pcl::search::OrganizedNeighbor<pcl::PointXYZ> search_;
  std::vector<int> indices_;
  std::vector<float> distances_;
};

class IntegralImageNormals : public NormalsPeer {
 public:
  using Estimation = pcl::IntegralImageNormalEstimation<pcl::PointXYZ, pcl::Normal>;

  IntegralImageNormals(PclCloud::Ptr points, Estimation::NormalEstimationMethod method,
                       std::string name)
      : points_(std::move(points)), name_(std::move(name)) {
    estimation_.setNormalEstimationMethod(method);
    estimation_.setMaxDepthChangeFactor(0.02F);
    estimation_.setNormalSmoothingSize(5);
    estimation_.setBorderPolicy(Estimation::BORDER_POLICY_MIRROR);
  }

  std::string name() const override { return name_; }

  void run() override {
    estimation_.setInputCloud(points_);  // computes the integral images
    estimation_.compute(normals_);
  }

  Vec3d normal(std::size_t i) const override {
    const pcl::Normal& n = normals_[i];
    return to_double(Vec3f{n.normal_x, n.normal_y, n.normal_z});
  }

 private:
  PclCloud::Ptr points_;
  std::string name_;
  Estimation estimation_;
  pcl::PointCloud<pcl::Normal> normals_;
};

}  // namespace

std::unique_ptr<BoundaryPeer> pcl_organized_neighbor(const PointCloud& cloud) {
  return std::make_unique<OrganizedNeighbor>(cloud);
}

std::vector<std::unique_ptr<NormalsPeer>> pcl_normals(const PointCloud& cloud) {
  using Estimation = IntegralImageNormals::Estimation;
  const PclCloud::Ptr points = to_pcl(cloud);
  std::vector<std::unique_ptr<NormalsPeer>> peers;
  peers.push_back(std::make_unique<IntegralImageNormals>(points, Estimation::AVERAGE_3D_GRADIENT,
                                                         "PCL gradient"));
  peers.push_back(std::make_unique<IntegralImageNormals>(points, Estimation::COVARIANCE_MATRIX,
                                                         "PCL covariance"));
  return peers;
}

}  // namespace palpate::bench
