// The hull for the elements of a cluster: seen-free space of all cameras, joined with remembered
// space and with the fields where these can still raise the value (hull_rules.h has the formulas).
// The words are explained in hull_kernel.cpp. Included by that file only.
#pragma once

#include "src/contact/hull/hull_looks.h"
#include "src/contact/hull/kept_elements.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// Joined values of the cameras for the elements of a cluster, or for clusters as one ball each.
template <class Sample>
class Hull : public HullLooks<Sample> {
  using Looks = HullLooks<Sample>;

 public:
  using Space = InSpace<Sample>;

  Hull(const HullJob& job, const Eye* eyes, int& freed_by) : Looks(job, eyes, freed_by) {
    may_pack_ =
        !job.is_alone && !job.has_memory && job.num_seeing > 1 && job.tool.noise.num == nullptr;
    for (int k = 0; k < job.num_seeing; ++k) may_pack_ &= job.cameras[k].may_see();
  }

  // Returns bits of `num` vectors from `slot` on, without those that some camera sees to be free.
  std::uint32_t evaluate(std::size_t slot, bool is_ball, int num) {
    start(rows_, slot, is_ball, num);
    if (!look(freed_by_, open_) || !look_on(freed_by_)) return 0;
    join();
    return open_;
  }

  // True if elements of several clusters may be evaluated together.
  bool may_pack() const { return may_pack_; }
  // Begins with none of those announced, of slots from `first` on.
  void begin(std::size_t first) {
    for (KeptElements<Sample>* const list : {&added_, &shallow_, &deep_}) list->begin(first);
  }
  // Adds the elements of a vector that the bounds of no camera show to be free: those with values
  // above `enough` are.
  void add(std::size_t slot, VecF enough, const Bounds& bounds) {
    const VecI is_open =
        (load(rows_.radius + slot) > VecF{}) & ~is_free_by(job_, bounds, rows_, slot, enough);
    const std::uint32_t bits = mask_bits(is_open);
    if (bits != 0) added_.add(rows_, slot, enough, bits);
  }
  // Evaluates what was added, in full vectors. The first camera is asked about all; what it does
  // not see to be free goes on, apart from each other what lies deep, for which more is sampled,
  // and what does not.
  void evaluate_added() {
    const int first = freed_by_;
    const Eye& eye = eyes_[first];
    EyeAnswer<Sample>& answer = answers_[first];
    for_each_vectors(added_, [&](int place) {
      look(first, open_);
      for (int i = 0; i < num_; ++i) {
        VecI is_deep{};
        for (int f = 0; f < eye.num_fields; ++f) {
          is_deep |= first_of(answer.samples[f][i]).phi < -deep_limit(radius_[i]);
        }
        const auto keep = [&](KeptElements<Sample>& list, VecI which) {
          list.add(added_, place + i * kLanes, shallowest_[i], answer.samples, i, eye.num_fields,
                   mask_bits(which & ~is_free_[i]));
        };
        keep(shallow_, ~is_deep);
        keep(deep_, is_deep);
      }
    });
    for (KeptElements<Sample>* const list : {&shallow_, &deep_}) {
      for_each_vectors(*list, [&](int place) {
        const std::uint32_t vectors = answer.used = open_;
        for (int i = 0; i < num_; ++i) {
          shallowest_[i] = list->shallowest(place + i * kLanes);
          list->read(place + i * kLanes, answer.samples, i, eye.num_fields);
        }
        if (eye.num_fields > 1) is_between_ = vectors;
        take_seats(eye, vectors, answer);
        if (look_on(first)) join();
        for (int i = 0; i < num_; ++i) {
          list->set(place + i * kLanes, (open_ >> i & 1) != 0 ? joined[i] : free(radius_[i]));
        }
      });
      list->finish();
    }
  }
  // Returns bits of `num` vectors from `slot` on whose elements were not all seen to be free, and
  // takes their values; call it for one slot after the other.
  std::uint32_t take(std::size_t slot, int num) {
    std::uint32_t vectors = 0;
    for (int i = 0; i < num; ++i) {
      const std::size_t at = slot + static_cast<std::size_t>(i * kLanes);
      if ((shallow_.lanes(at) | deep_.lanes(at)) == 0) continue;
      vectors |= 1u << i;
      joined[i] = free(load(rows_.radius + at));
      shallow_.take(at, joined[i]);
      deep_.take(at, joined[i]);
    }
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
  using Looks::answers_, Looks::enough_, Looks::extent_, Looks::eyes_, Looks::freed_by_,
      Looks::is_between_, Looks::is_free_, Looks::job_, Looks::look, Looks::look_on, Looks::nowhere,
      Looks::num_, Looks::open_, Looks::query, Looks::radius_, Looks::rows_, Looks::shallowest_,
      Looks::start, Looks::take_seats;

  // Begins with some vectors of a list after the other, each time calling f(place of the first).
  template <class F>
  void for_each_vectors(KeptElements<Sample>& list, const F& f) {
    const ElementRows rows = list.rows();
    const int num = list.num_vectors();
    for (int first = 0; first < num; first += kNumVectors) {
      const int place = first * kLanes;
      start(rows, static_cast<std::size_t>(place), false, std::min(num - first, kNumVectors));
      for (int i = 0; i < num_; ++i) {
        is_free_[i] = list.is_beyond(place + i * kLanes);
        enough_[i] = list.enough(place + i * kLanes);
      }
      f(place);
    }
  }
  // Returns the value of elements that some camera sees to be free.
  static Joined free(VecF radius) {
    Joined away;
    set(away.hull, SpaceGradient<VecF>{2.0f * radius});
    away.seen_phi = 2.0f * radius;
    return away;
  }

  // Joins all that was asked for.
  void join() {
    join_seen_free();
    for_each(open_, [&](int i) {
      if (job_.has_memory) join_remembered(i);
      join_fields(i);
    });
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
    }
    for_each(open_, [&](int i) {
      Agreed seen;
      for (int k = 0; k < job_.num_seeing; ++k) {
        if ((answers_[k].used >> i & 1) == 0) continue;
        seen.add(seen_by(eyes_[k], answers_[k], i), k, radius_[i]);
      }
      joined[i].see(seen);
    });
  }

