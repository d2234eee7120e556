#include "src/packing/seeds.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

constexpr double kNumCells = 40000;
constexpr int kMaxCellsPerAxis = 512;
constexpr double kTolerance = 0.02;  // of the distances of cells
constexpr int kMaxFacets = 1024;
constexpr int kQuestions = 64;  // whether to go on

// Side of a cube such that about kNumCells of them fill the box.
double cell_size(const Vec3d& extent) {
  const double longest = std::max({extent.x, extent.y, extent.z});
  double h = longest / kMaxCellsPerAxis;
  const auto num_cells = [&] {
    return std::ceil(extent.x / h) * std::ceil(extent.y / h) * std::ceil(extent.z / h);
  };
  while (num_cells() > kNumCells) h *= 1.05;
  return h;
}

// SplitMix64, in [0, 1).
double fraction(std::uint64_t z) {
  z *= 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1.0p-53;
}

// One row of cells along x. The surface is farther than a step away from most of them, and then
// the next cell is on the same side of it: rays are only shot near the surface, and empty space is
// crossed in large steps.
void scan_row(const TriangleBvh& mesh, const Vec3d& start, double h, int num,
              std::vector<Ball>& out) {
  bool inside = false;
  double safe = 0;  // how far the surface is from the previous cell, at least
  for (int i = 0; i < num;) {
    const Vec3d p = start + Vec3d{i * h, 0, 0};
    const double distance = mesh.closest(p, 1e300, kTolerance).distance / (1 + kTolerance);
    if (safe <= h && (distance <= h || i == 0)) inside = mesh.inside(p);
    safe = distance;
    if (inside) out.push_back({p, distance});
    const int num_steps = inside ? 1 : std::max(1, static_cast<int>(distance / h));
    i += num_steps;
    safe -= h * (num_steps - 1);
  }
}

}  // namespace

std::optional<StartingPoints> starting_points(const FreeSpace& space, const Bounds& box,
                                              std::uint64_t jitter, ThreadPool& pool,
                                              const std::function<bool()>& keep_going) {
  const TriangleBvh& mesh = space.mesh;
  const Vec3d extent = box.high - box.low;
  const double h = cell_size(extent);
  int num[3];
  Vec3d start;
  for (int k = 0; k < 3; ++k) {
    const double shift =
        jitter == 0 ? 0 : fraction(3 * jitter + static_cast<std::uint64_t>(k)) - 0.5;
    num[k] = static_cast<int>(std::ceil(extent[k] / h)) + (jitter == 0 ? 0 : 1);
    start[k] = (box.low[k] + box.high[k]) / 2 + h * (shift - 0.5 * (num[k] - 1));
  }
  const int num_rows = num[1] * num[2];
  const int num_facets = std::min(mesh.num_triangles(), kMaxFacets);
  constexpr int kFacetsPerTask = 64;
  const int num_facet_tasks = (num_facets + kFacetsPerTask - 1) / kFacetsPerTask;
  const int num_tasks = num_rows + num_facet_tasks;
  std::vector<std::vector<Ball>> parts(static_cast<std::size_t>(num_tasks));
  const auto run = [&](int task) {
    std::vector<Ball>& part = parts[static_cast<std::size_t>(task)];
    if (task < num_rows) {
      const int y = task % num[1], z = task / num[1];
      scan_row(mesh, start + Vec3d{0, h * y, h * z}, h, num[0], part);
      return;
    }
    const int begin = (task - num_rows) * kFacetsPerTask;
    for (int i = begin; i < std::min(begin + kFacetsPerTask, num_facets); ++i) {
      const auto facet = static_cast<std::int64_t>(i) * mesh.num_triangles() / num_facets;
      const Triangle& t = mesh.triangle(static_cast<int>(facet));
      const Vec3d n = -normalized(cross(t.b - t.a, t.c - t.a));
      if (n == Vec3d{}) continue;
      part.push_back(space.tangent_ball((t.a + t.b + t.c) / 3.0, n, norm(extent) / 2));
    }
  };
  const int tasks_per_question = std::max(1, num_tasks / kQuestions);
  for (int first = 0; first < num_tasks; first += tasks_per_question) {
    if (!keep_going()) return std::nullopt;
    pool.parallel_for(std::min(tasks_per_question, num_tasks - first),
                      [&](int task) { run(first + task); });
  }
  StartingPoints seeds{{}, h};
  for (const auto& part : parts) {
    std::copy_if(part.begin(), part.end(), std::back_inserter(seeds.balls),
                 [](const Ball& ball) { return ball.radius > 0 && std::isfinite(ball.radius); });
  }
  return seeds;
}

}}  // namespace palpate::v0
