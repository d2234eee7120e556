// The same points as PNG, PointCloud2 in recordings, PCD and PLY: images, and the volume of a tool
// in them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/io/formats.h"
#include "src/cloud/internal/cloud_camera.h"
#include "src/io/internal/cloud_folder.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_messages.h"
#include "tests/io/made_cloud.h"
#include "tests/io/ros1_bag_writer.h"
#include "tests/test_util/data.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::CloudLayout;

constexpr int kWidth = 160, kHeight = 120;
constexpr Intrinsics kIntrinsics{140, 140, 79.5, 59.5};
constexpr char kGiven[] = "?intrinsics=140,140,79.5,59.5&unit=0.001";

/// A ball before a slanted wall, without a column; `k` moves the ball.
DepthFrame image(int k = 0) {
  DepthFrame frame{kWidth, kHeight, 0.001, {}, 0.1 * k};
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const double du = u - 70 - k, dv = v - 60, r2 = 900 - du * du - dv * dv;
      const double z = r2 > 0 ? 0.7 - 0.004 * std::sqrt(r2) : 0.9 + 0.001 * v;
      frame.pixels.push_back(u == 7 ? 0 : static_cast<std::uint16_t>(std::lround(1000 * z)));
    }
  }
  return frame;
}

CloudPoints points_of(const DepthFrame& frame) {
  CloudPoints cloud{frame.width, frame.height, {}, {}};
  for (int i = 0; i < frame.width * frame.height; ++i) {
    const int u = i % frame.width, v = i / frame.width;
    const double z = frame.unit * frame.pixels[static_cast<std::size_t>(i)];
    const auto& k = kIntrinsics;
    const Vec3f p = to_float({(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z});
    cloud.points.push_back(z > 0 ? p : Vec3f{std::nanf(""), std::nanf(""), std::nanf("")});
  }
  return cloud;
}

CloudPoints shuffled(CloudPoints cloud) {
  std::erase_if(cloud.points, [](const Vec3f& p) { return !is_measured(p); });
  std::mt19937 random(5);
  std::shuffle(cloud.points.begin(), cloud.points.end(), random);
  cloud.width = static_cast<int>(cloud.points.size());
  cloud.height = 1;
  return cloud;
}

/// Binary PCD or PLY, by the name.
void save_points(const CloudPoints& cloud, const fs::path& path) {
  const std::string num = std::to_string(cloud.points.size());
  std::ofstream file(path, std::ios::binary);
  if (path.extension() == ".pcd") {
    file << "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << cloud.width
         << "\nHEIGHT " << cloud.height << "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << num
         << "\nDATA binary\n";
  } else {
    file << "ply\nformat binary_little_endian 1.0\nelement vertex " << num
         << "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  }
  file.write(reinterpret_cast<const char*>(cloud.points.data()),
             static_cast<std::streamsize>(12 * cloud.points.size()));
}

struct Seen {
  DepthStreamInfo info;
  std::vector<DepthFrame> frames;
  std::vector<std::string> notes;
  std::string error;

  bool is_noted(const std::string& words) const {
    return std::ranges::any_of(
        notes, [&](const std::string& note) { return note.find(words) != note.npos; });
  }
};

Seen see(const std::string& uri) {
  Seen seen;
  auto camera = open_camera(uri, {.in_real_time = false});
  if (!camera) {
    seen.error = camera.error().message;
    return seen;
  }
  seen.info = (*camera)->info();
  DepthFrame frame;
  for (;;) {
    const auto got = (*camera)->next(frame);
    if (!got) seen.error = got.error().message;
    if (!got || !*got) break;
    seen.frames.push_back(frame);
  }
  seen.notes = (*camera)->take_notes();
  return seen;
}

/// Volume of a box that lies behind the surface of an image, by its points, m3.
double volume_behind(const DepthStreamInfo& info, const DepthFrame& frame) {
  constexpr int kNum = 60;
  constexpr Vec3d kCorner{-0.08, -0.02, 0.57}, kSize{0.08, 0.06, 0.1};
  const auto& k = info.intrinsics;
  int num = 0;
  for (int i = 0; i < kNum * kNum * kNum; ++i) {
    const Vec3d p = kCorner + Vec3d{kSize.x * (i % kNum + 0.5), kSize.y * (i / kNum % kNum + 0.5),
                                    kSize.z * (i / kNum / kNum + 0.5)} /
                                  kNum;
    const int u = static_cast<int>(std::lround(k.fx * p.x / p.z + k.cx));
    const int v = static_cast<int>(std::lround(k.fy * p.y / p.z + k.cy));
    const int count = frame.pixels[static_cast<std::size_t>(v * info.width + u)];
    num += count > 0 && count * frame.unit < p.z;
  }
  return kSize.x * kSize.y * kSize.z * num / (kNum * kNum * kNum);
}

class CloudStreams : public testing::Test {
 protected:
  std::string write_bag(const std::string& name, const std::function<CloudPoints(int)>& cloud,
                        const CloudLayout& layout = {},
                        const std::vector<double>& stamps = {1, 1.1, 1.2}) {
    const fs::path path = folder_.path() / name;
    auto writer = McapWriter::create(path).value();
    const auto channel = writer.add_channel({"/points", "sensor_msgs/msg/PointCloud2", ""});
    const auto tf = writer.add_channel({"/tf_static", "tf2_msgs/msg/TFMessage", ""});
    const RosTransform there[] = {{"map", "cam", {{0, 0, 2}, {}}}};
    EXPECT_TRUE(writer.write(tf, 0, transform_message(0, there)));
    for (int k = 0; k < std::ssize(stamps); ++k) {
      const double stamp = stamps[static_cast<std::size_t>(k)];
      EXPECT_TRUE(writer.write(channel, static_cast<std::uint64_t>(1e9 + 1e8 * k),
                               test::cloud_message(cloud(k).view(), layout, stamp)));
    }
    EXPECT_TRUE(writer.finish());
    return "bag:" + path.string();
  }
  std::string write_folder(const std::string& extension,
                           const std::function<CloudPoints(int)>& cloud) {
    const fs::path path = folder_.path() / extension;
    fs::create_directory(path);
    for (int k = 0; k < 3; ++k) {
      save_points(cloud(k), path / (std::to_string(9 + k) + "." + extension));
    }
    return "folder:" + path.string();
  }
  Seen see_pngs() {
    const fs::path path = folder_.path() / "png";
    fs::create_directory(path);
    for (int k = 0; k < 3; ++k) {
      EXPECT_TRUE(save_depth_png(image(k), path / (std::to_string(k) + ".png")));
    }
    return see("folder:" + path.string() + kGiven);
  }
  static CloudPoints organized(int k) { return points_of(image(k)); }
  static CloudPoints unorganized(int k) { return shuffled(points_of(image(k))); }

  const test::TemporaryFolder folder_;
};

TEST_F(CloudStreams, OrganizedCloudsAreTheSameFramesAsTheirPngs) {
  const Seen pngs = see_pngs();
  ASSERT_EQ(pngs.frames.size(), 3u) << pngs.error;
  std::vector<std::string> uris{write_folder("pcd", organized)};
  for (const CloudLayout& layout : CloudLayout::three()) {
    uris.push_back(write_bag(std::to_string(uris.size()) + "a.mcap", organized, layout));
  }
  std::string records = test::ros1_connection(0, "/points", "sensor_msgs/PointCloud2");
  for (std::uint32_t k = 0; k < 3; ++k) {
    const std::uint32_t stamp = 100'000'000 * k;
    records += test::ros1_message(
        0, 1, stamp,
        test::ros1_cloud(test::ros1_stamp(1, stamp, "cam"), organized(static_cast<int>(k)).view(),
                         CloudLayout::three()[2]));
  }
  std::ofstream(folder_.path() / "b.bag", std::ios::binary)
      << test::ros1_bag({test::ros1_chunk(records)});
  uris.push_back("bag:" + (folder_.path() / "b.bag").string());
  for (const std::string& uri : uris) {
    const Seen clouds = see(uri);
    ASSERT_EQ(clouds.frames.size(), 3u) << uri << clouds.error;
    EXPECT_TRUE(clouds.notes.empty()) << clouds.notes.front();
    EXPECT_EQ(clouds.info.intrinsics, kIntrinsics) << uri;
    EXPECT_EQ(clouds.info.unit, 0.001);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(clouds.frames[k].pixels, pngs.frames[k].pixels) << uri << k;
      EXPECT_EQ(clouds.frames[k].X_WC, Pose{});
    }
    EXPECT_NEAR(clouds.frames[2].timestamp - clouds.frames[0].timestamp,
                uri.starts_with("bag:") ? 0.2 : 2 / 30.0, 1e-9);
  }
}

TEST_F(CloudStreams, UnorganizedCloudsHaveTheVolumeOfTheirPngs) {
  const Seen pngs = see_pngs();
  ASSERT_EQ(pngs.frames.size(), 3u) << pngs.error;
  std::vector<std::string> uris{write_folder("pcd", unorganized), write_folder("ply", unorganized)};
  for (const CloudLayout& layout : CloudLayout::three()) {
    uris.push_back(write_bag(std::to_string(uris.size()) + "u.mcap", unorganized, layout));
  }
  for (const std::string& uri : uris) {
    const Seen clouds = see(uri);
    ASSERT_EQ(clouds.frames.size(), 3u) << uri << clouds.error;
    EXPECT_TRUE(clouds.is_noted("share a pixel"));
    const double expected = volume_behind(pngs.info, pngs.frames[1]);
    EXPECT_GT(expected, 5e-5);
    EXPECT_NEAR(volume_behind(clouds.info, clouds.frames[1]) / expected, 1, 0.01) << uri;
    // With the camera of the images they are these images.
    const Seen same = see(uri + kGiven + "&size=160x120");
    ASSERT_EQ(same.frames.size(), 3u) << same.error;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(same.frames[k].pixels, pngs.frames[k].pixels);
  }
}

TEST_F(CloudStreams, TheyAreSeenFromWhereTheUriSaysAndPlacedByTf) {
  const std::string uri = write_bag("v.mcap", organized);
  const Seen placed = see(uri + "?world=map");
  ASSERT_EQ(placed.frames.size(), 3u) << placed.error;
  EXPECT_EQ(placed.frames[0].X_WC.translation, (Vec3d{0, 0, 2}));
  const Seen moved = see(uri + "?world=map&viewpoint=0.1,0,-0.2");
  ASSERT_EQ(moved.frames.size(), 3u) << moved.error;
  EXPECT_EQ(moved.frames[0].X_WC.translation, (Vec3d{0.1, 0, 1.8}));
  const Seen posed = see(uri + "?pose=0,0,0,0,0,1,0&viewpoint=0.1,0,-0.2");
  ASSERT_EQ(posed.frames.size(), 3u) << posed.error;
  EXPECT_LT(norm(posed.frames[0].X_WC.translation - Vec3d{-0.1, 0, -0.2}), 1e-12);
}

TEST_F(CloudStreams, BadMessagesAndParametersAreOneSentence) {
  CloudLayout lying;
  lying.point_step = 12;
  lying.fields[2].offset = 10;
  const auto expect = [](const Seen& seen, const std::string& words) {
    EXPECT_NE(seen.error.find(words), std::string::npos) << seen.error;
  };
  expect(see(write_bag("l.mcap", organized, lying)), "its field 'z' lies beyond");
  const std::string good = write_bag("g.mcap", organized);
  expect(see(good + "?viewpoint=1,2"), "'viewpoint' must be x,y,z");
  expect(see(good + "?viewpoint=1,2,nan"), "'viewpoint' must be x,y,z");
  expect(see(good + "?viewpoint=1,2,3,4"), "'viewpoint' must be x,y,z");
  expect(see(good + "?look=0,0,0"), "'look' must be longer than 0");
  expect(see(good + "?info=/a"), "leave out 'info'");
  expect(see(good + "?distortion=0.1,0,0,0"), "leave out 'distortion'");
  const Seen pngs = see_pngs();
  const std::string folder = "folder:" + (folder_.path() / "png").string() + kGiven;
  expect(see(folder + "&viewpoint=0,0,0"), "leave out 'viewpoint'");
  expect(see(folder + "&size=8x8"), "leave out 'size'");
  expect(see(folder + "&scale=0.001"), "leave out 'scale'");
  // A cloud without points in mid-stream is left out, with a note.
  const Seen hollow = see(write_bag("h.mcap", [](int k) {
    return k == 1 ? CloudPoints{1, 0, {}, {}} : points_of(image(k));
  }));
  EXPECT_EQ(hollow.frames.size(), 2u) << hollow.error;
  EXPECT_TRUE(hollow.is_noted("a message is left out: a point cloud has no points"));
}

TEST_F(CloudStreams, StampsThatJumpAreTold) {
  const Seen seen =
      see(write_bag("j.mcap", organized, {}, {1, 1.1, 0.4, 1.2, 1.3, 101.3, 101.4, 3}));
  EXPECT_EQ(seen.frames.size(), 6u) << seen.error;
  EXPECT_TRUE(seen.is_noted("2 of its 8 frames are left out, as their stamps are not later"));
  EXPECT_TRUE(seen.is_noted("100 s lie between two of its frames"));
}

TEST_F(CloudStreams, CloudsBesideUnreadableDepthImagesAreTakenWithANote) {
  const fs::path path = folder_.path() / "d.mcap";
  auto writer = McapWriter::create(path).value();
  const auto image = writer.add_channel({"/camera/depth/image", "sensor_msgs/msg/Image", ""});
  const auto color = writer.add_channel({"/camera/color/image", "sensor_msgs/msg/Image", ""});
  const auto points = writer.add_channel({"/points", "sensor_msgs/msg/PointCloud2", ""});
  ASSERT_TRUE(writer.write(image, 1, "damaged"));
  ASSERT_TRUE(writer.write(color, 1, "damaged"));
  ASSERT_TRUE(writer.write(points, 1, test::cloud_message(organized(0).view())));
  ASSERT_TRUE(writer.finish());
  const Seen seen = see("bag:" + path.string());
  EXPECT_EQ(seen.frames.size(), 1u) << seen.error;
  ASSERT_EQ(seen.notes.size(), 1u);
  EXPECT_TRUE(
      seen.is_noted("the clouds on /points are taken, as its depth images are not read; "
                    "/camera/depth/image: "));
  EXPECT_FALSE(seen.is_noted("color"));
}

TEST_F(CloudStreams, FarFromTheOriginTheyAreSeenAsNearIt) {
  const std::string size = "&look=0,0,1&size=160x120&intrinsics=140,140,79.5,59.5&unit=0.001";
  CloudLayout far = CloudLayout::three()[2];
  far.shift = {400'000, 5'000'000, 100};
  const Seen near = see(write_bag("n.mcap", organized) + "?viewpoint=0,0,0" + size);
  const Seen seen =
      see(write_bag("f.mcap", organized, far) + "?viewpoint=400000,5000000,100" + size);
  ASSERT_EQ(near.frames.size(), 3u) << near.error;
  ASSERT_EQ(seen.frames.size(), 3u) << seen.error;
  EXPECT_EQ(seen.frames[0].X_WC.translation, far.shift);
  EXPECT_EQ(seen.frames[1].pixels, near.frames[1].pixels);
  // The same as text, from where the file says.
  const fs::path path = folder_.path() / "far";
  fs::create_directory(path);
  const CloudPoints cloud = unorganized(1);
  std::ofstream file(path / "1.pcd");
  file.precision(12);
  file << "VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH "
       << cloud.points.size() << "\nHEIGHT 1\nVIEWPOINT 400000 5000000 100 1 0 0 0\nDATA ascii\n";
  for (const Vec3f& p : cloud.points) {
    const Vec3d there = to_double(p) + far.shift;
    file << there.x << ' ' << there.y << ' ' << there.z << '\n';
  }
  file.close();
  const Seen text = see("folder:" + path.string() + "?" + size.substr(1));
  ASSERT_EQ(text.frames.size(), 1u) << text.error;
  EXPECT_EQ(text.frames[0].pixels, near.frames[1].pixels);
}

// 40,000 points on the walls of a room of 4 x 4 x 2 m, as from a scanner in its middle.
TEST_F(CloudStreams, AScannerThatSeesAllRoundIsFourCameras) {
  const auto room = [](int) {
    CloudPoints cloud;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> angle(-3.14159265, 3.14159265), slope(-0.3, 0.3);
    for (int i = 0; i < 40'000; ++i) {
      const double a = angle(random),
                   far = 2 / std::max(std::abs(std::cos(a)), std::abs(std::sin(a)));
      cloud.points.push_back(to_float({far * std::cos(a), far * std::sin(a), far * slope(random)}));
    }
    cloud.width = static_cast<int>(cloud.points.size());
    return cloud;
  };
  const std::string uri = write_bag("r.mcap", room);
  EXPECT_NE(see(uri).error.find("give ?look=round"), std::string::npos) << see(uri).error;
  EXPECT_NE(see(uri + "?look=round").error.find("'look' must be x,y,z"), std::string::npos);
  const std::string text = uri + "?look=round&pose=0,0,1,0,0,0,1";
  const auto cameras = parse_camera_uris({&text, 1});
  ASSERT_TRUE(cameras);
  ASSERT_EQ(cameras->size(), 4u);
  std::size_t num = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Seen seen = see((*cameras)[k].text);
    ASSERT_EQ(seen.frames.size(), 3u) << seen.error;
    EXPECT_FALSE(seen.is_noted("field of view")) << "nobody has given one";
    const Intrinsics& intrinsics = seen.info.intrinsics;
    EXPECT_LT(2 * intrinsics.fx, seen.info.width);
    const Pose& X_WC = seen.frames[0].X_WC;
    EXPECT_EQ(X_WC.translation, (Vec3d{0, 0, 1}));
    // Each pixel lies on a wall.
    for (std::size_t i = 0; i < seen.frames[0].pixels.size(); ++i) {
      const double z = seen.frames[0].unit * seen.frames[0].pixels[i];
      if (z == 0) continue;
      const auto u = static_cast<double>(i % static_cast<std::size_t>(seen.info.width));
      const Vec3d p = X_WC * Vec3d{(u - intrinsics.cx) / intrinsics.fx * z, 0, z};
      ++num;
      if (std::abs(std::abs(p.x) - std::abs(p.y)) < 0.2) continue;  // corners are cut
      EXPECT_NEAR(std::max(std::abs(p.x), std::abs(p.y)), 2, 0.005);
    }
  }
  EXPECT_GT(num, 10'000u);
}

TEST_F(CloudStreams, PushedPointsAreTheImageOfTheirCamera) {
  DepthStreamInfo info;
  info.width = kWidth;
  info.height = kHeight;
  info.intrinsics = kIntrinsics;
  const Pose X_WC{{1, 2, 3}, {}};
  for (const bool is_organized : {true, false}) {
    auto camera = PushedSource::create(info).value();
    const CloudPoints cloud = is_organized ? organized(0) : unorganized(0);
    PointsView bad = cloud.view();
    bad.width = 3;
    camera->push_points(bad, X_WC, 0);
    camera->push_points(cloud.view(), X_WC, 0);
    DepthFrame frame;
    ASSERT_TRUE(camera->next(frame).value());
    EXPECT_EQ(frame.pixels, image().pixels);
    EXPECT_EQ(frame.X_WC, X_WC);
    const auto notes = camera->take_notes();
    ASSERT_EQ(notes.size(), is_organized ? 1u : 2u);
    EXPECT_NE(notes[0].find("does not match"), std::string::npos);
  }
}

// person.pcd is the cloud that person.png was made of.
TEST_F(CloudStreams, ARecordedOrganizedCloudIsItsImage) {
  PALPATE_DATA_OR_SKIP(frames, "frames");
  fs::create_directory(folder_.path() / "person");
  fs::create_symlink(frames / "pcl_person.pcd", folder_.path() / "person/1.pcd");
  const Seen cloud = see("folder:" + (folder_.path() / "person").string());
  ASSERT_EQ(cloud.frames.size(), 1u) << cloud.error;
  const DepthFrame expected = load_depth_png(frames / "pcl_person.png").value();
  EXPECT_EQ(cloud.info.intrinsics, (Intrinsics{525, 525, 319.5, 239.5}));
  EXPECT_EQ(cloud.info.unit, 0.001);
  EXPECT_EQ(cloud.frames[0].pixels, expected.pixels);
}

}  // namespace
}  // namespace palpate
