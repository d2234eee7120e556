// MCAP files: what is written is read, also from files that were cut off or damaged, and by the
// format's own Python library where that is installed.
#include "src/io/internal/mcap_file.h"

#include <sys/stat.h>
#include <zstd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "src/io/internal/bag_file.h"
#include "tests/io/made_mcap.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

struct Sent {
  std::uint16_t channel;
  std::uint64_t time;
  std::string data;
};

/// Returns random text, which compresses badly.
std::string noise(std::size_t size, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::string text;
  for (std::size_t i = 0; i < size; ++i) text += static_cast<char>('!' + random() % 90);
  return text;
}

/// A message of one string, as CDR has it.
std::string cdr_text(const std::string& text) {
  std::string bytes("\0\1\0\0", 4);
  for (int i = 0; i < 4; ++i) bytes += static_cast<char>((text.size() + 1) >> (8 * i) & 255);
  return bytes + text + '\0';
}

/// A frame of Zstandard that does not say how much is in it, as those who write a stream make them.
std::string streamed(std::string_view bytes) {
  const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(ZSTD_createCCtx(),
                                                                        ZSTD_freeCCtx);
  std::string packed(ZSTD_compressBound(bytes.size()) + 100, '\0');
  ZSTD_outBuffer to{packed.data(), packed.size(), 0};
  for (const bool is_end : {false, true}) {
    const std::size_t half = bytes.size() / 2;
    const std::string_view part = is_end ? bytes.substr(half) : bytes.substr(0, half);
    ZSTD_inBuffer from{part.data(), part.size(), 0};
    EXPECT_EQ(ZSTD_isError(ZSTD_compressStream2(context.get(), &to, &from,
                                                is_end ? ZSTD_e_end : ZSTD_e_flush)),
              0u);
  }
  EXPECT_EQ(ZSTD_getFrameContentSize(packed.data(), to.pos), ZSTD_CONTENTSIZE_UNKNOWN);
  return packed.substr(0, to.pos);
}

class McapFile : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    path_ = fs::temp_directory_path() / (std::string("palpate_") + test->name() + ".mcap");
  }
  void TearDown() override { fs::remove(path_); }

  // Two channels, many small messages and some large ones, small chunks.
  std::vector<Sent> write_some(bool finish = true) {
    auto writer = std::move(McapWriter::create(path_, {.chunk_bytes = 2000})).value();
    EXPECT_TRUE(writer.attach("tool", "text/plain", "some bytes"));
    const auto a = writer.add_channel({"/a", "palpate.A", "string text\n"});
    const auto b = writer.add_channel({"/b", "palpate.B", "string text\n"});
    std::vector<Sent> sent;
    for (std::uint64_t i = 0; i < 300; ++i) {
      const bool is_large = i % 50 == 7;
      sent.push_back({i % 3 == 0 ? b : a, 1000 * i,
                      cdr_text(std::to_string(i) + " " + noise(is_large ? 5000 : i % 40, i))});
      EXPECT_TRUE(writer.write(sent.back().channel, sent.back().time, sent.back().data));
    }
    if (finish) {
      EXPECT_TRUE(writer.finish());
    } else {
      EXPECT_TRUE(writer.flush());
      std::ifstream file(path_, std::ios::binary);
      unfinished_.assign(std::istreambuf_iterator<char>(file), {});
    }
    return sent;
  }

  std::string bytes() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void replace(const std::string& with) const {
    std::ofstream(path_, std::ios::binary | std::ios::trunc) << with;
  }

  fs::path path_;
  std::string unfinished_;
};

// Messages until the end or an error.
struct Got {
  std::vector<Sent> messages;
  bool failed = false, was_cut_off = false;
  std::string error;
};
Got read_all(const fs::path& path) {
  Got got;
  auto reader = McapReader::open(path);
  if (!reader) return {{}, true, false, reader.error().message};
  for (;;) {
    const auto message = reader->next();
    if (!message) {
      got.failed = true;
      got.error = message.error().message;
      break;
    }
    if (!*message) break;
    got.messages.push_back({(*message)->channel, (*message)->time, std::string((*message)->data)});
  }
  got.was_cut_off = reader->was_cut_off();
  return got;
}

