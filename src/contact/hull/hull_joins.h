// The hull for a vector of elements: seen-free space of all cameras, joined with remembered space
// and with the fields where these can still raise the value (hull_rules.h has the formulas). The
// words are explained in hull_kernel.cpp. Included by that file only.
#pragma once

#include "src/contact/field/ball_totals.h"
#include "src/contact/hull/depth_hull.h"
#include "src/contact/hull/hull_eyes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// Joined values of the cameras for a vector of elements.
template <class Sample>
class Hull {
 public:
  using Space = InSpace<Sample>;

  /// `freed_by`: the camera that is asked first, as it has seen elements to be free last.
  Hull(const HullJob& job, const Eye* eyes, int& freed_by)
      : job_(job), eyes_(eyes), freed_by_(freed_by) {}

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

  // Returns false if some camera sees that all elements of vector `number` of a cluster are free.
  bool evaluate(std::size_t slot, bool is_ball, int number) {
    start(slot, is_ball, number);
    if (!look(slot, freed_by_) || !look_on(slot, freed_by_)) return false;
    join(slot);
    return true;
  }

  // True if every element has a value. A single camera knows nothing of the space behind its eye.
  bool is_complete() const {
    if (!job_.is_alone) return true;
    VecI is_before = answers_[0].before[0] > VecF{};
    if (eyes_[0].seat(eyes_[0].num_fields - 1) > 0) is_before &= answers_[0].before[1] > VecF{};
    return mask_bits(~is_before) == 0;
  }

  // Returns the places of the elements in the cameras that decided them.
  NoisePlace place() const {
    NoisePlace at{};
    at.camera = splat(-1.0f);
    for (int k = 0; k < job_.num_cameras; ++k) {
      const VecI which = joined.decider == splat(k);
      if (mask_bits(which) == 0) continue;
      const HullCamera& camera = job_.cameras[k];
      at = chosen(which, noise_place(camera.field.frame, answers_[k].lanes[0], camera.R_WC[0], k),
                  at);
    }
    return at;
  }

  JoinedViews<Space, VecF, VecI> joined;

 private:
  using Agreed = AgreedViews<Space, VecF, VecI>;
  using Least = LeastView<Space, VecF, VecI>;

  // Begins with the elements of a vector.
  void start(std::size_t slot, bool is_ball, int number) {
    radius_ = load(rows_.radius + slot);
    extent_ = extent_of(radius_, is_ball, number);
    is_free_ = VecI{};
    shallowest_ = splat(-1e9f);
    is_between_ = false;
  }
  void join(std::size_t slot) {
    join_seen_free();
    if (job_.has_memory) join_remembered(slot);
    join_fields(slot);
  }

  // Takes the first samples of the other cameras, until all elements are free by one.
  bool look_on(std::size_t slot, int first) {
    for (const bool may_see : {true, false}) {
      for (int k = 0; k < job_.num_seeing; ++k) {
        if (k == first || job_.cameras[k].may_see() != may_see) continue;
        answers_[k].is_used = may_see || !cannot_decide(k);
        if (answers_[k].is_used && !look(slot, k)) {
          if (may_see) freed_by_ = k;
          return false;
        }
      }
    }
    may_touch_ = ~is_free_;
    return true;
  }

  // True if the bound of a camera that does not see the tool is far below the other values.
  bool cannot_decide(int k) const {
    // Wider pixels may make a deep element half as deep again.
    const VecF least = min(shallowest_, 1.5f * shallowest_) - 3.0f * agreement(radius_);
    return mask_bits(~is_free_ & ~(least > splat(job_.cameras[k].at_most))) == 0;
  }

