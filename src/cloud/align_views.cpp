#include "palpate/cloud/point_cloud.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "src/math/internal/cholesky.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMinPoints = 500;        // matches of a view, at least
constexpr double kMaxDistance = 5e-3;     // m
constexpr double kMinShape = 0.003;       // eigenvalue for two views: below it, normals are noise
constexpr double kMaxUncertainty = 3e-3;  // m; see AlignedViews::uncertainty
constexpr double kSigmaOfMedian = 1.4826;
constexpr double kMinNoise = 5e-4;   // m: no camera is better
constexpr double kPointsAlike = 50;  // neighbors whose errors count as one
constexpr double kSameNormal = 0.8;  // cosine
constexpr double kMinSlant = 0.3;    // cosine between a normal and the viewing ray
constexpr int kEdgeWidth = 3;        // pixels
constexpr float kEdgeStep = 0.03f;   // share of the depth
constexpr double kMinPivot = 1e-12;  // below it, the matrix is singular
constexpr double kStill = 1e-4;      // m, and rad times the scene's size: converged below
constexpr int kPatience = 5;         // minimum of rounds at the smallest reach

Vec3d point(const PointCloudView& view, std::size_t i) {
  return {static_cast<double>(view.x[i]), static_cast<double>(view.y[i]),
          static_cast<double>(view.z[i])};
}
Vec3d normal(const PointCloudView& view, std::size_t i) {
  return {static_cast<double>(view.nx[i]), static_cast<double>(view.ny[i]),
          static_cast<double>(view.nz[i])};
}

/// True well inside a surface that is seen from the front: edges differ from camera to camera.
bool is_good(const PointCloudView& view, int u, int v) {
  const auto index = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(view.width) +
           static_cast<std::size_t>(column);
  };
  if (u < kEdgeWidth || v < kEdgeWidth || u >= view.width - kEdgeWidth ||
      v >= view.height - kEdgeWidth) {
    return false;
  }
  const std::size_t i = index(u, v);
  const Vec3d p = point(view, i), n = normal(view, i);
  if (!(dot(n, p) < -kMinSlant * norm(p))) return false;  // also where there is none
  for (const auto& [du, dv] :
       {std::pair{-kEdgeWidth, 0}, {kEdgeWidth, 0}, {0, -kEdgeWidth}, {0, kEdgeWidth}}) {
    const float z = view.z[index(u + du, v + dv)];
    if (!(std::abs(z - view.z[i]) < kEdgeStep * view.z[i])) return false;
  }
  return true;
}

/// The points of a view that are compared, about evenly over its image.
std::vector<std::size_t> samples_of(const PointCloudView& view, int most) {
  std::vector<std::size_t> all;
  for (int v = 0; v < view.height; ++v) {
    for (int u = 0; u < view.width; ++u) {
      if (!is_good(view, u, v)) continue;
      all.push_back(static_cast<std::size_t>(v) * static_cast<std::size_t>(view.width) +
                    static_cast<std::size_t>(u));
    }
  }
  const std::size_t step = all.size() / static_cast<std::size_t>(std::max(most, 1)) + 1;
  std::vector<std::size_t> some;
  for (std::size_t i = 0; i < all.size(); i += step) some.push_back(all[i]);
  return some;
}

/// A symmetric positive definite matrix, then its triangular factor (Cholesky).
class Normal {
 public:
  explicit Normal(std::size_t size) : size_(size), a_(size * size) {}

