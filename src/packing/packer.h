// A packing in the making: the candidates, the spheres that were inserted, and what watches the
// surface. packer.cpp fills the solid, reach_ends.cpp gives spheres to thin ends.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "src/packing/hole_search.h"
#include "src/packing/solid/surface_watch.h"

namespace palpate { inline namespace v0 {

/// Fills a solid with spheres, up to the limits of the options.
class Packer {
 public:
  Packer(const TriangleMesh& solid, const PackOptions& options);

  /// Errors: cancelled by the progress function; no sphere fits.
  Result<SpherePacking> run();

 private:
  using Clock = std::chrono::steady_clock;

  static constexpr std::size_t kBatch = 256;      ///< spheres that are inserted together
  static constexpr std::size_t kFirstLook = 700;  ///< spheres, before the surface is looked at

  /// A ball that may become a sphere.
  struct Candidate {
    Ball ball;
    double priority = 0;   ///< radius it has, or may grow to
    std::uint64_t id = 0;  ///< breaks ties
    bool grown = false;    ///< a local maximum when it was found, not just a point with clearance

    friend bool operator<(const Candidate& a, const Candidate& b) {
      return a.priority < b.priority || (a.priority == b.priority && a.id > b.id);
    }
  };

  /// A candidate of a batch.
  struct Entry {
    Candidate candidate;
    Sphere sphere;  ///< radius 0: not to be inserted now
  };

  double elapsed() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  void stop(PackStop why);
  bool report();
  double priority(double radius, bool grown) const;
  void push(const Ball& ball, bool grown);
  void take_batch();
  template <class Work>
  void in_parallel(std::size_t num, Work&& work);
  void grow_batch();
  Sphere stored(const Ball& ball) const;
  void insert_batch();
  void insert(const Sphere& sphere);
  void find_holes();
  void reach_ends();
  Sphere sphere_near(const SurfaceWatch::Place& place, double desired);

  const TriangleMesh& solid_;
  const PackOptions& options_;
  const Clock::time_point start_ = Clock::now();
  Bounds box_;
  TriangleBvh mesh_;
  SphereLevels spheres_;
  ThreadPool pool_;
  FreeSpace space_{mesh_, spheres_, options_.max_radius};
  std::vector<HoleSearch> searches_;  ///< one per task of a batch
  double extent_ = 0;
  double smallest_ = 0;  ///< radius
  bool limited_by_radius_ = false;

  std::vector<Candidate> heap_;
  std::uint64_t next_id_ = 0;
  double head_start_ = 0;
  double threshold_ = 0;  ///< radius
  std::vector<Entry> batch_;
  std::vector<std::vector<Ball>> holes_;
  std::size_t num_new_ = 0;

  std::size_t next_look_ = kFirstLook;  ///< number of spheres
  std::optional<SurfaceWatch> watch_;   ///< from the first look on
  std::vector<char> hopeless_;          ///< by place: no sphere fits there

  SpherePacking packing_;
  double volume_ = 0;
  double next_report_ = 0;
  bool done_ = false;
};

}}  // namespace palpate::v0
