#include <lzf.h>
#include <array>

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "palpate/io/formats.h"
#include "tests/io/files.h"
#include "tests/test_util/data.h"

namespace palpate {
namespace {

using test::bytes_of;
using test::expect_error;
using test::TemporaryFolder;
using test::write_bytes;

const float kNan = std::numeric_limits<float>::quiet_NaN();

/// A little organized cloud; point 4 is invalid.
PointCloud sample(int width = 3, int height = 2) {
  PointCloud cloud(width, height);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float s = static_cast<float>(i);
    if (i != 4) cloud.set(i, {0.1f * s, -0.2f * s, 1 + s / 3}, {0, s, -1});
  }
  return cloud;
}

void expect_same(const PointCloud& a, const PointCloud& b) {
  ASSERT_EQ(a.width(), b.width());
  ASSERT_EQ(a.height(), b.height());
  for (int channel = 0; channel < 6; ++channel) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      const float p = a.channel(channel)[i], q = b.channel(channel)[i];
      if (std::isnan(p)) {
        EXPECT_TRUE(std::isnan(q));
      } else {
        EXPECT_NEAR(p, q, 1e-6) << "channel " << channel << " point " << i;
      }
    }
  }
}

const std::string kPlyNames =
    "property float x\nproperty float y\nproperty float z\n"
    "property float nx\nproperty float ny\nproperty float nz\n";

std::string ply(const std::string& format, const std::string& elements, const std::string& body) {
  return "ply\nformat " + format + " 1.0\ncomment by a test\n" + elements + "end_header\n" + body;
}

std::string pcd(const std::string& type, int size, const std::string& encoding, int width,
                int height, const std::string& body) {
  std::string head =
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
      "FIELDS x y z rgb normal_x normal_y normal_z\nSIZE";
  for (int k = 0; k < 7; ++k) head.append(" ").append(std::to_string(k == 3 ? 4 : size));
  head += "\nTYPE";
  for (int k = 0; k < 7; ++k) head.append(" ").append(k == 3 ? "U" : type);
  return head + "\nCOUNT 1 1 1 1 1 1 1\nWIDTH " + std::to_string(width) + "\nHEIGHT " +
         std::to_string(height) + "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " +
         std::to_string(width * height) + "\nDATA " + encoding + "\n" + body;
}

/// The body of a PCD file of the sample: rows, or field after field.
template <class Real>
std::string pcd_body(const PointCloud& cloud, bool by_field) {
  std::string body;
  const auto add = [&](std::size_t i, int field) {
    if (field == 3) {
      body += bytes_of(std::uint32_t(0xffffff));
    } else {
      body += bytes_of(Real(cloud.channel(field < 3 ? field : field - 1)[i]));
    }
  };
  if (by_field) {
    for (int field = 0; field < 7; ++field) {
      for (std::size_t i = 0; i < cloud.size(); ++i) add(i, field);
    }
  } else {
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      for (int field = 0; field < 7; ++field) add(i, field);
    }
  }
  return body;
}

std::string packed(const std::string& body) {
  std::string result(body.size() * 2 + 64, '\0');
  const auto size =
      lzf_compress(body.data(), unsigned(body.size()), result.data(), unsigned(result.size()));
  return bytes_of(std::uint32_t(size), std::uint32_t(body.size())) + result.substr(0, size);
}

TEST(CloudPly, RoundTripsAllValidPoints) {
  const TemporaryFolder folder;
  const PointCloud cloud = sample();
  ASSERT_TRUE(save_cloud_ply(cloud.view(), folder / "cloud.ply").has_value());
  const auto loaded = load_cloud(folder / "cloud.ply");
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  EXPECT_EQ(loaded->cloud.width(), 5);
  EXPECT_EQ(loaded->cloud.height(), 1);
  EXPECT_EQ(loaded->cloud.point(3), cloud.point(3));
  EXPECT_EQ(loaded->cloud.point(4), cloud.point(5));
  EXPECT_NEAR(norm(loaded->cloud.normal(4) - cloud.normal(5)), 0, 1e-6);
  EXPECT_FALSE(loaded->cloud.view().pinhole);
}

