// The camera of a cloud: recovered where the cloud is an image, else chosen by its density.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "src/cloud/internal/cloud_camera.h"
#include "src/cloud/internal/frame_limits.h"

namespace palpate { inline namespace v0 {
namespace {

bool is_in_front(const Vec3f& p) { return p.z > 0 && is_measured(p); }

/// Least squares of pixel = focal * slope + center along one axis of the image.
struct LineFit {
  double n = 0, slope = 0, pixel = 0, slope2 = 0, both = 0, pixel2 = 0;  // sums
  double lowest = INFINITY, highest = -INFINITY;                         // slopes

  void add(double s, double at) {
    n += 1;
    slope += s;
    pixel += at;
    slope2 += s * s;
    both += s * at;
    pixel2 += at * at;
    lowest = std::min(lowest, s);
    highest = std::max(highest, s);
  }
};

struct PinholeAxis {
  double focal = 0, center = 0, rms = 0;          // pixels
  double fitted = 0, mean_slope = 0, middle = 0;  // focal, and a point of the line: slope, pixel
};

/// Numbers within `reach` of one: with few decimals first, then of single precision, as drivers
/// have them, then with up to 6 decimals.
std::vector<double> numbers_near(double value, double reach) {
  std::vector<double> all;
  const auto add_with = [&](double parts) {
    for (double k = std::ceil((value - reach) * parts); k <= (value + reach) * parts; ++k) {
      all.push_back(k / parts);
    }
  };
  for (const double parts : {1.0, 2.0, 10.0, 100.0, 1e3, 1e4}) add_with(parts);
  const auto middle = static_cast<float>(value);
  for (const float single :
       {middle, std::nextafter(middle, -INFINITY), std::nextafter(middle, INFINITY)}) {
    if (std::abs(double(single) - value) <= reach) all.push_back(double(single));
  }
  for (const double parts : {1e5, 1e6}) add_with(parts);
  return all;
}

/// The number with the fewest decimals within the tolerance.
double roundest(double value, double tolerance) {
  for (const double parts : {1.0, 2.0, 10.0, 100.0, 1e3, 1e4, 1e5}) {
    const double rounded = std::round(value * parts) / parts;
    if (std::abs(rounded - value) <= tolerance) return rounded;
  }
  return value;
}

std::optional<PinholeAxis> solve(const LineFit& f) {
  constexpr double kMinRange = 3;  // pixels
  const double mean = f.slope / f.n, pixel = f.pixel / f.n;
  const double spread = f.slope2 - f.n * mean * mean, mixed = f.both - f.n * mean * pixel;
  if (!(spread > 0) || !(mixed > 0)) return {};
  PinholeAxis axis;
  axis.focal = axis.fitted = mixed / spread;
  axis.mean_slope = mean;
  axis.middle = pixel;
  const double left = std::max(0.0, f.pixel2 - f.n * pixel * pixel - axis.focal * mixed);
  axis.rms = std::sqrt(left / f.n);
  if (axis.focal * (f.highest - f.lowest) < kMinRange) return {};
  // Within the precision of the numbers, and the scatter of the points, all fits are equal.
  constexpr double kPrecision = 1e-5, kSigmas = 8;  // pixels
  const double tolerance = std::max(kPrecision, kSigmas * axis.rms / std::sqrt(f.n));
  const double lever = std::max(f.highest - mean, mean - f.lowest);
  axis.focal = roundest(axis.focal, tolerance / lever);
  axis.center = roundest(pixel - axis.focal * mean, tolerance);
  return axis;
}

/// The depth of a point: before it was narrowed to single precision, if it is a multiple of the
/// unit.
double unrounded_depth(const Vec3f& p, const std::optional<double>& unit) {
  const double counted = unit ? *unit * std::round(double(p.z) / *unit) : 0;
  return static_cast<float>(counted) == p.z ? counted : double(p.z);
}

/// Takes the roundest numbers near the fit that give 99 % of the points to the bit, if there are
/// such: those that the points were made with.
void make_exact(const PointsView& cloud, const std::optional<double>& unit, int axis_number,
                PinholeAxis& axis) {
  constexpr double kNear = 1e-5;  // pixels
  constexpr std::size_t kNumSamples = 1000, kMaxOff = kNumSamples / 100;
  const std::size_t step = cloud.points.size() / kNumSamples + 1;
  const auto width = static_cast<std::size_t>(cloud.width);
  const auto gives_points = [&](double focal, double center) {
    std::size_t num = 0, num_off = 0;
    for (std::size_t i = 0; i < cloud.points.size() && num_off <= kMaxOff; i += step) {
      const Vec3f& p = cloud.points[i];
      if (!is_in_front(p)) continue;
      const auto at = static_cast<double>(axis_number == 0 ? i % width : i / width);
      ++num;
      num_off +=
          static_cast<float>((at - center) / focal * unrounded_depth(p, unit)) != p[axis_number];
    }
    return 100 * num_off <= num;
  };
  for (const double focal : numbers_near(axis.fitted, kNear)) {
    const double fitted = axis.middle - focal * axis.mean_slope;
    for (const double center : numbers_near(fitted, kNear)) {
      if (!gives_points(focal, center)) continue;
      axis.focal = focal;
      axis.center = center;
      return;
    }
  }
}

/// Directions into which an image may reach: tangents.
constexpr double kWidest = 1.7320508075688772, kWidestLook = 1;

struct Extent {
  double left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY;  // tangents
  std::size_t num = 0;                                                            // points in it
};

/// Calls `use(x/z, y/z)` for each point that an image of that width may show.
template <class Use>
void for_each_slope(const PointsView& cloud, const Quaternion& R_FC, double widest,
                    const Use& use) {
  const Mat3d R_CF = rotation_matrix(conjugate(R_FC));
  for (const Vec3f& p : cloud.points) {
    if (!is_measured(p)) continue;
    const Vec3d p_C = R_CF * to_double(p);
    const double x = p_C.x / p_C.z, y = p_C.y / p_C.z;
    if (p_C.z > 0 && std::abs(x) <= widest && std::abs(y) <= widest) use(x, y);
  }
}

/// Returns the side of a pixel (tangent) with two points in it, where the cloud is thin: in three
/// quarters of what is seen there are more. O(points), a few times.
double pixel_side(const PointsView& cloud, const Quaternion& R_FC, double widest,
                  const Extent& seen) {
  constexpr double kPerPixel = 2, kPerCell = 16;
  constexpr std::size_t kMaxCells = std::size_t{1} << 24;
  const double width = seen.right - seen.left, height = seen.bottom - seen.top;
  const double longest = std::max({width, height, 1e-6});
  double side = std::max(std::sqrt(width * height * kPerCell / static_cast<double>(seen.num)),
                         longest / 4096);
  std::vector<std::uint32_t> cells;
  for (;;) {
    const auto wide = static_cast<std::size_t>(width / side) + 1;
    const auto high = static_cast<std::size_t>(height / side) + 1;
    if (wide * high <= kMaxCells) {
      cells.assign(wide * high, 0);
      for_each_slope(cloud, R_FC, widest, [&](double x, double y) {
        ++cells[static_cast<std::size_t>((y - seen.top) / side) * wide +
                static_cast<std::size_t>((x - seen.left) / side)];
      });
      std::erase(cells, 0u);
      const auto thin = cells.begin() + std::ssize(cells) / 4;
      std::ranges::nth_element(cells, thin);
      const bool is_enough = *thin >= kPerCell / 2 || side > longest;
      if (is_enough) return side * std::sqrt(kPerPixel / *thin);
    }
    side *= 1.5;
  }
}

/// The rotation of a camera that looks along `axis`, upright in a frame whose z is up.
Quaternion looking(const Vec3d& axis) {
  constexpr Quaternion kAlongX{-0.5, 0.5, -0.5, 0.5};
  const Vec3d way = normalized(axis);
  return axis_angle({0, 0, 1}, std::atan2(way.y, way.x)) *
         axis_angle({0, 1, 0}, -std::asin(std::clamp(way.z, -1.0, 1.0))) * kAlongX;
}

Extent extent_of(const PointsView& cloud, const Quaternion& R_FC, double widest) {
  Extent seen;
  for_each_slope(cloud, R_FC, widest, [&](double x, double y) {
    seen.left = std::min(seen.left, x);
    seen.right = std::max(seen.right, x);
    seen.top = std::min(seen.top, y);
    seen.bottom = std::max(seen.bottom, y);
    ++seen.num;
  });
  return seen;
}

/// Returns the finest unit (m), a multiple of that of 32FC1 images, in which the farthest point has
/// a count.
double unit_for(const PointsView& cloud, const Quaternion& R_FC) {
  constexpr double kMaxCounts = 60000;
  const Mat3d R_CF = rotation_matrix(conjugate(R_FC));
  double farthest = 0;
  for (const Vec3f& p : cloud.points) {
    if (is_measured(p)) farthest = std::max(farthest, (R_CF * to_double(p)).z);
  }
  const double units = std::max(1.0, std::ceil(farthest / (kMaxCounts * kFloatUnit)));
  return std::min(units * kFloatUnit, kLargestUnit);
}

}  // namespace

std::optional<Intrinsics> pinhole_of(const PointsView& cloud) {
  constexpr double kMinPoints = 64, kMaxRms = 0.2;  // pixels
  if (cloud.width < 8 || cloud.height < 8 || cloud.width > kMaxImageWidth ||
      cloud.height > kMaxImageHeight) {
    return {};
  }
  const auto unit = unit_of(cloud, 1);
  LineFit across, down;
  for (int v = 0; v < cloud.height; ++v) {
    for (int u = 0; u < cloud.width; ++u) {
      const Vec3f& p =
          cloud.points[static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                       static_cast<std::size_t>(u)];
      if (!is_in_front(p)) continue;
      const double z = unrounded_depth(p, unit);
      across.add(double(p.x) / z, u);
      down.add(double(p.y) / z, v);
    }
  }
  if (across.n < kMinPoints) return {};
  auto x = solve(across), y = solve(down);
  if (!x || !y || x->rms > kMaxRms || y->rms > kMaxRms) return {};
  make_exact(cloud, unit, 0, *x);
  make_exact(cloud, unit, 1, *y);
  return Intrinsics{x->focal, y->focal, x->center, y->center};
}

std::optional<double> unit_of(const PointsView& cloud, std::ptrdiff_t min_counts) {
  constexpr double kTolerance = 0.02;  // counts
  std::vector<bool> is_there;
  for (const double unit : {0.001, 0.0005, 0.00025, 0.0002, 0.000125, 0.0001}) {
    is_there.assign(std::size_t{kFarCount}, false);
    const auto is_counted = [&](const Vec3f& p) {
      if (!is_in_front(p)) return true;
      const double count = static_cast<double>(p.z) / unit, whole = std::round(count);
      if (!(whole < kFarCount) || std::abs(count - whole) > kTolerance) return false;
      is_there[static_cast<std::size_t>(whole)] = true;
      return true;
    };
    // A few depths, as of a wall, may be multiples of anything.
    if (std::ranges::all_of(cloud.points, is_counted) &&
        std::ranges::count(is_there, true) >= min_counts) {
      return unit;
    }
  }
  return {};
}

Result<CloudCamera> CloudCamera::create(const PointsView& first,
                                        const CloudCameraOptions& options) {
  constexpr double kMaxOutside = 0.1, kHalf = 0.5;
  constexpr int kMargin = 2;  // pixels
  CameraModel model{options.width, options.height, options.intrinsics.value_or(Intrinsics{}), {}};
  const bool is_free = !options.viewpoint && !options.look && options.width == 0;
  if (const auto pinhole = is_free ? pinhole_of(first) : std::nullopt) {
    model.width = first.width;
    model.height = first.height;
    if (!options.intrinsics) model.intrinsics = *pinhole;
    return CloudCamera(model, options.unit
                                  ? *options.unit
                                  : unit_of(first).value_or(unit_for(first, Quaternion{})));
  }
  Vec3d middle;
  std::size_t num_finite = 0;
  for (const Vec3f& p : first.points) {
    if (!is_measured(p)) continue;
    ++num_finite;
    middle += normalized(to_double(p));
  }
  if (num_finite == 0) return Error{Errc::bad_input, "a cloud has no points"};
  constexpr std::size_t kEnough = 64;
  if (num_finite < kEnough && !options.intrinsics && options.width == 0) {
    return Error{Errc::bad_input, "a cloud of " + std::to_string(num_finite) +
                                      " points does not tell the size of its image; give "
                                      "?size=WIDTHxHEIGHT or ?intrinsics=fx,fy,cx,cy"};
  }
  CloudCamera camera(model, 0);
  camera.X_FC_.translation = options.viewpoint.value_or(Vec3d{});
  camera.is_projected_ = true;
  const double all = static_cast<double>(num_finite);
  const double widest = options.look ? kWidestLook : kWidest;
  if (options.look) camera.X_FC_.rotation = looking(*options.look);
  Extent seen = extent_of(first, camera.X_FC_.rotation, widest);
  const auto is_outside = [&](double share) { return static_cast<double>(seen.num) < share * all; };
  if (!options.look && is_outside(1 - kMaxOutside)) {
    camera.X_FC_.rotation = looking(middle);
    seen = extent_of(first, camera.X_FC_.rotation, widest);
    if (norm(middle) < kHalf * all || is_outside(kHalf)) {
      return Error{Errc::invalid_argument,
                   "a cloud surrounds its viewpoint, and one image shows 60 degrees to each side; "
                   "give ?look=round for four images around z, or ?look=x,y,z, the direction of "
                   "one, in the frame of the cloud"};
    }
  }
  if (seen.num == 0) return Error{Errc::bad_input, "a cloud has no points where its image looks"};
  camera.unit_ = options.unit.value_or(unit_for(first, camera.X_FC_.rotation));
  const double width = seen.right - seen.left, height = seen.bottom - seen.top;
  CameraModel& made = camera.model_;
  Intrinsics& k = made.intrinsics;
  if (options.intrinsics) {
    const auto side = [](double center, int most) {
      return static_cast<int>(std::clamp(2 * center + 1, 8.0, static_cast<double>(most)));
    };
    if (made.width == 0) {
      made.width = side(k.cx, kMaxImageWidth);
      made.height = side(k.cy, kMaxImageHeight);
    }
    return camera;
  }
  double pixel = 0;
  if (made.width > 0) {
    pixel = std::max({width / (made.width - 1), height / (made.height - 1), 1e-6});
  } else {
    // Not more than four pixels for each point: the cloud may be dense in few places only.
    constexpr double kRoom = 4000, kMaxPixels = 4, kSmallest = 1e-5;
    const double num = static_cast<double>(seen.num);
    pixel = std::max({pixel_side(first, camera.X_FC_.rotation, widest, seen), width / kRoom,
                      height / kRoom, std::sqrt(width * height / (kMaxPixels * num)), kSmallest});
    made.width = std::max(8, static_cast<int>(std::ceil(width / pixel)) + 1 + 2 * kMargin);
    made.height = std::max(8, static_cast<int>(std::ceil(height / pixel)) + 1 + 2 * kMargin);
  }
  k.fx = k.fy = 1 / pixel;
  k.cx = 0.5 * (made.width - 1) - k.fx * 0.5 * (seen.left + seen.right);
  k.cy = 0.5 * (made.height - 1) - k.fy * 0.5 * (seen.top + seen.bottom);
  return camera;
}

}}  // namespace palpate::v0
