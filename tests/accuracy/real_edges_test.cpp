// Edge planes on real depth images: the query against brute force where people and furniture end.
#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"
#include "palpate/io/formats.h"
#include "tests/test_util/contact_queries.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/contact_truth.h"
#include "tests/test_util/real_frames.h"

namespace palpate {
namespace {

PALPATE_ON_ALL_FRAMES(RealEdges);

TEST_P(RealEdges, EqualBruteForce) {
  PALPATE_FRAMES_OR_SKIP(frames, [](const auto& path) { return load_depth_png(path).value(); },
                         {"pcl_person"});
  const DepthFrame& frame = frames[0].frame;
  SurfaceEstimator surface =
      SurfaceEstimator::create(frame.width, frame.height, frames[0].intrinsics).value();
  ThreadPool pool(1);
  surface.update(frame, pool);
  const PointCloudView cloud = surface.cloud();
  std::vector<std::size_t> edge_points;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.edge_x[i] != 0 && std::isfinite(cloud.x[i])) edge_points.push_back(i);
  }
  ASSERT_GT(edge_points.size(), 500u);

  const Tool tool = test::random_tool(120, 0.06, 3);
  const test::ToolTruth tool_truth(tool);
  test::ContactQueries queries(tool);
  test::Random random(5);
  int num_cut = 0;
  for (int k = 0; k < 40; ++k) {
    const std::size_t i = edge_points[random.bits() % edge_points.size()];
    const Pose X_WT{Vec3d{cloud.x[i], cloud.y[i], cloud.z[i]} + random.in_box(0.03),
                    random.rotation(3)};
    for (const Continuity continuity : {Continuity::none, Continuity::entry}) {
      const test::BoundaryTruth touched =
          test::boundary_truth(tool_truth.spheres, cloud, X_WT, continuity);
      for (const MethodKind method :
           {MethodKind::weighted, MethodKind::simplified, MethodKind::graph}) {
        double without = 0;
        for (const Edges edges : {Edges::none, Edges::strict, Edges::cut}) {
          const ContactOptions options{
              method,
              Priority::distance,
              method == MethodKind::graph ? InsideVolume::cap : InsideVolume::full,
              SphereVolumes::own,
              edges,
              continuity};
          const double expected =
              test::contact_truth(tool_truth, touched, X_WT, options).penetration.volume;
          const double measured = queries.measure({cloud}, X_WT, options).volume;
          ASSERT_NEAR(measured, expected, 1e-5 * expected + 1e-12) << "pose " << k;
          if (edges == Edges::none) without = measured;
          if (edges == Edges::cut) num_cut += measured < 0.98 * without;
        }
      }
    }
  }
  EXPECT_GT(num_cut, 60);  // of 240: edges matter here
}

}  // namespace
}  // namespace palpate