TEST(CloudFiles, MayBeginWithAByteOrderMark) {
  const TemporaryFolder folder;
  const std::string mark = "\xef\xbb\xbf", rows = "0 0 1 7 0 0 -1\n.1 0 1 7 0 0 -1\n";
  write_bytes(folder / "c.ply",
              mark + ply("ascii", "element vertex 1\n" + kPlyNames, "1 2 3 0 0 -1\n"));
  write_bytes(folder / "c.pcd", mark + pcd("F", 4, "ascii", 1, 2, rows));
  for (const char* name : {"c.ply", "c.pcd"}) {
    const auto cloud = load_cloud(folder / name);
    ASSERT_TRUE(cloud.has_value()) << cloud.error().message;
    EXPECT_FALSE(std::isnan(cloud->cloud.channel(0)[0])) << name;
  }
  const auto frame = load_depth_pcd(folder / "c.pcd");
  ASSERT_TRUE(frame.has_value()) << frame.error().message;
  EXPECT_EQ(frame->pixels[1], 1000);
}

TEST(CloudPly, ReadsTextAndBothByteOrdersAndOtherElements) {
  const TemporaryFolder folder;
  const std::string text_elements =
      "element patch 2\nproperty list uchar int ids\nelement vertex 2\nproperty uchar red\n" +
      kPlyNames + "element face 1\nproperty list uchar int vertex_indices\n";
  write_bytes(folder / "text.ply", ply("ascii", text_elements,
                                       "2 8 9\n0\n255 1 2 3 0 0 -2\n255 nan 5 6 1 0 0\n3 0 1 0\n"));
  const auto text = load_cloud(folder / "text.ply");
  ASSERT_TRUE(text.has_value()) << text.error().message;
  EXPECT_EQ(text->cloud.size(), 2u);
  EXPECT_EQ(text->cloud.point(0), (Vec3f{1, 2, 3}));
  EXPECT_EQ(text->cloud.normal(0), (Vec3f{0, 0, -1}));
  EXPECT_TRUE(std::isnan(text->cloud.point(1).y));

  std::string doubles = kPlyNames;
  for (auto at = doubles.find("float"); at != std::string::npos; at = doubles.find("float"))
    doubles.replace(at, 5, "double");
  write_bytes(folder / "little.ply", ply("binary_little_endian", "element vertex 1\n" + doubles,
                                         bytes_of(1.0, 2.0, 3.0, 0.0, -1.0, 0.0)));
  std::string big = bytes_of(1.0, 2.0, 3.0, 0.0, -1.0, 0.0);
  for (std::size_t i = 0; i < big.size(); i += 8)
    std::reverse(big.begin() + std::ptrdiff_t(i), big.begin() + std::ptrdiff_t(i) + 8);
  write_bytes(folder / "big.ply", ply("binary_big_endian", "element vertex 1\n" + doubles, big));
  for (const char* name : {"little.ply", "big.ply"}) {
    const auto loaded = load_cloud(folder / name);
    ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
    EXPECT_EQ(loaded->cloud.point(0), (Vec3f{1, 2, 3}));
    EXPECT_EQ(loaded->cloud.normal(0), (Vec3f{0, -1, 0}));
  }
}

// A camera sees no surface from behind.
TEST(CloudFiles, NormalsAreTurnedToWhereTheEyeStood) {
  const TemporaryFolder folder;
  const auto expect_turned = [&](const std::string& name, const std::string& bytes,
                                 const std::array<float, 4>& z_of_normals,
                                 const std::string& words) {
    write_bytes(folder / name, bytes);
    const auto loaded = load_cloud(folder / name);
    ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_EQ(loaded->cloud.point(i), (Vec3f{0, 0, float(i + 1)})) << "no point is moved";
      EXPECT_EQ(loaded->cloud.normal(i).z, z_of_normals[i]) << i;
    }
    EXPECT_EQ(loaded->note.empty(), words.empty()) << loaded->note;
    EXPECT_NE(loaded->note.find(words), std::string::npos) << loaded->note;
  };
  const std::string rows = "0 0 1 0 0 -1\n0 0 2 0 0 1\n0 0 3 0 0 -1\n0 0 4 0 0 -1\n";
  const std::string good = "0 0 1 0 0 -1\n0 0 2 0 0 -1\n0 0 3 0 0 -1\n0 0 4 0 0 -1\n";
  const auto as_pcd = [](const std::string& viewpoint, const std::string& body) {
    return "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\n"
           "TYPE F F F F F F\nCOUNT 1 1 1 1 1 1\nWIDTH 4\nHEIGHT 1\nVIEWPOINT " +
           viewpoint + " 1 0 0 0\nPOINTS 4\nDATA ascii\n" + body;
  };
  const std::string vertices = "element vertex 4\n" + kPlyNames;
  expect_turned("a.ply", ply("ascii", vertices, good), {-1, -1, -1, -1}, "");
  expect_turned("b.ply", ply("ascii", vertices, rows), {-1, -1, -1, -1},
                "25 % of its normals pointed away from the camera");
  expect_turned("a.pcd", as_pcd("0 0 0", good), {-1, -1, -1, -1}, "");
  expect_turned("b.pcd", as_pcd("0 0 0", rows), {-1, -1, -1, -1}, "25 % of its normals");
  expect_turned("c.pcd", as_pcd("0 0 2.5", rows), {1, 1, -1, -1},
                "its VIEWPOINT is (0, 0, 2.5): normals are turned to there (25 % of them), points "
                "stay where they are");
}

