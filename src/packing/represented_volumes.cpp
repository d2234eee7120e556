// The moments of a power cell, from inside: rays leave the center of the sphere, and each runs
// until the first plane of equal power, which ends its power cell. A ray u of length t stands for a
// cone with the volume t^3 / 3, the first moment t^4 / 4 u and the second moment t^5 / 5 per solid
// angle. Where it leaves the solid it loses the rest of its cone, and where it enters again it gets
// that back, so the solid may have any shape and no crossing is first or last. The sphere itself is
// free of planes and facets. Spheres are looked at one by one: any number of threads gives the same
// bits.
#include "palpate/packing/packing.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/mesh/mesh.h"
#include "src/packing/power_neighbors.h"
#include "src/packing/solid/ray_patches.h"
#include "src/packing/solid/triangle_bvh.h"

namespace palpate { inline namespace v0 {
namespace {

// Rays per sphere. Against a fine octree the error of a volume is .5 and .4 % rms with the fewest
// (bunny, 1000 and 17,000 spheres), a quarter of it with four times as many.
constexpr std::size_t kRays = 1 << 22;  // for all spheres and triangles together
constexpr std::size_t kMinRays = 512, kMaxRays = 1 << 14;

// A ray is followed that far beyond the sphere at first, as a multiple of the median radius: of the
// size of the holes in the packing.
constexpr double kFirstMargin = 2;
constexpr double kMinMargin = 1e-6;  // of the diagonal of the solid: bounds the attempts

constexpr std::size_t kTaskSize = 16;  // spheres
constexpr Float4 kOne{1, 1, 1, 1};
constexpr double kBall = 4 * kPi / 3;

// The longest radius of a ball, in radii of the ball of the same volume. It bounds how far a ball
// reaches out of a long cell, and so how early it touches.
constexpr double kMaxStretch = 1.5;

// A number for each ray of a patch.
struct Rays {
  Float4 part[RayPatch::kParts];

  float least() const {
    Float4 low = part[0];
    for (const Float4& other : part) low = other < low ? other : low;
    return std::min(std::min(low[0], low[1]), std::min(low[2], low[3]));
  }
};

/// Moments about the center of a sphere; the second one is the sum of those along three axes.
struct Moments {
  double volume = 0;  // m3
  Vec3d first;        // m4
  double second = 0;  // m5
};

// A triangle, seen from a point: a ray u meets it if no side . u is negative.
struct Facet {
  Pull plane;
  Pull sides[3];
  float turn = 1;  ///< 1: the ray leaves the solid; -1: it enters

  Facet(const Triangle& t, const Vec3d& point, double unit) {
    const Vec3d v[3] = {(t.a - point) / unit, (t.b - point) / unit, (t.c - point) / unit};
    const Vec3d normal = cross(v[1] - v[0], v[2] - v[0]);
    const double height = dot(normal, v[0]);
    turn = height < 0 ? -1 : 1;
    plane = make(normal / height);
    // Antisymmetric in its two corners, to the last bit: no ray slips between two triangles.
    for (int k = 0; k < 3; ++k) sides[k] = make(cross(v[k], v[(k + 1) % 3]) * double(turn));
  }

  bool may_meet(const RayPatch& patch, float weakest) const {
    return patch.bound(plane.pull, plane.strength) > weakest &&
           std::all_of(sides, sides + 3, [&](const Pull& side) {
             return patch.bound(side.pull, side.strength) >= 0;
           });
  }

 private:
  static Pull make(const Vec3d& a) { return {to_float(a), static_cast<float>(norm(a))}; }
};

class PowerCells {
 public:
  PowerCells(const TriangleMesh& solid, std::span<const Sphere> spheres)
      : mesh_(solid),
        neighbors_(spheres),
        patches_(make_ray_patches(
            std::clamp(kRays / (spheres.size() + solid.triangles.size()), kMinRays, kMaxRays) /
            RayPatch::kSize)) {
    const Bounds box = bounds(solid);
    middle_ = (box.low + box.high) * 0.5;
    half_diagonal_ = norm(box.high - box.low) / 2;
    std::vector<float> radii;
    for (const Sphere& sphere : spheres) radii.push_back(sphere.radius);
    const auto median = radii.begin() + static_cast<std::ptrdiff_t>(radii.size() / 2);
    std::nth_element(radii.begin(), median, radii.end());
    margin_ =
        std::max(kFirstMargin * static_cast<double>(*median), kMinMargin * 2 * half_diagonal_);
  }

