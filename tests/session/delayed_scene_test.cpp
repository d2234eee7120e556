// A scene that is seen late, through a link that delays, jitters and loses images, and is felt in a
// local loop on the simulated clock. What the hand is given is summed here once more, in double, of
// what is recorded: wrenches times the device's motion.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/devices/devices.h"
#include "palpate/mesh/mesh.h"
#include "src/math/internal/rotation_vector.h"
#include "src/run/internal/pipeline.h"
#include "tests/session/packed_tool.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr double kRate = 30;      // Hz, of the camera
constexpr double kSeconds = 6;    // of a run
constexpr double kEnd = 0.4;      // s more, so that the last image arrives
constexpr double kBehind = 1e-9;  // J, of rounding
constexpr double kTank = 0.01;    // J

const Tool& tool() {
  static const Tool tool = test::packed_tool(make_box({0.05, 0.05, 0.05}), 60);
  return tool;
}

DepthStreamInfo camera() {
  DepthStreamInfo info;
  info.width = 64;
  info.height = 48;
  info.intrinsics = {60, 60, 31.5, 23.5};
  info.unit = 0.0005;
  info.rate = kRate;
  info.is_live = true;
  return info;
}

/// A wall across the whole image.
DepthFrame wall(double depth) {
  const DepthStreamInfo info = camera();
  DepthFrame frame{info.width, info.height, info.unit, {}, 0};
  frame.pixels.assign(static_cast<std::size_t>(info.width * info.height),
                      static_cast<std::uint16_t>(std::lround(depth / info.unit)));
  return frame;
}

/// A wall half a meter away that goes to and fro, and jumps.
struct Wall {
  explicit Wall(test::Random& random)
      : swing(random.uniform(0, 0.01)), turn(random.uniform(1, 12)) {
    for (double time = 0; time < kSeconds; time += random.uniform(0.1, 1)) {
      jumps.push_back({time, random.uniform(-0.03, 0.02)});
    }
  }
  double depth(double time) const {
    double depth = 0.5 + swing * std::sin(turn * time);
    for (auto jump = jumps.rbegin(); jump != jumps.rend(); ++jump) {
      if (jump->time <= time) return depth + jump->by;
    }
    return depth;
  }

  struct Jump {
    double time, by;  // s, m
  };
  double swing, turn;
  std::vector<Jump> jumps;
};

/// Delay and loss of the images on the link.
struct Link {
  double delay = 0, jitter = 0, loss = 0;  // s, s more at most, share
};
struct Image {
  double arrival = 0, capture = 0;  // s
};
/// Returns the images in the order of arrival, without those that a later one has overtaken. The
/// first one comes at once.
std::vector<Image> sent_over(const Link& link, test::Random& random) {
  std::vector<Image> images;
  for (int k = 1; k < kSeconds * kRate; ++k) {
    const double capture = k / kRate;
    const double arrival = capture + link.delay + random.uniform(0, link.jitter);
    if (random.uniform(0, 1) >= link.loss) images.push_back({arrival, capture});
  }
  std::ranges::stable_sort(images, {}, &Image::arrival);
  std::vector<Image> taken{{0, 0}};
  for (const Image& image : images) {
    if (image.capture > taken.back().capture) taken.push_back(image);
  }
  return taken;
}

struct DelayedRun {
  std::vector<TickRecord> ticks;
  double energy_given = 0;  // J, as the device itself counts it
};

RunSettings settings_with(const SafetyOptions& safety) {
  RunSettings settings;
  settings.num_threads = 1;
  settings.coupling.X_WB.translation = {0, 0, 0.45};
  settings.safety = safety;
  return settings;
}

constexpr double kRubs = 0.02;  // m, to either side

