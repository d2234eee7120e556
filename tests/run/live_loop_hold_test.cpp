// Held frames and pictures of a running loop.
#include <gtest/gtest.h>

#include <cmath>
#include <mutex>
#include <optional>

#include "tests/run/touching_loop.h"
#include "tests/test_util/contact_queries.h"

namespace palpate {
namespace {

using namespace test::touching_loop;  // NOLINT: all of it
using test::box_tool;
using test::wait_for;

TEST(LiveLoopHold, TheSceneStandsStillAndTheHandGoesOn) {
  Touching touching({.depth = [](int k) { return 0.5 + 0.0005 * k; }, .rate = 100});
  Seen& seen = touching.seen;
  const auto depth_of = [&](std::size_t k) {
    const std::lock_guard lock(seen.mutex);
    return seen.frames[k].frame.pixels[0];
  };
  const auto wait_for_frames = [&](std::size_t more) {
    const std::size_t desired = seen.num_frames() + more;
    EXPECT_TRUE(wait_for([&] { return seen.num_frames() >= desired; }));
  };
  touching.loop->hold_frames(true);
  // Wait for frames that were on their way: no two new frames are the same.
  EXPECT_TRUE(wait_for([&] {
    const std::size_t num = seen.num_frames();
    return num > 1 && depth_of(num - 1) == depth_of(num - 2);
  }));
  const std::size_t held = seen.num_frames() - 1;
  const int num_ticks = touching.device.num_ticks();
  wait_for_frames(10);
  EXPECT_TRUE(wait_for([&] { return touching.device.num_ticks() > num_ticks + 30; }));
  for (std::size_t k = held; k < held + 10; ++k) EXPECT_EQ(depth_of(k), depth_of(held));

  touching.loop->step_frame();
  EXPECT_TRUE(wait_for([&] { return depth_of(seen.num_frames() - 1) != depth_of(held); }));
  EXPECT_EQ(depth_of(seen.num_frames() - 1), depth_of(held) + 5);  // the next one, 0.5 mm on
  const std::size_t stepped = seen.num_frames() - 1;
  wait_for_frames(5);
  EXPECT_EQ(depth_of(seen.num_frames() - 1), depth_of(stepped));

  // Settings change meanwhile too.
  RunSettings settings = touching.loop->settings();
  settings.contact.method = MethodKind::graph;
  EXPECT_TRUE(touching.loop->change(settings));

  touching.loop->hold_frames(false);
  EXPECT_TRUE(
      wait_for([&] { return depth_of(seen.num_frames() - 1) >= depth_of(stepped) + 4 * 5; }));
  touching.loop->stop();
  for (std::size_t k = 1; k < seen.frames.size(); ++k) {
    EXPECT_GT(seen.frames[k].time, seen.frames[k - 1].time);
    const int step = depth_of(k) - depth_of(k - 1);
    EXPECT_TRUE(step >= 0 && step % 5 == 0) << step;  // a busy machine leaves some out
  }
  EXPECT_EQ(touching.loop->report().fault, Fault::stopped);
}

TEST(LiveLoopPictures, AreWhatAFreshQuerySays) {
  for (const MethodKind method : {MethodKind::field, MethodKind::graph}) {
    RunSettings settings = patient_settings();
    settings.contact.method = method;
    Touching touching({.depth = [](int k) { return 0.5 + 0.001 * std::sin(k); }}, settings);
    EXPECT_EQ(touching.loop->new_contact_picture(PictureConsumer::robots), nullptr);
    EXPECT_EQ(touching.loop->new_surface_picture(), nullptr);
    touching.run_for(0.1);
    touching.loop->request_contact_picture(PictureConsumer::robots);
    touching.loop->request_surface_picture();
    const ContactPicture* picture = nullptr;
    const SurfacePicture* surface = nullptr;
    ASSERT_TRUE(wait_for(
        [&] { return (picture = touching.loop->new_contact_picture(PictureConsumer::robots)); }));
    ASSERT_TRUE(wait_for([&] { return (surface = touching.loop->new_surface_picture()); }));
    touching.run_for(0.05);
    EXPECT_EQ(touching.loop->new_contact_picture(PictureConsumer::robots),
              nullptr);  // one for each question
    EXPECT_EQ(touching.loop->new_surface_picture(), nullptr);
    touching.loop->stop();

    const Seen& seen = touching.seen;
    ASSERT_EQ(touching.loop->report().num_lost_records, 0u);
    const ContactRecord& contact = seen.contacts.at(picture->contact_number - 1);
    EXPECT_EQ(contact.number, picture->contact_number);
    EXPECT_EQ(contact.frame_number, picture->frame_number);
    EXPECT_EQ(contact.X_WT, picture->X_WT);
    ThreadPool pool(1);
    SurfaceTimeline timeline = test::timeline_of(touching.source.info(), settings);
    const auto query = test::query_of(settings);
    int num_compared = 0;
    for (std::size_t k = 0; k < seen.frames.size(); ++k) {
      timeline.push(seen.frames[k].frame, seen.frames[k].time, pool);
      if (k == surface->frame_number) {
        const PointCloud cloud = timeline.newest_cloud(pool);
        ASSERT_EQ(surface->points.size(), cloud.size());
        ASSERT_EQ(surface->edges.size(), cloud.size());
        EXPECT_EQ(surface->width, cloud.width());
        for (std::size_t i = 0; i < cloud.size(); ++i) {
          if (std::isnan(cloud.point(i).x)) continue;
          ASSERT_EQ(surface->points[i], cloud.point(i));
          ASSERT_EQ(surface->normals[i], cloud.normal(i));
          ++num_compared;
        }
      }
      if (k != picture->frame_number) continue;
      SurfaceBlend blend = timeline.at(1e12);
      blend.progress = contact.cameras.of[0].progress;
      const auto whole =
          test::whole_contact(*query, blend.from, blend.to, blend.progress, picture->X_WT);
      ASSERT_EQ(picture->spheres.states.size(), whole.states.size());
      ASSERT_EQ(picture->spheres.planes.size(), whole.planes.size());
      int num_touched = 0;
      for (std::size_t i = 0; i < whole.states.size(); ++i) {
        ASSERT_EQ(picture->spheres.states[i], whole.states[i]);
        ASSERT_EQ(picture->spheres.planes[i].normal, whole.planes[i].normal);
        num_touched += whole.states[i] != SphereState::outside;
      }
      EXPECT_GT(num_touched, 0);
    }
    EXPECT_GT(num_compared, 1000);
  }
}

}  // namespace
}  // namespace palpate
