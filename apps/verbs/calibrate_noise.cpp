#include "apps/verbs/calibrate_noise.h"

#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/output_files.h"
#include "apps/sensor_choice.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "apps/touch/sources.h"
#include "palpate/cameras/cameras.h"
#include "palpate/session/run.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/cloud/internal/noise_measurement.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::apps {
namespace {

SensorNoise mode_of(const DepthStreamInfo& stream) {
  SensorNoise mode;
  mode.kind = stream.sensor;
  mode.width = stream.width;
  mode.height = stream.height;
  mode.unit = stream.unit;
  return mode;
}

std::string text_of(const SensorNoise& mode) {
  char text[120];
  std::snprintf(text, sizeof text, "%d x %d pixels of %g m (%s)", mode.width, mode.height,
                mode.unit, name_of(mode.kind).c_str());
  return text;
}

/// Reads the frames of one scene; sets the mode, or checks that it is the same.
Result<std::vector<DepthFrame>> read_scene(const std::string& text, int num_frames,
                                           SensorNoise& mode) {
  const auto uri = parse_camera_uri(text);
  if (!uri) return Error{uri.error().code, "--" + uri.error().message};
  const auto source = open_camera(*uri, opening());
  if (!source) return source.error();
  const DepthStreamInfo& stream = (*source)->info();
  if (stream.is_moving) {
    return Error{Errc::bad_input,
                 text + ": the camera moves; noise is measured with one that stands still"};
  }
  if (projection_of(**source)) {
    return Error{Errc::bad_input,
                 text +
                     ": its clouds are projected into images, whose noise is not that of a "
                     "sensor; give the depth images of the camera, or its organized clouds"};
  }
  const SensorNoise own = mode_of(stream);
  if (mode.width == 0) mode = own;
  if (text_of(own) != text_of(mode)) {
    return Error{Errc::bad_input, text + " has " + text_of(own) + ", and the first scene " +
                                      text_of(mode) + "; measure one camera in one mode"};
  }
  std::vector<DepthFrame> frames;
  for (DepthFrame frame; static_cast<int>(frames.size()) < num_frames;) {
    const auto got = (*source)->next(frame);
    if (!got) return got.error();
    if (!*got) break;
    drop_far_codes(frame, stream.sensor);
    frames.push_back(frame);
  }
  return frames;
}

void print(const SensorNoise& sensor, const NoiseTable& measured, const NoiseOptions& options) {
  if (options.json) {
    nlohmann::ordered_json table = nlohmann::ordered_json::array(), near = table;
    for (const NoiseAtDepth& at : measured.by_depth) {
      table.push_back({{"depth", at.depth},
                       {"deviation_mm", 1e3 * at.deviation},
                       {"variance_mm2", 1e6 * at.deviation * at.deviation},
                       {"pixels", at.num_pixels}});
    }
    for (std::size_t i = 0; i < measured.correlation.size(); ++i) {
      near.push_back({{"pixels", kNoiseDistances[i]}, {"correlation", measured.correlation[i]}});
    }
    print_json({{"noise_mm", 1e3 * sensor.noise.at_zero},
                {"noise_growth_mm", 1e3 * sensor.noise.growth},
                {"noise_length", sensor.noise.length},
                {"by_depth", table},
                {"by_distance", near}});
    return;
  }
  for (const NoiseAtDepth& at : measured.by_depth) {
    std::printf("at %5.2f m     %6.2f mm, fitted %.2f mm (%zu pixels)\n", at.depth,
                1e3 * at.deviation, 1e3 * sensor.noise.deviation(at.depth), at.num_pixels);
  }
  for (std::size_t i = 0; i < measured.correlation.size(); ++i) {
    std::printf("%d pixels apart  correlation %.2f\n", kNoiseDistances[i], measured.correlation[i]);
  }
  std::printf("noise          %.3g mm + %.3g mm z^2 (z in m), shared over %.2g pixels\n",
              1e3 * sensor.noise.at_zero, 1e3 * sensor.noise.growth, sensor.noise.length);
  std::printf("written        %s\n", options.output.c_str());
}

}  // namespace

Status calibrate_noise(const NoiseOptions& options) {
  if (const Status status = check_output_file(options.output, OutputKind::sensor); !status) {
    return status;
  }
  SensorNoise sensor;
  NoiseMeasurement measurement;
  for (const std::string& camera : options.cameras) {
    const auto frames = read_scene(camera, options.num_frames, sensor);
    if (!frames) return frames.error();
    if (const Status status = measurement.add(camera, *frames); !status) return status;
  }
  const DepthAverageOptions usual = depth_average_options_for(sensor.kind);
  const auto measured = measurement.result({usual.noise, usual.noise_growth, 0});
  if (!measured) return measured.error();
  sensor.noise = measured->noise;
  sensor.nearest = measured->by_depth.front().depth;
  sensor.farthest = measured->by_depth.back().depth;
  const Status written = write_file_atomically(options.output, settings_toml(settings_of(sensor)));
  if (!written) return written;
  print(sensor, *measured, options);
  return Done{};
}

}  // namespace palpate::apps