/// A hand that goes 2 cm to and fro where the wall is, and less aside.
DelayedRun feel(const std::string& model, const RunSettings& settings,
                const std::vector<Image>& images, const Wall& scene, double hand_turn,
                double aside = 0.003) {
  SimulatedDeviceOptions options;
  options.model = *find_device_model(model);
  options.target = [hand_turn, aside](double time) {
    return Pose{{aside * std::sin(9 * time), 0, 0.02 - 0.03 * std::cos(hand_turn * time)},
                axis_angle({1, 2, 3}, 0.1 * std::sin(5 * time))};
  };
  options.in_real_time = false;
  const auto device = *SimulatedDevice::create(options);
  auto pipeline = Pipeline::create(tool(), camera(), device->info(), settings).value();
  DelayedRun run;
  std::size_t next = 0;
  const Status started = device->start([&](const DeviceState& state) {
    for (; next < images.size() && images[next].arrival <= state.time; ++next) {
      pipeline.push(wall(scene.depth(images[next].capture)), images[next].capture);
    }
    run.ticks.push_back(pipeline.tick(state));
    return run.ticks.back().F_H_B;
  });
  EXPECT_TRUE(started);
  device->run(static_cast<int>(1000 * (kSeconds + kEnd)));
  run.energy_given = device->energy_given();
  return run;
}

/// J, of the wrench that was on the handle between two ticks.
double work_between(const TickRecord& a, const TickRecord& b) {
  const Quaternion turn = b.device.X_BH.rotation * conjugate(a.device.X_BH.rotation);
  return dot(a.F_H_B.force, b.device.X_BH.translation - a.device.X_BH.translation) +
         dot(a.F_H_B.torque, rotation_vector(turn));
}

struct Given {
  // J, net: in all, since the force came (back), and from any moment since then on beyond what was
  // stored at that.
  double sum = 0, most = 0, most_beyond_stored = 0;
};
Given energy_given(const std::vector<TickRecord>& ticks) {
  Given given;
  double since = 0, least = 0;
  for (std::size_t i = 1; i < ticks.size(); ++i) {
    const double work = work_between(ticks[i - 1], ticks[i]);
    given.sum += work;
    since += work;
    given.most = std::max(given.most, since);
    given.most_beyond_stored = std::max(given.most_beyond_stored, since - least);
    least = std::min(least, since + ticks[i].step.stored);
    const bool has_faded = ticks[i - 1].safety.state == ForceState::fading &&
                           ticks[i].safety.state != ForceState::fading;
    if (has_faded) since = least = 0;
  }
  return given;
}

const char* const kModels[] = {"touch", "omega.6", "sigma.7"};

// However late, jittery and lossy the scene comes and however it jumps, the hand is never given
// more than the tank. Without the controller the same scenes give it more.
TEST(DelayedScene, NoUpdateGivesTheHandMoreThanTheTankAllows) {
  int num_tamed = 0, num_given = 0;
  for (int seed = 0; seed < 24; ++seed) {
    SCOPED_TRACE(seed);
    test::Random random(static_cast<std::uint64_t>(seed + 1));
    const Link link{0.05 * (seed % 7), random.uniform(0, 0.05), 0.05};
    const Wall scene(random);
    const auto images = sent_over(link, random);
    const double hand_turn = random.uniform(1, 8);
    const char* const model = kModels[seed % 3];
    SafetyOptions safety;
    safety.energy_tank = kTank;
    safety.max_slew = seed % 2 == 0 ? 500 : 100;
    const DelayedRun run = feel(model, settings_with(safety), images, scene, hand_turn);
    const Given given = energy_given(run.ticks);
    EXPECT_LE(given.most, kTank + kBehind);
    EXPECT_NEAR(given.sum, run.energy_given, 1e-4 * (1 + std::abs(given.sum)));
    num_given += given.most > kTank / 10;

    safety.passivity_control = false;
    const DelayedRun wild = feel(model, settings_with(safety), images, scene, hand_turn);
    num_tamed += energy_given(wild.ticks).most > kTank;
  }
  EXPECT_GE(num_tamed, 6);
  EXPECT_GE(num_given, 12);  // it is not that there was no force
}

