// Records that a live loop publishes, for stages that write in any order the threads may give.
#include "src/run/loop/publisher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "src/run/loop/surface_stage.h"

namespace palpate {
namespace {

/// Three stages, each a step at a time: what is written may be used before its record is.
class Stages {
 public:
  explicit Stages(std::size_t contacts_kept) : contacts(contacts_kept) {}

  LoopRecords records() {
    return {frames, contacts, ticks, [this] { return num_frames_; },
            [this] { return num_contacts_; }};
  }

  /// New settings come into use with the next frame, contact and tick.
  void change(Publisher& publisher) {
    publisher.add_settings({});
    ++revision_;
  }

  void step_surface() {
    if (made_frames_ == num_frames_) {
      frame_revision_ = revision_;
      ++made_frames_;  // can be felt
      return;
    }
    PublishedFrame seen;
    seen.record.number = num_frames_;
    seen.record.revision = frame_revision_;
    frames.push(seen);
    ++num_frames_;
  }

  void step_contact() {
    if (made_frames_ == 0) return;
    if (made_contacts_ == num_contacts_) {
      contact_ = ContactRecord{};
      contact_.number = ++made_contacts_;  // can be held
      contact_.frame_number = made_frames_ - 1;
      contact_.revision = revision_;
      return;
    }
    contacts.push(contact_);
    ++num_contacts_;
  }

  void step_haptic() {
    if (made_contacts_ == 0) return;
    TickRecord tick;
    tick.number = num_ticks_++;
    tick.contact_number = made_contacts_;
    tick.revision = revision_;
    ticks.push(tick);
  }

  /// Writes all records that were begun.
  void finish() {
    if (made_frames_ > num_frames_) step_surface();
    if (made_contacts_ > num_contacts_) step_contact();
  }

  std::uint64_t num_frames() const { return num_frames_; }
  std::uint64_t num_contacts() const { return num_contacts_; }
  std::uint64_t num_ticks() const { return num_ticks_; }

  RecordQueue<PublishedFrame> frames{512};
  RecordQueue<ContactRecord> contacts;
  RecordQueue<TickRecord> ticks{4096};

 private:
  std::uint64_t made_frames_ = 0, num_frames_ = 0, made_contacts_ = 0, num_contacts_ = 0;
  std::uint64_t num_ticks_ = 0;
  std::uint32_t revision_ = 0, frame_revision_ = 0;
  ContactRecord contact_;
};

/// Observer that checks the records as they come.
struct Listener {
  explicit Listener(std::function<void()> meanwhile) {
    observer.on_frame = [this, meanwhile](const FrameRecord& frame, const DepthFrame&) {
      EXPECT_EQ(frame.number, num_frames++);
      EXPECT_LE(frame.revision, revision);
      meanwhile();
    };
    observer.on_contact = [this, meanwhile](const ContactRecord& contact) {
      EXPECT_GT(contact.number, newest_contact);
      EXPECT_LT(contact.frame_number, num_frames) << "a contact before its frame";
      EXPECT_LE(contact.revision, revision);
      newest_contact = contact.number;
      ++num_contacts;
      meanwhile();
    };
    observer.on_ticks = [this, meanwhile](std::span<const TickRecord> ticks) {
      ASSERT_FALSE(ticks.empty());
      for (const TickRecord& tick : ticks) {
        EXPECT_EQ(tick.number, num_ticks++);
        EXPECT_LE(tick.revision, revision);
        if (loses_no_contact) {
          EXPECT_LE(tick.contact_number, newest_contact) << "a tick before its contact";
        }
      }
      meanwhile();
    };
    observer.on_settings = [this, meanwhile](std::uint32_t next, const RunSettings&) {
      EXPECT_EQ(next, ++revision);
      meanwhile();
    };
  }

