// Messages of a depth camera in bags of ROS 1.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/io/ros1_bag_writer.h"

namespace palpate::test {

inline constexpr int kWidth = 32, kHeight = 24;

/// A frame of a bag: how the camera is then.
struct Shot {
  std::uint32_t seconds = 100, nanoseconds = 0;
  int width = kWidth, height = kHeight;
  double fx = 30;  // of an image of kWidth; 0: the camera is not calibrated
  std::uint32_t binning = 0;
  std::array<std::uint32_t, 4> roi{};  // x, y, height, width
  std::string frame = "cam";
  std::string model = "plumb_bob";
  std::vector<double> distortion;
  int info_width = kWidth;
};

inline Bytes stamp_of(const Shot& shot) {
  return ros1_stamp(shot.seconds, shot.nanoseconds, shot.frame);
}
inline void add_number(Bytes& to, double number) {
  to.number(std::bit_cast<std::uint64_t>(number));
}

inline std::string camera_info(const Shot& shot) {
  Bytes info = stamp_of(shot);
  info.number(kHeight).number(shot.info_width).text(shot.model);
  info.number(static_cast<std::uint32_t>(shot.distortion.size()));
  for (const double d : shot.distortion) add_number(info, d);
  const double K[] = {shot.fx, 0, 15.5, 0, shot.fx, 11.5, 0, 0, 1};
  const double R[] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double P[] = {shot.fx, 0, 15.5, 0, 0, shot.fx, 11.5, 0, 0, 0, 1, 0};
  for (const double k : K) add_number(info, k);
  for (const double r : R) add_number(info, r);
  for (const double p : P) add_number(info, p);
  for (int i = 0; i < 2; ++i) info.number(shot.binning);
  for (const std::uint32_t number : shot.roi) info.number(number);
  return info.number(std::uint8_t{0}).str();
}

/// Half a meter left of the middle, twice as far right of it, in millimeters.
inline std::uint16_t count_at(const Shot& shot, int u) { return 2 * u < shot.width ? 500 : 1000; }

inline std::string image(const Shot& shot) {
  std::string counts;
  for (int v = 0; v < shot.height; ++v) {
    for (int u = 0; u < shot.width; ++u) counts += bytes_of(count_at(shot, u));
  }
  return ros1_image(stamp_of(shot), shot.width, shot.height, counts);
}

/// The same in 32FC1, each number of so many meters.
inline std::string float_image(const Shot& shot, double unit) {
  Bytes numbers;
  for (int v = 0; v < shot.height; ++v) {
    for (int u = 0; u < shot.width; ++u) {
      numbers.number(
          std::bit_cast<std::uint32_t>(static_cast<float>(0.001 * count_at(shot, u) / unit)));
    }
  }
  Bytes message = stamp_of(shot);
  message.number(shot.height).number(shot.width).text("32FC1").number(std::uint8_t{0});
  return message.number(4 * shot.width).text(numbers.str()).str();
}

inline std::string compressed_image(const Shot& shot, std::string_view format,
                                    std::string_view data) {
  return stamp_of(shot).text(format).text(data).str();
}

/// tf2_msgs/TFMessage of one transform: 1 m along x.
inline std::string transform(const std::string& parent, const std::string& child,
                             const std::array<double, 4>& q) {
  Bytes message;
  message.number(1).raw(ros1_stamp(100, 0, parent).str()).text(child);
  for (const double number : {1.0, 0.0, 0.0, q[0], q[1], q[2], q[3]}) add_number(message, number);
  return message.str();
}

}  // namespace palpate::test