  double& at(std::size_t row, std::size_t column) { return a_[row * size_ + column]; }
  bool factor() { return factor_cholesky(a_.data(), static_cast<int>(size_), kMinPivot); }
  std::vector<double> solve(std::vector<double> b) const {
    solve_forward(a_.data(), static_cast<int>(size_), b.data());
    solve_backward(a_.data(), static_cast<int>(size_), b.data());
    return b;
  }
  /// Computes it by inverse iteration.
  double smallest_eigenvalue() const {
    std::vector<double> v(size_);
    for (std::size_t i = 0; i < size_; ++i) v[i] = 1 + 0.1 * static_cast<double>(i % 7);
    double length = 1;
    for (int round = 0; round < 40; ++round) {
      v = solve(std::move(v));
      length = 0;
      for (const double x : v) length += x * x;
      length = std::sqrt(length);
      for (double& x : v) x /= length;
    }
    return 1 / length;
  }

 private:
  std::size_t size_;
  std::vector<double> a_;
};

/// A point of view a on the plane that view b has there.
struct Match {
  Vec3d p_W, n_W;
  double distance;
};

class Alignment {
 public:
  Alignment(std::span<const PointCloudView> views, std::span<const Pose> X_WC,
            std::span<const std::string> names, const AlignOptions& options)
      : views_(views), names_(names), options_(options), first_(X_WC.begin(), X_WC.end()) {
    for (Pose& X : first_) X.rotation = normalized(X.rotation);
    now_ = first_;
    for (const PointCloudView& view : views) {
      samples_.push_back(samples_of(view, options.max_points));
    }
  }

  Result<AlignedViews> run() {
    place_middle();
    double reach = options_.reach;
    int num_last = 0;
    for (int round = 0; round < options_.max_rounds; ++round) {
      const auto moved = improve(reach);
      if (!moved) return moved.error();
      if (reach <= options_.min_reach && ++num_last >= kPatience && *moved < kStill) {
        return finish();
      }
      reach = std::max(options_.min_reach, 0.8 * reach);
    }
    if (!is_held()) return not_held();  // they slide along the surfaces
    return Error{Errc::bad_input,
                 "the poses do not converge: check intrinsics and units, and that the scene and "
                 "the cameras are static"};
  }

 private:
  std::size_t num_views() const { return views_.size(); }
  std::string name(std::size_t view) const {
    return view < names_.size() ? names_[view] : "camera " + std::to_string(view + 1);
  }

  /// Sets the center of all points, and their RMS distance from it.
  void place_middle() {
    Vec3d sum;
    double num = 0, squares = 0;
    const auto for_all = [&](const auto& f) {
      for (std::size_t k = 0; k < num_views(); ++k) {
        for (const std::size_t i : samples_[k]) f(first_[k] * point(views_[k], i));
      }
    };
    for_all([&](const Vec3d& p) { sum += p, num += 1; });
    middle_ = sum / std::max(num, 1.0);
    for_all([&](const Vec3d& p) { squares += norm(p - middle_) * norm(p - middle_); });
    size_ = std::max(std::sqrt(squares / std::max(num, 1.0)), 1e-3);
  }

  /// Calls f(match) for the points of one view that another one sees within reach.
  template <class F>
  void for_matches(std::size_t a, std::size_t b, const std::vector<Pose>& X_WC, double reach,
                   const F& f) const {
    const PointCloudView &from = views_[a], &to = views_[b];
    const Pose X_BA = inverse(X_WC[b]) * X_WC[a];
    const Mat3d R_BA = rotation_matrix(X_BA.rotation), R_WB = rotation_matrix(X_WC[b].rotation);
    const auto& [fx, fy, cx, cy] = to.intrinsics;
    for (const std::size_t i : samples_[a]) {
      const Vec3d q = R_BA * point(from, i) + X_BA.translation;
      if (!(q.z > 0)) continue;
      const double u = std::round(cx + fx * q.x / q.z), v = std::round(cy + fy * q.y / q.z);
      if (!(u >= 0 && v >= 0 && u < to.width && v < to.height)) continue;
      if (!is_good(to, static_cast<int>(u), static_cast<int>(v))) continue;
      const auto k = static_cast<std::size_t>(v) * static_cast<std::size_t>(to.width) +
                     static_cast<std::size_t>(u);
      const Vec3d r = point(to, k), n = normal(to, k);
      const double distance = dot(n, q - r);
      if (!(norm(q - r) < 2 * reach) || !(std::abs(distance) < reach)) continue;
      if (!(dot(n, R_BA * normal(from, i)) > kSameNormal)) continue;
      f(Match{X_WC[b] * q, R_WB * n, distance});
    }
  }