  // Takes the first sample of one camera. False: now all elements are free.
  bool look(std::size_t slot, int k) {
    const Eye& eye = eyes_[k];
    const MeasureJob& seen = eye.camera->seen_free;
    EyeAnswer<Sample>& answer = answers_[k];
    answer.is_used = true;
    is_between_ |= eye.num_fields > 1;
    Lanes& e = answer.lanes[0] = aim(rows_, seen.frame, eye.seen_free.grid, slot);
    answer.before[0] = e.lz + (seen.frame.p_WC[2] - kMinDepth);
    Look look = look_of(eye.seen_free.grid, e, e.radius);
    VecF phi[2];
    for (int f = 0; f < eye.num_fields; ++f) {
      const int seat = eye.seat(f);
      if (seat > 0) {
        const MeasureJob& older = eye.camera->older;
        answer.lanes[1] = aim(rows_, older.frame, eye.seen_free.grid, slot);
        answer.before[1] = answer.lanes[1].lz + (older.frame.p_WC[2] - kMinDepth);
        look = look_of(eye.seen_free.grid, answer.lanes[1], e.radius);
      }
      const Lanes& at = answer.lanes[seat];
      answer.samples[f] = query_field<Sample>(eye.seen_free.grid, eye.seen_free.pixels[f], look,
                                              at.depth, at.inverse_depth);
      phi[f] = limited(first_of(answer.samples[f]).phi, e.radius, extent_).value;
      if (answer.queries_in_front) {
        answer.in_front[f] = query_field<Sample>(eye.in_front.grid, eye.in_front.pixels[f], look,
                                                 at.depth, at.inverse_depth);
        phi[f] = min(phi[f], first_of(answer.in_front[f]).phi);
      }
      if (job_.is_alone) {
        phi[f] = select(answer.before[seat] > VecF{}, phi[f], free_limit(e.radius, extent_));
      } else if (eye.camera->has_moved) {
        phi[f] = min(phi[f], answer.before[seat]);
      }
    }
    VecF now = phi[0];
    if (eye.num_fields > 1) {
      now = phi[1] + splat(eye.camera->progress) * (phi[0] - phi[1]);
    }
    if (!eye.camera->has_moved && !job_.is_alone) now = min(now, answer.before[0]);
    shallowest_ = max(shallowest_, now);
    // Rounding lowers the lesser of two by no more than this.
    VecF limit = extent_ + free_margin(job_.num_seeing, e.radius);
    if (answer.queries_in_front) limit += front_margin(e.radius);
    is_free_ |= now > limit;
    return mask_bits(~is_free_) != 0;
  }

  // Joins the seen-free space of the cameras: the maximum. Only the camera with the smallest depth
  // needs wider pixels.
  void join_seen_free() {
    const VecF limit = -deep_limit(radius_);
    const VecI may_be_deep =
        may_touch_ & (is_between_ ? splat(-1) : shallowest_ < limit + agreement(radius_));
    Agreed seen;
    for (int k = 0; k < job_.num_seeing; ++k) {
      const Eye& eye = eyes_[k];
      EyeAnswer<Sample>& answer = answers_[k];
      if (!answer.is_used) continue;
      Space moments[2];
      for (int f = 0; f < eye.num_fields; ++f) {
        const int seat = eye.seat(f);
        const float(&R_WC)[3][3] = eye.camera->R_WC[seat];
        deepen(eye.seen_free, f, answer.lanes[seat], may_be_deep, answer.samples[f]);
        moments[f] = in_world(R_WC, eye.camera->field.frame, answer.lanes[seat], answer.samples[f],
                              radius_, extent_);
        if (answer.queries_in_front) {
          deepen(eye.in_front, f, answer.lanes[seat], may_be_deep, answer.in_front[f]);
          answer.front[f] = rotated_to_world(R_WC, eye.camera->field.frame, answer.lanes[seat],
                                             answer.in_front[f]);
          moments[f] = lesser_of(moments[f], answer.front[f], hull_width(radius_));
        }
        if (job_.is_alone) {
          moments[f] = chosen(answer.before[seat] > VecF{}, moments[f], nowhere());
        } else if (eye.camera->has_moved) {
          moments[f] = limited_by_eye(R_WC, moments[f], answer.before[seat]);
        }
      }
      Space here = between(eye, moments);
      if (!eye.camera->has_moved && !job_.is_alone) {
        here = limited_by_eye(eye.camera->R_WC[0], here, answer.before[0]);
      }
      seen.add(here, k, radius_);
    }
    joined.see(seen);
  }

  // Joins remembered free space, limited by the surfaces seen now, where these exceed the value
  // joined so far.
  void join_remembered(std::size_t slot) {
    const auto phi = [&] { return first_of(joined.hull).phi; };
    VecI counts = may_touch_ & (phi() < extent_);
    if (mask_bits(counts) == 0) return;
    Least shown;
    shown.value = nowhere();
    for (int k = 0; k < job_.num_seeing; ++k) {
      if (!job_.cameras[k].may_see()) continue;
      const Eye& eye = eyes_[k];
      Space moments[2];
      for (int f = 0; f < eye.num_fields; ++f) {
        const int seat = eye.seat(f);
        moments[f] =
            chosen(answers_[k].before[seat] > VecF{},
                   evaluate(eye, eye.in_front, f, answers_[k].lanes[seat], counts), nowhere());
      }
      shown.add(between(eye, moments), k, radius_);
      counts &= first_of(shown.value).phi > phi();
      if (mask_bits(counts) == 0) return;
    }
    Agreed known;
    for (const bool may_see : {true, false}) {
      for (int k = 0; k < job_.num_cameras; ++k) {
        const HullCamera& camera = job_.cameras[k];
        if (!camera.is_remembered || camera.may_see() != may_see) continue;
        // A camera whose bound is too low to decide is skipped.
        const VecI may_decide = known.most < splat(camera.at_most) + 2.0f * agreement(radius_);
        if (!may_see && mask_bits(counts & may_decide) == 0) continue;
        known.add(remembered_by(k, slot, counts), k, radius_);
      }
    }
    joined.remember(known, shown, radius_, counts);
  }

