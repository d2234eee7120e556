// Cameras whose own libraries show nothing without a device, played by libraries of the tests.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "palpate/cameras/cameras.h"
#include "src/cameras/camera_kinds.h"
#include "tests/cameras/conformance.h"
#include "tests/cameras/fake_camera.h"

namespace palpate {
namespace {

struct Emulated {
  const char* kind;
  const char* variable;
  const char* library;
  const char* control;
  int width, height;
  FindKind& find;
  OpenKind& open;
};

void PrintTo(const Emulated& each, std::ostream* out) { *out << each.kind; }

class EmulatedCamera : public testing::TestWithParam<Emulated> {
 protected:
  void SetUp() override {
    setenv(GetParam().variable, GetParam().library, 1);
    ASSERT_TRUE(GetParam().find().is_usable);
    void* const library = dlopen(GetParam().library, RTLD_NOW | RTLD_NOLOAD);
    ASSERT_NE(library, nullptr);
    void* const control = dlsym(library, GetParam().control);
    ASSERT_NE(control, nullptr);
    control_ = reinterpret_cast<test::FakeCamera* (*)()>(control)();
    control_->is_plugged = true;
    control_->is_stalled = false;
    control_->microseconds = 5000;
  }
  void TearDown() override {
    EXPECT_EQ(control_->num_objects, 0) << "not given back to the library";
  }
  static Result<std::unique_ptr<DepthSource>> open() { return open_camera(GetParam().kind); }
  static std::vector<std::uint16_t> sent(int width, int height, int number) {
    return test::pattern(width, height, number % test::kNumPatterns);
  }

  test::FakeCamera* control_ = nullptr;
};

TEST_P(EmulatedCamera, Conforms) {
  const std::string kind = GetParam().kind;
  EXPECT_EQ(GetParam().find().devices, std::vector<std::string>{kind + ":0"});
  test::expect_camera(open, 30, GetParam().width, GetParam().height, sent);
  test::expect_outlives_unplugging(open,
                                   [&](bool is_plugged) { control_->is_plugged = is_plugged; });
  test::expect_outlives_a_stall(open, [&](bool is_stalled) { control_->is_stalled = is_stalled; });
  control_->is_plugged = false;
  const auto refused = open();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("number 0"), std::string::npos) << refused.error().message;
  EXPECT_TRUE(GetParam().find().devices.empty());
}

TEST_P(EmulatedCamera, TenThousandFramesTakeNoMemory) {
  control_->microseconds = 0;
  const auto raw = GetParam().open(parse_camera_uri(GetParam().kind).value(), {});
  ASSERT_TRUE(raw) << raw.error().message;
  test::expect_no_growth(*raw->source, 10000);
}

INSTANTIATE_TEST_SUITE_P(
    All, EmulatedCamera,
    testing::Values(Emulated{"k4a", "K4A_LIBRARY", FAKE_K4A_LIBRARY, "palpate_fake_k4a", 640, 576,
                             find_k4a_cameras, open_k4a_camera},
                    Emulated{"freenect", "FREENECT_LIBRARY", FAKE_FREENECT_LIBRARY,
                             "palpate_fake_freenect", 640, 480, find_freenect_cameras,
                             open_freenect_camera}),
    [](const auto& each) { return std::string(each.param.kind); });

}  // namespace
}  // namespace palpate
