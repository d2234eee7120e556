#include "palpate/cameras/cameras.h"

#include <gtest/gtest.h>

#include "src/cameras/stream/raw_frames.h"

namespace palpate {
namespace {

TEST(CameraUri, ReadsEveryParameter) {
  const auto uri = parse_camera_uri(
      "pipe:/tmp/a:b?intrinsics=525,526.5,319.5,239.5&distortion=0.1,-0.2,0.001,0.002,0.3,0.4,0.5,"
      "0.6&size=640x480&unit=0.0002&rate=15&latency=0.03&pose=0,0,0,0,0,0,1&sensor=tof&crop=valid&"
      "header=1");
  ASSERT_TRUE(uri) << uri.error().message;
  EXPECT_EQ(uri->kind, "pipe");
  EXPECT_EQ(uri->target, "/tmp/a:b");
  EXPECT_EQ(*uri->intrinsics, (Intrinsics{525, 526.5, 319.5, 239.5}));
  EXPECT_EQ(*uri->distortion, (Distortion{0.1, -0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6}));
  EXPECT_EQ(*uri->size, (ImageSize{640, 480}));
  EXPECT_EQ(*uri->unit, 0.0002);
  EXPECT_EQ(*uri->rate, 15);
  EXPECT_EQ(uri->latency, 0.03);
  EXPECT_EQ(uri->sensor, SensorKind::tof);
  EXPECT_TRUE(uri->is_cropped);
  EXPECT_EQ(uri->extras.at("header"), "1");
}

TEST(CameraUri, ShortFormsAndFiveCoefficients) {
  EXPECT_EQ(parse_camera_uri("openni2")->kind, "openni2");
  EXPECT_EQ(parse_camera_uri("openni2")->target, "");
  EXPECT_EQ(parse_camera_uri("bag:run.mcap?topic=/depth")->extras.at("topic"), "/depth");
  EXPECT_EQ(*parse_camera_uri("k4a?distortion=1,2,3,4,5")->distortion,
            (Distortion{1, 2, 3, 4, 5, 0, 0, 0}));
}

TEST(CameraUri, NamesWhatIsWrong) {
  const char* const wrong[] = {
      "a?intrinsics=1,2,3",
      "a?intrinsics=0,2,3,4",
      "a?intrinsics=1,2,3,x",
      "a?distortion=1,2,3",
      "a?size=640",
      "a?size=4x4",
      "a?size=5000x480",
      "a?unit=0",
      "a?unit=nan",
      "a?rate=-1",
      "a?latency=2",
      "a?sensor=laser",
      "a?crop=all",
      "a?pose=1,2,3",
      "a?pose=1,0,0,0,0,0,2",
      "a?intrinsics",
      "a?=3",
      "a?intrinsics=1,2,3,4,",
      "a?distortion=1e30,0,0,0",
      "a?rate=10&rate=20",
      "a?pose=0,0,0,0,0,0,1&unit=0.001&pose=0,0,1,0,0,0,1",
      "a?noise=off&noise=on",
  };
  for (const char* text : wrong) {
    const auto uri = parse_camera_uri(text);
    ASSERT_FALSE(uri) << text;
    EXPECT_NE(uri.error().message.find("camera a"), std::string::npos) << uri.error().message;
  }
}

TEST(CameraModels, TellHowTheyMeasure) {
  EXPECT_EQ(sensor_of_model("Intel RealSense D435I"), SensorKind::active_stereo);
  EXPECT_EQ(sensor_of_model("Intel RealSense SR305"), SensorKind::structured_light);
  EXPECT_EQ(sensor_of_model("Intel RealSense L515"), SensorKind::tof);
  EXPECT_EQ(sensor_of_model("Orbbec Femto Bolt"), SensorKind::tof);
  EXPECT_EQ(sensor_of_model("Orbbec Gemini 335"), SensorKind::active_stereo);
  EXPECT_EQ(sensor_of_model("Astra Pro Plus"), SensorKind::structured_light);
  EXPECT_EQ(sensor_of_model("HD Webcam"), SensorKind::none);
}

TEST(OpenCamera, SaysWhichKindsThereAreAndWhatIsMissing) {
  const auto message = [](const char* uri) { return open_camera(uri).error().message; };
  EXPECT_NE(message("webcam:0").find("folder:DIR"), std::string::npos);
  EXPECT_NE(message("folder:nowhere").find("no such folder"), std::string::npos);
  EXPECT_NE(message("folder:nowhere?intrinsics=1,1,1,1").find("no such folder"), std::string::npos);
  EXPECT_NE(message("folder:x?topic=a").find("'topic'"), std::string::npos);
  EXPECT_NE(message("folder:x?flow=y&intrinsics=1,1,1,1").find("no such folder"),
            std::string::npos);
  EXPECT_NE(message("scene:nothing").find("hand"), std::string::npos);
  EXPECT_NE(message("scene:hand?noise=loud").find("on or off"), std::string::npos);
}

TEST(FindCameras, TellsEveryKindOnce) {
  const auto found = find_cameras();
  std::vector<std::string> kinds;
  for (const auto& each : found) {
    kinds.push_back(each.kind);
    EXPECT_FALSE(each.reason.empty()) << each.kind;
    EXPECT_TRUE(each.usage.starts_with(each.kind));
  }
  for (const char* kind : {"scene", "folder", "pipe"}) {
    EXPECT_EQ(std::count(kinds.begin(), kinds.end(), kind), 1) << kind;
  }
}

TEST(SceneCamera, IsAsLargeAndFastAsAskedFor) {
  const auto camera =
      open_camera("scene:hand?size=160x120&rate=10&noise=off&seed=3", {true, 0.35}).value();
  EXPECT_EQ(camera->info().width, 160);
  EXPECT_EQ(camera->info().height, 120);
  DepthFrame frame;
  int num = 0;
  while (*camera->next(frame)) {
    EXPECT_EQ(frame.pixels.size(), 160u * 120u);
    EXPECT_DOUBLE_EQ(frame.timestamp, num++ / 10.0);
  }
  EXPECT_EQ(num, 4);
}

}  // namespace
}  // namespace palpate