TEST(CloudPly, SaysWhatIsWrong) {
  const TemporaryFolder folder;
  const auto expect_bad = [&](const std::string& bytes, const std::string& words) {
    write_bytes(folder / "bad.ply", bytes);
    expect_error(load_cloud(folder / "bad.ply"), words);
  };
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  expect_bad(ply("ascii", "element vertex 1\n" + xyz, "1 2 3\n"), "normals");
  expect_bad(ply("ascii", "element vertex 0\n" + kPlyNames, ""), "no points");
  expect_bad(ply("ascii", "element vertex 4000000000\n" + kPlyNames, "1 2 3 0 0 1\n"), "truncated");
  expect_bad(ply("binary_little_endian", "element vertex 4000000000\n" + kPlyNames, "x"),
             "truncated");
  expect_bad(ply("binary_little_endian", "element vertex 18446744073709551615\n" + kPlyNames, "x"),
             "truncated");
  expect_bad(ply("ascii", "element vertex 1\n" + kPlyNames, "1 2 three 0 0 1\n"), "damaged");
  expect_bad(ply("ascii", "element face 1\nproperty list uchar int vertex_indices\n", "0\n"),
             "no element 'vertex'");
  expect_bad(ply("ebcdic", "element vertex 1\n" + kPlyNames, "1 2 3 0 0 1\n"), "unknown format");
  expect_bad("", "neither a PLY nor a PCD");
  expect_bad("solid not a cloud", "neither a PLY nor a PCD");
  EXPECT_EQ(load_cloud(folder / "absent.ply").error().code, Errc::not_found);
}

TEST(CloudPly, TruncationsAreErrors) {
  const TemporaryFolder folder;
  ASSERT_TRUE(save_cloud_ply(sample(20, 10).view(), folder / "cloud.ply").has_value());
  test::for_each_truncation(folder / "cloud.ply", 200,
                            [](const std::filesystem::path& cut, std::size_t length) {
                              EXPECT_FALSE(load_cloud(cut).has_value()) << length;
                            });
  EXPECT_FALSE(save_cloud_ply(sample().view(), folder / "no/folder.ply").has_value());
}

TEST(CloudPcd, ReadsAllEncodingsAndStaysOrganized) {
  const TemporaryFolder folder;
  const PointCloud cloud = sample();
  std::string text;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3f p = cloud.point(i), n = cloud.normal(i);
    for (const float value : {p.x, p.y, p.z, 16777215.0f, n.x, n.y, n.z})
      text += (std::isnan(value) ? "nan" : std::to_string(value)) + " ";
    text += "\n";
  }
  const std::pair<const char*, std::string> files[] = {
      {"text.pcd", pcd("F", 4, "ascii", 3, 2, text)},
      {"rows.pcd", pcd("F", 4, "binary", 3, 2, pcd_body<float>(cloud, false))},
      {"rows8.pcd", pcd("F", 8, "binary", 3, 2, pcd_body<double>(cloud, false))},
      {"packed.pcd", pcd("F", 4, "binary_compressed", 3, 2, packed(pcd_body<float>(cloud, true)))},
      {"packed8.pcd",
       pcd("F", 8, "binary_compressed", 3, 2, packed(pcd_body<double>(cloud, true)))}};
  for (const auto& [name, bytes] : files) {
    SCOPED_TRACE(name);
    write_bytes(folder / name, bytes);
    const auto loaded = load_cloud(folder / name);
    ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
    expect_same(loaded->cloud, cloud);
    EXPECT_FALSE(loaded->cloud.view().pinhole);
    const auto depth = load_depth_pcd(folder / name);
    ASSERT_TRUE(depth.has_value()) << depth.error().message;
    EXPECT_EQ(depth->pixels[3], 2000);
    EXPECT_EQ(depth->pixels[4], 0);
  }
}

