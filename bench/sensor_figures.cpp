// Effect of the presets by kind of sensor on frames of such cameras: noise, false edges, pixels
// between two surfaces, and time. Not a Google Benchmark: make sensor-figures.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <numbers>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/field/depth_field.h"
#include "palpate/io/formats.h"
#include "palpate/settings/setting_table.h"
#include "src/cameras/stream/rectifier.h"

namespace palpate {
namespace {

struct Group {
  const char* name;
  SensorKind sensor;
  std::vector<const char*> files;  ///< in the folder of data
  double focal, unit;
};
const Group kGroups[] = {
    {"Kinect v1",
     SensorKind::structured_light,
     {"frames/pcl_person.png", "frames/pcl_floor_box_chair.png", "frames/pcl_milk_clorox_table.png",
      "frames/pcl_stairs_shelf_1.png", "frames/pcl_stairs_shelf_2.png", "frames/pcl_grabber_1.png",
      "frames/pcl_grabber_2.png", "frames/pcl_grabber_3.png"},
     525,
     0.001},
    {"RealSense SR305, a hand",
     SensorKind::structured_light,
     {"sequences/hand_sr305_20210326-230536/000030.png",
      "sequences/hand_sr305_20210326-230536/000090.png",
      "sequences/hand_sr305_20210326-230536/000170.png"},
     476,
     0.000125},
    {"RealSense, a room",
     SensorKind::active_stereo,
     {"frames/realsense_room_0.png", "frames/realsense_room_2.png", "frames/realsense_room_4.png"},
     617,
     0.001},
    {"RealSense D4xx, a desk",
     SensorKind::active_stereo,
     {"sequences/visp_rbt/depth/000000.png", "sequences/visp_rbt/depth/000006.png",
      "sequences/visp_rbt/depth/000012.png", "sequences/visp_rbt/depth/000018.png",
      "sequences/visp_rbt/depth/000024.png"},
     607,
     0.001},
};

constexpr int kWindow = 7;                        // pixels
constexpr double kOneSurface = 0.03;              // share of the depth
constexpr double kMinDepth = 0.5, kMaxDepth = 3;  // m

struct Depth {
  int width = 0, height = 0;
  std::span<const float> meters;  ///< NaN: none

  double at(int u, int v) const {
    return static_cast<double>(meters[static_cast<std::size_t>(v * width + u)]);
  }
};

/// A frame with its surface.
struct Made {
  SurfaceEstimator surface;
  DepthField field;

