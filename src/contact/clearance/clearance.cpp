#include "src/contact/clearance/clearance.h"

#include <algorithm>
#include <cmath>

#include "src/contact/clearance/surface_plane.h"
#include "src/contact/hull/camera_seats.h"
#include "src/contact/index/tool_parts.h"
#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void find_nearest(const ClearanceJob&, ClearanceHit&);
                        constexpr ClearanceKernels kClearance{find_nearest};)

namespace {

constexpr ClearanceKernels kKernels[] = PALPATE_BY_ISA(kClearance);

Error refused(std::size_t surface, const std::string& why) {
  return {Errc::invalid_argument,
          "surface " + std::to_string(surface) + " of a scene asked for clearance " + why};
}

}  // namespace

ClearanceKernels clearance_kernels(Isa isa) { return select_isa(kKernels, isa); }

Status ClearanceScene::update(std::span<const SurfaceView> surfaces, ThreadPool& pool) {
  const bool is_alone = surfaces.size() == 1;
  for (std::size_t k = 0; k < surfaces.size(); ++k) {
    const SurfaceView& surface = surfaces[k];
    const DepthFieldView& field = surface.field;
    if (field.num_levels == 0) return refused(k, "has no depth field: its image was refused");
    if (field.gpu != kHostMemory) {
      return refused(k, "lies in the memory of GPU " + std::to_string(field.gpu) +
                            ", where it is not searched; make it with Place::cpu()");
    }
    if (!field.requested.has_all(field.levels[0].width, field.levels[0].height)) {
      return refused(k, "is known in a window of its image only; make it whole");
    }
    if (has_in_front(surface) || is_remembered(surface)) {
      return refused(k, "has a memory, which is not searched; make it without");
    }
    if (!is_alone && surface.seen_free.num_levels == 0) {
      return refused(k,
                     "is joined with others without SurfaceView::seen_free; make it with "
                     "DepthFieldOptions::one_of_several");
    }
  }
  cameras_.resize(surfaces.size());
  pool.parallel_for(static_cast<int>(2 * surfaces.size()), [&](int task) {
    const SurfaceView& surface = surfaces[static_cast<std::size_t>(task / 2)];
    Camera& camera = cameras_[static_cast<std::size_t>(task / 2)];
    const bool is_field = task % 2 == 0;
    if (is_field) {
      camera.is_joined = !is_alone;
      camera.X_WC = {surface.X_WC.translation, normalized(surface.X_WC.rotation)};
      camera.X_CW = inverse(camera.X_WC);
    } else if (is_alone) {
      return;
    }
    const DepthFieldView& view = is_field ? surface.field : surface.seen_free;
    ClearanceFrame& frame = is_field ? camera.field : camera.seen_free;
    const bool is_there = view.stamp != 0 && frame.stamp() == view.stamp &&
                          (!is_field || camera.thickness == view.thickness);
    if (is_field) camera.thickness = view.thickness;
    if (!is_there) frame.update(view, !is_field);
  });
  return Done{};
}

ClearanceQuery::ClearanceQuery(const ToolIndex& index, Isa isa)
    : tool_(&index.tool()),
      spheres_(&parts_of(index).clusters()),
      kernels_(clearance_kernels(isa)) {}

/// The cameras of a search, with the tool at a pose.
struct ClearanceQuery::Cameras {
  Cameras(const ClearanceScene& scene, const Pose& X_WT) {
    const Pose X{X_WT.translation, normalized(X_WT.rotation)};
    for (const ClearanceScene::Camera& camera : scene.cameras_) {
      ClearanceCamera& to = cameras[num];
      to.field = &camera.field.image();
      if (camera.is_joined) to.seen_free = &camera.seen_free.image();
      X_CT[num] = camera.X_CW * X;
      const Mat3d R = rotation_matrix(X_CT[num].rotation);
      for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) {
          to.R_CT[row][column] = static_cast<float>(R.m[row][column]);
        }
        to.p_CT[row] = static_cast<float>(X_CT[num].translation[row]);
      }
      ++num;
    }
  }

  ClearanceJob job(const SphereClusters& spheres, double limit) const {
    return {&spheres, cameras, num, static_cast<float>(limit)};
  }

  ClearanceCamera cameras[kMaxCameras];
  Pose X_CT[kMaxCameras];
  int num = 0;
};

Clearance ClearanceQuery::measure(const ClearanceScene& scene, const Pose& X_WT, double limit,
                                  bool wants_gradient) const noexcept {
  const Cameras cameras(scene, X_WT);
  ClearanceHit hit;
  kernels_.find_nearest(cameras.job(*spheres_, limit), hit);
  Clearance result;
  result.value = hit.kind == ClearanceKind::deep ? -limit : limit;
  if (hit.kind == ClearanceKind::nothing || hit.kind == ClearanceKind::deep) return result;
  const ClearanceCamera& camera = cameras.cameras[hit.camera];
  const Sphere& sphere = tool_->spheres()[static_cast<std::size_t>(hit.sphere)];
  const Vec3d c_T = to_double(sphere.center);
  const PointDistance found = refined_distance(hit.is_of_field ? *camera.field : *camera.seen_free,
                                               hit, cameras.X_CT[hit.camera] * c_T);
  const double value = found.phi - static_cast<double>(sphere.radius);
  if (!(std::abs(value) < limit)) {
    result.value = value < 0 ? -limit : limit;
    return result;
  }
  result.value = value;
  result.sphere = hit.sphere;
  result.decider = hit.camera;
  if (!wants_gradient) return result;
  const Quaternion& q_WC = scene.cameras_[static_cast<std::size_t>(hit.camera)].X_WC.rotation;
  const Vec3d n = rotate(q_WC, found.gradient);
  const Vec3d lever = rotate(normalized(X_WT.rotation), c_T - tool_->sphere_mass().center_of_mass);
  const Vec3d turn = cross(lever, n);
  for (int axis = 0; axis < 3; ++axis) {
    result.gradient[axis] = n[axis];
    result.gradient[3 + axis] = turn[axis];
  }
  return result;
}

bool ClearanceQuery::is_within(const ClearanceScene& scene, const Pose& X_WT,
                               double margin) const noexcept {
  const Cameras cameras(scene, X_WT);
  // Planes change distances by no more than this, which decides between both.
  double change = 0;
  for (int k = 0; k < cameras.num; ++k) {
    const double farthest = std::abs(cameras.X_CT[k].translation.z) + reach_ + std::abs(margin);
    change = std::max(change, plane_change(*cameras.cameras[k].field, 1.01 * farthest));
  }
  ClearanceJob job = cameras.job(*spheres_, margin + change);
  job.enough = static_cast<float>(margin - change);
  ClearanceHit hit;
  kernels_.find_nearest(job, hit);
  if (hit.kind == ClearanceKind::nothing) return false;
  if (hit.kind == ClearanceKind::deep || hit.value < job.enough) return true;
  const ClearanceCamera& camera = cameras.cameras[hit.camera];
  const Sphere& sphere = tool_->spheres()[static_cast<std::size_t>(hit.sphere)];
  const PointDistance found =
      refined_distance(hit.is_of_field ? *camera.field : *camera.seen_free, hit,
                       cameras.X_CT[hit.camera] * to_double(sphere.center));
  return found.phi - static_cast<double>(sphere.radius) < margin;
}

}}  // namespace palpate::v0
