// Recordings: MCAP files, and the messages in them. The first byte says what the rest is.
#include "src/io/internal/bag_file.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_messages.h"
#include "src/session/internal/run_reader.h"
#include "tests/fuzz/target.h"
#include "tests/io/made_mcap.h"
#include "tests/io/ros1_bag_writer.h"

namespace palpate::fuzz {
namespace {

constexpr char kFile = 'f', kSettings = 's', kFrame = 'r', kContact = 'c', kTick = 't', kNote = 'n',
               kImage = 'i', kBag = 'b', kPart = 'p', kFlow = 'o';

void read_file(std::string_view bytes) {
  static ScratchFile file(".mcap");
  file.write(bytes);
  if (auto reader = McapReader::open(file.path())) {
    (void)reader->attachment(kToolFile);
    std::uint64_t place = 0;
    for (;;) {
      const auto message = reader->next();
      if (!message || !*message) break;
      require(reader->channels().contains((*message)->channel), "a message has a channel");
      place = reader->chunk_place();
    }
    reader->seek(place);
    (void)reader->next();
  }
  auto run = RunReader::open(file.path());
  if (!run) return;
  (void)run->load_tools();
  RecordedDepth frame;
  for (int i = 0; i < 1000; ++i) {
    const auto got = run->next_frame(frame);
    if (!got || !*got) return;
  }
}

/// Bags of other programs, whatever their format.
void read_bag(std::string_view bytes) {
  static ScratchFile file(".bag");
  file.write(bytes);
  const auto bag = BagReader::open(file.path());
  if (!bag) return;
  for (;;) {
    const auto message = (*bag)->next();
    if (!message || !*message) break;
    require((*bag)->channels().contains((*message)->channel), "a message has a channel");
    (void)read_depth_image((*message)->data, 0.001);
  }
}

/// Requires that a message that was read is written, and read again, with the same bytes.
template <class Read, class Write>
void round_trip(std::string_view message, const Read& read, const Write& write) {
  const auto first = read(message);
  if (!first) return;
  const std::string written = write(*first);
  const auto again = read(written);
  require(again.has_value(), "a message that was written can be read");
  require(write(*again) == written, "a message comes back with the same bytes");
}

DepthFrame small_frame() { return {4, 3, 0.001, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}, 1.5}; }

RunSetup one_camera() {
  RunSetup setup;
  setup.streams.resize(1);
  return setup;
}

ContactRecord seen_by_two() {
  ContactRecord contact;
  contact.cameras.num = 2;
  return contact;
}

DepthFrame small_flow() {
  DepthFrame frame = small_frame();
  frame.flow.assign(2 * frame.pixels.size(), 0.5f);
  return frame;
}

std::string small_file() {
  ScratchFile file(".seed.mcap");
  auto writer = McapWriter::create(file.path());
  (void)writer->attach("notes.txt", "text/plain", "hello");
  const std::uint16_t settings = writer->add_channel(settings_channel());
  const std::uint16_t tick = writer->add_channel(tick_channel());
  (void)writer->write(settings, 1, settings_message(one_camera()));
  for (std::uint64_t i = 0; i < 3; ++i) {
    TickRecord record;
    record.number = i;
    (void)writer->write(tick, 2 + i, tick_message(record));
  }
  (void)writer->finish();
  return file.read();
}

/// In a frame of Zstandard, as rosbag2 compresses messages one by one.
std::string packed_message() {
  return {"\x28\xb5\x2f\xfd\x20\x0d\x69\0\0\0\1\0\0\5\0\0\0four\0", 22};
}

}  // namespace

std::vector<std::string> seeds() {
  const std::string image =
      test::ros1_image(test::ros1_stamp(1, 2, "camera"), 2, 1, std::string_view("\1\2\3\4"));
  const std::string bag =
      test::ros1_bag({test::ros1_chunk(test::ros1_connection(1, "/depth", "sensor_msgs/Image") +
                                       test::ros1_message(1, 1, 2, image))});
  return {kFile + small_file(),
          kBag + bag,
          kBag + test::mcap_file(test::mcap_channel(1, "/depth", "sensor_msgs/Image", "ros1") +
                                 test::mcap_message(1, 5, image) +
                                 test::mcap_channel(2, "/text", "std_msgs/String") +
                                 test::mcap_message(2, 6, packed_message())),
          kSettings + settings_message(one_camera()),
          kFrame + frame_message(FrameRecord{}),
          kContact + contact_message(seen_by_two()),
          kTick + tick_message({}),
          kNote + note_message("a note"),
          kPart + part_message({2, 1000}),
          kFlow + flow_message({12, "camera"}, small_flow()),
          kImage + image_message({12, "camera"}, small_frame())};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  if (size == 0) return 0;
  const std::string_view message = text_of(data + 1, size - 1);
  switch (data[0]) {
    case kFile: fuzz::read_file(message); break;
    case kBag: fuzz::read_bag(message); break;
    case kSettings: round_trip(message, read_settings, settings_message); break;
    case kFrame: round_trip(message, read_frame, frame_message); break;
    case kContact: round_trip(message, read_contact, contact_message); break;
    case kTick: round_trip(message, read_tick, tick_message); break;
    case kNote: round_trip(message, read_note, note_message); break;
    case kPart: round_trip(message, read_part, part_message); break;
    case kFlow: (void)read_flow_image(message); break;
    case kImage: (void)read_depth_image(message, 0.001); break;
    default: break;
  }
  return 0;
}
