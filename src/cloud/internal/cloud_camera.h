// Point clouds as depth images, so that all that is made of images is made of clouds, too.
//
// An organized cloud whose points lie on the rays of a pinhole camera *is* a depth image: each
// pixel gets the z of its point. All others are projected: a pixel gets the nearest surface among
// its points, at its own center. Inverse depth is linear over the image of a plane, 1/z = a + b u +
// c v, so both the step from a point to the center and a gap between two neighbors are exact on
// planes.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "src/cloud/internal/lens_table.h"

namespace palpate { inline namespace v0 {

/// Number of points that a cloud may have: those of the largest image.
inline constexpr std::uint64_t kMaxCloudPoints = std::uint64_t{kMaxImageWidth} * kMaxImageHeight;

/// False for NaN and infinity, and for the origin itself, which sensors send for no measurement.
inline bool is_measured(const Vec3f& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z) && !(p == Vec3f{});
}

/// Owns the points of one capture; its memory serves the next one, too.
struct CloudPoints {
  int width = 0, height = 1;
  std::vector<Vec3f> points, normals;

  PointsView view() const { return {width, height, points, normals}; }
};

/// Finds the pinhole camera whose rays go through the points of an organized cloud: the least
/// squares of u = fx x/z + cx and v = fy y/z + cy, as the roundest numbers that the points allow.
/// None: not organized, too few points, or they are off their rays by 0.2 pixels (rms) or more.
std::optional<Intrinsics> pinhole_of(const PointsView& cloud);
/// Finds the unit (m) of which the depth of all points is a multiple: usual units from a millimeter
/// down to 0.1 mm. None: the depth was not counted so, or it has fewer different counts.
std::optional<double> unit_of(const PointsView& cloud, std::ptrdiff_t min_counts = 8);

/// Parameters that replace what the first cloud of a stream says.
struct CloudCameraOptions {
  /// m; where it is seen from, else the origin of its frame F. All points are relative to it, with
  /// the axes of F: far from the origin of F they would lose their digits.
  std::optional<Vec3d> viewpoint = {};
  std::optional<Vec3d> look =
      {};  ///< direction of the image's center in F; 45 degrees to each side
  std::optional<Intrinsics> intrinsics = {};
  int width = 0, height = 0;  ///< 0: by the first cloud
  std::optional<double> unit = {};
};

/// Numbers of points of a cloud: all that were measured, and those that are not a pixel's alone.
struct CloudShares {
  std::size_t points = 0;
  std::size_t outside = 0;  ///< of the image
  std::size_t hidden = 0;   ///< behind others, or seen from behind by their normals
  std::size_t merged = 0;   ///< share their pixel with others of the same surface
  bool is_image = true;     ///< the cloud is an image: each point has its pixel
  /// "its clouds are projected ...": the shares, in percent.
  std::string text() const;
};

/// The pinhole camera C by which the clouds of a stream are seen.
class CloudCamera {
 public:
  /// A camera fixed by the first cloud: the one that the cloud is an image of, or one with two
  /// points in each of its pixels. It looks along z of F if the points are there, else to their
  /// middle. Points are relative to the viewpoint, here and in `take`. Errors: no points, or too
  /// few to tell a size; they surround the viewpoint (Errc::invalid_argument: what is asked for has
  /// to change).
  static Result<CloudCamera> create(const PointsView& first, const CloudCameraOptions& options);
  /// A given camera at F.
  CloudCamera(const CameraModel& model, double unit) : model_(model), unit_(unit) {}

  const CameraModel& model() const { return model_; }
  double unit() const { return unit_; }
  /// Sets size, intrinsics and unit of a stream of its images.
  void describe(DepthStreamInfo& info) const;
  const Pose& X_FC() const { return X_FC_; }  ///< pose of the camera in the frame of the points
  /// The same. None: the first cloud is an image.
  std::optional<Pose> projection() const {
    return is_projected_ ? std::optional(X_FC_) : std::nullopt;
  }

  /// Makes the depth image: size, unit and pixels of `frame`. A cloud of the image's size whose
  /// points lie on the camera's rays (99 % of 4096 samples, within half a pixel) gives its z, to
  /// the bit, whatever its normals; all others are projected. O(points +
  /// pixels); allocates when clouds grow.
  CloudShares take(const PointsView& cloud, DepthFrame& frame);

 private:
  /// Sums of a pixel's nearest surface.
  struct Pixel {
    float nearest = 0;                // 1/z of the nearest point; 0: none
    float u = 0, v = 0, inverse = 0;  // sums, of offsets from the center and of 1/z
    float count = 0;
  };
  bool is_image_of(const PointsView& cloud) const;
  CloudShares project(const PointsView& cloud, DepthFrame& frame);
  void fill(DepthFrame& frame);

  CameraModel model_;
  double unit_ = 0;
  Pose X_FC_;
  bool is_projected_ = false;  // the first cloud is no image
  std::vector<Pixel> pixels_;
  std::vector<float> inverse_;  // 1/z at the centers; 0: none
  bool is_grid_ = false;        // all points lie at centers: those of an image in another order
};

}}  // namespace palpate::v0
