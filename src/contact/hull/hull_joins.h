// The hull for the elements of a cluster: seen-free space of all cameras, joined with remembered
// space and with the fields where these can still raise the value (hull_rules.h has the formulas).
// The words are explained in hull_kernel.cpp. Included by that file only.
#pragma once

#include "src/contact/field/ball_totals.h"
#include "src/contact/hull/depth_hull.h"
#include "src/contact/hull/hull_eyes.h"
#include "src/contact/hull/kept_elements.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// Joined values of the cameras for the elements of a cluster, or for clusters as one ball each.
template <class Sample>
class Hull {
 public:
  using Space = InSpace<Sample>;

  /// `freed_by`: the camera that is asked first, as it has seen elements to be free last.
  Hull(const HullJob& job, const Eye* eyes, int& freed_by)
      : job_(job), eyes_(eyes), freed_by_(freed_by) {
    for (int k = 0; k < job.num_cameras; ++k) new (answers_ + k) EyeAnswer<Sample>;
    may_pack_ =
        !job.is_alone && !job.has_memory && job.num_seeing > 1 && job.tool.noise.num == nullptr;
    for (int k = 0; k < job.num_seeing; ++k) may_pack_ &= job.cameras[k].may_see();
  }

  // Announces the elements that are sampled next, and a ball that contains those with a value.
  void aim_at(const Cluster& ball, float largest_radius, const ElementRows& rows) {
    rows_ = rows;
    for (int k = 0; k < job_.num_cameras; ++k) {
      const HullCamera& camera = job_.cameras[k];
      answers_[k].queries_in_front =
          camera.has_in_front &&
          !sees_free(camera, camera.in_front, ball, largest_radius, front_limit(largest_radius));
    }
  }

  // Returns bits of `num` vectors from `slot` on, without those that some camera sees to be free.
  std::uint32_t evaluate(std::size_t slot, bool is_ball, int num) {
    start(rows_, slot, is_ball, num);
    if (!look(freed_by_, open_)) return 0;
    const std::uint32_t vectors = open_;
    const bool is_packed = !is_ball && may_pack_ && pack(vectors);
    if (!look_on(freed_by_)) return 0;
    join_seen_free();
    for_each(open_, [&](int i) {
      if (job_.has_memory) join_remembered(i);
      join_fields(i);
    });
    if (!is_packed) return open_;
    unpack(vectors, slot);
    return vectors;
  }
  // True if every element has a value. A single camera knows nothing of the space behind its eye.
  bool is_complete(int i) const {
    if (!job_.is_alone) return true;
    VecI is_before = answers_[0].before[0][i] > VecF{};
    if (eyes_[0].seat(eyes_[0].num_fields - 1) > 0) is_before &= answers_[0].before[1][i] > VecF{};
    return mask_bits(~is_before) == 0;
  }

  // Returns the places of the elements in the cameras that decided them.
  NoisePlace place(int i) const {
    NoisePlace at{};
    at.camera = splat(-1.0f);
    for (int k = 0; k < job_.num_cameras; ++k) {
      const VecI which = joined[i].decider == splat(k);
      if (mask_bits(which) == 0) continue;
      const HullCamera& camera = job_.cameras[k];
      at = chosen(which,
                  noise_place(camera.field.frame, answers_[k].lanes[0][i], camera.R_WC[0], k), at);
    }
    return at;
  }

  using Joined = typename KeptElements<Sample>::Joined;
  Joined joined[kNumVectors];

 private:
  using Agreed = AgreedViews<Space, VecF, VecI>;
  using Least = LeastView<Space, VecF, VecI>;

  std::size_t slot_of(int i) const { return slot_ + static_cast<std::size_t>(i * kLanes); }

  // Begins with `num` vectors of elements.
  void start(const ElementRows& rows, std::size_t slot, bool is_ball, int num) {
    sampled_ = rows;
    slot_ = slot;
    open_ = (1u << num) - 1;
    is_ball_ = is_ball;
    is_between_ = 0;
    for (int i = 0; i < num; ++i) {
      radius_[i] = load(sampled_.radius + slot_of(i));
      extent_[i] = extent_of(radius_[i], is_ball, i);
      is_free_[i] = VecI{};
      shallowest_[i] = splat(-1e9f);
    }
  }