void expect_begins_with(const std::vector<Sent>& sent, const std::vector<Sent>& got) {
  ASSERT_LE(got.size(), sent.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].channel, sent[i].channel);
    EXPECT_EQ(got[i].time, sent[i].time);
    EXPECT_EQ(got[i].data, sent[i].data);
  }
}

TEST_F(McapFile, ReadsWhatWasWritten) {
  const std::vector<Sent> sent = write_some();
  const Got got = read_all(path_);
  EXPECT_FALSE(got.failed) << got.error;
  EXPECT_FALSE(got.was_cut_off);
  EXPECT_EQ(got.messages.size(), sent.size());
  expect_begins_with(sent, got.messages);
  auto reader = std::move(McapReader::open(path_)).value();
  (void)reader.next();
  EXPECT_EQ(reader.channels().at(1).topic, "/a");
  EXPECT_EQ(reader.channels().at(2).schema_name, "palpate.B");
}

TEST_F(McapFile, AFileThatWasNeverFinishedLosesNothingThatWasFlushed) {
  const std::vector<Sent> sent = write_some(false);
  replace(unfinished_);
  const Got got = read_all(path_);
  EXPECT_FALSE(got.failed) << got.error;
  EXPECT_TRUE(got.was_cut_off);
  EXPECT_EQ(got.messages.size(), sent.size());
}

TEST_F(McapFile, WhatIsHalfASecondOldIsWritten) {
  auto writer = std::move(McapWriter::create(path_)).value();
  const auto channel = writer.add_channel({"/a", "palpate.A", "string text\n"});
  ASSERT_TRUE(writer.write(channel, 1, cdr_text("old")));
  EXPECT_TRUE(read_all(path_).messages.empty());  // it would be lost by now
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  ASSERT_TRUE(writer.write(channel, 2, cdr_text("new")));
  EXPECT_EQ(read_all(path_).messages.size(), 2u);
}

TEST_F(McapFile, AFileThatWasCutOffAnywhereIsReadUpToItsLastWholeChunk) {
  const std::vector<Sent> sent = write_some();
  const std::string whole = bytes();
  std::size_t most = 0;
  for (std::size_t size = 0; size < whole.size(); size += 97) {
    replace(whole.substr(0, size));
    const Got got = read_all(path_);
    EXPECT_EQ(got.failed, size < 8) << got.error;
    expect_begins_with(sent, got.messages);
    EXPECT_GE(got.messages.size(), most);
    most = std::max(most, got.messages.size());
  }
  EXPECT_EQ(most, sent.size());
}

TEST_F(McapFile, DamageIsFoundAndSaid) {
  const std::vector<Sent> sent = write_some();
  const std::string whole = bytes();
  int num_found = 0;
  for (std::size_t at = 40; at < whole.size(); at += 211) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x55);
    replace(damaged);
    const Got got = read_all(path_);  // does not crash, hang or invent messages
    if (got.failed) {
      ++num_found;
      EXPECT_NE(got.error.find("damaged at byte"), std::string::npos) << got.error;
    }
    if (!got.failed && !got.was_cut_off) continue;
    expect_begins_with(sent, got.messages);
  }
  EXPECT_GT(num_found, 20);
}