TEST(CloudPcd, SaysWhatIsWrong) {
  const TemporaryFolder folder;
  const auto expect_bad = [&](const std::string& bytes, const std::string& words) {
    write_bytes(folder / "bad.pcd", bytes);
    expect_error(load_cloud(folder / "bad.pcd"), words);
  };
  const auto replaced = [](std::string text, const std::string& from, const std::string& to) {
    return text.replace(text.find(from), from.size(), to);
  };
  const std::string rows = pcd_body<float>(sample(), false);
  const std::string good = pcd("F", 4, "binary", 3, 2, rows);
  expect_bad(replaced(good, "normal_x", "other_xx"), "normals");
  expect_bad(replaced(good, "POINTS 6", "POINTS 7"), "WIDTH x HEIGHT");
  expect_bad(replaced(good, "WIDTH 3", "WIDTH 0"), "no points");
  expect_bad(replaced(good, "WIDTH 3", "WIDTH -3"), "bad header line");
  expect_bad(replaced(good, "WIDTH 3", "WIDTH three"), "bad header line");
  expect_bad(replaced(good, "SIZE 4", "SIZE 3"), "bad header line");
  expect_bad(replaced(good, "SIZE 4 4", "SIZE 4"), "bad header line");
  expect_bad(replaced(good, "COUNT 1", "COUNT 0"), "bad header line");
  expect_bad(replaced(good, "DATA binary", "DATA zip"), "bad header line");
  expect_bad(replaced(good, "TYPE F", "TYPE I"), "normals");
  expect_bad(pcd("F", 4, "binary", 3, 3, rows), "truncated");
  expect_bad(pcd("F", 4, "ascii", 40000, 50000, rows), "truncated");
  expect_bad(pcd("F", 4, "binary", 40000, 50000, rows), "truncated");
  expect_bad(replaced(replaced(good, "WIDTH 3", "WIDTH 4000000000"), "POINTS 6", "POINTS 8"),
             "2^31");
  const std::string body = packed(pcd_body<float>(sample(), true));
  expect_bad(pcd("F", 4, "binary_compressed", 30000, 50000, body), "truncated");
  expect_bad(pcd("F", 4, "binary_compressed", 3, 3, body), "unpacked size");
  expect_bad(pcd("F", 4, "binary_compressed", 3, 2, bytes_of(0xffffffffu, 168u) + body),
             "truncated");
  std::string damaged = body;
  for (std::size_t i = 8; i < damaged.size(); ++i) damaged[i] = '\xff';
  expect_bad(pcd("F", 4, "binary_compressed", 3, 2, damaged), "unpacked");
  expect_error(load_depth_pcd(folder / "absent.pcd"), "absent.pcd");
  write_bytes(folder / "flat.pcd", pcd("F", 4, "binary", 6, 1, rows));
  expect_error(load_depth_pcd(folder / "flat.pcd"), "not organized");
}

TEST(CloudPcd, TruncationsAreErrorsAndDamageNeverCrashes) {
  const TemporaryFolder folder;
  const PointCloud cloud = sample(20, 10);
  const std::pair<const char*, std::string> files[] = {
      {"rows.pcd", pcd("F", 4, "binary", 20, 10, pcd_body<float>(cloud, false))},
      {"packed.pcd",
       pcd("F", 4, "binary_compressed", 20, 10, packed(pcd_body<float>(cloud, true)))}};
  for (const auto& [name, bytes] : files) {
    write_bytes(folder / name, bytes);
    ASSERT_TRUE(load_cloud(folder / name).has_value());
    test::for_each_truncation(folder / name, 200,
                              [](const std::filesystem::path& cut, std::size_t length) {
                                EXPECT_FALSE(load_cloud(cut).has_value()) << length;
                              });
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
      std::string damaged = bytes;
      damaged[i] = static_cast<char>(damaged[i] ^ 0x55);
      write_bytes(folder / "damaged.pcd", damaged);
      (void)load_cloud(folder / "damaged.pcd").has_value();
    }
  }
}

TEST(CloudPcd, RealCloudWithoutNormalsSaysSo) {
  PALPATE_DATA_OR_SKIP(path, "frames/pcl_person.pcd");
  expect_error(load_cloud(path), "normals");
}

}  // namespace
}  // namespace palpate
