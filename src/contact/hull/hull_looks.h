// Looks of the cameras of a hull at a few vectors of elements: the first ones, one camera after the
// other, until one sees that all are free, and what else is sampled later. The words are explained
// in hull_kernel.cpp. Included by hull_joins.h only.
#pragma once

#include "src/contact/field/ball_totals.h"
#include "src/contact/hull/hull_eyes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

template <class Sample>
class HullLooks {
 public:
  using Space = InSpace<Sample>;

  /// `freed_by`: the camera that is asked first, as it has seen elements to be free last.
  HullLooks(const HullJob& job, const Eye* eyes, int& freed_by)
      : job_(job), eyes_(eyes), freed_by_(freed_by) {
    for (int k = 0; k < job.num_cameras; ++k) new (answers_ + k) EyeAnswer<Sample>;
  }

  // Announces the elements that are sampled next.
  void announce(const ElementRows& rows) { rows_ = rows; }
  // Announces a ball that contains those with a value.
  void aim_at(const Cluster& ball, float largest_radius) {
    for (int k = 0; k < job_.num_cameras; ++k) {
      const HullCamera& camera = job_.cameras[k];
      answers_[k].queries_in_front =
          camera.has_in_front &&
          !sees_free(camera, camera.in_front, ball, largest_radius, front_limit(largest_radius));
    }
  }

 protected:
  std::size_t slot_of(int i) const { return slot_ + static_cast<std::size_t>(i * kLanes); }

  // Begins with `num` vectors of elements.
  void start(const ElementRows& rows, std::size_t slot, bool is_ball, int num) {
    sampled_ = rows;
    slot_ = slot;
    num_ = num;
    open_ = (1u << num) - 1;
    is_ball_ = is_ball;
    is_between_ = 0;
    for (int i = 0; i < num; ++i) {
      radius_[i] = load(sampled_.radius + slot_of(i));
      enough_[i] = extent_[i] = extent_of(radius_[i], is_ball, i);
      is_free_[i] = VecI{};
      shallowest_[i] = splat(-1e9f);
    }
  }
  // Takes the first samples of the other cameras, until all elements are free by one.
  bool look_on(int first) {
    for (const bool may_see : {true, false}) {
      for (int k = 0; k < job_.num_seeing; ++k) {
        if (k == first || job_.cameras[k].may_see() != may_see) continue;
        std::uint32_t vectors = open_;
        if (!may_see) for_each(open_, [&](int i) { vectors &= ~(cannot_decide(k, i) << i); });
        if (!look(k, vectors)) {
          if (may_see) freed_by_ = k;
          return false;
        }
      }
    }
    return true;
  }

  // 1 if the bound of a camera that does not see the tool is far below the other values.
  std::uint32_t cannot_decide(int k, int i) const {
    // Wider pixels may make a deep element half as deep again.
    const VecF least = min(shallowest_[i], 1.5f * shallowest_[i]) - 3.0f * agreement(radius_[i]);
    const VecI counts = is_ball_ ? splat(-1) : ~is_free_[i];
    return mask_bits(counts & ~(least > splat(job_.cameras[k].at_most))) == 0;
  }

