#include "apps/ros/ros_display.h"

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "apps/ros/wall_time.h"

namespace palpate::apps {

Status RosDisplay::open(const MakeRosPublisher& publish) {
  for (const Status& status :
       {publish(points_, "points", "sensor_msgs/PointCloud2", {true, false, 1}),
        publish(spheres_, "spheres", "visualization_msgs/MarkerArray", {true, false, 1}),
        publish(markers_, "markers", "visualization_msgs/MarkerArray", {true, true, 1})}) {
    if (!status) return status.error();
  }
  return Done{};
}

void RosDisplay::publish_meshes(std::span<const RosBody> bodies) {
  markers_->publish(mesh_markers_message(options_.tool_frame, tool_.mesh(), bodies));
}

void RosDisplay::publish_points(const FrameRecord& record, const DepthFrame& frame) {
  if (!(options_.points_rate > 0) || record.capture_time < next_points_) return;
  if (points_->num_readers() == 0) return;
  next_points_ = record.capture_time + 1 / options_.points_rate;
  points_->publish(points_message({wall_time(record.capture_time), options_.camera_frame}, frame,
                                  streams_[record.camera].intrinsics, record.X_WC));
}

void RosDisplay::keep(const FrameRecord& record, const DepthFrame& frame) {
  if (!(options_.points_rate > 0) || spheres_->num_readers() == 0) return;
  const std::lock_guard lock(seen_mutex_);
  Seen& seen = seen_[record.camera];
  if (record.capture_time < seen.time + 1 / options_.points_rate) return;
  seen = {record.capture_time, record.X_WC, frame};
}

bool RosDisplay::is_seen(const Vec3d& p_W) const {
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const auto& [time, X_WC, frame] = seen_[k];
    const Vec3d p_C = inverse(X_WC) * p_W;
    const Intrinsics& camera = streams_[k].intrinsics;
    if (!(p_C.z > 0)) continue;
    const double u = std::floor(camera.fx * p_C.x / p_C.z + camera.cx + 0.5);
    const double v = std::floor(camera.fy * p_C.y / p_C.z + camera.cy + 0.5);
    if (!(u >= 0 && v >= 0 && u < frame.width && v < frame.height)) continue;
    const std::uint16_t count = frame.pixels[static_cast<std::size_t>(v * frame.width + u)];
    if (count == 0 || count == 65535) continue;
    if (p_C.z <= count * frame.unit + kSeenBehind) return true;
  }
  return false;
}

void RosDisplay::publish_spheres(RunLoop& loop, double time) {
  if (const ContactPicture* const now = loop.new_contact_picture(PictureConsumer::robots)) {
    const std::lock_guard lock(seen_mutex_);
    for (std::size_t i = 0; i < now->spheres.states.size(); ++i) {
      const Vec3d p_W = now->X_WT * to_double(tool_.spheres()[i].center);
      sphere_states_[i] = !is_seen(p_W)                                     ? RosSphere::unseen
                          : now->spheres.states[i] == SphereState::outside  ? RosSphere::free
                          : now->spheres.states[i] == SphereState::boundary ? RosSphere::touching
                                                                            : RosSphere::inside;
    }
    spheres_->publish(sphere_markers_message({wall_time(time), options_.tool_frame},
                                             tool_.spheres(), sphere_states_));
  }
  if (!(options_.points_rate > 0) || time < next_spheres_ || spheres_->num_readers() == 0) return;
  next_spheres_ = time + 1 / options_.points_rate;
  loop.request_contact_picture(PictureConsumer::robots);
}

}  // namespace palpate::apps