  // Returns the seen-free space of a camera, in the world.
  Space seen_by(const Eye& eye, EyeAnswer<Sample>& answer, int i) {
    const FieldFrame& frame = eye.camera->field.frame;
    const Space here = between(eye, [&](int f) {
      const int seat = eye.seat(f);
      const float(&R_WC)[3][3] = eye.camera->R_WC[seat];
      const Lanes& lanes = answer.lanes[seat][i];
      Space space = in_world(R_WC, frame, lanes, answer.samples[f][i], radius_[i], extent_[i]);
      if (answer.queries_in_front) {
        answer.front[f][i] = rotated_to_world(R_WC, frame, lanes, answer.in_front[f][i]);
        space = lesser_of(space, answer.front[f][i], hull_width(radius_[i]));
      }
      if (job_.is_alone) return chosen(answer.before[seat][i] > VecF{}, space, nowhere(i));
      if (!eye.camera->has_moved) return space;
      return limited_by_eye(R_WC, space, answer.before[seat][i], i);
    });
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
      const Space here = between(eye, [&](int f) {
        const int seat = eye.seat(f);
        return chosen(answers_[k].before[seat][i] > VecF{},
                      query(eye, eye.in_front, f, answers_[k].lanes[seat][i], counts, i),
                      nowhere(i));
      });
      shown.add(here, k, radius_[i]);
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
    const Space here = between(eye, [&](int f) {
      const int seat = eye.seat(f);
      const Space space = query(eye, eye.remembered, f, answer.lanes[seat][i], counts, i);
      if (!eye.camera->has_moved) return space;
      return limited_by_eye(eye.camera->R_WC[seat], space, answer.before[seat][i], i);
    });
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
      const Space here = between(eye, [&](int f) {
        const int seat = eye.seat(f);
        Space space = query(eye, eye.field, f, answers_[k].lanes[seat][i], is_touching, i);
        if (answers_[k].queries_in_front) space = lesser_of(space, answers_[k].front[f][i], width);
        return chosen(answers_[k].before[seat][i] > VecF{}, space, nowhere(i));
      });
      least.add(here, k, radius_[i]);
      const VecF phi = first_of(least.value).phi + later;
      if (mask_bits(is_touching & (phi > first_of(joined[i].hull).phi - width.w)) == 0) return;
    }
    joined[i].close(least, radius_[i], is_touching);
  }

  // Makes space behind the camera unseen, and that near its eye; most is far from it.
  Space limited_by_eye(const float (&R_WC)[3][3], const Space& seen, VecF before, int i) const {
    const VecF near = first_of(seen).phi - before + hull_width(radius_[i]).w;
    if (mask_bits((before > VecF{}) & (near < VecF{})) == kAllLanes) return seen;
    return before_eye(R_WC, chosen(before > VecF{}, seen, nowhere(i)), before, radius_[i]);
  }

  bool may_pack_ = false;  // elements that the first camera sees to be free are left out
  VecI may_touch_[kNumVectors];
  KeptElements<Sample> added_, shallow_, deep_;
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