  /// Makes a Gauss-Newton step for all views but the first. Returns the largest motion, m.
  Result<double> improve(double reach) {
    const std::size_t num_free = num_views() - 1, size = 6 * num_free;
    Normal matrix(size);
    std::vector<double> right(size), weights(num_views());
    for (std::size_t a = 0; a < num_views(); ++a) {
      for (std::size_t b = 0; b < num_views(); ++b) {
        if (a == b) continue;
        std::array<std::array<double, 6>, 6> block{};
        std::array<double, 6> side{};
        double all = 0;
        for_matches(a, b, now_, reach, [&](const Match& match) {
          const double x = match.distance / reach, w = (1 - x * x) * (1 - x * x);
          const Vec3d turn = cross(match.p_W - middle_, match.n_W) / size_;
          const double row[6] = {turn.x, turn.y, turn.z, match.n_W.x, match.n_W.y, match.n_W.z};
          for (std::size_t i = 0; i < 6; ++i) {
            side[i] -= w * row[i] * match.distance;
            for (std::size_t k = 0; k < 6; ++k) block[i][k] += w * row[i] * row[k];
          }
          all += w;
        });
        weights[a] += all;
        weights[b] += all;
        // The distance grows as a moves along the normal, and shrinks as b does.
        for (std::size_t i = 0; i < 6; ++i) {
          if (a > 0) right[6 * (a - 1) + i] += side[i];
          if (b > 0) right[6 * (b - 1) + i] -= side[i];
          for (std::size_t k = 0; k < 6; ++k) {
            if (a > 0) matrix.at(6 * (a - 1) + i, 6 * (a - 1) + k) += block[i][k];
            if (b > 0) matrix.at(6 * (b - 1) + i, 6 * (b - 1) + k) += block[i][k];
            if (a == 0 || b == 0) continue;
            matrix.at(6 * (a - 1) + i, 6 * (b - 1) + k) -= block[i][k];
            matrix.at(6 * (b - 1) + i, 6 * (a - 1) + k) -= block[i][k];
          }
        }
      }
    }
    for (std::size_t k = 0; k < num_views(); ++k) {
      if (weights[k] >= kMinPoints) continue;
      return Error{Errc::bad_input,
                   name(k) +
                       " sees too little of what the others see: check its pose, and that "
                       "their images overlap"};
    }
    // Independent of the number of points: the shape counts.
    for (std::size_t i = 0; i < size; ++i) {
      for (std::size_t k = 0; k < size; ++k) {
        matrix.at(i, k) /= std::sqrt(weights[1 + i / 6] * weights[1 + k / 6]);
      }
      right[i] /= std::sqrt(weights[1 + i / 6]);
    }
    if (!matrix.factor()) return not_held();
    smallest_eigenvalue_ = matrix.smallest_eigenvalue();
    num_points_ = *std::min_element(weights.begin(), weights.end());
    const std::vector<double> step = matrix.solve(std::move(right));
    double most = 0;
    for (std::size_t view = 1; view < num_views(); ++view) {
      const double* const d = &step[6 * (view - 1)];
      const double scale = 1 / std::sqrt(weights[view]);
      const Vec3d turn = Vec3d{d[0], d[1], d[2]} * (scale / size_);
      const Vec3d shift = Vec3d{d[3], d[4], d[5]} * scale;
      const double angle = norm(turn);
      const Quaternion q = angle > 0 ? axis_angle(turn, angle) : Quaternion{};
      Pose& X = now_[view];
      X.translation = middle_ + rotate(q, X.translation - middle_) + shift;
      X.rotation = normalized(q * X.rotation);
      most = std::max({most, norm(shift), angle * size_});
    }
    return most;
  }

