// Changes of a running loop: other settings, held frames, pictures.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <thread>
#include <vector>

#include "eval/studies/method_queries.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/run/internal/pipeline.h"
#include "src/run/loop/haptic_stage.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/sanitized.h"

namespace palpate {
namespace {

using test::box_tool;
using test::ScriptedDevice;
using test::wait_for;
using test::WallSource;

/// Forces that nothing but the slew limit and the device bends.
RunSettings patient_settings() {
  RunSettings settings = test::patient_settings();
  settings.safety.passivity_control = false;
  return settings;
}

/// The box is 5 to 15 mm in the wall, at 20 mm/s at most.
Vec3d pressing_hand(double time) { return {0, 0, 0.035 + 0.005 * std::sin(4 * time)}; }

struct SeenFrameCopy {
  std::uint32_t revision;
  double time;
  DepthFrame frame;
};

/// Everything that an observer gets, with checks that settings come before their results.
struct Seen {
  std::mutex mutex;
  std::vector<SeenFrameCopy> frames;
  std::vector<ContactRecord> contacts;
  std::vector<TickRecord> ticks;
  std::vector<RunSettings> settings;

  RunObserver observer() {
    RunObserver observer;
    observer.on_settings = [this](std::uint32_t revision, const RunSettings& now) {
      const std::lock_guard lock(mutex);
      settings.push_back(now);
      EXPECT_EQ(revision, settings.size());
    };
    observer.on_frame = [this](const FrameRecord& record, const DepthFrame& frame) {
      const std::lock_guard lock(mutex);
      EXPECT_LE(record.revision, settings.size());
      frames.push_back({record.revision, record.capture_time, frame});
    };
    observer.on_contact = [this](const ContactRecord& contact) {
      const std::lock_guard lock(mutex);
      EXPECT_LE(contact.revision, settings.size());
      contacts.push_back(contact);
    };
    observer.on_ticks = [this](std::span<const TickRecord> records) {
      const std::lock_guard lock(mutex);
      EXPECT_LE(records.back().revision, settings.size());
      ticks.insert(ticks.end(), records.begin(), records.end());
    };
    return observer;
  }
  std::size_t num_frames() {
    const std::lock_guard lock(mutex);
    return frames.size();
  }
};

/// A loop that presses into a wall.
struct Touching {
  explicit Touching(WallSource::Options wall = {}, RunSettings settings = patient_settings())
      : source(std::move(wall)), device({.hand = pressing_hand}) {
    loop = RunLoop::create(box_tool(), source, device, settings, seen.observer()).value();
    EXPECT_TRUE(loop->start());
    EXPECT_TRUE(wait_for([&] { return loop->report().num_contacts > 20; }));
  }
  void run_for(double seconds) {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  }