  Made(const DepthFrame& frame, const Intrinsics& k, const SurfaceOptions& options,
       ThreadPool& pool)
      : surface(SurfaceEstimator::create(frame.width, frame.height, k, options).value()),
        field(DepthField::create(frame.width, frame.height).value()) {
    surface.update(frame, pool);
    field.update(surface.cloud(), pool);
  }
  Depth depth(const DepthFrame& frame) const {
    return {frame.width, frame.height, surface.depth()};
  }
};

/// Returns the middle pixels of windows of a raw image that show one smooth surface.
std::vector<std::pair<int, int>> smooth_windows(const Depth& raw) {
  std::vector<std::pair<int, int>> middles;
  const int half = kWindow / 2;
  for (int v = half; v + half < raw.height; v += kWindow) {
    for (int u = half; u + half < raw.width; u += kWindow) {
      double low = 1e9, high = 0;
      for (int dv = -half; dv <= half; ++dv) {
        for (int du = -half; du <= half; ++du) {
          const double z = raw.at(u + du, v + dv);
          low = std::isnan(z) ? 0 : std::min(low, z);
          high = std::isnan(z) ? 1e9 : std::max(high, z);
        }
      }
      if (low > kMinDepth && high < kMaxDepth && high - low < kOneSurface * low)
        middles.push_back({u, v});
    }
  }
  return middles;
}

/// Returns the rms residual of 1 / z from a plane: meters at 1 m. NaN: a pixel is missing.
double noise_at(const Depth& depth, int u, int v) {
  const int half = kWindow / 2;
  double sum = 0, along_u = 0, along_v = 0, squares = 0, num = 0, moment = 0;
  for (int dv = -half; dv <= half; ++dv) {
    for (int du = -half; du <= half; ++du) {
      const double w = 1 / depth.at(u + du, v + dv);
      sum += w, along_u += du * w, along_v += dv * w, squares += w * w;
      num += 1, moment += du * du;
    }
  }
  const double rest = squares - sum * sum / num - (along_u * along_u + along_v * along_v) / moment;
  return std::sqrt(std::max(rest, 0.0) / (num - 3));
}

/// Returns the scatter of the normals around their mean, rad rms. NaN: one is missing.
double scatter_at(const PointCloudView& cloud, int u, int v) {
  const int half = kWindow / 2;
  const auto normal = [&](int du, int dv) {
    const auto i = static_cast<std::size_t>((v + dv) * cloud.width + u + du);
    return Vec3d{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
  };
  Vec3d sum;
  for (int dv = -half; dv <= half; ++dv) {
    for (int du = -half; du <= half; ++du) sum += normal(du, dv);
  }
  const double mean_cosine = norm(sum) / (kWindow * kWindow);
  return std::sqrt(2 * std::max(0.0, 1 - mean_cosine));
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return NAN;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

struct Figures {
  std::vector<double> noise;       ///< m at 1 m
  std::vector<double> scatter;     ///< rad, of the normals of a window around their mean, rms
  double milliseconds = INFINITY;  ///< CPU time of the cloud of a frame; the fastest
  double num_removed = 0, num_valid = 0, num_windows = 0, num_false_edges = 0;

  std::string row() const {
    char text[200];
    std::snprintf(text, sizeof text, "%.2f (%.2f) | %.1f | %.1f | %.3f | %.1f",
                  1e3 * quantile(noise, 0.5), 1e3 * quantile(noise, 0.9),
                  180 / std::numbers::pi * quantile(scatter, 0.5),
                  100 * num_false_edges / num_windows, 100 * num_removed / num_valid, milliseconds);
    return text;
  }
};

Figures measure(const std::vector<DepthFrame>& frames, const Intrinsics& k,
                const SurfaceOptions& options, ThreadPool& pool) {
  Figures figures;
  SurfaceOptions untouched;
  untouched.filter.enabled = false;
  for (const DepthFrame& frame : frames) {
    const Made raw(frame, k, untouched, pool);
    Made made(frame, k, options, pool);
    const Depth was = raw.depth(frame), is = made.depth(frame);
    const DepthFieldLevel& level = made.field.view().levels[0];
    for (const auto& [u, v] : smooth_windows(was)) {
      const double noise = noise_at(is, u, v);
      if (std::isfinite(noise)) figures.noise.push_back(noise);
      ++figures.num_windows;
      figures.num_false_edges += level.near_silhouette[v * level.stride + u];
      const double scatter = scatter_at(made.surface.cloud(), u, v);
      if (std::isfinite(scatter)) figures.scatter.push_back(scatter);
    }
    for (std::size_t i = 0; i < was.meters.size(); ++i) {
      figures.num_valid += !std::isnan(was.meters[i]);
      figures.num_removed += !std::isnan(was.meters[i]) && std::isnan(is.meters[i]);
    }
    for (int i = 0; i < 5; ++i) {
      const std::clock_t begin = std::clock();
      made.surface.update(frame, pool);
      figures.milliseconds = std::min(
          figures.milliseconds, 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
    }
  }
  return figures;
}

/// A disc and a slanted bar before a slanted wall as a time-of-flight camera sees them: a pixel
/// measures the mean of its surfaces, weighted by the returned light (1 / z^2), and of its
/// neighbors' according to the spread of the lens; noise of 1.5 mm.
struct Simulated {
  DepthFrame frame;
  std::vector<bool> is_mixed;  ///< farther than 1.5 % from all surfaces in it and around
};
Simulated time_of_flight(double near, double far, double spread) {
  constexpr int kWidth = 320, kHeight = 240, kFine = 4;
  constexpr double kFocal = 252;
  constexpr int kWide = kWidth * kFine, kHigh = kHeight * kFine;
  std::vector<double> fine(static_cast<std::size_t>(kWide * kHigh));
  for (int v = 0; v < kHigh; ++v) {
    for (int u = 0; u < kWide; ++u) {
      const double x = (u + 0.5) / kFine - kWidth / 2.0, y = (v + 0.5) / kFine - kHeight / 2.0;
      const bool is_near = std::hypot(x + 40, y) < 60 || std::abs(0.8 * x + 0.6 * y - 60) < 9;
      fine[static_cast<std::size_t>(v * kWide + u)] = is_near ? near : far / (1 - 0.5 * x / kFocal);
    }
  }
  const int reach = static_cast<int>(3 * spread * kFine);
  std::vector<double> weights;
  for (int i = -reach; i <= reach; ++i) {
    weights.push_back(spread > 0 ? std::exp(-0.5 * i * i / (spread * spread * kFine * kFine)) : 1);
  }
  Simulated made;
  made.frame = {kWidth, kHeight, 0.001, {}, 0};
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 0.0015);
  const int begin = -reach, end = kFine + reach;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      double sum = 0, all = 0, nearest = 1e9, farthest = 0;
      for (int j = begin; j < end; ++j) {
        for (int i = begin; i < end; ++i) {
          const int fu = std::clamp(u * kFine + i, 0, kWide - 1);
          const int fv = std::clamp(v * kFine + j, 0, kHigh - 1);
          const double z = fine[static_cast<std::size_t>(fv * kWide + fu)];
          const auto weight = [&](int at) {
            double total = 0;
            for (int s = 0; s < kFine; ++s) {
              const int off = at - s;
              if (std::abs(off) <= reach) total += weights[static_cast<std::size_t>(off + reach)];
            }
            return total;
          };
          const double light = weight(i) * weight(j) / (z * z);
          sum += light * z, all += light;
          nearest = std::min(nearest, z), farthest = std::max(farthest, z);
        }
      }
      const double z = sum / all;
      made.is_mixed.push_back(z - nearest > 0.015 * z && farthest - z > 0.015 * z);
      made.frame.pixels.push_back(
          static_cast<std::uint16_t>(std::lround(1e3 * (z + noise(random)))));
    }
  }
  return made;
}

void print_time_of_flight(ThreadPool& pool) {
  std::printf(
      "\n| simulated time of flight: near, far, spread of the lens | between two surfaces | of "
      "these "
      "removed | others removed |\n|---|---|---|---|\n");
  const struct {
    double near, far, spread;
  } cases[] = {{0.6, 0.8, 0}, {0.6, 0.8, 0.5}, {0.6, 1.2, 0.5}, {1, 1.2, 0.5}, {1, 1.2, 1}};
  for (const auto& [near, far, spread] : cases) {
    const Simulated seen = time_of_flight(near, far, spread);
    const Intrinsics k{252, 252, 159.5, 119.5};
    const Made made(seen.frame, k, surface_options_for(SensorKind::tof), pool);
    double num_mixed = 0, num_found = 0, num_other = 0;
    for (std::size_t i = 0; i < seen.is_mixed.size(); ++i) {
      const bool is_removed = std::isnan(made.surface.depth()[i]);
      num_mixed += seen.is_mixed[i];
      num_found += seen.is_mixed[i] && is_removed;
      num_other += !seen.is_mixed[i] && is_removed;
    }
    std::printf("| %.1f m, %.1f m, %.1f pixels | %.0f pixels | %.1f %% | %.0f of %zu pixels |\n",
                near, far, spread, num_mixed, 100 * num_found / num_mixed, num_other,
                seen.is_mixed.size() - static_cast<std::size_t>(num_mixed));
  }
}

/// Prints the time of undistorting an image of an Azure Kinect before it is recorded.
void print_straightening() {
  const Intrinsics k{504, 504, 319.5, 239.5};
  Rectifier rectifier({640, 480, k, {}});
  const CameraModel bent{640, 480, k, {3.13, 2.32, 8e-5, -5e-5, 0.13, 3.46, 3.35, 0.66}};
  DepthFrame frame{640, 480, 0.001, std::vector<std::uint16_t>(640 * 480, 800), 0};
  rectifier.apply(bent, frame);  // builds the table
  std::vector<double> milliseconds;
  for (int i = 0; i < 300; ++i) {
    const std::clock_t begin = std::clock();
    rectifier.apply(bent, frame);
    milliseconds.push_back(1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  std::printf(
      "\nstraightening 640 x 480 pixels on the CPU: %.2f ms of a core (median), %.2f ms (90 %%)\n",
      quantile(milliseconds, 0.5), quantile(milliseconds, 0.9));
}

int run(const std::filesystem::path& data) {
  ThreadPool pool(1);
  std::printf(
      "| camera | surfaces | noise at 1 m, mm: median (90 %%) | normals, degrees | false edges, %% "
      "| "
      "pixels removed, %% | ms of a core |\n|---|---|---|---|---|---|---|\n");
  for (const Group& group : kGroups) {
    std::vector<DepthFrame> frames;
    for (const char* file : group.files) {
      auto frame = load_depth_png(data / file, group.unit);
      if (!frame) {
        std::fprintf(stderr, "sensor_figures: %s\n", frame.error().message.c_str());
        return 1;
      }
      frames.push_back(*std::move(frame));
    }
    const Intrinsics k{group.focal, group.focal, 319.5, 239.5};
    SurfaceOptions raw;
    raw.filter.enabled = false;
    const SurfaceOptions of_kind = surface_options_for(group.sensor);
    const auto bilateral = [](SurfaceOptions options) {
      options.filter.smoothing = Smoothing::bilateral;
      return options;
    };
    const std::string kind = name_of(group.sensor);
    const std::pair<std::string, SurfaceOptions> kinds[] = {
        {"raw", raw},
        {"bilateral", bilateral({})},
        {"bilateral, " + kind, bilateral(of_kind)},
        {"adaptive, " + kind, of_kind}};
    for (const auto& [name, options] : kinds) {
      std::printf("| %s | %s | %s |\n", group.name, name.c_str(),
                  measure(frames, k, options, pool).row().c_str());
    }
  }
  print_time_of_flight(pool);
  print_straightening();
  return 0;
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: sensor_figures FOLDER_OF_RECORDED_FRAMES\n");
    return 2;
  }
  return palpate::run(argv[1]);
}