  /// True if the surfaces' shapes fix all poses.
  bool is_held() const {
    // In a chain of views the eigenvalue falls with the square of its length.
    const double num_free = static_cast<double>(num_views() - 1);
    return smallest_eigenvalue_ > kMinShape / (num_free * num_free);
  }

  static Error not_held() {
    return {
        Errc::bad_input,
        "the surfaces in common do not fix the cameras' poses: they are too flat or too round, or "
        "some cameras share nothing with the others; put a few objects with edges there"};
  }

  Result<AlignedViews> finish() const {
    AlignedViews aligned{now_, {}, 0};
    double worst = kMinNoise;
    for (std::size_t a = 0; a < num_views(); ++a) {
      for (std::size_t b = a + 1; b < num_views(); ++b) {
        ViewPair pair = compare(a, b);
        if (pair.num_points == 0) continue;
        if (pair.after > kMaxDistance) {
          char text[64];
          std::snprintf(text, sizeof text, " stay %.1f mm apart", 1e3 * pair.after);
          return Error{Errc::bad_input,
                       "the surfaces that " + name(a) + " and " + name(b) + " see" + text +
                           ": check intrinsics and units, and that the scene is static"};
        }
        worst = std::max(worst, pair.after);
        aligned.pairs.push_back(pair);
      }
    }
    aligned.uncertainty = worst / std::sqrt(num_points_ / kPointsAlike * smallest_eigenvalue_);
    if (!is_held() || !(aligned.uncertainty < kMaxUncertainty)) return not_held();
    return aligned;
  }

  ViewPair compare(std::size_t a, std::size_t b) const {
    ViewPair pair{static_cast<int>(a), static_cast<int>(b)};
    Vec3d sum;
    const auto apart = [&](const std::vector<Pose>& X_WC, bool counts) {
      std::vector<double> distances;
      const auto add = [&](const Match& match) {
        distances.push_back(std::abs(match.distance));
        if (!counts) return;
        sum += match.p_W;
        ++pair.num_points;
      };
      for_matches(a, b, X_WC, options_.reach, add);
      for_matches(b, a, X_WC, options_.reach, add);
      if (distances.empty()) return 0.0;
      const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
      std::nth_element(distances.begin(), middle, distances.end());
      return kSigmaOfMedian * *middle;
    };
    pair.before = apart(first_, false);
    pair.after = apart(now_, true);
    if (pair.num_points == 0) return pair;
    // Displacement of the center of the shared points, in the frame of a.
    const Vec3d p_B = inverse(now_[b]) * (sum / static_cast<double>(pair.num_points));
    const Pose before = inverse(first_[a]) * first_[b], after = inverse(now_[a]) * now_[b];
    const Quaternion q = after.rotation * conjugate(before.rotation);
    pair.turned = 2 * std::atan2(norm(Vec3d{q.x, q.y, q.z}), std::abs(q.w));
    pair.moved = norm(after * p_B - before * p_B);
    return pair;
  }

  std::span<const PointCloudView> views_;
  std::span<const std::string> names_;
  const AlignOptions& options_;
  std::vector<Pose> first_, now_;
  std::vector<std::vector<std::size_t>> samples_;
  Vec3d middle_;
  double size_ = 1, smallest_eigenvalue_ = 0, num_points_ = 0;
};

}  // namespace

Result<AlignedViews> align_views(std::span<const PointCloudView> views, std::span<const Pose> X_WC,
                                 std::span<const std::string> names, const AlignOptions& options) {
  if (views.size() < 2 || views.size() != X_WC.size()) {
    return Error{Errc::invalid_argument, "poses are refined between two cameras or more"};
  }
  return Alignment(views, X_WC, names, options).run();
}

}}  // namespace palpate::v0
