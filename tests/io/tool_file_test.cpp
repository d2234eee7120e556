#include "palpate/io/files.h"

#include <xxhash.h>

#include <algorithm>
#include <cstring>

#include <gtest/gtest.h>

#include "tests/io/files.h"
#include "tests/tool/random_packing.h"

namespace palpate {
namespace {

using test::expect_error;
using test::read_bytes;
using test::TemporaryFolder;
using test::write_bytes;

Tool small_tool(int num_spheres) {
  TriangleMesh mesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                    {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
  SpherePacking packing{test::random_packing(num_spheres, 3), 1.0 / 6, PackStop::radius};
  return *Tool::build(mesh, packing, {.source = "a tool for tests"});
}

void expect_same(const Tool& a, const Tool& b) {
  ASSERT_EQ(a.mesh().vertices.size(), b.mesh().vertices.size());
  EXPECT_EQ(std::memcmp(a.mesh().vertices.data(), b.mesh().vertices.data(),
                        a.mesh().vertices.size() * sizeof(Vec3d)),
            0);
  EXPECT_EQ(a.mesh().triangles, b.mesh().triangles);
  ASSERT_EQ(a.spheres().size(), b.spheres().size());
  EXPECT_EQ(std::memcmp(a.spheres().data(), b.spheres().data(), a.spheres().size_bytes()), 0);
  EXPECT_EQ(a.packing().mesh_volume, b.packing().mesh_volume);
  EXPECT_EQ(a.packing().stop, b.packing().stop);
  EXPECT_EQ(a.graph().edges(), b.graph().edges());
  ASSERT_EQ(a.tree().nodes().size(), b.tree().nodes().size());
  EXPECT_EQ(
      std::memcmp(a.tree().nodes().data(), b.tree().nodes().data(), a.tree().nodes().size_bytes()),
      0);
  EXPECT_EQ(a.graph().num_bridges(), b.graph().num_bridges());
  EXPECT_EQ(a.graph().num_components_before_bridging(), b.graph().num_components_before_bridging());
  EXPECT_EQ(a.gap_rule(), b.gap_rule());
  EXPECT_TRUE(std::ranges::equal(a.represented_volumes(), b.represented_volumes()));
  ASSERT_EQ(a.represented_balls().size(), b.represented_balls().size());
  EXPECT_EQ(std::memcmp(a.represented_balls().data(), b.represented_balls().data(),
                        a.represented_balls().size_bytes()),
            0);
  EXPECT_EQ(a.sphere_mass().volume, b.sphere_mass().volume);
  EXPECT_EQ(a.source(), b.source());
}

/// A crafted file passes the checksum.
void seal(std::string& bytes) {
  const std::uint64_t checksum = XXH3_64bits(bytes.data(), bytes.size() - 8);
  std::memcpy(bytes.data() + bytes.size() - 8, &checksum, 8);
}

template <class T>
T peek(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

template <class T>
void poke(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
}

TEST(ToolFile, RoundTripsBitForBit) {
  const TemporaryFolder folder;
  for (const int count : {1, 2, 5, 1000}) {
    const Tool tool = small_tool(count);
    ASSERT_TRUE(save_tool(tool, folder / "tool.palp").has_value());
    const auto loaded = load_tool(folder / "tool.palp");
    ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
    expect_same(tool, *loaded);
    ASSERT_TRUE(save_tool(*loaded, folder / "again.palp").has_value());
    EXPECT_EQ(read_bytes(folder / "tool.palp"), read_bytes(folder / "again.palp"));
  }
}

TEST(ToolFile, EveryTruncationIsAnError) {
  const TemporaryFolder folder;
  ASSERT_TRUE(save_tool(small_tool(5), folder / "tool.palp").has_value());
  test::for_each_truncation(folder / "tool.palp", std::size_t(-1),
                            [](const std::filesystem::path& cut, std::size_t length) {
                              expect_error(load_tool(cut),
                                           length < 8 ? "is not a tool file" : "is truncated");
                            });
}

TEST(ToolFile, EveryFlippedByteIsAnError) {
  const TemporaryFolder folder;
  ASSERT_TRUE(save_tool(small_tool(5), folder / "tool.palp").has_value());
  const std::string good = read_bytes(folder / "tool.palp");
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const char mask : {'\x01', '\x80', '\xff'}) {
      std::string bytes = good;
      bytes[i] = static_cast<char>(bytes[i] ^ mask);
      write_bytes(folder / "bad.palp", bytes);
      ASSERT_FALSE(load_tool(folder / "bad.palp").has_value()) << "byte " << i;
    }
  }
}

TEST(ToolFile, SaysWhatIsWrong) {
  const TemporaryFolder folder;
  EXPECT_EQ(load_tool(folder / "absent.palp").error().code, Errc::not_found);
  EXPECT_FALSE(load_tool(folder.path()).has_value());
  write_bytes(folder / "empty.palp", "");
  expect_error(load_tool(folder / "empty.palp"), "is not a tool file");
  write_bytes(folder / "garbage.palp", std::string(5000, 'x'));
  expect_error(load_tool(folder / "garbage.palp"), "is not a tool file");

  ASSERT_TRUE(save_tool(small_tool(3), folder / "tool.palp").has_value());
  const std::string good = read_bytes(folder / "tool.palp");
  std::string newer = good;
  poke<std::uint32_t>(newer, 8, 5);
  write_bytes(folder / "newer.palp", newer);
  expect_error(load_tool(folder / "newer.palp"), "newer");
  std::string older = good;
  poke<std::uint32_t>(older, 8, 3);
  write_bytes(folder / "older.palp", older);
  expect_error(load_tool(folder / "older.palp"), "pack the mesh again");
  std::string flipped = good;
  flipped[good.size() / 2] ^= 1;
  write_bytes(folder / "flipped.palp", flipped);
  expect_error(load_tool(folder / "flipped.palp"), "checksum");
  write_bytes(folder / "longer.palp", good + "x");
  expect_error(load_tool(folder / "longer.palp"), "bytes follow");
}

TEST(ToolFile, CraftedFilesWithGoodChecksumsAreErrorsToo) {
  const TemporaryFolder folder;
  ASSERT_TRUE(save_tool(small_tool(5), folder / "tool.palp").has_value());
  const std::string good = read_bytes(folder / "tool.palp");
  const auto expect_bad = [&](std::string bytes, const std::string& words) {
    seal(bytes);
    write_bytes(folder / "bad.palp", bytes);
    expect_error(load_tool(folder / "bad.palp"), words);
  };
  constexpr std::size_t kTable = 24, kEntry = 24;
  for (std::size_t section = 0; section < 9; ++section) {
    const std::size_t entry = kTable + section * kEntry;
    for (const std::uint64_t huge : {~std::uint64_t(0), std::uint64_t(1) << 62,
                                     std::uint64_t(1) << 32, std::uint64_t(100000)}) {
      std::string bytes = good;
      poke(bytes, entry + 16, huge);  // number of elements
      expect_bad(bytes, "damaged");
      bytes = good;
      poke(bytes, entry + 8, huge);  // offset
      expect_bad(bytes, "damaged");
    }
    std::string bytes = good;
    poke<std::uint32_t>(bytes, entry, 99);  // a section of another name: ours is missing
    expect_bad(bytes, "missing");
    bytes = good;
    poke<std::uint32_t>(bytes, entry + 4, 7);  // element size
    expect_bad(bytes, "does not fit");
  }
  std::string bytes = good;
  poke<std::uint32_t>(bytes, 12, 0xffffffffu);  // number of sections
  expect_bad(bytes, "sections");

  const auto at = [&](std::size_t section) {
    return peek<std::uint64_t>(good, kTable + section * kEntry + 8);
  };
  const auto expect_value_refused = [&](std::size_t where, auto value, const std::string& words) {
    std::string changed = good;
    poke(changed, where, value);
    expect_bad(changed, words);
  };
  const double nan = std::nan("");
  expect_value_refused(at(0), nan, "vertex 0");
  expect_value_refused(at(1), std::uint32_t(4), "triangle 0");
  expect_value_refused(at(2) + 12, -1.0f, "sphere 0");
  expect_value_refused(at(2) + 16, std::nanf(""), "sphere 1");
  expect_value_refused(at(3), nan, "volume");
  expect_value_refused(at(3) + 8, std::uint32_t(6), "facts");
  expect_value_refused(at(3) + 12, std::uint32_t(0x80000000u), "facts");
  expect_value_refused(at(3) + 16, std::uint32_t(0), "facts");
  expect_value_refused(at(3) + 20, std::uint32_t(2), "facts");
  expect_value_refused(at(4), std::uint32_t(9), "edges");
  expect_value_refused(at(4) + 4, std::uint32_t(0), "edges");
  expect_value_refused(at(4) + 4, std::uint32_t(0x80000001u), "edges");
  expect_value_refused(at(6), std::nanf(""), "volumes");
  expect_value_refused(at(6) + 4, 1.0f, "volumes");
  expect_value_refused(at(7), std::nanf(""), "volumes");
  expect_value_refused(at(7) + 12, -1.0f, "volumes");
  // The tree: every number of every node. Balls may grow, and zeros change their sign.
  const std::size_t num_tree_bytes = 32 * peek<std::uint64_t>(good, kTable + 8 * kEntry + 16);
  for (std::size_t i = 0; i < num_tree_bytes; i += 4) {
    for (const std::uint32_t value : {0x80000000u, 0x7fc00000u, 0x7fffffffu, 0xfffffffeu}) {
      expect_value_refused(at(8) + i, value, "tree");
    }
  }
  bytes = good;
  poke<std::uint64_t>(bytes, kTable + 8 * kEntry + 16, 0);
  expect_bad(bytes, "tree");
  bytes = good;
  poke<std::uint64_t>(bytes, kTable + 4 * kEntry + 16, 1);  // only one edge left, and no bridges
  poke<std::uint32_t>(bytes, at(3) + 12, 0);
  poke<std::uint32_t>(bytes, at(3) + 16, 1);
  expect_bad(bytes, "parts");
}

TEST(ToolFile, KeepsADistanceField) {
  const TemporaryFolder folder;
  const Tool without = small_tool(20);
  const Tool tool = small_tool(20).with_solid_field();
  ASSERT_NE(tool.solid_field(), nullptr);
  ASSERT_TRUE(save_tool(tool, folder / "tool.palp").has_value());
  const auto loaded = load_tool(folder / "tool.palp");
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  expect_same(*loaded, tool);
  ASSERT_NE(loaded->solid_field(), nullptr);
  EXPECT_TRUE(*loaded->solid_field() == *tool.solid_field());
  // A file of the time before fields: what a tool without one is still written as.
  ASSERT_TRUE(save_tool(without, folder / "old.palp").has_value());
  const std::string old = read_bytes(folder / "old.palp");
  EXPECT_EQ(peek<std::uint32_t>(old, 12), 9u) << "sections";
  EXPECT_EQ(load_tool(folder / "old.palp")->solid_field(), nullptr);
}

TEST(ToolFile, DamagedDistanceFieldsAreErrors) {
  const TemporaryFolder folder;
  ASSERT_TRUE(save_tool(small_tool(5).with_solid_field(), folder / "tool.palp").has_value());
  const std::string good = read_bytes(folder / "tool.palp");
  constexpr std::size_t kTable = 24, kEntry = 24, kGrid = kTable + 9 * kEntry,
                        kValues = kGrid + kEntry;
  const auto expect_bad = [&](std::size_t where, auto value, const std::string& words) {
    std::string bytes = good;
    poke(bytes, where, value);
    seal(bytes);
    write_bytes(folder / "bad.palp", bytes);
    expect_error(load_tool(folder / "bad.palp"), words);
  };
  expect_bad(kGrid, std::uint32_t(99), "distance field");  // one of both is missing
  expect_bad(kValues, std::uint32_t(99), "distance field");
  expect_bad(kValues, std::uint32_t(9), "distance field");  // twice
  expect_bad(kGrid + 16, std::uint64_t(0), "distance field");
  expect_bad(kGrid + 16, ~std::uint64_t(0), "distance field");
  expect_bad(kValues + 16, std::uint64_t(1) << 62, "distance field");
  expect_bad(kValues + 16, std::uint64_t(1000), "not of its grid");
  expect_bad(kValues + 4, std::uint32_t(8), "distance field");
  const auto grid = peek<std::uint64_t>(good, kGrid + 8);
  const auto values = peek<std::uint64_t>(good, kValues + 8);
  expect_bad(grid, std::nan(""), "no grid");
  expect_bad(grid + 24, -1.0, "no grid");
  expect_bad(grid + 24, 0.0, "no grid");
  expect_bad(grid + 32, std::int32_t(0), "no grid");
  expect_bad(grid + 36, std::int32_t(1) << 30, "no grid");
  expect_bad(grid + 40, std::int32_t(3), "not of its grid");
  expect_bad(values, std::nanf(""), "not a distance");
  expect_bad(values + 400, 1e30f, "not a distance");
}

TEST(ToolFile, SavingLeavesNoHalfFile) {
  const TemporaryFolder folder;
  EXPECT_FALSE(save_tool(small_tool(2), folder / "no/such/folder.palp").has_value());
  ASSERT_TRUE(save_tool(small_tool(2), folder / "tool.palp").has_value());
  const auto entries = std::filesystem::directory_iterator(folder.path());
  EXPECT_EQ(std::distance(begin(entries), end(entries)), 1);
}

}  // namespace
}  // namespace palpate
