// Frames of WebSockets, and the digest of their opening.

#include "src/devices/transport/web_socket.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "src/devices/transport/web_socket_frames.h"
#include "src/io/internal/base64.h"
#include "src/io/internal/hashes.h"
#include "tests/devices/mutation.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using Got = WebSocketReader::Got;

std::string hex(std::string_view text) {
  std::string out;
  for (const std::uint8_t byte : sha1(text)) {
    out += "0123456789abcdef"[byte >> 4];
    out += "0123456789abcdef"[byte & 15];
  }
  return out;
}

TEST(Sha1, AsPublished) {
  EXPECT_EQ(hex(""), "da39a3ee5e6b4b0d3255bfef95601890afd80709");
  EXPECT_EQ(hex("abc"), "a9993e364706816aba3e25717850c26c9cd0d89d");
  EXPECT_EQ(hex("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "84983e441c3bd26ebaae4aa1f95129e5e54670f1");
  EXPECT_EQ(hex(std::string(1000000, 'a')), "34aa973cd4c4daa4f61eeb2bdbad27316534016f");
  // RFC 6455, section 1.3.
  EXPECT_EQ(base64(sha1("dGhlIHNhbXBsZSBub25jZQ==258EAFA5-E914-47DA-95CA-C5AB0DC85B11")),
            "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
}

/// An unmasked frame, as servers send them.
std::string frame(int first_byte, const std::string& payload) {
  std::string text(1, static_cast<char>(first_byte));
  if (payload.size() < 126) {
    text += static_cast<char>(payload.size());
  } else {
    text += static_cast<char>(126);
    text += static_cast<char>(payload.size() >> 8);
    text += static_cast<char>(payload.size());
  }
  return text + payload;
}

void feed(WebSocketReader& reader, std::string_view bytes) {
  const std::span<char> space = reader.space();
  ASSERT_GE(space.size(), bytes.size());
  std::copy(bytes.begin(), bytes.end(), space.begin());
  reader.added(bytes.size());
}

TEST(WebSocketFrames, OursAreMasked) {
  for (const std::size_t size : {0u, 5u, 125u, 126u, 65535u, 65536u}) {
    const std::string payload(size, 'p');
    std::string out;
    write_web_socket_frame(WebSocketOpcode::text, payload, 0x37fa213d, out);
    const std::size_t head = size < 126 ? 6 : (size < 65536 ? 8 : 14);
    ASSERT_EQ(out.size(), head + size);
    EXPECT_EQ(out[0], '\x81');
    EXPECT_NE(out[1] & 0x80, 0);
    for (std::size_t i = 0; i < size; ++i) ASSERT_EQ(out[head + i] ^ out[head - 4 + i % 4], 'p');
  }
  // RFC 6455, section 5.7.
  std::string hello;
  write_web_socket_frame(WebSocketOpcode::text, "Hello", 0x37fa213d, hello);
  EXPECT_EQ(hello, "\x81\x85\x37\xfa\x21\x3d\x7f\x9f\x4d\x51\x58");
}

TEST(WebSocketFrames, MessagesWholeAndInPieces) {
  const std::string stream = frame(0x81, "one") + frame(0x01, "tw") + frame(0x89, "ping") +
                             frame(0x80, "o") + frame(0x8a, "") +
                             frame(0x82, std::string(300, 'x')) + frame(0x88, "\x03\xe8");
  for (std::size_t step = 1; step < stream.size(); ++step) {
    WebSocketReader reader;
    std::string seen;
    for (std::size_t at = 0; at < stream.size(); at += step) {
      feed(reader, std::string_view(stream).substr(at, step));
      std::string_view payload;
      for (Got got; (got = reader.next(payload)) != Got::nothing;) {
        ASSERT_NE(got, Got::broken);
        seen += got == Got::message ? "m:" : (got == Got::ping ? "p:" : "c:");
        seen += payload;
      }
    }
    ASSERT_EQ(seen, "m:onep:pingm:twom:" + std::string(300, 'x') + "c:\x03\xe8") << step;
  }
}

TEST(WebSocketFrames, WhatServersMayNotDoBreaksTheStream) {
  const std::string huge = std::string("\x81\x7f\xff\xff\xff\xff\xff\xff\xff\xff", 10);
  for (const std::string& bad :
       {std::string("\x81\x80\0\0\0\0", 6), frame(0xc1, "a"), frame(0x83, "a"), frame(0x80, "a"),
        frame(0x01, "a") + frame(0x81, "b"), frame(0x09, "a"), frame(0x89, std::string(126, 'a')),
        huge}) {
    WebSocketReader reader;
    feed(reader, bad);
    std::string_view payload;
    Got got = Got::nothing;
    while ((got = reader.next(payload)) != Got::broken) ASSERT_NE(got, Got::nothing);
    feed(reader, frame(0x81, "fine"));
    EXPECT_EQ(reader.next(payload), Got::broken) << "it stays broken";
  }
}

TEST(WebSocketFrames, PiecesWithoutEndAreRefused) {
  WebSocketReader reader;
  const std::string piece = frame(0x00, std::string(60000, 'x'));
  feed(reader, frame(0x01, ""));
  std::string_view payload;
  Got got = Got::nothing;
  for (int i = 0; i < 10 && got == Got::nothing; ++i) {
    feed(reader, piece);
    got = reader.next(payload);
  }
  EXPECT_EQ(got, Got::broken);
}

TEST(WebSocketFrames, MutatedStreamsHurtNobody) {
  const std::string stream = frame(0x81, "{\"a\":1}") + frame(0x01, std::string(200, 'x')) +
                             frame(0x89, "") + frame(0x80, "end") + frame(0x81, "again");
  test::Random random(2);
  WebSocketReader fresh;
  const test::AllocationCounter counter;
  std::size_t num_messages = 0;
  for (int i = 0; i < 100000; ++i) {
    const std::string bytes = test::mutated(stream, random);
    // A reader of its own for some only: its buffers are large.
    if (i % 100 == 0) fresh = WebSocketReader();
    std::span<char> space = fresh.space();
    if (space.size() < bytes.size()) {
      fresh = WebSocketReader();
      space = fresh.space();
    }
    std::copy(bytes.begin(), bytes.end(), space.begin());
    fresh.added(bytes.size());
    std::string_view payload;
    for (;;) {
      const Got got = fresh.next(payload);
      if (got == Got::nothing) break;
      if (got == Got::broken) {
        fresh = WebSocketReader();
        break;
      }
      num_messages += got == Got::message;
      ASSERT_LE(payload.size(), WebSocketReader::kMaxMessage);
      ASSERT_EQ(std::count(payload.begin(), payload.end(), 'x') > 0,
                payload.find('x') != payload.npos);
    }
  }
  EXPECT_GT(num_messages, 10000u);
}

TEST(NetAddress, Words) {
  const auto text = [](std::string_view words) {
    const auto address = parse_net_address(words, 80);
    return address ? describe(*address) : "none";
  };
  EXPECT_EQ(text("localhost"), "localhost:80");
  EXPECT_EQ(text("10.0.0.1:3883"), "10.0.0.1:3883");
  EXPECT_EQ(text("[::1]:99"), "[::1]:99");
  EXPECT_EQ(text("[::1]"), "[::1]:80");
  for (const char* bad :
       {"", ":1", "a:", "a:b", "a:0", "a:65536", "a:1x", "[::1", "[::1]x", "a:1:2"})
    EXPECT_EQ(text(bad), "none") << bad;
}

}  // namespace
}  // namespace palpate
