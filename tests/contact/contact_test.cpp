// From an image to newtons through the front door, against closed forms.
#include "palpate/contact/contact.h"

#include <cmath>
#include <type_traits>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/sensor.h"
#include "palpate/mesh/mesh.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

constexpr Camera kCamera{160, 120, {140, 140, 79.5, 59.5}};
constexpr double kSide = 0.1, kUnit = 0.001;

Tool cube() { return Tool::pack(make_box({kSide, kSide, kSide}), {.max_spheres = 3000}).value(); }

/// A wall that faces the camera.
std::vector<std::uint16_t> wall(double depth) {
  return std::vector<std::uint16_t>(160 * 120,
                                    static_cast<std::uint16_t>(std::lround(depth / kUnit)));
}
DepthImageView image(const std::vector<std::uint16_t>& counts) {
  return {kCamera.width, kCamera.height, counts.data(), kUnit};
}

/// The cube with its front `depth` meters behind a wall at 0.6 m.
Pose pushed_in(double depth) { return {{0.01, -0.02, 0.6 + depth - kSide / 2}, {}}; }

TEST(Contact, ACubeInAWallIsFeltByItsVolume) {
  const Tool tool = cube();
  const auto counts = wall(0.6);
  for (const ContactMethod& method :
       {ContactMethod(FieldMethod{}),
        ContactMethod(SimplifiedMethod{.volumes = SphereVolumes::represented})}) {
    Sensor sensor = Sensor::create(kCamera).value();
    const Contact contact = std::move(Contact::create(tool, method)).value();
    const SphereVolumes options = contact_options(method).counted();
    for (const double depth : {0.02, 0.05, 0.08}) {
      const ContactResult result = contact.measure(sensor.update(image(counts)), pushed_in(depth));
      const Penetration& measured = result.penetration;
      // Spheres lie in layers, which the wall meets one after the other: 1 % of the tool.
      const double whole = kSide * kSide * kSide;
      EXPECT_EQ(measured.status, ContactStatus{});
      EXPECT_NEAR(measured.volume / whole, depth / kSide, 0.01);
      EXPECT_EQ(contact.fraction(measured), measured.volume / full_volume(tool, options));
      const Wrench F_W = VolumeStiffness{1e6} * measured.measure_W;
      EXPECT_NEAR(F_W.force.z / (1e6 * whole), -depth / kSide, 0.01);
      EXPECT_LT(std::hypot(F_W.force.x, F_W.force.y), 0.02 * std::abs(F_W.force.z));
    }
    EXPECT_EQ(contact.measure(sensor.update(image(counts)), pushed_in(-0.01)).penetration.volume,
              0);
  }
}

/// Memory that a CPU cannot read: a view of it is not followed.
TEST(Contact, OnACpuASurfaceInTheMemoryOfAGpuIsNoSurface) {
  const Tool tool = cube();
  const auto counts = wall(0.6);
  SensorOptions joined;
  joined.field.one_of_several = true;
  Sensor sensor = Sensor::create(kCamera, Place::cpu(), joined).value();
  const SurfaceView here = sensor.update(image(counts));
  SurfaceView there = here;
  there.cloud.gpu = there.field.gpu = there.seen_free.gpu = 0;
  for (const ContactMethod& method :
       {ContactMethod(FieldMethod{}), ContactMethod(WeightedMethod{}),
        ContactMethod(SimplifiedMethod{}), ContactMethod(GraphMethod{})}) {
    const Contact contact = std::move(Contact::create(tool, method)).value();
    const Pose X_WT = pushed_in(0.03);
    ASSERT_GT(contact.measure(here, X_WT).penetration.volume, 0);
    for (const SurfaceBlend& camera :
         {SurfaceBlend{there, there, 1}, SurfaceBlend{here, there, 0.5},
          SurfaceBlend{there, here, 0.5}}) {
      const auto measured = contact.measure({&camera, 1}, X_WT, {.stiffness = true});
      EXPECT_TRUE(measured.penetration.status.has(StepStatus::no_surface));
      if (!std::holds_alternative<FieldMethod>(method)) continue;
      EXPECT_EQ(measured.penetration.volume, 0);
      const SurfaceBlend both[] = {{here, here, 1}, camera};
      EXPECT_EQ(contact.measure(both, X_WT).penetration.status, StepStatus::no_surface);
    }
  }
}

