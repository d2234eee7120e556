// The cameras of a hull on a GPU, from those of a call: copies of fields that lie elsewhere, and
// the arguments of kernels.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "src/contact/cuda/gpu_field.h"
#include "src/contact/field/unseen_by_one.cuh"
#include "src/contact/hull/camera_seats.h"
#include "src/contact/hull/hull_views.cuh"
#include "src/contact/noise/noise_model.h"

namespace palpate { inline namespace v0 {

class HullCameras {
 public:
  explicit HullCameras(int gpu) {
    for (int i = 0; i < 4 * kMaxCameras; ++i) copies_.emplace_back(gpu);
  }

  /// Takes the cameras of a query, and the pose of a tool with this center of mass and reach.
  ContactStatus take(std::span<const SurfaceBlend> cameras, const Pose& X_WT, const Vec3d& p_TC,
                     double reach, gpu::Stream& stream) noexcept {
    num_ = num_seeing_ = 0;
    has_memory_ = false;
    in_world_ = frame_of({}, X_WT, p_TC);
    is_alone_ = is_alone(cameras);
    for (const bool sees : {true, false}) {
      for (std::size_t k = 0; k < cameras.size(); ++k) {
        const SurfaceView& surface = cameras[k].to;
        if (surface.field.num_levels == 0) continue;  // no frame yet: it abstains
        if (is_seen(surface, is_alone_) != sees) continue;
        const ContactStatus status =
            take(cameras[k], X_WT, p_TC, reach, static_cast<int>(k), stream);
        if (status.is_unmeasured()) return status;
      }
      if (sees) num_seeing_ = num_;
    }
    return num_seeing_ > 0 ? StepStatus::ok : StepStatus::no_surface;
  }

  int num() const { return num_; }
  const HullEye* eyes() const { return eyes_; }
  /// Returns the noise of one of them. Both frames of a blend count.
  SurfaceNoise noise(int k) const {
    const HullEye& eye = eyes_[k];
    const double newer = eye.num_fields == 2 ? static_cast<double>(eye.progress) : 1;
    return surface_noise(noises_[k], std::hypot(newer, 1 - newer));
  }
  /// A surface of a camera by itself that was taken.
  OneCamera one_camera(const SurfaceView& surface, gpu::Stream& stream) {
    const bool is_memory = surface.role == SurfaceRole::with_memory;
    return {{copies_[0].on_gpu(surface.field, stream), copies_[2].on_gpu(surface.in_front, stream)},
            is_memory ? 2 : 1};
  }

  template <int kMaxViews>
  HullQuery<kMaxViews> query() const {
    HullQuery<kMaxViews> query;
    query.num_cameras = num_;
    query.num_seeing = num_seeing_;
    query.is_alone = is_alone_;
    query.has_memory = has_memory_;
    std::copy_n(eyes_, num_, query.eyes);
    return query;
  }
  template <int kMaxViews>
  PosedTool<kMaxViews> posed(const ElementsView& elements) const {
    PosedTool<kMaxViews> tool;
    tool.elements = elements;
    tool.in_world = in_world_;
    for (int k = 0; k < num_; ++k) std::copy_n(in_eyes_[k], 2, tool.in_eyes[k]);
    return tool;
  }

 private:
  ContactStatus take(const SurfaceBlend& view, const Pose& X_WT, const Vec3d& p_TC, double reach,
                     int number, gpu::Stream& stream) noexcept {
    const SurfaceView &from = view.from, &to = view.to;
    if (!has_fields(to, is_alone_)) return StepStatus::no_surface;
    const CameraSeats seats(view, X_WT, is_alone_);
    if (seats.is_outside_window(view, p_TC, reach)) return StepStatus::outside_window;
    GpuFields* const copies = &copies_[4 * static_cast<std::size_t>(number)];
    for (int seat = 0; seat < 2; ++seat) {
      in_eyes_[num_][seat] = frame_of(to.field.intrinsics, seats.X_CT[seat], p_TC);
    }
    const auto look = [&](GpuFields& copy, const DepthFieldView& of) {
      return look_of(copy.on_gpu(of, stream), frame_of(to.field.intrinsics, {}, {}), 1);
    };
    const bool is_known = seats.num_moments == 1 || from.field.noise != nullptr;
    noises_[num_] = is_known ? to.field.noise : nullptr;
    HullEye& eye = eyes_[num_++] = {};
    eye.number = number;
    eye.num_fields = seats.num_moments;
    eye.has_moved = seats.has_moved;
    eye.progress = static_cast<float>(view.progress);
    eye.has_in_front = is_alone_ && has_in_front(to);
    eye.is_remembered = !is_alone_ && is_remembered(to);
    has_memory_ |= eye.is_remembered;
    for (int f = eye.num_fields - 1; f >= 0; --f) {
      const SurfaceView& surface = f == 0 ? to : from;
      eye.field[f] = look(copies[0], surface.field);
      eye.seen_free[f] = surface.role == SurfaceRole::one_of_several
                             ? look(copies[1], surface.seen_free)
                             : eye.field[f];
      // A surface without thickness is solid as far as its camera sees.
      eye.in_front[f] = has_in_front(to) ? look(copies[2], surface.in_front) : eye.field[f];
      if (eye.is_remembered) eye.remembered[f] = look(copies[3], surface.remembered);
    }
    seats.write_rotations(eye.R_WC);
    return StepStatus::ok;
  }

  std::vector<GpuFields> copies_;  // four per camera, in the order of SurfaceView
  HullEye eyes_[kMaxCameras];
  FieldFrame in_eyes_[kMaxCameras][2];          // by seat
  const FrameNoise* noises_[kMaxCameras] = {};  // null: unknown
  FieldFrame in_world_;
  int num_ = 0, num_seeing_ = 0;
  bool is_alone_ = false, has_memory_ = false;
};

}}  // namespace palpate::v0