  // Samples the remembered free space of one camera, in the world.
  Space remembered_by(int k, std::size_t slot, VecI counts) {
    const Eye& eye = eyes_[k];
    EyeAnswer<Sample>& answer = answers_[k];
    if (k >= job_.num_seeing || !answer.is_used) take_seats(eye, slot, answer);
    Space moments[2];
    for (int f = 0; f < eye.num_fields; ++f) {
      const int seat = eye.seat(f);
      moments[f] = evaluate(eye, eye.remembered, f, answer.lanes[seat], counts);
      if (eye.camera->has_moved) {
        moments[f] = limited_by_eye(eye.camera->R_WC[seat], moments[f], answer.before[seat]);
      }
    }
    const Space here = between(eye, moments);
    if (eye.camera->has_moved) return here;
    return limited_by_eye(eye.camera->R_WC[0], here, answer.before[0]);
  }

  // Joins the fields where they can still raise the value.
  void join_fields(std::size_t slot) {
    const HullWidth<VecF> width = hull_width(radius_);
    const VecI is_touching = may_touch_ & (first_of(joined.hull).phi < extent_);
    if (!job_.may_be_unseen || mask_bits(is_touching) == 0) return;
    const VecF later = -agreement(radius_);
    Least least;
    least.value = nowhere();
    for (int k = 0; k < job_.num_cameras; ++k) {
      if (!job_.cameras[k].may_see()) continue;
      const Eye& eye = eyes_[k];
      if (k >= job_.num_seeing) take_seats(eye, slot, answers_[k]);
      Space moments[2];
      for (int f = 0; f < eye.num_fields; ++f) {
        const int seat = eye.seat(f);
        moments[f] = evaluate(eye, eye.field, f, answers_[k].lanes[seat], is_touching);
        if (answers_[k].queries_in_front) {
          moments[f] = lesser_of(moments[f], answers_[k].front[f], width);
        }
        moments[f] = chosen(answers_[k].before[seat] > VecF{}, moments[f], nowhere());
      }
      least.add(between(eye, moments), k, radius_);
      const VecF phi = first_of(least.value).phi + later;
      if (mask_bits(is_touching & (phi > first_of(joined.hull).phi - width.w)) == 0) return;
    }
    joined.close(least, radius_, is_touching);
  }

  // Returns the value of space that no surface is near to.
  Space nowhere() const {
    Space space;
    set(space, SpaceGradient<VecF>{free_limit(radius_, extent_)});
    return space;
  }
  // Makes space behind the camera unseen, and that near its eye.
  Space limited_by_eye(const float (&R_WC)[3][3], const Space& seen, VecF before) const {
    return before_eye(R_WC, chosen(before > VecF{}, seen, nowhere()), before, radius_);
  }

  // Places the elements in a camera at all its seats.
  void take_seats(const Eye& eye, std::size_t slot, EyeAnswer<Sample>& answer) const {
    for (int seat = 0; seat <= eye.seat(eye.num_fields - 1); ++seat) {
      const MeasureJob& job = seat == 0 ? eye.camera->field : eye.camera->older;
      answer.lanes[seat] = aim(rows_, job.frame, eye.field.grid, slot);
      answer.before[seat] = answer.lanes[seat].lz + (job.frame.p_WC[2] - kMinDepth);
    }
  }

  // Samples a field at moment f, in the world.
  Space evaluate(const Eye& eye, const FieldPair& field, int f, const Lanes& e, VecI which) {
    Sample sample = query_field<Sample>(field.grid, field.pixels[f],
                                        look_of(field.grid, e, radius_), e.depth, e.inverse_depth);
    deepen(field, f, e, which, sample);
    return in_world(eye.camera->R_WC[eye.seat(f)], eye.camera->field.frame, e, sample, radius_,
                    extent_);
  }

  // Samples wider pixels where elements are deep.
  void deepen(const FieldPair& field, int f, const Lanes& e, VecI which, Sample& sample) {
    if (mask_bits(which & (first_of(sample).phi < -deep_limit(e.radius))) == 0) return;
    const Pixels pixels[1] = {field.pixels[f]};
    Answer<Sample, 1> answer{{sample}, {which}};
    query_deeper<Sample, 1>(field.grid, pixels, e, answer);
    sample = answer.samples[0];
  }

  const HullJob& job_;
  const Eye* eyes_;
  int& freed_by_;
  ElementRows rows_;
  EyeAnswer<Sample> answers_[kMaxCameras];
  VecF shallowest_, radius_, extent_;
  VecI is_free_, may_touch_;
  bool is_between_ = false;
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