  // Goes on with the elements alone that the first camera does not see to be free, if these fill
  // fewer vectors.
  bool pack(std::uint32_t vectors) {
    const int num = kept_.begin(vectors, is_free_);
    if (num == __builtin_popcount(vectors)) return false;
    const Eye& eye = eyes_[freed_by_];
    EyeAnswer<Sample>& answer = answers_[freed_by_];
    for_each(vectors, [&](int i) {
      kept_.pack(i, rows_, slot_of(i), shallowest_[i], answer, eye.num_fields);
    });
    start(kept_.rows(), 0, false, num);
    for_each(open_, [&](int i) {
      is_free_[i] = kept_.is_beyond(i);
      shallowest_[i] = kept_.shallowest(i);
      kept_.read(i, answer, eye.num_fields);
    });
    answer.used = open_;
    if (eye.num_fields > 1) is_between_ = open_;
    take_seats(eye, open_, answer);
    return true;
  }
  // Returns joined values to the vectors that were packed, from `slot` on; all other elements are
  // free.
  void unpack(std::uint32_t vectors, std::size_t slot) {
    const auto free = [](VecF radius) {
      Joined away;
      set(away.hull, SpaceGradient<VecF>{2.0f * radius});
      away.seen_phi = 2.0f * radius;
      return away;
    };
    for_each(answers_[freed_by_].used,
             [&](int i) { kept_.keep(i, (open_ >> i & 1) != 0 ? joined[i] : free(radius_[i])); });
    for_each(vectors, [&](int i) {
      joined[i] = free(load(rows_.radius + slot + static_cast<std::size_t>(i * kLanes)));
      kept_.unpack(i, joined[i]);
    });
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
      VecF limit = extent + free_margin(job_.num_seeing, radius);
      if (answer.queries_in_front) limit += front_margin(radius);
      is_free_[i] |= now > limit;
      if (mask_bits(~is_free_[i]) == 0) free |= 1u << i;
    });
    // The plane of a ball asks all of its parts, so that its bits do not depend on the vectors.
    if (!is_ball_ || free == open_) open_ &= ~free;
    return open_ != 0;
  }

  // Joins the seen-free space of the cameras: the maximum. Only the camera with the smallest depth
  // needs wider pixels.
  void join_seen_free() {
    VecI may_be_deep[kNumVectors] = {};
    for_each(open_, [&](int i) {
      may_touch_[i] = ~is_free_[i];
      const VecF limit = -deep_limit(radius_[i]);
      may_be_deep[i] = may_touch_[i] & ((is_between_ >> i & 1) != 0
                                            ? splat(-1)
                                            : shallowest_[i] < limit + agreement(radius_[i]));
    });
    Agreed seen[kNumVectors];
    for (int k = 0; k < job_.num_seeing; ++k) {
      const Eye& eye = eyes_[k];
      EyeAnswer<Sample>& answer = answers_[k];
      const std::uint32_t vectors = answer.used & open_;
      if (vectors == 0) continue;
      for (int f = 0; f < eye.num_fields; ++f) {
        const Lanes* const lanes = answer.lanes[eye.seat(f)];
        deepen(eye.seen_free, f, lanes, may_be_deep, vectors, answer.samples[f]);
        if (!answer.queries_in_front) continue;
        deepen(eye.in_front, f, lanes, may_be_deep, vectors, answer.in_front[f]);
      }
      for_each(vectors, [&](int i) { seen[i].add(seen_by(eye, answer, i), k, radius_[i]); });
    }
    for_each(open_, [&](int i) { joined[i].see(seen[i]); });
  }

  // Returns the seen-free space of a camera, in the world.
  Space seen_by(const Eye& eye, EyeAnswer<Sample>& answer, int i) {
    const FieldFrame& frame = eye.camera->field.frame;
    Space moments[2];
    for (int f = 0; f < eye.num_fields; ++f) {
      const int seat = eye.seat(f);
      const float(&R_WC)[3][3] = eye.camera->R_WC[seat];
      const Lanes& lanes = answer.lanes[seat][i];
      moments[f] = in_world(R_WC, frame, lanes, answer.samples[f][i], radius_[i], extent_[i]);
      if (answer.queries_in_front) {
        answer.front[f][i] = rotated_to_world(R_WC, frame, lanes, answer.in_front[f][i]);
        moments[f] = lesser_of(moments[f], answer.front[f][i], hull_width(radius_[i]));
      }
      if (job_.is_alone) {
        moments[f] = chosen(answer.before[seat][i] > VecF{}, moments[f], nowhere(i));
      } else if (eye.camera->has_moved) {
        moments[f] = limited_by_eye(R_WC, moments[f], answer.before[seat][i], i);
      }
    }
    const Space here = between(eye, moments);
    if (eye.camera->has_moved || job_.is_alone) return here;
    return limited_by_eye(eye.camera->R_WC[0], here, answer.before[0][i], i);
  }

  // Joins remembered free space, limited by the surfaces seen now, where these exceed the value
  // joined so far.
  void join_remembered(int i) {
    const auto phi = [&] { return first_of(joined[i].hull).phi; };
    VecI counts = may_touch_[i] & (phi() < extent_[i]);
    if (mask_bits(counts) == 0) return;
    Least shown;
    shown.value = nowhere(i);
    for (int k = 0; k < job_.num_seeing; ++k) {
      if (!job_.cameras[k].may_see()) continue;
      const Eye& eye = eyes_[k];
      Space moments[2];
      for (int f = 0; f < eye.num_fields; ++f) {
        const int seat = eye.seat(f);
        moments[f] = chosen(answers_[k].before[seat][i] > VecF{},
                            evaluate(eye, eye.in_front, f, answers_[k].lanes[seat][i], counts, i),
                            nowhere(i));
      }
      shown.add(between(eye, moments), k, radius_[i]);
      counts &= first_of(shown.value).phi > phi();
      if (mask_bits(counts) == 0) return;
    }
    Agreed known;
    for (const bool may_see : {true, false}) {
      for (int k = 0; k < job_.num_cameras; ++k) {
        const HullCamera& camera = job_.cameras[k];
        if (!camera.is_remembered || camera.may_see() != may_see) continue;
        // A camera whose bound is too low to decide is skipped.
        const VecI may_decide = known.most < splat(camera.at_most) + 2.0f * agreement(radius_[i]);
        if (!may_see && mask_bits(counts & may_decide) == 0) continue;
        known.add(remembered_by(k, i, counts), k, radius_[i]);
      }
    }
    joined[i].remember(known, shown, radius_[i], counts);
  }

  // Samples the remembered free space of one camera, in the world.
  Space remembered_by(int k, int i, VecI counts) {
    const Eye& eye = eyes_[k];
    EyeAnswer<Sample>& answer = answers_[k];
    if (k >= job_.num_seeing || (answer.used >> i & 1) == 0) take_seats(eye, 1u << i, answer);
    Space moments[2];
    for (int f = 0; f < eye.num_fields; ++f) {
      const int seat = eye.seat(f);
      moments[f] = evaluate(eye, eye.remembered, f, answer.lanes[seat][i], counts, i);
      if (eye.camera->has_moved) {
        moments[f] = limited_by_eye(eye.camera->R_WC[seat], moments[f], answer.before[seat][i], i);
      }
    }
    const Space here = between(eye, moments);
    if (eye.camera->has_moved) return here;
    return limited_by_eye(eye.camera->R_WC[0], here, answer.before[0][i], i);
  }

  // Joins the fields where they can still raise the value.
  void join_fields(int i) {
    const HullWidth<VecF> width = hull_width(radius_[i]);
    const VecI is_touching = may_touch_[i] & (first_of(joined[i].hull).phi < extent_[i]);
    if (!job_.may_be_unseen || mask_bits(is_touching) == 0) return;
    const VecF later = -agreement(radius_[i]);
    Least least;
    least.value = nowhere(i);
    for (int k = 0; k < job_.num_cameras; ++k) {
      if (!job_.cameras[k].may_see()) continue;
      const Eye& eye = eyes_[k];
      if (k >= job_.num_seeing) take_seats(eye, 1u << i, answers_[k]);
      Space moments[2];
      for (int f = 0; f < eye.num_fields; ++f) {
        const int seat = eye.seat(f);
        moments[f] = evaluate(eye, eye.field, f, answers_[k].lanes[seat][i], is_touching, i);
        if (answers_[k].queries_in_front) {
          moments[f] = lesser_of(moments[f], answers_[k].front[f][i], width);
        }
        moments[f] = chosen(answers_[k].before[seat][i] > VecF{}, moments[f], nowhere(i));
      }
      least.add(between(eye, moments), k, radius_[i]);
      const VecF phi = first_of(least.value).phi + later;
      if (mask_bits(is_touching & (phi > first_of(joined[i].hull).phi - width.w)) == 0) return;
    }
    joined[i].close(least, radius_[i], is_touching);
  }

  // Returns the value of space that no surface is near to.
  Space nowhere(int i) const {
    Space space;
    set(space, SpaceGradient<VecF>{free_limit(radius_[i], extent_[i])});
    return space;
  }
  // Makes space behind the camera unseen, and that near its eye.
  Space limited_by_eye(const float (&R_WC)[3][3], const Space& seen, VecF before, int i) const {
    return before_eye(R_WC, chosen(before > VecF{}, seen, nowhere(i)), before, radius_[i]);
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
  Space evaluate(const Eye& eye, const FieldPair& field, int f, const Lanes& e, VecI which, int i) {
    const VecI all = splat(-1);
    Sample sampled;
    sample_together<1>(field.grid, field.pixels[f], &e, &all, 1, 1, &sampled);
    deepen_together<1>(field.grid, field.pixels[f], &e, &which, 1, &sampled);
    return in_world(eye.camera->R_WC[eye.seat(f)], eye.camera->field.frame, e, sampled, radius_[i],
                    extent_[i]);
  }

  const HullJob& job_;
  const Eye* eyes_;
  int& freed_by_;
  ElementRows rows_, sampled_;  // announced, and those of them that are sampled
  bool may_pack_ = false;       // elements that the first camera sees to be free are left out
  union {
    EyeAnswer<Sample> answers_[kMaxCameras];  // as many as there are cameras
  };
  VecF shallowest_[kNumVectors], radius_[kNumVectors], extent_[kNumVectors];
  VecI is_free_[kNumVectors], may_touch_[kNumVectors];
  KeptElements<Sample> kept_;
  std::size_t slot_ = 0;
  std::uint32_t open_ = 0, is_between_ = 0;  // bits of vectors
  bool is_ball_ = false;                     // a ball in parts
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