TEST_F(McapFile, ChunksOfZstandardAreReadWhateverTheirFramesSayOfTheirSize) {
  const std::string message = noise(200'000, 3) + std::string(9'000'000, 'x') + noise(50, 4);
  const std::string records =
      test::mcap_channel(1, "/a", "palpate.A") + test::mcap_message(1, 5, message);
  const std::string_view all = records;
  const std::string skipped("\x50\x2a\x4d\x18\3\0\0\0pad", 11);
  for (const std::string& packed :
       {streamed(all), streamed(all.substr(0, 1000)) + streamed(all.substr(1000)),
        streamed(all) + skipped,
        skipped + streamed(all.substr(0, 7)) + skipped + streamed("") + streamed(all.substr(7))}) {
    replace(test::mcap_file(test::mcap_chunk(packed, all.size(), "zstd")));
    const Got got = read_all(path_);
    EXPECT_FALSE(got.failed) << got.error;
    ASSERT_EQ(got.messages.size(), 1u);
    EXPECT_EQ(got.messages[0].data, message);
  }
  for (const std::uint64_t size : {all.size() - 1, all.size() + 1, std::size_t{1} << 29}) {
    replace(test::mcap_file(test::mcap_chunk(streamed(all), size, "zstd")));
    EXPECT_TRUE(read_all(path_).failed) << size;
  }
  replace(test::mcap_file(test::mcap_chunk(streamed(all).substr(0, 100'000), all.size(), "zstd")));
  EXPECT_TRUE(read_all(path_).failed);
}

TEST_F(McapFile, AMessageOfAChannelThatNobodyToldIsDamage) {
  write_some();
  auto all = std::move(McapReader::open(path_)).value();
  std::uint64_t last = 0;
  for (auto message = all.next(); *message; message = all.next()) last = all.chunk_place();
  auto late = std::move(McapReader::open(path_)).value();
  late.seek(last);
  const auto message = late.next();
  ASSERT_FALSE(message);
  EXPECT_NE(message.error().message.find("channel"), std::string::npos) << message.error().message;
  EXPECT_FALSE(*late.next());
}

TEST_F(McapFile, SaysWhatCannotBeOpened) {
  EXPECT_FALSE(McapReader::open("/nowhere/x.mcap"));
  replace("no such thing");
  const auto reader = McapReader::open(path_);
  ASSERT_FALSE(reader);
  EXPECT_NE(reader.error().message.find("is not an MCAP file"), std::string::npos);
  EXPECT_FALSE(McapWriter::create("/nowhere/x.mcap"));
}

/// To open a pipe that nobody writes into would wait for ever.
TEST_F(McapFile, APipeIsRefusedAndNotWaitedFor) {
  ASSERT_EQ(mkfifo(path_.c_str(), 0600), 0);
  for (const auto& error : {McapReader::open(path_).error(), BagReader::open(path_).error()}) {
    EXPECT_EQ(error.message,
              "cannot read " + path_.string() + ": it is not a regular file; give a file");
  }
}

TEST_F(McapFile, AFullDiskIsAnErrorAndWhatWasWrittenStays) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "SKIPPED: this system has no /dev/full";
  const auto writer = McapWriter::create("/dev/full");
  ASSERT_FALSE(writer);
  EXPECT_EQ(writer.error().code, Errc::io_failure);
}

TEST_F(McapFile, TheFormatsOwnLibraryReadsIt) {
  // scripts/setup.sh --test keeps the packages of tests in a folder of their own.
  const char* const kept = PALPATE_SOURCE_DIR "/build/python/bin/python";
  const std::string python = fs::exists(kept) ? kept : "python3";
  if (std::system((python + " -c 'import mcap' 2>/dev/null").c_str()) != 0) {
    GTEST_SKIP() << "SKIPPED: the Python package mcap is not installed";
  }
  write_some();
  const std::string script =
      python +
      " -c \"\n"
      "from mcap.reader import make_reader\n"
      "with open('" +
      path_.string() +
      "','rb') as f:\n"
      "  r=make_reader(f, validate_crcs=True)\n"
      "  assert r.get_header().profile=='ros2'\n"
      "  s=r.get_summary()\n"
      "  assert s.statistics.message_count==300, s.statistics\n"
      "  assert s.statistics.attachment_count==1, s.statistics\n"
      "  m=[(c.topic,c.message_encoding,x.encoding,m.log_time,m.data) for x,c,m in "
      "r.iter_messages()]\n"
      "  assert len(m)==300 and m[5][3]==5000 and m[5][4][8:10]==b'5 ', m[5]\n"
      "  assert {t[:3] for t in m}=={('/a','cdr','ros2msg'),('/b','cdr','ros2msg')}\n"
      "  a=next(r.iter_attachments())\n"
      "  assert a.name=='tool' and a.data==b'some bytes'\n"
      "\"";
  EXPECT_EQ(std::system(script.c_str()), 0);
}

TEST_F(McapFile, HoldsWholeFiles) {
  write_some();
  auto reader = std::move(McapReader::open(path_)).value();
  const auto file = reader.attachment("tool");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(*file, "some bytes");
  const auto absent = reader.attachment("stool");
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error().code, Errc::not_found);
  // Messages are where they were.
  EXPECT_EQ(read_all(path_).messages.size(), 300u);
  std::string damaged = bytes();
  damaged[damaged.find("some bytes")] = 'S';
  replace(damaged);
  auto again = std::move(McapReader::open(path_)).value();
  EXPECT_NE(again.attachment("tool").error().message.find("damaged"), std::string::npos);
}

}  // namespace
}  // namespace palpate