  WallSource source;
  ScriptedDevice device;
  Seen seen;
  std::unique_ptr<RunLoop> loop;
};

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

// Other settings

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
  eval::MethodQueries query(Backend::cpu, box_tool());
  std::optional<SurfaceTimeline> timeline;
  std::size_t num_pushed = 0;
  for (const ContactRecord& contact : seen.contacts) {
    for (; num_pushed <= contact.frame_number; ++num_pushed) {
      const auto& [revision, time, frame] = seen.frames[num_pushed];
      const RunSettings& now = seen.settings[revision];
      if (num_pushed == 0 ||
          !keeps_surfaces(seen.settings[seen.frames[num_pushed - 1].revision], now)) {
        std::optional<DepthFieldOptions> field;
        if (now.contact.method == MethodKind::field) field = now.field;
        timeline.emplace(
            SurfaceTimeline::create(touching.source.info(),
                                    {.surface = now.surface, .field = field, .time = now.time})
                .value());
      }
      timeline->push(frame, time, pool);
    }
    SurfaceBlend blend = timeline->at(1e12);
    blend.progress = contact.cameras.of[0].progress;
    query.set_blend(blend);
    const Penetration again = query.query(contact.X_WT, seen.settings[contact.revision].contact);
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

// Couplings

/// A wall that pushes back with 2000 N/m, known at the tool's pose.
LocalContact wall_contact(const Pose& X_WT, double time) {
  LocalContact contact;
  contact.time = time;
  contact.X_WT = X_WT;
  contact.p_WC = X_WT * box_tool().sphere_mass().center_of_mass;
  const double depth = std::max(0.0, X_WT.translation.z);
  contact.F_C_W.force = {0, 0, -2000 * depth};
  if (depth > 0) contact.stiffness.m[2][2] = contact.max_stiffness = 2000;
  contact.volume = 0.0025 * depth;
  contact.is_valid = true;
  return contact;
}

TEST(CouplingTakeOver, FromEachKindToEachTheToolMovesOn) {
  const ScriptedDevice device({});
  const DeviceLimits& limits = device.info().limits;
  const auto coupling_of = [&](CouplingKind kind, double scale) {
    CouplingOptions options;
    options.kind = kind;
    options.motion_scale = scale;
    const auto checked = check_coupling(options, limits, 1e-3, box_tool().sphere_mass()).value();
    return make_coupling(checked.options, limits, box_tool().sphere_mass());
  };
  constexpr CouplingKind kKinds[] = {CouplingKind::virtual_coupling, CouplingKind::direct,
                                     CouplingKind::proxy};
  for (const double height : {-0.02, 0.003}) {  // before the wall, and in it
    for (const CouplingKind from : kKinds) {
      for (const CouplingKind to : kKinds) {
        auto coupling = coupling_of(from, 1);
        DeviceState state;
        state.is_valid = true;
        CouplingStep last;
        Vec3d velocity;
        for (int k = 0; k < 1400; ++k) {
          const double time = 1e-3 * k;
          state.time = time;
          state.X_BH = {{0.02 * std::sin(3 * time), 0, height}, axis_angle({1, 2, 3}, 0.3 * time)};
          state.V_BH.linear = {0.06 * std::cos(3 * time), 0, 0};
          state.V_BH.angular = 0.3 / norm(Vec3d{1, 2, 3}) * Vec3d{1, 2, 3};
          if (k == 0) coupling->reset(state);
          if (k == 700) {
            auto next = coupling_of(to, 2);
            next->take_over(coupling->state());
            coupling = std::move(next);
          }
          const CouplingStep now =
              coupling->step(state, wall_contact(k == 0 ? Pose{} : last.X_WT, time), 1e-3);
          if (k >= 700) {
            // At most twice the hand's pace, and the way of the tool back to the hand.
            EXPECT_LT(norm(now.X_WT.translation - last.X_WT.translation), 3e-4)
                << static_cast<int>(from) << static_cast<int>(to) << " " << k;
          }
          if (k == 700) {
            EXPECT_LT(norm(now.X_WT_hand.translation - last.X_WT_hand.translation), 1.3e-4);
            EXPECT_LT(norm(now.X_WT.translation - last.X_WT.translation - 1e-3 * velocity), 1e-4);
          }
          velocity = 1e3 * (now.X_WT.translation - last.X_WT.translation);
          last = now;
        }
        if (height < 0 || to == CouplingKind::direct) {
          EXPECT_LT(norm(last.X_WT.translation - last.X_WT_hand.translation), 2e-3);
        }
      }
    }
  }
}

// Held frames

TEST(LiveLoopHold, TheSceneStandsStillAndTheHandGoesOn) {
  Touching touching({.depth = [](int k) { return 0.5 + 0.0005 * k; }, .rate = 100});
  Seen& seen = touching.seen;
  const auto depth_of = [&](std::size_t k) {
    const std::lock_guard lock(seen.mutex);
    return seen.frames[k].frame.pixels[0];
  };
  const auto wait_for_frames = [&](std::size_t more) {
    const std::size_t desired = seen.num_frames() + more;
    EXPECT_TRUE(wait_for([&] { return seen.num_frames() >= desired; }));
  };
  touching.loop->hold_frames(true);
  // Wait for frames that were on their way: no two new frames are the same.
  EXPECT_TRUE(wait_for([&] {
    const std::size_t num = seen.num_frames();
    return num > 1 && depth_of(num - 1) == depth_of(num - 2);
  }));
  const std::size_t held = seen.num_frames() - 1;
  const int num_ticks = touching.device.num_ticks();
  wait_for_frames(10);
  EXPECT_TRUE(wait_for([&] { return touching.device.num_ticks() > num_ticks + 30; }));
  for (std::size_t k = held; k < held + 10; ++k) EXPECT_EQ(depth_of(k), depth_of(held));

  touching.loop->step_frame();
  EXPECT_TRUE(wait_for([&] { return depth_of(seen.num_frames() - 1) != depth_of(held); }));
  EXPECT_EQ(depth_of(seen.num_frames() - 1), depth_of(held) + 5);  // the next one, 0.5 mm on
  const std::size_t stepped = seen.num_frames() - 1;
  wait_for_frames(5);
  EXPECT_EQ(depth_of(seen.num_frames() - 1), depth_of(stepped));

  // Settings change meanwhile too.
  RunSettings settings = touching.loop->settings();
  settings.contact.method = MethodKind::graph;
  EXPECT_TRUE(touching.loop->change(settings));

  touching.loop->hold_frames(false);
  EXPECT_TRUE(
      wait_for([&] { return depth_of(seen.num_frames() - 1) >= depth_of(stepped) + 4 * 5; }));
  touching.loop->stop();
  for (std::size_t k = 1; k < seen.frames.size(); ++k) {
    EXPECT_GT(seen.frames[k].time, seen.frames[k - 1].time);
    const int step = depth_of(k) - depth_of(k - 1);
    EXPECT_TRUE(step >= 0 && step % 5 == 0) << step;  // a busy machine leaves some out
  }
  EXPECT_EQ(touching.loop->report().fault, Fault::stopped);
}

// Pictures

TEST(LiveLoopPictures, AreWhatAFreshQuerySays) {
  for (const MethodKind method : {MethodKind::field, MethodKind::graph}) {
    RunSettings settings = patient_settings();
    settings.contact.method = method;
    Touching touching({.depth = [](int k) { return 0.5 + 0.001 * std::sin(k); }}, settings);
    EXPECT_EQ(touching.loop->new_contact_picture(PictureConsumer::robots), nullptr);
    EXPECT_EQ(touching.loop->new_surface_picture(), nullptr);
    touching.run_for(0.1);
    touching.loop->request_contact_picture(PictureConsumer::robots);
    touching.loop->request_surface_picture();
    const ContactPicture* picture = nullptr;
    const SurfacePicture* surface = nullptr;
    ASSERT_TRUE(wait_for(
        [&] { return (picture = touching.loop->new_contact_picture(PictureConsumer::robots)); }));
    ASSERT_TRUE(wait_for([&] { return (surface = touching.loop->new_surface_picture()); }));
    touching.run_for(0.05);
    EXPECT_EQ(touching.loop->new_contact_picture(PictureConsumer::robots),
              nullptr);  // one for each question
    EXPECT_EQ(touching.loop->new_surface_picture(), nullptr);
    touching.loop->stop();

    const Seen& seen = touching.seen;
    ASSERT_EQ(touching.loop->report().num_lost_records, 0u);
    const ContactRecord& contact = seen.contacts.at(picture->contact_number - 1);
    EXPECT_EQ(contact.number, picture->contact_number);
    EXPECT_EQ(contact.frame_number, picture->frame_number);
    EXPECT_EQ(contact.X_WT, picture->X_WT);
    ThreadPool pool(1);
    std::optional<DepthFieldOptions> field;
    if (method == MethodKind::field) field = settings.field;
    auto timeline = SurfaceTimeline::create(
                        touching.source.info(),
                        {.surface = settings.surface, .field = field, .time = settings.time})
                        .value();
    eval::MethodQueries query(Backend::cpu, box_tool());
    int num_compared = 0;
    for (std::size_t k = 0; k < seen.frames.size(); ++k) {
      timeline.push(seen.frames[k].frame, seen.frames[k].time, pool);
      if (k == surface->frame_number) {
        const PointCloud cloud = timeline.newest_cloud(pool);
        ASSERT_EQ(surface->points.size(), cloud.size());
        ASSERT_EQ(surface->edges.size(), cloud.size());
        EXPECT_EQ(surface->width, cloud.width());
        for (std::size_t i = 0; i < cloud.size(); ++i) {
          if (std::isnan(cloud.point(i).x)) continue;
          ASSERT_EQ(surface->points[i], cloud.point(i));
          ASSERT_EQ(surface->normals[i], cloud.normal(i));
          ++num_compared;
        }
      }
      if (k != picture->frame_number) continue;
      SurfaceBlend blend = timeline.at(1e12);
      blend.progress = contact.cameras.of[0].progress;
      query.set_blend(blend);
      query.query(picture->X_WT, settings.contact);
      const auto states = query.states();
      const auto planes = query.planes();
      ASSERT_EQ(picture->spheres.states.size(), states.size());
      ASSERT_EQ(picture->spheres.planes.size(), planes.size());
      int num_touched = 0;
      for (std::size_t i = 0; i < states.size(); ++i) {
        ASSERT_EQ(picture->spheres.states[i], states[i]);
        ASSERT_EQ(picture->spheres.planes[i].normal, planes[i].normal);
        num_touched += states[i] != SphereState::outside;
      }
      EXPECT_GT(num_touched, 0);
    }
    EXPECT_GT(num_compared, 1000);
  }
}

}  // namespace
}  // namespace palpate