  /// Measures what each cell holds besides its sphere.
  std::vector<Moments> measure(ThreadPool& pool) const {
    std::vector<Moments> result(neighbors_.size());
    const std::size_t num_tasks = (result.size() + kTaskSize - 1) / kTaskSize;
    pool.parallel_for(static_cast<int>(num_tasks), [&](int task) {
      View view;
      const std::size_t begin = static_cast<std::size_t>(task) * kTaskSize;
      for (std::size_t i = begin; i < std::min(begin + kTaskSize, result.size()); ++i)
        result[neighbors_.original(i)] = void_of(i, view);
    });
    return result;
  }

 private:
  // Planes and facets around the center of a sphere. Unit of length: the reach of the rays.
  struct View {
    std::vector<Pull> planes;
    std::vector<Rays> ends;  ///< per patch: the planes' pull on each ray, 1 / its length
    std::vector<int> triangles;
    std::vector<Facet> facets;
  };

  Moments void_of(std::size_t i, View& view) const {
    const Sphere& sphere = neighbors_.sphere(i);
    const Vec3d center = to_double(sphere.center);
    const double radius = sphere.radius;
    const double whole = norm(center - middle_) + half_diagonal_;
    for (double margin = margin_;; margin *= 2) {
      const double reach = std::min(radius + margin, whole);
      view.planes.clear();
      if (!neighbors_.gather(i, reach, view.planes)) return {};
      const float weakest = find_ends(view);
      find_facets(center, reach, reach / static_cast<double>(weakest), view);
      Moments mean;  // of t^3, t^4 u and t^5
      if (!add_cones(view, radius / reach, mean) && reach != whole) continue;
      const double reach3 = reach * reach * reach, reach4 = reach3 * reach;
      const double volume = kBall * (mean.volume * reach3 - radius * radius * radius);
      if (!(volume > 0)) return {};
      return {volume, mean.first * (kPi * reach4), 0.8 * kPi * mean.second * reach4 * reach};
    }
  }

  // Finds where the rays meet the first plane; returns the weakest pull on any of them.
  float find_ends(View& view) const {
    std::sort(view.planes.begin(), view.planes.end(),
              [](const Pull& a, const Pull& b) { return a.strength > b.strength; });
    view.ends.clear();
    float weakest = std::numeric_limits<float>::infinity();
    for (const RayPatch& patch : patches_) {
      Rays ends{{kOne, kOne, kOne, kOne}};
      float low = 1;
      for (const Pull& plane : view.planes) {
        if (plane.strength <= low) break;
        if (patch.bound(plane.pull, plane.strength) <= low) continue;
        for (std::size_t k = 0; k < RayPatch::kParts; ++k) {
          const Float4 pull = patch.along(plane.pull, k);
          ends.part[k] = ends.part[k] > pull ? ends.part[k] : pull;
        }
        low = ends.least();
      }
      view.ends.push_back(ends);
      weakest = std::min(weakest, low);
    }
    return weakest;
  }

  void find_facets(const Vec3d& center, double unit, double distance, View& view) const {
    view.triangles.clear();
    view.facets.clear();
    const auto all = static_cast<std::size_t>(mesh_.num_triangles());
    mesh_.gather(center, distance, all, view.triangles);
    for (const int t : view.triangles) view.facets.emplace_back(mesh_.triangle(t), center, unit);
  }