TEST(Contact, CountsAndMetersAreTheSame) {
  const Tool tool = cube();
  const auto counts = wall(0.6);
  std::vector<float> meters;
  for (const auto count : counts) meters.push_back(static_cast<float>(count * kUnit));
  Sensor sensor = Sensor::create(kCamera).value();
  const Contact contact = std::move(Contact::create(tool)).value();
  const auto a = contact.measure(sensor.update(image(counts)), pushed_in(0.03));
  const auto b = contact.measure(sensor.update({160, 120, meters.data()}), pushed_in(0.03));
  EXPECT_GT(a.penetration.volume, 0);
  EXPECT_EQ(a.penetration.volume, b.penetration.volume);
  EXPECT_EQ(a.penetration.measure_W.torque.x, b.penetration.measure_W.torque.x);
}

TEST(Contact, SurfacesStayForAsManyUpdatesAsAsked) {
  const Tool tool = cube();
  const auto near = wall(0.6), far = wall(0.62);
  SensorOptions options;
  options.num_surfaces = 2;
  Sensor sensor = std::move(Sensor::create(kCamera, Place::cpu(), options)).value();
  const Contact contact = std::move(Contact::create(tool)).value();
  const SurfaceView first = sensor.update(image(near));
  const double at_first = contact.measure(first, pushed_in(0.05)).penetration.volume;
  const SurfaceView second = sensor.update(image(far));
  EXPECT_EQ(contact.measure(first, pushed_in(0.05)).penetration.volume, at_first);
  const double at_second = contact.measure(second, pushed_in(0.05)).penetration.volume;
  EXPECT_LT(at_second, 0.7 * at_first);
  EXPECT_NEAR(contact.measure(first, second, 0.25, pushed_in(0.05)).penetration.volume,
              0.75 * at_first + 0.25 * at_second, 1e-9 * at_first);
}

TEST(Contact, ImagesThatCannotBeTakenSayWhyAndAreNoSurface) {
  const Tool tool = cube();
  const auto counts = wall(0.6);
  Sensor sensor = Sensor::create(kCamera).value();
  const Contact contact = std::move(Contact::create(tool)).value();
  const struct {
    DepthImageView image;
    const char* words;
  } cases[] = {{{80, 120, counts.data(), kUnit}, "80 x 120"},
               {{160, 120, static_cast<const float*>(nullptr)}, "without values"},
               {{160, 120, counts.data(), kUnit, 3}, "GPU 3"}};
  for (const auto& c : cases) {
    const SurfaceView surface = sensor.update(c.image);
    ASSERT_FALSE(sensor.status());
    EXPECT_NE(sensor.status().error().message.find(c.words), std::string::npos)
        << sensor.status().error().message;
    const Penetration measured = contact.measure(surface, pushed_in(0.05)).penetration;
    EXPECT_TRUE(measured.status.has(StepStatus::no_surface));
    EXPECT_EQ(measured.volume, 0);
    EXPECT_GT(contact.measure(sensor.update(image(counts)), pushed_in(0.05)).penetration.volume, 0);
    EXPECT_TRUE(sensor.status());
  }
  EXPECT_FALSE(Sensor::create({4, 4, {1, 1, 2, 2}}));
  for (const auto& [num, is_possible] : {std::pair{0, false}, {1, true}, {64, true}, {65, false}}) {
    const Result<Sensor> made =
        Sensor::create(kCamera, Place::cpu(), {.surface = {}, .field = {}, .num_surfaces = num});
    EXPECT_EQ(made.has_value(), is_possible) << num;
  }
}

TEST(Contact, NeitherHalfAllocates) {
  const Tool tool = cube();
  const auto counts = wall(0.6);
  Sensor sensor = Sensor::create(kCamera).value();
  const Contact contact = std::move(Contact::create(tool)).value();
  double sum = contact.measure(sensor.update(image(counts)), pushed_in(0.05)).penetration.volume;
  const test::AllocationCounter counter;
  for (int i = 0; i < 3; ++i) {
    sum += contact.measure(sensor.update(image(counts)), pushed_in(0.05)).penetration.volume;
  }
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_GT(sum, 0);
}

template <class T>
concept TakesTool = requires(T&& tool) {
  Contact::create(std::forward<T>(tool));
};
static_assert(TakesTool<const Tool&> && !TakesTool<Tool>, "a tool must outlive its contact");
static_assert(!std::is_convertible_v<VolumeWrench, Wrench>, "cubic meters are no newtons");

}  // namespace
}  // namespace palpate
