// Surfaces made for a window of the image answer every query inside of it with the bits of those of
// the whole image, and say so of every other query.
#include <cstring>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"
#include "palpate/field/sensor.h"
#include "palpate/io/formats.h"
#include "src/contact/backends.h"
#include "src/contact/internal/field_elements.h"
#include "src/field/internal/needed_window.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/data.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/random_frame.h"
#include "tests/test_util/real_frames.h"

namespace palpate {
namespace {

using test::Random;
using test::random_frame;

struct Options {
  SurfaceOptions surface;
  DepthFieldOptions field;
  TimeOptions time;

  Options() { time.mode = TimeMode::latest; }
};

/// Frames that are seen as a whole and, in memory where other windows were before, in windows.
class BothWays {
 public:
  BothWays(const DepthStreamInfo& stream, const Options& options)
      : stream_(stream),
        whole_(
            SurfaceTimeline::create(
                stream, {.surface = options.surface, .field = options.field, .time = options.time})
                .value()),
        windowed_(
            SurfaceTimeline::create(
                stream, {.surface = options.surface, .field = options.field, .time = options.time})
                .value()) {}

  void push(const DepthFrame& frame, const PixelWindow& requested) {
    time_ += 1 / 30.0;
    whole_.push(frame, time_, pool_);
    windowed_.push(frame, time_, two_threads_, requested);
    EXPECT_EQ(windowed_.at(time_).to.field.requested, requested);
  }
  SurfaceBlend whole() const { return whole_.at(time_ + 0.01); }
  SurfaceBlend windowed() const { return windowed_.at(time_ + 0.01); }
  PixelWindow window_of(const Vec3d& p_C, double reach) const {
    return needed_window(stream_.intrinsics, stream_.width, stream_.height, p_C, reach);
  }

 private:
  DepthStreamInfo stream_;
  ThreadPool pool_{1}, two_threads_{2};
  SurfaceTimeline whole_, windowed_;
  double time_ = 0;
};

struct Answer {
  ContactResult result;
  std::vector<SphereState> states;
  std::vector<Plane<float>> planes;
};
Answer evaluate(const ContactQuery& query, const SurfaceBlend& moment, const Pose& X_WT) {
  const std::size_t num = query.index()->tool().spheres().size();
  Answer answer{{}, std::vector<SphereState>(num), std::vector<Plane<float>>(num)};
  answer.result =
      query.measure(moment.from, moment.to, moment.progress, X_WT,
                    {.stiffness = true, .states = answer.states, .planes = answer.planes});
  return answer;
}

void expect_same(const Answer& got, const Answer& want) {
  const Penetration &a = got.result.penetration, &b = want.result.penetration;
  EXPECT_EQ(a.status.bits, b.status.bits);
  EXPECT_EQ(a.volume, b.volume);
  EXPECT_EQ(a.potential, b.potential);
  EXPECT_EQ(std::memcmp(&a.measure_W, &b.measure_W, sizeof(VolumeWrench)), 0);
  EXPECT_EQ(a.num_boundary_spheres, b.num_boundary_spheres);
  EXPECT_EQ(a.num_inside_spheres, b.num_inside_spheres);
  EXPECT_EQ(std::memcmp(&*got.result.stiffness, &*want.result.stiffness, sizeof(Stiffness)), 0);
  EXPECT_EQ(got.states, want.states);
  EXPECT_EQ(
      std::memcmp(got.planes.data(), want.planes.data(), got.planes.size() * sizeof(Plane<float>)),
      0);
}

/// A tool among others, and how far its elements are from its center of mass.
struct Probe {
  const Tool* tool;
  double reach;
  std::unique_ptr<ContactQuery> query;

