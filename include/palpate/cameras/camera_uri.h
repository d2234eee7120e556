// The words that name a depth camera: KIND[:TARGET][?NAME=VALUE&...].
#pragma once

#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/cloud/intrinsics.h"
#include "palpate/cloud/sensor_kind.h"
#include "palpate/core/result.h"
#include "palpate/math/pose.h"

namespace palpate {

struct ImageSize {
  int width = 0, height = 0;

  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

/// What such a text says. Parameters win over what the stream says of itself:
///   intrinsics=fx,fy,cx,cy  distortion=k1,k2,p1,p2[,k3[,k4,k5,k6]]  size=WIDTHxHEIGHT
///   unit=METRES_PER_COUNT  rate=HZ  latency=SECONDS  sensor=KIND  crop=none|valid
///   pose=tx,ty,tz,qx,qy,qz,qw  poses=FILE: X_WC, or that of a camera that moves, by time (TUM)
struct CameraUri {
  std::string text;          ///< as it was given, for humans
  std::string kind, target;  ///< "folder" and "frames/"
  std::optional<Intrinsics> intrinsics;
  std::optional<Distortion> distortion;
  std::optional<ImageSize> size;
  std::optional<double> unit, rate;
  std::optional<SensorKind> sensor;
  bool is_cropped = false;  ///< to the largest rectangle whose every pixel the lens can see
  double latency = 0;       ///< s, from the exposure to the time stamp
  Pose X_WC;                ///< of the camera in the world
  std::string poses;        ///< file of X_WC by time; empty: it stands still
  std::map<std::string, std::string> extras;  ///< parameters that only some kinds know

  /// Error: an extra parameter other than these, which this kind knows.
  Status check_extras(std::initializer_list<std::string_view> known = {}) const;
};

/// Errors: a parameter that is not what it should be, with its name. Kinds are not checked here.
Result<CameraUri> parse_camera_uri(std::string_view text);

}  // namespace palpate