  // Takes the first sample of one camera for some vectors. False: now all elements are free.
  bool look(int k, std::uint32_t vectors) {
    const Eye& eye = eyes_[k];
    const MeasureJob& seen = eye.camera->seen_free;
    EyeAnswer<Sample>& answer = answers_[k];
    std::uint32_t free = 0;
    answer.used = vectors;
    if (eye.num_fields > 1) is_between_ |= vectors;
    for (int seat = 0; seat <= eye.seat(eye.num_fields - 1); ++seat) {
      take_seat(eye.seen_free.grid, seat == 0 ? seen : eye.camera->older, vectors, seat, answer);
    }
    for (int f = 0; f < eye.num_fields; ++f) {
      const Lanes* const lanes = answer.lanes[eye.seat(f)];
      sample(eye.seen_free, f, lanes, vectors, answer.samples[f]);
      if (answer.queries_in_front) sample(eye.in_front, f, lanes, vectors, answer.in_front[f]);
    }
    for_each(vectors, [&](int i) {
      VecF phi[2];
      const VecF radius = radius_[i], extent = extent_[i];
      for (int f = 0; f < eye.num_fields; ++f) {
        const VecF before = answer.before[eye.seat(f)][i];
        phi[f] = limited(first_of(answer.samples[f][i]).phi, radius, extent).value;
        if (answer.queries_in_front) phi[f] = min(phi[f], first_of(answer.in_front[f][i]).phi);
        if (job_.is_alone) {
          phi[f] = select(before > VecF{}, phi[f], free_limit(radius, extent));
        } else if (eye.camera->has_moved) {
          phi[f] = min(phi[f], before);
        }
      }
      VecF now = phi[0];
      if (eye.num_fields > 1) {
        now = phi[1] + splat(eye.camera->progress) * (phi[0] - phi[1]);
      }
      if (!eye.camera->has_moved && !job_.is_alone) now = min(now, answer.before[0][i]);
      shallowest_[i] = max(shallowest_[i], now);
      // Rounding lowers the lesser of two by no more than this.
      VecF limit = enough_[i] + free_margin(job_.num_seeing, radius);
      if (answer.queries_in_front) limit += front_margin(radius);
      is_free_[i] |= now > limit;
      if (mask_bits(~is_free_[i]) == 0) free |= 1u << i;
    });
    // The plane of a ball asks all of its parts, so that its bits do not depend on the vectors.
    if (!is_ball_ || free == open_) open_ &= ~free;
    return open_ != 0;
  }

  // Places vectors of elements in a camera, at one of its seats.
  void take_seat(const Grid& grid, const MeasureJob& job, std::uint32_t vectors, int seat,
                 EyeAnswer<Sample>& answer) const {
    for_each(vectors, [&](int i) {
      Lanes& e = answer.lanes[seat][i] = aim(sampled_, job.frame, grid, slot_of(i));
      answer.before[seat][i] = e.lz + (job.frame.p_WC[2] - kMinDepth);
    });
  }
  // At all its seats.
  void take_seats(const Eye& eye, std::uint32_t vectors, EyeAnswer<Sample>& answer) const {
    for (int seat = 0; seat <= eye.seat(eye.num_fields - 1); ++seat) {
      take_seat(eye.field.grid, seat == 0 ? eye.camera->field : eye.camera->older, vectors, seat,
                answer);
    }
  }

  // Samples a field at moment f for one vector, in the world.
  Space query(const Eye& eye, const FieldPair& field, int f, const Lanes& e, VecI which, int i) {
    const VecI all = splat(-1);
    Sample sampled;
    sample_together<1>(field.grid, field.pixels[f], &e, &all, 1, 1, &sampled);
    deepen_together<1>(field.grid, field.pixels[f], &e, &which, 1, &sampled);
    return in_world(eye.camera->R_WC[eye.seat(f)], eye.camera->field.frame, e, sampled, radius_[i],
                    extent_[i]);
  }

  // Returns the value of space that no surface is near to.
  Space nowhere(int i) const {
    Space space;
    set(space, SpaceGradient<VecF>{free_limit(radius_[i], extent_[i])});
    return space;
  }

  const HullJob& job_;
  const Eye* eyes_;
  int& freed_by_;
  ElementRows rows_, sampled_;  // announced, and those that are sampled
  union {
    EyeAnswer<Sample> answers_[kMaxCameras];  // as many as there are cameras
  };
  VecF shallowest_[kNumVectors], radius_[kNumVectors], extent_[kNumVectors];
  VecF enough_[kNumVectors];  // values above it are free
  VecI is_free_[kNumVectors];
  std::size_t slot_ = 0;
  int num_ = 0;                              // of the vectors that are sampled
  std::uint32_t open_ = 0, is_between_ = 0;  // bits of vectors
  bool is_ball_ = false;                     // a ball in parts
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
