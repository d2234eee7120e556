// The two sides of a haptic run once more: frames and poses to contacts, contacts and states to
// wrenches.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>

#include "palpate/contact/blended_query.h"
#include "src/session/haptic_messages.h"

namespace palpate {

/// What a run works with from one revision of its settings on. What the loop kept from the one
/// before is left out.
struct RevisionParts {
  ContactOptions contact;
  ForceScale scale;
  std::optional<SurfaceTimeline> timeline;
  std::unique_ptr<BlendedQuery> query;
  std::unique_ptr<Coupling> coupling;
};
/// Errors: settings out of range, the backend. `before` is null for the first.
Result<RevisionParts> make_revision(const Tool& tool, const HapticSetup& setup,
                                    const HapticSettings* before);

/// The contact side: frames to surfaces, poses to contacts.
class ContactRepetition {
 public:
  ContactRepetition(const Vec3d& centre_of_mass_T, int num_threads)
      : pool_(std::make_unique<ThreadPool>(num_threads)), centre_of_mass_T_(centre_of_mass_T) {}

  /// In order, the first one before all else.
  void add(std::uint32_t revision, RevisionParts& parts);
  void add(HapticFrame frame) { frames_.push_back(std::move(frame)); }

  /// Whether all frames up to this one are there.
  bool has_frames_until(std::uint64_t number) const {
    return number < num_pushed_ + frames_.size();
  }
  /// The first frame that is there while one before it is not.
  bool has_gap() const {
    return !frames_.empty() && frames_.back().number + 1 != num_pushed_ + frames_.size();
  }

  /// What a query at the same moment and pose gives. Its frames must be there.
  ContactRecord repeat(const ContactRecord& recorded);

 private:
  struct Measuring {
    ContactOptions contact;
    ForceScale scale;
    std::unique_ptr<BlendedQuery> query;
  };
  void push_next();

  std::map<std::uint32_t, SurfaceTimeline> timelines_;  // by revision, from the present one on
  std::map<std::uint32_t, Measuring> measuring_;
  std::unique_ptr<BlendedQuery> query_;
  std::unique_ptr<ThreadPool> pool_;
  Vec3d centre_of_mass_T_;
  std::deque<HapticFrame> frames_;  // not yet pushed
  std::uint64_t num_pushed_ = 0;
  SurfaceMoment moment_;
  double capture_time_ = 0;
};

/// The hand's side: device states and contacts to wrenches.
class TickRepetition {
 public:
  explicit TickRepetition(SafetyFilter safety) : safety_(std::move(safety)) {}

  /// In order, the first one before all else.
  void add(std::uint32_t revision, RevisionParts& parts);
  HapticRecord repeat(const HapticRecord& recorded, const LocalContact& contact);

 private:
  void go_on_with(std::unique_ptr<Coupling> coupling);

  std::map<std::uint32_t, std::unique_ptr<Coupling>> couplings_;  // by revision, not yet used
  std::unique_ptr<Coupling> coupling_;
  SafetyFilter safety_;
  bool has_tool_ = false;
};

}  // namespace palpate
