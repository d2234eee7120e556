// Other settings of a running loop.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <thread>
#include <vector>

#include "src/core/internal/monotonic_clock.h"
#include "src/run/internal/pipeline.h"
#include "src/run/loop/haptic_stage.h"
#include "tests/run/touching_loop.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_queries.h"
#include "tests/test_util/sanitized.h"

namespace palpate {
namespace {

using namespace test::touching_loop;  // NOLINT: all of it
using test::box_tool;
using test::ScriptedDevice;
using test::wait_for;
using test::WallSource;

using Edit = void (*)(RunSettings&);
constexpr Edit kEdits[] = {
    [](auto& s) { s.contact.method = MethodKind::graph; },
    [](auto& s) { s.coupling.stiffness = 300; },
    [](auto& s) { s.time.mode = TimeMode::latest; },
    [](auto& s) { s.coupling.kind = CouplingKind::proxy; },
    [](auto& s) { s.contact.method = MethodKind::field; },
    [](auto& s) { s.surface.filter.enabled = false; },
    [](auto& s) { s.coupling.motion_scale = 1.5; },
    [](auto& s) { s.coupling.kind = CouplingKind::direct; },
    [](auto& s) { s.contact_rate = 200; },
    [](auto& s) { s.coupling.kind = CouplingKind::virtual_coupling; },
};

constexpr std::uint32_t kOtherMethod = 5;  // of a proxy

TEST(LiveLoopChange, EveryStageGoesOnAndNothingJumps) {
  Touching touching({.depth = [](int k) { return 0.5 + 0.001 * std::sin(k); }});
  touching.run_for(0.2);
  for (const Edit edit : kEdits) {
    RunSettings settings = touching.loop->settings();
    edit(settings);
    const Status changed = touching.loop->change(settings);
    ASSERT_TRUE(changed) << changed.error().message;
    touching.run_for(0.08);
  }
  touching.loop->stop();
  const Seen& seen = touching.seen;
  constexpr std::uint32_t kNum = std::size(kEdits);
  EXPECT_EQ(seen.settings.size(), kNum);
  EXPECT_EQ(seen.ticks.back().revision, kNum);
  EXPECT_EQ(seen.contacts.back().revision, kNum);
  EXPECT_EQ(seen.ticks.size(), touching.loop->report().num_ticks);
  EXPECT_EQ(seen.settings.back().coupling.motion_scale, 1.5);

  const SafetyOptions safety = patient_settings().safety;
  double strongest = 0;
  for (std::size_t k = 1; k < seen.ticks.size(); ++k) {
    const TickRecord &last = seen.ticks[k - 1], &now = seen.ticks[k];
    ASSERT_GE(now.revision, last.revision);
    ASSERT_LE(now.revision, last.revision + 1);
    const double dt = now.device.time - last.device.time;
    strongest = std::max(strongest, norm(now.F_H_B.force));
    if (now.safety.fault == Fault::none) {
      ASSERT_LE(norm(now.F_H_B.force - last.F_H_B.force), 1.001 * safety.max_slew * dt) << k;
    }
    if (now.revision == last.revision || now.revision == 0) continue;
    // Neither the tool nor its pose by the hand jumps: allowed are the hand's motion, the tool's
    // last motion, the motion of the frames, and the acceleration of 0.1 kg by 30 N.
    const TickRecord& before = seen.ticks[k > 1 ? k - 2 : 0];
    const double went_on = norm(last.step.X_WT.translation - before.step.X_WT.translation) *
                           std::max(now.dt / last.dt, 1.0);
    const double moved = norm(now.device.X_BH.translation - last.device.X_BH.translation);
    EXPECT_LT(norm(now.step.X_WT_hand.translation - last.step.X_WT_hand.translation),
              2 * moved + 1e-9)
        << now.revision;
    // A coupling without a mass follows the wall of another frame at once; if contacts are late,
    // also the contact by another method: at most by the tool's depth.
    const bool is_late =
        now.revision == kOtherMethod && (test::kIsSanitized || last.contact_age > 0.005);
    const double wall_moved = is_late ? 0.015 : now.frame_number == last.frame_number ? 0 : 0.002;
    EXPECT_LT(norm(now.step.X_WT.translation - last.step.X_WT.translation),
              2 * moved + went_on + wall_moved + 300 * now.dt * now.dt)
        << now.revision << ", went on by " << went_on << " in " << now.dt << ", frames "
        << last.frame_number << " " << now.frame_number << ", contacts " << last.contact_number
        << " " << now.contact_number;
  }
  EXPECT_GT(strongest, 0.5);
  for (std::size_t k = 1; k < seen.frames.size(); ++k) {
    ASSERT_GE(seen.frames[k].revision, seen.frames[k - 1].revision);
  }
}

// Each contact equals that of a fresh query with the settings and frames of its revision.
TEST(LiveLoopChange, ContactsAreThoseOfTheirRevision) {
  Touching touching({.depth = [](int k) { return 0.5 + 0.001 * std::sin(k); }});
  for (const Edit edit : {kEdits[0], kEdits[2], kEdits[4]}) {
    RunSettings settings = touching.loop->settings();
    edit(settings);
    ASSERT_TRUE(touching.loop->change(settings));
    touching.run_for(0.1);
  }
  touching.loop->stop();
  Seen& seen = touching.seen;
  ASSERT_EQ(touching.loop->report().num_lost_records, 0u);
  seen.settings.insert(seen.settings.begin(), patient_settings());
  ThreadPool pool(1);
  test::ContactQueries queries(box_tool());
  std::optional<SurfaceTimeline> timeline;
  std::size_t num_pushed = 0;
  for (const ContactRecord& contact : seen.contacts) {
    for (; num_pushed <= contact.frame_number; ++num_pushed) {
      const auto& [revision, time, frame] = seen.frames[num_pushed];
      const RunSettings& now = seen.settings[revision];
      if (num_pushed == 0 ||
          !keeps_surfaces(seen.settings[seen.frames[num_pushed - 1].revision], now)) {
        timeline.emplace(test::timeline_of(touching.source.info(), now));
      }
      timeline->push(frame, time, pool);
    }
    SurfaceBlend blend = timeline->at(1e12);
    blend.progress = contact.cameras.of[0].progress;
    const ContactQuery& query = queries.by(seen.settings[contact.revision].contact);
    const Penetration again = query.measure({&blend, 1}, contact.X_WT).penetration;
    ASSERT_EQ(again.volume, contact.penetration.volume) << contact.number;
    ASSERT_EQ(again.measure_W.force.z, contact.penetration.measure_W.force.z);
  }
  EXPECT_EQ(seen.contacts.back().revision, 3u);
}

TEST(LiveLoopChange, WhatIsRefusedChangesNothing) {
  RunSettings limited = patient_settings();
  limited.safety.max_contact_age = 1;
  limited.may_thin = false;
  Touching touching({}, limited);
  const auto refusal = [&](auto edit) {
    RunSettings settings = touching.loop->settings();
    settings.coupling.stiffness = 123;
    settings.contact.method = MethodKind::weighted;
    edit(settings);
    const Status changed = touching.loop->change(settings);
    return changed ? std::string() : changed.error().message;
  };
  const std::pair<const char*, Edit> lasting[] = {
      {"safety.max_slew", [](auto& s) { s.safety.max_slew = 1e6; }},
      {"safety.energy_tank", [](auto& s) { s.safety.energy_tank = 1; }},
      {"safety.dead_man", [](auto& s) { s.safety.dead_man = true; }},
      {"loop.threads", [](auto& s) { s.num_threads = 2; }},
      {"loop.contact_gpu", [](auto& s) { s.contact_gpu = 1; }},
      {"loop.real_time", [](auto& s) { s.wants_real_time = true; }},
      {"coupling.base_in_scene", [](auto& s) { s.coupling.X_WB.translation.x += 0.1; }},
      {"coupling.tool_in_hand", [](auto& s) { s.coupling.X_HT.translation.x += 0.1; }},
  };
  for (const auto& [name, edit] : lasting) {
    EXPECT_NE(refusal(edit).find(name), std::string::npos) << name;
  }
  EXPECT_NE(refusal([](auto& s) { s.contact_rate = NAN; }), "");
  EXPECT_NE(refusal([](auto& s) { s.contact_rate = 1; }).find("contact_rate of 1 Hz"),
            std::string::npos);
  EXPECT_NE(refusal([](auto& s) { s.coupling.damping_ratio = -1; }), "");
  EXPECT_NE(refusal([](auto& s) { s.time.max_jump = -1; }), "");
  EXPECT_NE(refusal([](auto& s) { s.surface.filter.radius = 99; }), "");
  EXPECT_EQ(touching.loop->settings().coupling.stiffness, 0);
  touching.loop->stop();
  EXPECT_NE(refusal([](auto&) {}).find("ended"), std::string::npos);
  EXPECT_TRUE(touching.seen.settings.empty());
  EXPECT_EQ(touching.seen.ticks.back().revision, 0u);
  EXPECT_EQ(touching.seen.contacts.back().revision, 0u);
}

// Somebody plays with a slider: the same note again and again, and then ever new ones.
TEST(LiveLoopChange, NotesAboutSettingsAreToldOnceAndNotWithoutEnd) {
  Touching touching;
  const auto change_to = [&](double stiffness) {
    RunSettings settings = touching.loop->settings();
    settings.coupling.stiffness = stiffness;
    ASSERT_TRUE(touching.loop->change(settings));
  };
  const auto num_notes = [&] {
    const auto notes = touching.loop->report().notes;
    return std::ranges::count_if(notes, [](const std::string& note) {
      return note.find("the coupling stiffness is lowered") != std::string::npos;
    });
  };
  for (int k = 0; k < 5; ++k) {
    change_to(1e6);
    change_to(300);
  }
  EXPECT_EQ(num_notes(), 1);
  for (int k = 0; k < 150; ++k) change_to(500 + 10 * k);
  EXPECT_GT(num_notes(), 90);
  EXPECT_LE(num_notes(), 100);
}

// Surfaces are blended for a frame period: with one of an hour no surface would ever be new.
TEST(LiveLoopChange, FramesThatAreExpectedInAnHourComeWhenTheyCome) {
  Touching touching;
  RunSettings settings = touching.loop->settings();
  settings.time.first_period = 3600;
  ASSERT_TRUE(touching.loop->change(settings));
  const std::uint64_t before = touching.loop->report().num_frames;
  EXPECT_TRUE(wait_for([&] { return touching.loop->report().num_frames > before + 20; }));
  // A surface of that time is all that is felt.
  const auto has_blended = [&] {
    const std::lock_guard lock(touching.seen.mutex);
    const auto& frames = touching.seen.frames;
    const auto first = std::ranges::find(frames, 1u, &SeenFrameCopy::revision);
    const auto number = static_cast<std::uint64_t>(first - frames.begin());
    return std::ranges::any_of(touching.seen.contacts, [&](const ContactRecord& contact) {
      return contact.frame_number > number && contact.cameras.of[0].progress == 1;
    });
  };
  EXPECT_TRUE(wait_for(has_blended));
  settings.time.first_period = 0;
  EXPECT_TRUE(touching.loop->change(settings));
}

// A change of settings while the camera stands still is answered soon, and the next one at once:
// the thread of a page waits for the answer, and the end of a run for that thread.
TEST(LiveLoopChange, WithoutDepthFramesIsRefusedSoonAndTakenLater) {
  std::atomic<bool> may_come_again = false;
  Touching touching({.depth = [&](int k) {
    if (k == 10) wait_for([&] { return may_come_again.load(); });
    return 0.5;
  }});
  const auto begin = std::chrono::steady_clock::now();
  const auto filter = [&](int radius) {
    RunSettings settings = touching.loop->settings();
    settings.surface.filter.radius = radius;
    return touching.loop->change(settings);
  };
  Status last = Done{};
  int radius = 0;
  ASSERT_TRUE(wait_for([&] {
    last = filter(radius = 1 + radius % 3);
    return !last;
  }));
  EXPECT_NE(last.error().message.find("no depth frame"), std::string::npos);
  for (int k = 0; k < 100; ++k) EXPECT_FALSE(filter(5));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::minutes(1));
  may_come_again = true;
  EXPECT_TRUE(wait_for([&] { return bool(filter(4)); }));
  EXPECT_EQ(touching.loop->settings().surface.filter.radius, 4);
}

TEST(LiveLoopChange, AnotherBackendWhereThereIsOneElseACleanNo) {
  Touching touching;
  const auto gpus = find_gpus();
  RunSettings settings = touching.loop->settings();
  settings.backend = Backend::cuda;
  const Status changed = touching.loop->change(settings);
  ASSERT_EQ(changed.has_value(), gpus.has_value());
  if (changed) {
    touching.run_for(0.1);
    touching.loop->stop();
    EXPECT_TRUE(touching.loop->status());
    EXPECT_EQ(touching.seen.contacts.back().revision, 1u);
  } else {
    EXPECT_EQ(changed.error().message, gpus.error().message);
    EXPECT_EQ(touching.loop->settings().backend, Backend::cpu);
    const std::size_t num_contacts = touching.loop->report().num_contacts;
    EXPECT_TRUE(wait_for([&] { return touching.loop->report().num_contacts > num_contacts; }));
  }
}

// A loop by hand: the changes are made beforehand, so that nothing else allocates meanwhile.
TEST(LiveLoopChange, StagesTakeChangesWithoutAllocating) {
  WallSource source({.rate = 200});
  const RunSettings settings = patient_settings();
  RunSettings other = settings;
  other.contact.method = MethodKind::graph;
  other.coupling.kind = CouplingKind::proxy;
  ScriptedDevice device({});
  const auto parts_of = [&](const RunSettings& some) {
    return make_run_parts(ToolIndex::create(box_tool()), source.info(), device.info(), some,
                          {nullptr, SurfaceStage::kNumSpare, nullptr})
        .value();
  };
  LoopTimes times;
  RunParts parts = parts_of(settings), next = parts_of(other);
  SurfaceStage surfaces(source, std::move(parts.timelines), settings, ball_of(box_tool()), true,
                        times.surface_compute);
  ContactStage contacts(std::move(parts.contact), surfaces,
                        {1000, 1e-3, box_tool().spheres().size(), false, true, 0},
                        times.contact_compute);
  HapticStage haptic({std::move(parts.coupling),
                      SafetyFilter::create(device.info().limits, settings.safety).value(), 1e-3},
                     surfaces, contacts, {1e-3, false, true}, times);
  SurfaceChange surface_change{1, std::move(next.timelines)};
  ContactChange contact_change{1, 1, 500, next.scale, std::move(next.contact)};
  HapticChange haptic_change{1, std::move(next.coupling)};
  ASSERT_TRUE(surfaces.start());
  contacts.start(monotonic_now(), {});

  TickRecord record;
  const auto tick = [&] {
    DeviceState state;
    state.time = monotonic_now();
    state.X_BH.translation = pressing_hand(0.3);
    state.is_valid = true;
    haptic.tick(state);
    if (const auto newest = haptic.latest()) record = *newest;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  EXPECT_TRUE(wait_for([&] { return tick(), contacts.num_contacts() > 20; }));
  const test::AllocationCounter counter;
  contacts.changes().offer(contact_change);
  surfaces.changes().offer(surface_change);
  haptic.changes().offer(haptic_change);
  EXPECT_TRUE(wait_for([&] {
    contacts.request_picture(PictureConsumer::page);
    contacts.new_picture(PictureConsumer::page);
    tick();
    return contacts.changes().is_settled() && surfaces.changes().is_settled() &&
           haptic.changes().is_settled();
  }));
  const std::uint64_t taken = contacts.num_contacts();
  EXPECT_TRUE(wait_for([&] { return tick(), contacts.num_contacts() > taken + 20; }));
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(record.revision, 1u);
  // The replaced parts have come back.
  EXPECT_NE(haptic_change.coupling, nullptr);
  EXPECT_NE(contact_change.part, nullptr);
  EXPECT_TRUE(!surface_change.timelines.empty());
  contacts.stop();
  surfaces.stop();
}

/// A query on a GPU that is lost.
class LostQuery final : public ContactQuery {
 public:
  using ContactQuery::measure;
  explicit LostQuery(const ContactQuery& like) : ContactQuery(like.index(), like.method()) {}
  ContactResult measure_one(const SurfaceView&, const SurfaceView&, double, const Pose&,
                            const ContactWants&) const noexcept override {
    ContactResult nothing;
    nothing.penetration.status = StepStatus::backend_failed;
    return nothing;
  }
};

// While nothing is measured the force is away; with another part everything is measured again.
TEST(LiveLoopChange, ALostBackendIsReplaced) {
  WallSource source({.rate = 200});
  const RunSettings settings = patient_settings();
  ScriptedDevice device({});
  const auto parts_of = [&] {
    return make_run_parts(ToolIndex::create(box_tool()), source.info(), device.info(), settings,
                          {nullptr, SurfaceStage::kNumSpare, nullptr})
        .value();
  };
  LoopTimes times;
  RunParts parts = parts_of(), next = parts_of();
  auto lost = std::make_unique<ContactPart>(
      box_tool(), std::make_unique<LostQuery>(parts.contact->query()), parts.scale);
  SurfaceStage surfaces(source, std::move(parts.timelines), settings, ball_of(box_tool()), false,
                        times.surface_compute);
  ContactStage contacts(std::move(lost), surfaces,
                        {1000, 1e-3, box_tool().spheres().size(), false, false, 0},
                        times.contact_compute);
  HapticStage haptic({std::move(parts.coupling),
                      SafetyFilter::create(device.info().limits, settings.safety).value(), 1e-3},
                     surfaces, contacts, {1e-3, false, false}, times);
  ASSERT_TRUE(surfaces.start());
  contacts.start(monotonic_now(), {});
  TickRecord record;
  const auto tick = [&] {
    DeviceState state;
    state.time = monotonic_now();
    state.is_valid = true;
    haptic.tick(state);
    if (const auto newest = haptic.latest()) record = *newest;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  EXPECT_TRUE(wait_for([&] { return tick(), record.safety.state == ForceState::off; }));
  EXPECT_EQ(record.safety.fault, Fault::backend);
  EXPECT_TRUE(contacts.has_backend_failed());
  EXPECT_EQ(contacts.num_contacts(), 0u);

  SurfaceChange surface_change{1, std::move(next.timelines)};
  ContactChange contact_change{1, 1, 1000, next.scale, std::move(next.contact)};
  contacts.changes().offer(contact_change);
  surfaces.changes().offer(surface_change);
  EXPECT_TRUE(wait_for([&] { return tick(), record.safety.is_engaged(); }));
  EXPECT_FALSE(contacts.has_backend_failed());
  EXPECT_GT(contacts.num_contacts(), 0u);
  EXPECT_FALSE(haptic.has_faded());
  contacts.stop();
  surfaces.stop();
}

}  // namespace
}  // namespace palpate
