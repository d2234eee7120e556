// Packs six meshes with Palpate and with two published methods, side by side, and writes index.html
// and packing-curves.csv; prints the summary as Markdown.
//   packing_curves OUT_DIR [--budget SECONDS] [--large SHARE] [--cells N] [--commit ID]
// The bunny, the spiral and the drill are read from $PALPATE_DATA/meshes_good.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "bench/harness.h"
#include "bench/packing_comparison.h"
#include "bench/packing_peers.h"
#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"

namespace palpate::bench {
namespace {

constexpr double kShapeSize = 0.1;  // meters
constexpr int kMaxPeerSpheres = 30000;

struct Source {
  const char* name;
  const char* shape;  ///< of make_shape; nullptr: a file
  const char* file;
  double scale;
};
constexpr Source kSources[] = {
    {"cube", "box", nullptr, 1},
    {"tetrahedron", "tetrahedron", nullptr, 1},
    {"octahedron", "octahedron", nullptr, 1},
    {"bunny", nullptr, "bunny_3k.off", 1},
    {"spiral", nullptr, "spiral_tool.obj", 1},
    {"drill", nullptr, "chai3d_drill.obj", 0.001},  // in millimeters
};

struct Settings {
  std::string out;
  double budget = 20;  ///< seconds, of a peer on one mesh
  double large = 0.7;  ///< threshold of a prototype round, as fraction of its largest sphere
  int cells = 128;     ///< of the fixed grid, along the longest side
  std::string commit = "unknown";
};

Result<TriangleMesh> read(const Source& source) {
  if (source.shape != nullptr) return make_shape(source.shape, kShapeSize);
  const char* data = std::getenv("PALPATE_DATA");
  if (data == nullptr) {
    return Error{Errc::not_found, "set PALPATE_DATA to the folder of real data"};
  }
  const auto raw =
      load_mesh(std::filesystem::path(data) / "meshes_good" / source.file, source.scale);
  if (!raw) return raw.error();
  auto solid = check_solid(*raw);
  if (!solid) return solid.error();
  return std::move(solid->mesh);
}

[[noreturn]] void fail(const std::string& message) {
  std::fprintf(stderr, "packing_curves: %s\n", message.c_str());
  std::exit(1);
}

void require_valid(const TriangleMesh& solid, const std::vector<Sphere>& spheres,
                   const std::string& what) {
  if (const std::string fault = find_fault(solid, spheres); !fault.empty()) {
    fail(what + ": " + fault);
  }
}

// Separate runs: Palpate inserts in batches, so a prefix has no time of its own.
PackingCurve measure_ours(const TriangleMesh& solid) {
  PackingCurve curve;
  for (const int count : kCounts) {
    PackOptions options;
    options.max_spheres = count;
    options.num_threads = 1;
    const Stopwatch stopwatch;
    const auto packing = pack_spheres(solid, options);
    const Times times = stopwatch.elapsed();
    if (!packing) fail(packing.error().message);
    require_valid(solid, packing->spheres, "palpate");
    double volume = 0;
    for (const Sphere& s : packing->spheres) {
      volume += sphere_volume(static_cast<double>(s.radius));
    }
    const auto num = static_cast<int>(packing->spheres.size());
    curve.points.push_back({num, volume / packing->mesh_volume, times,
                            static_cast<double>(packing->spheres.back().radius)});
    if (num < count) {
      curve.ending = "found room for " + std::to_string(num) + " spheres.";
      break;
    }
  }
  return curve;
}

PackingCurve measure_peer(const TriangleMesh& solid, const PeerPacking& packing,
                          const PeerLimits& limits, const std::string& what) {
  require_valid(solid, packing.spheres, what);
  const double mesh_volume = mass_properties(solid).volume;
  PackingCurve curve;
  double volume = 0;
  for (std::size_t i = 0; i < packing.spheres.size(); ++i) {
    const auto radius = static_cast<double>(packing.spheres[i].radius);
    volume += sphere_volume(radius);
    curve.points.push_back(
        {static_cast<int>(i) + 1, volume / mesh_volume, packing.times[i], radius});
  }
  const auto num = packing.spheres.size();
  if (num < static_cast<std::size_t>(limits.max_spheres)) {
    const bool late = packing.out_of_time;
    char text[100];
    std::snprintf(
        text, sizeof text,
        late ? "stopped at %zu spheres, its %g s being over." : "found room for %zu spheres.", num,
        limits.max_seconds);
    curve.ending = text;
  }
  return curve;
}

MeshComparison compare(const std::string& name, const TriangleMesh& solid,
                       const Settings& settings) {
  const PeerLimits limits{kMaxPeerSpheres, settings.budget};
  MeshComparison result{name, {}};
  result.curves[0] = measure_ours(solid);
  result.curves[1] =
      measure_peer(solid, pack_prototypes(solid, settings.large, limits), limits, kMethods[1].id);
  result.curves[2] =
      measure_peer(solid, pack_fixed_grid(solid, settings.cells, limits), limits, kMethods[2].id);
  for (std::size_t m = 0; m < kMethods.size(); ++m) {
    const CurvePoint& end = result.curves[m].points.back();
    std::fprintf(stderr, "%-12s %-20s %6d spheres, fill %.4f, %.2f s of processor time %s\n",
                 name.c_str(), kMethods[m].name, end.spheres, end.fill, end.times.cpu,
                 result.curves[m].ending.c_str());
  }
  return result;
}

Settings parse(int argc, char** argv) {
  const char* usage =
      "usage: packing_curves OUT_DIR [--budget SECONDS] [--large SHARE] [--cells N] [--commit ID]";
  Settings settings;
  if (argc < 2 || argc % 2 != 0 || argv[1][0] == '-') fail(usage);
  settings.out = argv[1];
  for (int i = 2; i < argc; i += 2) {
    const std::string flag = argv[i];
    if (flag == "--budget") {
      settings.budget = std::atof(argv[i + 1]);
    } else if (flag == "--large") {
      settings.large = std::atof(argv[i + 1]);
    } else if (flag == "--cells") {
      settings.cells = std::atoi(argv[i + 1]);
    } else if (flag == "--commit") {
      settings.commit = argv[i + 1];
    } else {
      fail("unknown option " + flag + "; " + usage);
    }
  }
  if (!(settings.budget > 0) || settings.cells < 1 || settings.cells > 512 ||
      !(settings.large > 0 && settings.large <= 1)) {
    fail("the budget must be positive, the share at most 1, the cells at most 512");
  }
  return settings;
}

void write(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) fail("cannot write " + path.string());
  std::fprintf(stderr, "wrote %s\n", path.c_str());
}

int run(const Settings& settings) {
  std::error_code error;
  std::filesystem::create_directories(settings.out, error);
  char numbers[200];
  std::snprintf(
      numbers, sizeof numbers,
      "one thread; at most %g s for each peer and mesh; prototypes from %g of the largest; "
      "fixed grid of %d cells; load before %.1f",
      settings.budget, settings.large, settings.cells, machine_load());
  PackingComparison comparison;
  comparison.prototype_share = settings.large;
  comparison.grid_cells = settings.cells;
  comparison.facts = {{"date", today()},
                      {"machine", machine()},
                      {"commit", settings.commit},
                      {"settings", numbers},
                      {"command", "make packing-curves"}};
  for (const Source& source : kSources) {
    const auto solid = read(source);
    if (solid) {
      comparison.meshes.push_back(compare(source.name, *solid, settings));
    } else {
      comparison.skipped.push_back("SKIPPED " + std::string(source.name) + ": " +
                                   solid.error().message);
      std::fprintf(stderr, "%s\n", comparison.skipped.back().c_str());
    }
  }
  const std::filesystem::path out = settings.out;
  write(out / "packing-curves.csv", to_csv(comparison));
  if (const auto page = to_html(comparison)) {
    write(out / "index.html", *page);
  } else {
    std::fprintf(stderr, "%s\n", page.error().message.c_str());
  }
  std::printf("%s\n%s\n", finding(comparison).c_str(), to_markdown(comparison).c_str());
  return 0;
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) { return palpate::bench::run(palpate::bench::parse(argc, argv)); }
