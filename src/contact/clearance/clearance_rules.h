// From the nearest sphere of a search to the clearance at a pose: shared by host and device.
#pragma once

#include "palpate/tool/tool.h"
#include "src/contact/clearance/surface_plane.h"

namespace palpate { inline namespace v0 {

/// The least clearance at a pose.
struct Clearance {
  double value = 0;           ///< m, negative inside
  std::int32_t sphere = -1;   ///< -1: saturated
  std::int32_t decider = -1;  ///< camera, or number of cameras + body; -1: saturated
  double gradient[6] = {};    ///< by translation and rotation about C, in W
};

/// The images of a camera of a scene, in the memory of the device that searches.
struct SeenByCamera {
  ClearanceImage field, seen_free;
  std::int32_t is_joined = 0;  ///< with other cameras
  std::int32_t number = 0;     ///< of its surface in the scene
  Pose X_WC, X_CW;
};

/// Places the tool before a camera; its quaternion is unit.
PALPATE_HOSTDEV inline void place_camera(const SeenByCamera& seen, const Pose& X_WT,
                                         ClearanceCamera& to) {
  to.field = &seen.field;
  to.seen_free = seen.is_joined != 0 ? &seen.seen_free : nullptr;
  const Pose X_CT = seen.X_CW * X_WT;
  const Mat3d R = rotation_matrix(X_CT.rotation);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      to.R_CT[row][column] = static_cast<float>(R.m[row][column]);
    }
    to.p_CT[row] = static_cast<float>(X_CT.translation[row]);
  }
}

/// Writes the derivative of a sphere's distance by the pose, from that by its center.
PALPATE_HOSTDEV inline void put_gradient(const Vec3d& n_W, const Vec3d& lever_W, double* to) {
  const Vec3d turn = cross(lever_W, n_W);
  for (int axis = 0; axis < 3; ++axis) {
    to[axis] = n_W[axis];
    to[3 + axis] = turn[axis];
  }
}

/// A tool that is asked for its clearance.
struct ClearanceTool {
  const Sphere* spheres = nullptr;
  Vec3d p_TC;        ///< center of mass
  double reach = 0;  ///< from the origin to the farthest point of a sphere, m
  Cluster ball;      ///< around all spheres
};

/// `tool` must outlive it.
ClearanceTool clearance_tool(const Tool& tool);

/// Returns the clearance of what a search has found at a pose with a unit quaternion.
PALPATE_HOSTDEV inline Clearance clearance_of(const SeenByCamera* cameras,
                                              const ClearanceTool& tool, const ClearanceHit& hit,
                                              const Pose& X_WT, double limit) {
  Clearance result;
  result.value = hit.kind == ClearanceKind::deep ? -limit : limit;
  if (hit.kind == ClearanceKind::nothing || hit.kind == ClearanceKind::deep) return result;
  const SeenByCamera& camera = cameras[hit.camera];
  const Sphere& sphere = tool.spheres[hit.sphere];
  const Vec3d c_T = to_double(sphere.center);
  const PointDistance found = refined_distance(hit.is_of_field ? camera.field : camera.seen_free,
                                               hit, camera.X_CW * (X_WT * c_T));
  const double value = found.phi - static_cast<double>(sphere.radius);
  if (!(std::abs(value) < limit)) {
    result.value = value < 0 ? -limit : limit;
    return result;
  }
  result.value = value;
  result.sphere = hit.sphere;
  result.decider = camera.number;
  put_gradient(rotate(camera.X_WC.rotation, found.gradient), rotate(X_WT.rotation, c_T - tool.p_TC),
               result.gradient);
  return result;
}

/// The smooth minimum of clearances (SceneAnswers::clearance_smoothing), from their least on:
///   least - s ln(sum of e^((least - c) / s)), each term less that of the limit, and that once.
struct SoftMinimum {
  double least, limit, smoothing;
  double reach;     ///< m: clearances from here on are negligible
  double at_limit;  ///< weight of the limit
  double sum, gradient[6] = {};

  PALPATE_HOSTDEV SoftMinimum(double nearest, double at_most, double s)
      : least(nearest), limit(at_most), smoothing(s) {
    constexpr double kNegligible = 30;  // e^-30
    reach = lesser(limit, least + kNegligible * smoothing);
    sum = at_limit = weight(limit);
  }
  PALPATE_HOSTDEV double weight(double value) const {
    return std::exp((least - value) / smoothing);
  }
  PALPATE_HOSTDEV void add(const Clearance& one) {
    if (!(one.value < reach)) return;
    const double w = weight(one.value);
    sum += w - at_limit;
    for (int k = 0; k < 6; ++k) gradient[k] += w * one.gradient[k];
  }
  /// Puts it in place of the least.
  PALPATE_HOSTDEV void put(Clearance& to) const {
    to.value = least - smoothing * std::log(sum);
    if (to.value <= -limit) to = Clearance{-limit};
    if (to.sphere < 0) return;
    for (int k = 0; k < 6; ++k) to.gradient[k] = gradient[k] / sum;
  }
};

/// Returns the most (m) that planes change distances of a tool that is within a margin.
PALPATE_HOSTDEV inline double margin_change(const SeenByCamera* cameras, int num_cameras,
                                            const ClearanceTool& tool, const Pose& X_WT,
                                            double margin) {
  double change = 0;
  for (int k = 0; k < num_cameras; ++k) {
    const Vec3d p_CT = cameras[k].X_CW * X_WT.translation;
    const double farthest = std::abs(p_CT.z) + tool.reach + std::abs(margin);
    change = greater(change, plane_change(cameras[k].field, 1.01 * farthest));
  }
  return change;
}

/// Sets the limits of a search that decides whether a tool is within a margin, where planes change
/// distances by no more than the range that is left open.
PALPATE_HOSTDEV inline void set_margin(double margin, double change, ClearanceJob& job) {
  job.limit = static_cast<float>(margin + change);
  job.enough = static_cast<float>(margin - change);
  job.deepest = static_cast<float>(std::abs(margin) + change);
}

/// Returns the search that decides whether a tool at a pose is within a margin.
PALPATE_HOSTDEV inline ClearanceJob margin_job(ClearanceJob job, const SeenByCamera* cameras,
                                               int num_cameras, const ClearanceTool& tool,
                                               const Pose& X_WT, double margin) {
  set_margin(margin, margin_change(cameras, num_cameras, tool, X_WT, margin), job);
  return job;
}

/// True if what such a search has found is within the margin.
PALPATE_HOSTDEV inline bool is_hit_within(const SeenByCamera* cameras, const ClearanceTool& tool,
                                          const ClearanceHit& hit, const ClearanceJob& job,
                                          const Pose& X_WT, double margin) {
  if (hit.kind == ClearanceKind::nothing) return false;
  if (hit.kind == ClearanceKind::deep || hit.value < job.enough) return true;
  constexpr double kAnything = 1e9;
  return clearance_of(cameras, tool, hit, X_WT, kAnything).value < margin;
}

}}  // namespace palpate::v0