  // Computes the mean moments of the rays' cones, without those of the sphere; false if a ray is
  // still in the solid at its end.
  bool add_cones(const View& view, double radius, Moments& mean) const {
    bool complete = true;
    const auto sphere4 = static_cast<float>(std::pow(radius, 4));
    const auto sphere5 = static_cast<float>(std::pow(radius, 5));
    for (std::size_t p = 0; p < patches_.size(); ++p) {
      const RayPatch& patch = patches_[p];
      const Rays& ends = view.ends[p];
      const float low = ends.least();
      Rays whole, cones, whole4, cones4, whole5, cones5;
      for (std::size_t k = 0; k < RayPatch::kParts; ++k) {
        const Float4 length = 1 / ends.part[k];
        cones.part[k] = whole.part[k] = 1 / (ends.part[k] * ends.part[k] * ends.part[k]);
        cones4.part[k] = whole4.part[k] = whole.part[k] * length;
        cones5.part[k] = whole5.part[k] = whole4.part[k] * length;
      }
      for (const Facet& facet : view.facets) {
        if (!facet.may_meet(patch, low)) continue;
        for (std::size_t k = 0; k < RayPatch::kParts; ++k) {
          const Float4 pull = patch.along(facet.plane.pull, k);
          const auto meets = (pull > ends.part[k]) & (patch.along(facet.sides[0].pull, k) >= 0) &
                             (patch.along(facet.sides[1].pull, k) >= 0) &
                             (patch.along(facet.sides[2].pull, k) >= 0);
          const Float4 length = 1 / pull, cone = 1 / (pull * pull * pull);
          const auto lose = [&](Float4& left, const Float4& all, const Float4& here) {
            left -= meets ? facet.turn * (all - here) : Float4{};
          };
          lose(cones.part[k], whole.part[k], cone);
          lose(cones4.part[k], whole4.part[k], cone * length);
          lose(cones5.part[k], whole5.part[k], cone * length * length);
        }
      }
      for (std::size_t k = 0; k < RayPatch::kParts; ++k) {
        for (int i = 0; i < 4; ++i) {
          mean.volume += static_cast<double>(cones.part[k][i]);
          const float lever = cones4.part[k][i] - sphere4;
          mean.first +=
              to_double(Vec3f{patch.x[k][i] * lever, patch.y[k][i] * lever, patch.z[k][i] * lever});
          mean.second += static_cast<double>(cones5.part[k][i] - sphere5);
          complete &= cones.part[k][i] != 1;
        }
      }
    }
    const double share = 1 / static_cast<double>(patches_.size() * RayPatch::kSize);
    mean.volume /= static_cast<double>(patches_.size() * RayPatch::kSize);
    mean.first = mean.first * share;
    mean.second *= share;
    return complete;
  }

  TriangleBvh mesh_;
  PowerNeighbors neighbors_;
  std::vector<RayPatch> patches_;
  Vec3d middle_;
  double half_diagonal_ = 0;
  double margin_ = 0;
};

/// Returns the ball with the centroid and the second moment of a sphere with what its cell holds
/// besides.
Sphere ball_of(const Sphere& sphere, double own, const Moments& besides) {
  const double volume = own + besides.volume, radius = sphere.radius;
  const Vec3d shift = besides.first / volume;
  const double second = (0.6 * own * radius * radius + besides.second) / volume - dot(shift, shift);
  const double least = std::cbrt(volume / kBall);
  const double desired = std::sqrt(std::max(0.0, second) * (5.0 / 3));
  return {to_float(to_double(sphere.center) + shift),
          static_cast<float>(std::clamp(desired, least, kMaxStretch * least))};
}

}  // namespace

Result<RepresentedParts> represented_parts(const TriangleMesh& solid,
                                           std::span<const Sphere> spheres, ThreadPool& pool) {
  if (spheres.empty()) {
    return Error{Errc::invalid_argument,
                 "no spheres to share the volume of the mesh; pack the mesh first"};
  }
  const double mesh_volume = mass_properties(solid).volume;
  if (!(mesh_volume > 0) || !std::isfinite(mesh_volume)) {
    return Error{Errc::bad_input,
                 "the mesh encloses no volume to share among its spheres; pass what check_solid "
                 "returns"};
  }
  // A sphere is known exactly. Only what its cell holds besides is measured, and scaled so that the
  // sum is right.
  const std::vector<Moments> voids = PowerCells(solid, spheres).measure(pool);
  std::vector<double> own;
  double sphere_sum = 0, void_sum = 0;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    own.push_back(sphere_volume(static_cast<double>(spheres[i].radius)));
    sphere_sum += own[i];
    void_sum += voids[i].volume;
  }
  const double rest = mesh_volume - sphere_sum;
  const bool fits = rest > 0 && void_sum > 0;  // else the spheres are none of this mesh
  RepresentedParts parts;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const double scale = rest / void_sum;
    const double volume =
        fits ? own[i] + voids[i].volume * scale : own[i] * (mesh_volume / sphere_sum);
    parts.volumes.push_back(static_cast<float>(volume));
    parts.balls.push_back(
        fits ? ball_of(spheres[i], own[i],
                       {voids[i].volume * scale, voids[i].first * scale, voids[i].second * scale})
             : spheres[i]);
  }
  return parts;
}

}}  // namespace palpate::v0
