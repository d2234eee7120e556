// A force that vanishes because nothing was measured is told: dark patches of a block before a
// wall.
#include <cmath>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate {
namespace {

using test::HullScene;

constexpr double kBlock = 0.5, kWall = 1.2, kEdge = 0.1;  // depths and the block's right edge, m

/// The depth image of a wall and, if there is one, the block to the left of x = kEdge, whose pixels
/// from `left` to `right` of its edge (m, of x) are dark in the middle rows.
std::vector<float> dark_image(double left, double right, bool has_block = true) {
  const Camera camera = test::vga();
  std::vector<float> meters;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double x = (u - camera.intrinsics.cx) / camera.intrinsics.fx * kBlock;
      const bool is_block = has_block && x < kEdge;
      const bool is_dark = is_block && x > kEdge - left && x <= kEdge - right && v > 60 && v < 420;
      meters.push_back(static_cast<float>(is_dark ? 0 : (is_block ? kBlock : kWall)));
    }
  }
  return meters;
}

class Unseen : public testing::Test {
 protected:
  Unseen()
      : tool_(test::random_tool(300, 0.008, 5)),
        query_(make_contact_query(Place::cpu(), tool_, FieldMethod{SphereVolumes::own}).value()),
        whole_(tool_.sphere_mass().volume) {}

  /// Shares of the tool that are felt and unseen, `depth` behind the block's front, so far left of
  /// its edge.
  struct Shares {
    double felt, unseen;
  };
  Shares at(const std::vector<SurfaceBlend>& views, double from_edge, double depth) {
    const Pose X_WT{{kEdge - from_edge, 0, kBlock + depth}, {}};
    const Penetration p = query_->measure(views, X_WT, {.unseen_volume = true}).penetration;
    return {p.volume / whole_, p.unseen_volume / whole_};
  }

  Tool tool_;
  std::unique_ptr<ContactQuery> query_;
  double whole_;
};

TEST_F(Unseen, ByOneCameraIsWhatItDidNotMeasure) {
  const auto with = [](double left, double right) {
    HullScene scene;
    test::add_view(scene, test::vga(), {}, dark_image(left, right));
    test::set_apart(scene.views[0].from, scene.views[0].to);
    return scene;
  };
  const HullScene none = with(0, 0), edge = with(0.04, 0), wide = with(0.16, 0.03);
  const HullScene small = with(0.035, 0.03);
  // Without a patch it is felt and seen, before the block and little behind its front.
  EXPECT_GT(at(none.views, 0.02, 0.005).felt, 0.5);
  EXPECT_EQ(at(none.views, 0.02, 0.005).unseen, 0);
  EXPECT_EQ(at(none.views, 0.02, -0.1).unseen, 0);
  // At the edge what is behind goes on through the patch, in its middle nothing is known.
  for (const auto& [scene, place] : {std::pair{&edge, 0.02}, {&wide, 0.095}}) {
    for (const double depth : {-0.03, 0.005, 0.05}) {
      EXPECT_LT(at(scene->views, place, depth).felt, 0.02) << place << " " << depth;
      EXPECT_GT(at(scene->views, place, depth).unseen, 0.98) << place << " " << depth;
    }
  }
  // A small patch is closed.
  EXPECT_GT(at(small.views, 0.03, 0.005).felt, 0.5);
  EXPECT_LT(at(small.views, 0.03, 0.005).unseen, 0.01);
}

// One of several, asked alone, costs a second query.
TEST_F(Unseen, ByOneOfSeveralCamerasAloneIsMeasuredOnRequest) {
  HullScene scene;
  test::add_view(scene, test::vga(), {}, dark_image(0.16, 0.03));
  const Pose X_WT{{kEdge - 0.095, 0, kBlock + 0.005}, {}};
  std::vector<std::uint8_t> marks(tool_.spheres().size());
  const Penetration plain = query_->measure(scene.views, X_WT).penetration;
  const Penetration wanted =
      query_->measure(scene.views, X_WT, {.unseen_volume = true}).penetration;
  const Penetration marked = query_->measure(scene.views, X_WT, {.unseen = marks}).penetration;
  EXPECT_EQ(plain.unseen_volume, 0);
  EXPECT_GT(wanted.unseen_volume, 0.98 * whole_);
  EXPECT_EQ(marked.unseen_volume, wanted.unseen_volume);
  EXPECT_EQ(plain.volume, wanted.volume);
}

TEST_F(Unseen, BySeveralCamerasIsWhatNoneHasMeasured) {
  HullScene scene;
  for (int k = 0; k < 2; ++k) test::add_view(scene, test::vga(), {}, dark_image(0.16, 0.03));
  EXPECT_LT(at(scene.views, 0.095, 0.005).felt, 0.02);
  EXPECT_GT(at(scene.views, 0.095, 0.005).unseen, 0.98);
  // One that has measured it is enough.
  HullScene both;
  test::add_view(both, test::vga(), {}, dark_image(0.16, 0.03));
  test::add_view(both, test::vga(), {}, dark_image(0, 0));
  EXPECT_GT(at(both.views, 0.095, 0.005).felt, 0.5);
  EXPECT_LT(at(both.views, 0.095, 0.005).unseen, 0.02);
}

// The wall behind is remembered; that the block is before it was not measured in its dark patches.
TEST_F(Unseen, WithAMemoryIsWhatWasNotMeasuredNow) {
  const Camera camera = test::vga();
  DepthStreamInfo stream;
  stream.width = camera.width;
  stream.height = camera.height;
  stream.intrinsics = camera.intrinsics;
  TimeOptions time;
  time.mode = TimeMode::latest;
  time.average.kind = DepthAverage::none;
  time.memory.kind = DepthMemory::on;
  ThreadPool pool(1);
  for (const auto& [left, right, place] : {std::tuple{0.04, 0.0, 0.02}, {0.16, 0.03, 0.095}}) {
    SurfaceTimeline timeline = SurfaceTimeline::create(stream, {.time = time}).value();
    for (int i = 0; i < 6; ++i) {
      DepthFrame frame{camera.width, camera.height, 0.0001, {}, 0};
      for (const float z : dark_image(left, right, i > 3)) {
        frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / frame.unit)));
      }
      timeline.push(frame, i / 30.0, pool);
    }
    const std::vector<SurfaceBlend> views{timeline.at(1)};
    EXPECT_LT(at(views, place, 0.005).felt, 0.02);
    EXPECT_GT(at(views, place, 0.005).unseen, 0.98);
    // The block itself is felt, and behind it space is remembered.
    EXPECT_GT(at(views, place + 0.12, 0.005).felt, 0.5);
    EXPECT_EQ(at(views, place + 0.12, 0.005).unseen, 0);
    EXPECT_EQ(at(views, place + 0.12, 0.4).unseen, 0);
  }
}

}  // namespace
}  // namespace palpate