// Energy that friction has taken from the hand is no credit for the scene's next motion.
TEST(DelayedScene, NorMoreThanThatAndWhatIsStoredHoweverMuchFrictionTook) {
  int num_tamed = 0, num_rubbed = 0;
  for (int seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE(seed);
    test::Random random(static_cast<std::uint64_t>(seed + 101));
    const Link link{0.05 * (seed % 7), random.uniform(0, 0.05), 0.05};
    const Wall scene(random);
    const auto images = sent_over(link, random);
    const double hand_turn = random.uniform(1, 8);
    SafetyOptions safety;
    safety.energy_tank = kTank;
    RunSettings settings = settings_with(safety);
    settings.coupling.kind = static_cast<CouplingKind>(seed % 3);
    settings.coupling.friction.coefficient = 0.4;
    const char* const model = kModels[seed / 3 % 3];
    const Given given = energy_given(feel(model, settings, images, scene, hand_turn, kRubs).ticks);
    EXPECT_LE(given.most_beyond_stored, kTank + kBehind);
    num_rubbed += given.sum < -3 * kTank;

    settings.safety.passivity_control = false;
    const DelayedRun wild = feel(model, settings, images, scene, hand_turn, kRubs);
    num_tamed += energy_given(wild.ticks).most_beyond_stored > kTank;
  }
  EXPECT_GE(num_tamed, 6);
  EXPECT_GE(num_rubbed, 6);
}

// A scene that stands still gives back the energy that the hand has put in: nothing is held back,
// though that is more than the tank.
TEST(DelayedScene, ASceneThatStandsStillGivesBackAllThatItWasGiven) {
  test::Random random(7);
  Wall scene(random);
  scene.swing = 0;
  scene.jumps = {{0, 0}};
  for (const CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::proxy, CouplingKind::direct}) {
    SafetyOptions safety;
    safety.energy_tank = kTank / 2;
    RunSettings settings = settings_with(safety);
    settings.coupling.kind = kind;
    const auto images = sent_over({}, random);
    const DelayedRun run = feel("omega.6", settings, images, scene, 4);
    double least = 0, most = 0, damping = 0;
    for (const TickRecord& tick : run.ticks) {
      least = std::min(least, tick.safety.energy);
      most = std::max(most, tick.safety.energy);
      damping = std::max(damping, tick.safety.damping);
    }
    EXPECT_EQ(damping, 0) << name_of(kind) << ": the hand was given " << most << " J";
    EXPECT_EQ(run.ticks.back().safety.num_faults, 0u);
    EXPECT_LT(least, -safety.energy_tank) << name_of(kind);
  }
}

// A delay of a scene that stands still is not felt: the same wrenches, only older.
TEST(DelayedScene, ASceneThatStandsStillMerelyAges) {
  test::Random random(5);
  Wall scene(random);
  scene.swing = 0;
  scene.jumps = {{0, 0}};
  const RunSettings settings = settings_with({});
  const DelayedRun near = feel("omega.6", settings, sent_over({}, random), scene, 4);
  for (const Link link : {Link{0.1, 0, 0}, Link{0.3, 0.05, 0.05}}) {
    const auto images = sent_over(link, random);
    const DelayedRun far = feel("omega.6", settings, images, scene, 4);
    ASSERT_EQ(far.ticks.size(), near.ticks.size());
    std::size_t next = 0;
    double capture = 0, max_force = 0;
    for (std::size_t i = 1; i < far.ticks.size(); ++i) {
      const TickRecord &a = near.ticks[i], &b = far.ticks[i];
      // But for the rounding of blends from one image to the same again.
      ASSERT_LT(norm(a.F_H_B.force - b.F_H_B.force), 1e-9) << i;
      ASSERT_LT(norm(a.F_H_B.torque - b.F_H_B.torque), 1e-10) << i;
      ASSERT_LT(norm(a.step.X_WT.translation - b.step.X_WT.translation), 1e-12) << i;
      // A tick feels what was measured at the one before, and says of when that is.
      ASSERT_NEAR(b.sensor_age, b.device.time - capture, 1e-12) << i;
      for (; next < images.size() && images[next].arrival <= b.device.time; ++next) {
        capture = images[next].capture;
      }
      max_force = std::max(max_force, norm(b.F_H_B.force));
    }
    EXPECT_GT(max_force, 1);
  }
}

}  // namespace
}  // namespace palpate
