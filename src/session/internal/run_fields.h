// Fields of the messages of a recording: each structure once, for writing, reading and describing
// it. `visit(name, member)` is called for every member.
#pragma once

#include <concepts>
#include <type_traits>

#include "palpate/run/records.h"

namespace palpate { inline namespace v0 {

/// T or const T.
template <class T, class Plain>
concept Of = std::same_as<std::remove_const_t<T>, Plain>;

template <Of<Vec3d> T>
void visit_fields(T& v, auto&& visit) {
  visit("x", v.x);
  visit("y", v.y);
  visit("z", v.z);
}

template <Of<Quaternion> T>
void visit_fields(T& q, auto&& visit) {
  visit("x", q.x);
  visit("y", q.y);
  visit("z", q.z);
  visit("w", q.w);
}

template <Of<Pose> T>
void visit_fields(T& X, auto&& visit) {
  visit("position", X.translation);
  visit("orientation", X.rotation);
}

template <Of<SurfaceStats> T>
void visit_fields(T& stats, auto&& visit) {
  visit("num_valid", stats.num_valid);
  visit("num_points", stats.num_points);
}

template <Of<PixelWindow> T>
void visit_fields(T& window, auto&& visit) {
  visit("left", window.left);
  visit("top", window.top);
  visit("right", window.right);
  visit("bottom", window.bottom);
}

template <Of<FrameRecord> T>
void visit_fields(T& frame, auto&& visit) {
  visit("number", frame.number);
  visit("camera", frame.camera);
  visit("camera_frame", frame.camera_frame);
  visit("revision", frame.revision);
  visit("capture_time", frame.capture_time);
  visit("source_time", frame.source_time);
  visit("unit", frame.unit);
  visit("camera_pose", frame.X_WC);
  visit("surface", frame.surface);
  visit("requested", frame.requested);
  visit("compute_nanoseconds", frame.compute_nanoseconds);
}

template <Of<Wrench> T>
void visit_fields(T& F, auto&& visit) {
  visit("force", F.force);
  visit("torque", F.torque);
}

template <Of<VolumeWrench> T>
void visit_fields(T& F, auto&& visit) {
  visit("force", F.force);
  visit("torque", F.torque);
}

template <Of<Twist> T>
void visit_fields(T& V, auto&& visit) {
  visit("linear", V.linear);
  visit("angular", V.angular);
}

template <Of<DeviceState> T>
void visit_fields(T& state, auto&& visit) {
  visit("time", state.time);
  visit("pose", state.X_BH);
  visit("velocity", state.V_BH);
  visit("buttons", state.buttons);
  visit("is_valid", state.is_valid);
  visit("has_force", state.has_force);
}

template <Of<CouplingStep> T>
void visit_fields(T& step, auto&& visit) {
  visit("desired", step.desired_F_H_B);
  visit("tool", step.X_WT);
  visit("hand", step.X_WT_hand);
  visit("contact", step.contact_W);
  visit("stretch", step.stretch);
  visit("energy", step.energy);
  visit("stored", step.stored);
}

template <Of<SafetyStatus> T>
void visit_fields(T& safety, auto&& visit) {
  visit("state", safety.state);
  visit("fault", safety.fault);
  visit("fault_time", safety.fault_time);
  visit("num_faults", safety.num_faults);
  visit("gain", safety.gain);
  visit("energy", safety.energy);
  visit("damping", safety.damping);
  visit("num_limited", safety.num_limited);
}

template <Of<Penetration> T>
void visit_fields(T& penetration, auto&& visit) {
  visit("volume", penetration.volume);
  visit("measure", penetration.measure_W);
  visit("potential", penetration.potential);
  visit("num_boundary_spheres", penetration.num_boundary_spheres);
  visit("num_inside_spheres", penetration.num_inside_spheres);
  visit("num_points", penetration.num_points);
  visit("status", penetration.status.bits);
  visit("unseen_volume", penetration.unseen_volume);
}

/// A covariance: its upper half.
template <Of<Mat3d> T>
void visit_fields(T& covariance, auto&& visit) {
  visit("xx", covariance.m[0][0]);
  visit("xy", covariance.m[0][1]);
  visit("xz", covariance.m[0][2]);
  visit("yy", covariance.m[1][1]);
  visit("yz", covariance.m[1][2]);
  visit("zz", covariance.m[2][2]);
}

template <Of<MeasureNoise> T>
void visit_fields(T& noise, auto&& visit) {
  visit("volume", noise.volume);
  visit("force", noise.force);
  visit("torque", noise.torque);
}

template <Of<TickRecord> T>
void visit_fields(T& tick, auto&& visit) {
  visit("number", tick.number);
  visit("time", tick.time);
  visit("dt", tick.dt);
  visit("device", tick.device);
  visit("coupling", tick.step);
  visit("wrench_on_hand", tick.F_H_B);
  visit("safety", tick.safety);
  visit("penetration", tick.penetration);
  visit("objects", tick.objects);
  visit("num_object_pairs", tick.num_object_pairs);
  visit("contact_age", tick.contact_age);
  visit("sensor_age", tick.sensor_age);
  visit("contact_number", tick.contact_number);
  visit("frame_number", tick.frame_number);
  visit("is_stopping", tick.is_stopping);
  visit("is_force_requested", tick.is_force_requested);
  visit("is_suspended", tick.is_suspended);
  visit("has_sensor_failed", tick.has_sensor_failed);
  visit("has_backend_failed", tick.has_backend_failed);
  visit("compute_nanoseconds", tick.compute_nanoseconds);
  visit("revision", tick.revision);
  visit("noise", tick.noise);
}

template <Of<ContactPatch> T>
void visit_fields(T& patch, auto&& visit) {
  visit("lever", patch.lever_W);
  visit("torsion_radius", patch.torsion_radius);
  visit("share", patch.share);
  visit("own_friction", patch.own_friction);
}

template <Of<Ground> T>
void visit_fields(T& ground, auto&& visit) {
  visit("share", ground.share);
  visit("friction", ground.friction);
  visit("static_friction", ground.static_friction);
  visit("viscous", ground.viscous);
  visit("ridges", ground.ridges);
  visit("grain", ground.grain);
  visit("velocity", ground.velocity_W);
  visit("turning", ground.turning_W);
}

template <Of<LocalContact> T>
void visit_fields(T& contact, auto&& visit) {
  visit("time", contact.time);
  visit("tool", contact.X_WT);
  visit("center_of_mass", contact.p_WC);
  visit("wrench", contact.F_C_W);
  visit("stiffness", contact.stiffness);
  visit("patch", contact.patch);
  visit("volume", contact.volume);
  visit("max_stiffness", contact.max_stiffness);
  visit("energy", contact.energy);
  visit("surface_age", contact.surface_age);
  visit("status", contact.status.bits);
  visit("is_valid", contact.is_valid);
}

template <Of<CameraBlend> T>
void visit_fields(T& blend, auto&& visit) {
  visit("camera_frame", blend.camera_frame);
  visit("progress", blend.progress);
}

template <Of<ContactRecord> T>
void visit_fields(T& record, auto&& visit) {
  visit("number", record.number);
  visit("time", record.time);
  visit("frame_number", record.frame_number);
  visit("cameras", record.cameras);
  visit("bodies", record.bodies);
  visit("capture_time", record.capture_time);
  visit("has_new_stiffness", record.has_new_stiffness);
  visit("tool", record.X_WT);
  visit("penetration", record.penetration);
  visit("objects", record.objects);
  visit("num_object_pairs", record.num_object_pairs);
  visit("contact", record.contact);
  visit("revision", record.revision);
  visit("ground", record.contact.patch.ground);
  visit("noise", record.noise);
}

template <Of<DeviceLimits> T>
void visit_fields(T& limits, auto&& visit) {
  visit("max_force", limits.max_force);
  visit("max_torque", limits.max_torque);
  visit("max_stiffness", limits.max_stiffness);
  visit("max_angular_stiffness", limits.max_angular_stiffness);
  visit("max_damping", limits.max_damping);
  visit("workspace_radius", limits.workspace_radius);
  visit("damping", limits.damping);
  visit("angular_damping", limits.angular_damping);
}

template <Of<DeviceInfo> T>
void visit_fields(T& device, auto&& visit) {
  visit("kind", device.kind);
  visit("name", device.name);
  visit("limits", device.limits);
  visit("rate", device.rate);
  visit("senses_orientation", device.senses_orientation);
  visit("num_buttons", device.num_buttons);
}

}}  // namespace palpate::v0