  RunObserver observer;
  std::uint64_t num_frames = 0, num_contacts = 0, newest_contact = 0, num_ticks = 0;
  std::uint32_t revision = 0;
  bool loses_no_contact = true;
};

/// Random steps of all three, some of them while the observer is being told.
void run(Stages& stages, unsigned seed, bool loses_no_contact) {
  std::mt19937 random(seed);
  Publisher* reported_by = nullptr;
  int left = 3000;
  const auto step = [&] {
    if (left-- <= 0) return;
    switch (random() % 8) {
      case 0: stages.step_surface(); break;
      case 1:
      case 2: stages.step_contact(); break;
      case 3:
        if (random() % 20 == 0) stages.change(*reported_by);
        break;
      default: stages.step_haptic();
    }
  };
  Listener listener([&] {
    while (left > 0 && random() % 3 != 0) step();
  });
  listener.loses_no_contact = loses_no_contact;
  Publisher publisher(listener.observer, stages.records());
  reported_by = &publisher;
  while (left > 0) {
    for (unsigned i = random() % 40; i > 0; --i) step();
    publisher.publish();
  }
  stages.finish();
  publisher.publish();
  EXPECT_EQ(listener.num_frames, stages.num_frames());
  EXPECT_EQ(listener.num_contacts + stages.contacts.num_lost(), stages.num_contacts());
  EXPECT_EQ(listener.num_ticks, stages.num_ticks());
  EXPECT_GT(listener.num_ticks, 100u);
}

TEST(Publisher, TellsEachRecordOnceAfterThoseItRestsOn) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    Stages stages(2048);
    run(stages, seed, true);
    if (HasFailure()) FAIL() << "seed " << seed;
  }
}

TEST(Publisher, TellsTicksWhoseContactsWereLost) {
  std::uint64_t lost = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    Stages stages(2);
    run(stages, seed, false);
    lost += stages.contacts.num_lost();
    if (HasFailure()) FAIL() << "seed " << seed;
  }
  EXPECT_GT(lost, 100u);
}

TEST(Publisher, AContactWaitsForItsFrame) {
  Stages stages(16);
  Listener listener([] {});
  Publisher publisher(listener.observer, stages.records());
  stages.step_surface();  // felt, not written
  stages.step_contact();
  stages.step_contact();
  stages.step_haptic();
  publisher.publish();
  EXPECT_EQ(listener.num_contacts, 0u);
  EXPECT_EQ(listener.num_ticks, 0u);
  stages.step_surface();
  publisher.publish();
  EXPECT_EQ(listener.num_frames, 1u);
  EXPECT_EQ(listener.num_contacts, 1u);
  EXPECT_EQ(listener.num_ticks, 1u);
}

/// Settings that no observer receives are not kept for weeks.
TEST(Publisher, KeepsNoSettingsThatNobodyHears) {
  RunSettings settings;
  settings.regions = {std::make_shared<const MaterialRegions>()};
  RunObserver deaf, without_records;
  deaf.on_ticks = [](std::span<const TickRecord>) {};
  without_records.on_settings = [](std::uint32_t, const RunSettings&) {};
  for (const RunObserver& observer : {RunObserver{}, deaf, without_records}) {
    Stages stages(16);
    Publisher publisher(observer, stages.records());
    for (int i = 0; i < 10; ++i) publisher.add_settings(settings);
    publisher.publish();
    EXPECT_EQ(settings.regions[0].use_count(), 1);
  }
}

/// Contacts and frames of later ticks wait.
TEST(Publisher, TellsNoMoreThanTheTicksOfABatchRestOn) {
  constexpr std::uint64_t kNum = 400;
  Stages stages(1024);
  for (std::uint64_t i = 0; i < kNum; ++i) {
    for (int begun_and_written = 0; begun_and_written < 2; ++begun_and_written) {
      stages.step_surface();
      stages.step_contact();
      stages.step_haptic();
    }
  }
  stages.finish();
  stages.step_surface();  // felt by nobody
  stages.step_surface();
  std::uint64_t num_batches = 0;
  Listener listener([] {});
  listener.observer.on_ticks =
      [&, others = listener.observer.on_ticks](std::span<const TickRecord> ticks) {
        others(ticks);
        EXPECT_LE(listener.newest_contact, ticks.back().contact_number + 1);  // of the next batch
        EXPECT_LE(listener.num_frames, ticks.back().contact_number + 1);
        ++num_batches;
      };
  Publisher publisher(listener.observer, stages.records());
  publisher.publish();
  EXPECT_GT(num_batches, 1u);
  EXPECT_EQ(listener.num_contacts, kNum);
  EXPECT_EQ(listener.num_frames, kNum + 1);
}

}  // namespace
}  // namespace palpate