  Probe(Backend backend, const Tool& of, Isa isa = best_isa())
      : tool(&of),
        reach(FieldElements(of, SphereVolumes::represented).reach),
        query(backend == Backend::cpu
                  ? make_contact_query(Place::cpu(), of, FieldMethod{}, {isa}).value()
                  : make_contact_query_cuda(ToolIndex::create(of), FieldMethod{}, 0).value()) {}
};

/// Windows at random places, tools of random poses in and out of them.
struct Counts {
  int touching = 0, deep = 0, outside = 0;
};
void compare(BothWays& seen, const DepthStreamInfo& stream, const std::vector<DepthFrame>& frames,
             const std::vector<Probe>& probes, int num_windows, int num_poses, Random& random,
             Counts& counts) {
  const Intrinsics& k = stream.intrinsics;
  for (int i = 0; i < num_windows; ++i) {
    const Probe& probe = probes[random.bits() % probes.size()];
    const DepthFrame& frame = frames[random.bits() % frames.size()];
    const double u = random.uniform(-0.1, 1.1) * frame.width;
    const double v = random.uniform(-0.1, 1.1) * frame.height;
    const auto at = [](double x, int size) {
      return static_cast<std::size_t>(std::clamp(static_cast<int>(x), 0, size - 1));
    };
    const std::size_t pixel =
        at(v, frame.height) * static_cast<std::size_t>(frame.width) + at(u, frame.width);
    const double z = (frame.pixels[pixel] > 0 ? frame.pixels[pixel] * frame.unit : 0.8) +
                     random.uniform(-0.5, 2) * probe.reach;
    const Vec3d middle{(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z};
    const double room = random.uniform(0, 0.5) * probe.reach;
    const PixelWindow requested = seen.window_of(middle, probe.reach + room);
    // For both frames of a moment, or for the newer one alone.
    const bool has_both = random.bits() % 2 == 0;
    if (has_both) seen.push(frames[random.bits() % frames.size()], requested);
    seen.push(frame, requested);
    for (int j = 0; j < num_poses; ++j) {
      const bool is_away = j % 8 == 7;
      const Vec3d C_W =
          middle + (is_away ? 4 * probe.reach : random.uniform(0, 0.9) * room) * random.direction();
      Pose X_WT{{}, random.rotation(kPi)};
      X_WT.translation = C_W - X_WT * probe.tool->sphere_mass().center_of_mass;
      SurfaceBlend whole = seen.whole(), windowed = seen.windowed();
      if (!has_both) whole.progress = windowed.progress = 1;
      const Answer got = evaluate(*probe.query, windowed, X_WT);
      if (got.result.penetration.status.has(StepStatus::outside_window)) {
        EXPECT_TRUE(is_away);
        EXPECT_TRUE(got.result.penetration.status.is_unmeasured());
        EXPECT_EQ(got.result.penetration.volume, 0);
        ++counts.outside;
        continue;
      }
      const Answer want = evaluate(*probe.query, whole, X_WT);
      expect_same(got, want);
      const Penetration& p = want.result.penetration;
      counts.touching += p.volume > 0;
      counts.deep += p.volume > 0.7 * probe.tool->mesh_mass().volume;
    }
  }
}

std::vector<Probe> probes_of(const std::vector<Tool>& tools, Backend backend) {
  std::vector<Probe> probes;
  for (const Tool& tool : tools) {
    probes.emplace_back(backend, tool);
    if (backend == Backend::cpu) probes.emplace_back(backend, tool, Isa::baseline);
  }
  return probes;
}

std::vector<Tool> tools() {
  std::vector<Tool> made;
  made.push_back(test::random_tool(300, 0.02, 1));
  made.push_back(test::random_tool(40, 0.06, 2));
  made.push_back(test::random_tool(200, 0.005, 3));
  return made;
}

/// As many options as there are ways through the code.
std::vector<Options> all_options() {
  std::vector<Options> all(8);
  all[1].field.unknown = UnknownSpace::solid;
  all[2].field.fill_levels = 0;
  all[3].field.fill_levels = 5;
  all[3].field.unseen = UnseenSpace::free;
  all[3].field.thickness = 0.02;
  all[4].surface.filter.smoothing = Smoothing::bilateral;
  all[4].surface.filter.radius = 5;
  all[4].surface.normals.radius = 7;
  all[5].surface.filter.enabled = false;
  all[5].time.average.kind = DepthAverage::exponential;
  all[6].time.mode = TimeMode::interpolate;
  all[7].time.mode = TimeMode::predict;
  return all;
}

void compare_synthetic(Backend backend, int num_windows, int num_poses) {
  const std::vector<Tool> all_tools = tools();
  const std::vector<Probe> probes = probes_of(all_tools, backend);
  Random random(11);
  Counts counts;
  int number = 0;
  for (const Options& options : all_options()) {
    SCOPED_TRACE(number);
    const auto [width, height] = number++ % 2 == 0 ? std::pair{1201, 703} : std::pair{903, 611};
    DepthStreamInfo stream;
    stream.width = width;
    stream.height = height;
    stream.intrinsics = {0.9 * width, 0.93 * width, 0.5 * width, 0.51 * height};
    std::vector<DepthFrame> frames;
    for (int i = 0; i < 3; ++i) frames.push_back(random_frame(width, height, random));
    if (options.time.mode == TimeMode::predict) {
      // The same scene, which moves by less than a jump.
      for (std::size_t i = 1; i < frames.size(); ++i) {
        frames[i] = frames[0];
        for (std::uint16_t& count : frames[i].pixels) {
          count = static_cast<std::uint16_t>(count * (100 + i) / 100);
        }
      }
    }
    BothWays seen(stream, options);
    compare(seen, stream, frames, probes, num_windows, num_poses, random, counts);
  }
  EXPECT_GT(counts.touching, num_windows);
  EXPECT_GT(counts.deep, num_windows / 4);
  EXPECT_GT(counts.outside, num_windows / 4);
}

TEST(WindowedField, AnswersLikeTheWholeOneForAllOptions) {
  compare_synthetic(Backend::cpu, 12, 24);
}

TEST(WindowedField, AnswersLikeTheWholeOneOnAGpu) {
  PALPATE_GPU_OR_SKIP();
  compare_synthetic(Backend::cuda, 4, 8);
}

PALPATE_ON_ALL_FRAMES(WindowedFieldOn);

TEST_P(WindowedFieldOn, RealFramesAnswersLikeTheWholeOne) {
  PALPATE_FRAMES_OR_SKIP(frames, [](const auto& path) { return load_depth_png(path).value(); });
  const std::vector<Tool> all_tools = tools();
  const std::vector<Probe> probes = probes_of(all_tools, Backend::cpu);
  Random random(12);
  Counts counts;
  for (const test::TriedFrame& real : frames) {
    SCOPED_TRACE(real.name);
    const DepthFrame& frame = real.frame;
    DepthStreamInfo stream;
    stream.width = frame.width;
    stream.height = frame.height;
    stream.intrinsics = real.intrinsics;
    BothWays seen(stream, {});
    compare(seen, stream, {frame, random_frame(frame.width, frame.height, random)}, probes, 12, 24,
            random, counts);
  }
  EXPECT_GT(counts.touching, 40 * static_cast<int>(frames.size()));
  EXPECT_GT(counts.deep, 8 * static_cast<int>(frames.size()));
}

// Data outside a window is missing rather than wrong, and is computed on demand.
TEST(WindowedField, HasNoCloudUntilAPictureNeedsIt) {
  DepthStreamInfo stream;
  stream.width = 640;
  stream.height = 480;
  stream.intrinsics = {600, 600, 319.5, 239.5};
  Random random(13);
  const DepthFrame other = random_frame(640, 480, random), frame = random_frame(640, 480, random);
  ThreadPool pool(2);
  const auto make = [&] {
    const Options options;
    return SurfaceTimeline::create(
               stream, {.surface = options.surface, .field = options.field, .time = options.time})
        .value();
  };
  SurfaceTimeline whole = make(), windowed = make();
  whole.push(frame, 0, pool);
  EXPECT_EQ(whole.at(0).to.cloud.edge_x, nullptr);
  windowed.push(other, 0, pool);
  windowed.push(frame, 1, pool, {10, 10, 40, 30});
  EXPECT_EQ(windowed.at(1).to.cloud.size(), 0u);
  const PointCloud got = windowed.newest_cloud(pool), want = whole.newest_cloud(pool);
  int num_points = 0, num_edges = 0;
  for (std::size_t i = 0; i < want.size(); ++i) {
    for (int channel = 0; channel < 9; ++channel) {
      const float a = got.channel(channel)[i], b = want.channel(channel)[i];
      ASSERT_EQ(std::memcmp(&a, &b, sizeof a), 0) << channel << " at " << i;
    }
    num_points += want.channel(2)[i] > 0;
    num_edges += norm(to_double(want.edge(i))) > 0;
  }
  EXPECT_GT(num_points, 100000);
  EXPECT_GT(num_edges, 100);
}

}  // namespace
}  // namespace palpate
