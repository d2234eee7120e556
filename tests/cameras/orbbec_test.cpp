// The Orbbec SDK as a library of the tests plays it.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "palpate/cameras/cameras.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/orbbec_api.h"
#include "tests/cameras/conformance.h"
#include "tests/cameras/fake_orbbec.h"

namespace palpate {
namespace {

using test::FakeOrbbec;

class Orbbec : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    setenv("ORBBEC_LIBRARY", FAKE_ORBBEC_LIBRARY, 1);
    ASSERT_TRUE(orbbec::api()) << orbbec::api().error().message;
    void* const library = dlopen(FAKE_ORBBEC_LIBRARY, RTLD_NOW | RTLD_NOLOAD);
    ASSERT_NE(library, nullptr);
    control_ = reinterpret_cast<FakeOrbbec* (*)()>(dlsym(library, "palpate_fake_orbbec"))();
  }
  void SetUp() override {
    control_->is_plugged = true;
    control_->is_stalled = control_->is_busy = false;
    control_->microseconds = 5000;
    control_->millimeters = 0.1f;
  }
  void TearDown() override { EXPECT_EQ(control_->num_objects, 0); }
  static Result<std::unique_ptr<DepthSource>> open() { return open_camera("orbbec?size=64x48"); }
  static void expect_refused(const char* text, const char* words) {
    const auto refused = open_camera(text);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message.find(words), std::string::npos) << refused.error().message;
  }

  inline static FakeOrbbec* control_ = nullptr;
};

TEST_F(Orbbec, IsFoundWithItsVersionAndCamera) {
  const FoundCameras found = find_orbbec_cameras();
  EXPECT_TRUE(found.is_usable);
  EXPECT_EQ(found.version, "2.9.3");
  EXPECT_EQ(found.devices, std::vector<std::string>{"orbbec:AY123"});
}

TEST_F(Orbbec, RefusesWhatItCannotDo) {
  expect_refused("orbbec:AY9", "serial number AY9");
  expect_refused("orbbec?size=100x100", "it has 320x240 at 30 Hz, 64x48 at 30 Hz, 640x576");
  control_->is_busy = true;
  expect_refused("orbbec", "Device is in use");
  control_->is_plugged = false;
  expect_refused("orbbec", "sees no camera");
}

TEST_F(Orbbec, Conforms) {
  EXPECT_EQ((*open_camera("orbbec:AY123"))->info().width, 640);
  EXPECT_EQ((*open_camera("orbbec"))->info().sensor, SensorKind::tof);
  EXPECT_EQ(find_orbbec_cameras().reason, "Orbbec Femto Bolt");
  test::expect_camera(open, 30, 64, 48);
  test::expect_outlives_unplugging(open,
                                   [](bool is_plugged) { control_->is_plugged = is_plugged; });
  test::expect_outlives_a_stall(open, [](bool is_stalled) { control_->is_stalled = is_stalled; });
}

TEST_F(Orbbec, SaysThatALensIsNotKnown) {
  const auto notes_of = [](int lens, float k1, const char* uri) {
    control_->lens = lens;
    control_->k1 = k1;
    const auto camera = open_camera(uri).value();
    DepthFrame frame;
    EXPECT_TRUE(*camera->next(frame));
    control_->lens = 4;
    control_->k1 = 0;
    return test::all_notes(*camera);
  };
  const char* const words = "distortion is of a model that is not known";
  EXPECT_NE(notes_of(2, 0.1f, "orbbec?size=64x48").find(words), std::string::npos);
  for (const auto& [lens, k1] : {std::pair(3, 0.1f), {4, 0.1f}, {2, 0.0f}, {0, 0.1f}}) {
    EXPECT_EQ(notes_of(lens, k1, "orbbec?size=64x48").find(words), std::string::npos) << lens;
  }
  EXPECT_EQ(notes_of(2, 0.1f, "orbbec?size=64x48&distortion=0.1,0,0,0").find(words),
            std::string::npos);
}

TEST_F(Orbbec, FollowsAnotherSizeAndUnit) {
  const auto camera = open().value();
  DepthFrame frame;
  ASSERT_TRUE(*camera->next(frame));
  EXPECT_DOUBLE_EQ(frame.unit, 0.0001);
  control_->width = 32;
  control_->height = 24;
  control_->millimeters = 1;
  EXPECT_TRUE(test::next_until(*camera, frame, [&] { return frame.unit == 0.001; }));
  EXPECT_EQ(frame.width, 64);
  const std::string notes = test::all_notes(*camera);
  EXPECT_NE(notes.find("from 64 x 48 to 32 x 24 pixels"), std::string::npos) << notes;
}

TEST_F(Orbbec, TenThousandFramesTakeNoMemory) {
  control_->microseconds = 50;
  const auto raw = open_orbbec_camera(parse_camera_uri("orbbec?size=64x48").value(), {}).value();
  test::expect_no_growth(*raw.source, 10000);
}

}  // namespace
}  // namespace palpate
