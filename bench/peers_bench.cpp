// Other libraries beside ours in one run: point-in-sphere queries of a tool in a frame (the
// boundary stage), normals, and the filter of depth. Results are compared before they are timed.
// Prints a table and writes the input of `palpate_eval --peers`.
#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>

#include <CLI/CLI.hpp>

#include "bench/contact_setup.h"
#include "bench/harness.h"
#include "bench/peers.h"
#include "bench/wall_frame.h"
#include "eval/studies/boundary_stage.h"
#include "src/cloud/surface/surface_stages.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::bench {
namespace {

struct Settings {
  std::string csv, commit = "unknown", command;
  int passes = 3, poses = 200, frames = 30;
  std::vector<int> spheres = {1000, 5000, 17000};
  std::vector<int> depths = {10, 50, 100};
};

struct Summary {
  double median = 0, p99 = 0;  ///< µs
};

using Work = std::function<void(int)>;

/// Returns the processor time: on a busy machine a long call is interrupted more often than a short
/// one, and wall time would favor ours.
double microseconds() {
  timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}
double microseconds(const Work& work, int i) {
  const double start = microseconds();
  work(i);
  return microseconds() - start;
}

/// Times work(i) for i = 0 ... num - 1, one work after the other, in several passes: other load on
/// the machine slows all of them alike.
std::vector<Summary> time_in_turn(const std::vector<Work>& works, int num, int passes) {
  std::vector<std::vector<double>> times(works.size());
  for (int pass = 0; pass < passes; ++pass) {
    for (std::size_t w = 0; w < works.size(); ++w) {
      works[w](0);  // evicts the data of the previous work from the caches
      for (int i = 0; i < num; ++i) times[w].push_back(microseconds(works[w], i));
    }
  }
  std::vector<Summary> summaries;
  for (std::vector<double>& t : times) {
    std::sort(t.begin(), t.end());
    const double last = static_cast<double>(t.size() - 1);
    summaries.push_back({t[static_cast<std::size_t>(0.5 * last)],
                         t[static_cast<std::size_t>(std::ceil(0.99 * last))]});
  }
  return summaries;
}

/// Legend of the short names.
constexpr const char* kLibraries =
    "PCL organized is search::OrganizedNeighbor; PCL gradient and covariance are "
    "IntegralImageNormalEstimation; OpenCV FALS is rgbd::RgbdNormals; Embree answers point queries "
    "with its trees of quality medium (best) and low (quick)";

/// The lines of the file, also printed as they are added.
class Rows {
 public:
  void add(const std::string& name, const std::string& peer, const Summary& ours,
           const Summary& theirs, double build, const std::string& facts) {
    char line[400];
    std::snprintf(line, sizeof line, "%s,%s,%.2f,%.2f,%.2f,%.2f,%.2f,%s\n", name.c_str(),
                  peer.c_str(), ours.median, ours.p99, theirs.median, theirs.p99, build,
                  facts.c_str());
    text_ += line;
    std::printf("%-44s %-40s %9.1f us, ours %9.1f us: %7.2f times, its tree %8.1f ms  %s\n",
                name.c_str(), peer.c_str(), theirs.median, ours.median, theirs.median / ours.median,
                build / 1000, facts.c_str());
    std::fflush(stdout);
  }

  Status write(const Settings& settings, double load) const {
    char head[1200];
    std::snprintf(
        head, sizeof head,
        "# date: %s\n# machine: %s\n# commit: %s\n"
        "# settings: processor time; %d poses, %d frames, %d passes; load %.1f before, %.1f after\n"
        "# libraries: %s\n# command: %s\n"
        "case,peer,ours_median_us,ours_p99_us,peer_median_us,peer_p99_us,build_us,facts\n",
        today().c_str(), machine().c_str(), settings.commit.c_str(), settings.poses,
        settings.frames, settings.passes, load, machine_load(), kLibraries,
        settings.command.c_str());
    return write_file_atomically(settings.csv, head + text_);
  }

 private:
  std::string text_;
};

// ---- Boundary stage ----

/// Distance from a sphere's surface within which single precision may decide either way, m.
constexpr double kCloseCall = 2e-6;

struct QueriedPeer {
  std::unique_ptr<BoundaryPeer> library;
  double build = 0;  ///< µs
};

/// Runs ours with the output of the peers.
void query_ours(eval::BoundaryStage& stage, const Pose& X_WT, std::vector<SphereAnswer>& answers) {
  std::fill(answers.begin(), answers.end(), SphereAnswer{});
  stage.run(X_WT, [&](std::size_t k, const PointSums& sums) {
    constexpr double kScale = PointSums::kFinestScale;
    const double num = sums.num_points(kScale);
    answers[k] = {static_cast<int>(num), sums.offset(kScale) + num * X_WT.translation,
                  sums.normal(kScale)};
  });
}

/// True if both results are right for a sphere on which they differ: points lie on its surface.
bool is_close_call(const PointCloud& cloud, const Vec3d& c_W, double radius, int ours, int theirs) {
  int surely = 0, perhaps = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double distance = norm(to_double(cloud.point(i)) - c_W);
    surely += distance < radius - kCloseCall;
    perhaps += distance < radius + kCloseCall;
  }
  const auto [low, high] = std::minmax(ours, theirs);
  return surely <= low && high <= perhaps;
}

/// Returns the number of spheres on which a library differs from ours in close calls; fails on any
/// other difference.
int compare(BoundaryPeer& peer, Question question, const PointCloud& cloud, const Tool& tool,
            const Pose& X_WT, const std::vector<SphereAnswer>& ours) {
  std::vector<SphereAnswer> theirs(ours.size());
  peer.evaluate(question, tool.spheres(), X_WT, theirs);
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  int num_close = 0;
  for (std::size_t k = 0; k < ours.size(); ++k) {
    const SphereAnswer &a = ours[k], &b = theirs[k];
    const bool same = question == Question::which ? (a.num_points > 0) == (b.num_points > 0)
                                                  : a.num_points == b.num_points;
    if (!same) {
      const Sphere& s = tool.spheres()[k];
      const Vec3d c_W = R_WT * to_double(s.center) + X_WT.translation;
      const auto radius = static_cast<double>(s.radius);
      // For `which`, a library stops counting at one.
      const int num = question == Question::which ? std::min(a.num_points, 1) : a.num_points;
      const bool is_close = question == Question::which && num > b.num_points
                                ? is_close_call(cloud, c_W, radius, a.num_points, 0)
                                : is_close_call(cloud, c_W, radius, num, b.num_points);
      if (!is_close) {
        fail(peer.name() + " finds " + std::to_string(b.num_points) + " points in sphere " +
             std::to_string(k) + ", ours " + std::to_string(a.num_points) +
             "; the times of different work say nothing");
      }
      ++num_close;
    } else if (question == Question::sums && (norm(a.points - b.points) > 1e-6 * a.num_points ||
                                              norm(a.normals - b.normals) > 1e-6 * a.num_points)) {
      fail(peer.name() + " adds up the points of sphere " + std::to_string(k) +
           " to something else than ours");
    }
  }
  return num_close;
}

void time_boundary(const std::vector<QueriedPeer>& peers, int spheres, int depth,
                   const Settings& settings, Rows& rows) {
  const PointCloud& cloud = bumpy_wall();
  const Tool& tool = cube_tool(spheres);
  const std::vector<Pose> poses = random_poses(depth / 100.0, settings.poses);
  const auto pose = [&](int i) { return poses[static_cast<std::size_t>(i)]; };
  eval::BoundaryStage stage(tool, cloud.view());
  std::vector<SphereAnswer> answers(tool.spheres().size());

  struct Query {
    const QueriedPeer* peer;
    Question question;
    int num_close = 0;
  };
  std::vector<Query> requested;
  for (const Question question : {Question::sums, Question::which}) {
    for (const QueriedPeer& peer : peers) requested.push_back({&peer, question});
  }
  double touched = 0;
  for (int i = 0; i < settings.poses; ++i) {
    query_ours(stage, pose(i), answers);
    touched += static_cast<double>(std::count_if(
        answers.begin(), answers.end(), [](const SphereAnswer& a) { return a.num_points > 0; }));
    for (Query& a : requested) {
      a.num_close += compare(*a.peer->library, a.question, cloud, tool, pose(i), answers);
    }
  }

  int num_touched = 0;
  std::vector<Work> works = {
      [&](int i) { stage.run(pose(i), [&](std::size_t, const PointSums&) { ++num_touched; }); }};
  for (const Query& a : requested) {
    works.push_back(
        [&, a](int i) { a.peer->library->evaluate(a.question, tool.spheres(), pose(i), answers); });
  }
  const std::vector<Summary> times = time_in_turn(works, settings.poses, settings.passes);
  for (std::size_t w = 0; w < requested.size(); ++w) {
    char name[100], facts[100];
    std::snprintf(name, sizeof name, "boundary/spheres:%d/depth:%d/ask:%s", spheres, depth,
                  requested[w].question == Question::sums ? "sums" : "which");
    std::snprintf(facts, sizeof facts, "touched=%.1f close_calls=%d", touched / settings.poses,
                  requested[w].num_close);
    rows.add(name, requested[w].peer->library->name(), times[0], times[w + 1],
             requested[w].peer->build, facts);
  }
}

std::vector<QueriedPeer> boundary_peers(const Settings& settings) {
  const PointCloud& cloud = bumpy_wall();
  std::vector<QueriedPeer> peers;
  peers.push_back({pcl_organized_neighbor(cloud)});
  peers.push_back({nanoflann_tree(cloud)});
  peers.push_back({embree_tree(cloud, EmbreeTree::fast_to_query)});
  peers.push_back({embree_tree(cloud, EmbreeTree::fast_to_build)});
  for (QueriedPeer& peer : peers) {
    const Work build = [&](int) { peer.library->build(); };
    peer.build = time_in_turn({build}, 2, settings.passes).front().median;
  }
  return peers;
}

// ---- Surface estimation ----

constexpr int kWidth = 640, kHeight = 480;

/// Returns the rms depth error on a flat wall at 1 m, mm.
double depth_error(const std::function<float(std::size_t)>& depth) {
  double sum = 0;
  for (std::size_t i = 0; i < kWidth * kHeight; ++i) {
    const double error = static_cast<double>(depth(i)) - 1;
    sum += error * error;
  }
  return 1000 * std::sqrt(sum / (kWidth * kHeight));
}

std::string errors(double ours, double theirs) {
  char text[100];
  std::snprintf(text, sizeof text, "ours_error=%.4f peer_error=%.4f", ours, theirs);
  return text;
}

/// Makes the input points of the other libraries.
PointCloud points_of(std::span<const float> depth, const Intrinsics& k) {
  PointCloud cloud(kWidth, kHeight, k);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const auto i = static_cast<std::size_t>(v * kWidth + u);
      const auto z = static_cast<double>(depth[i]);
      cloud.set(i, to_float({(u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z}), {0, 0, -1});
    }
  }
  return cloud;
}

void time_normals(bool is_filtered, const Settings& settings, Rows& rows) {
  const WallFrame wall(kWidth, kHeight);
  SurfaceOptions options;
  options.filter.enabled = is_filtered;
  ThreadPool pool(1);
  SurfaceStages stages(kWidth, kHeight, wall.intrinsics, options, best_isa());
  stages.read(wall.image(), pool);
  stages.filter(pool);
  const PointCloud points = points_of(stages.depth(), wall.intrinsics);
  std::vector<std::unique_ptr<NormalsPeer>> peers = pcl_normals(points);
  peers.insert(peers.begin(), opencv_normals(points, wall.intrinsics));

  std::vector<Work> works = {[&](int) { stages.estimate_normals(pool); }};
  for (const auto& peer : peers) works.push_back([&peer](int) { peer->run(); });
  const std::vector<Summary> times = time_in_turn(works, settings.frames, settings.passes);
  const auto mean_error = [](const std::function<Vec3d(std::size_t)>& normal) {
    MeanAngle error;
    for (std::size_t i = 0; i < kWidth * kHeight; ++i) error.add(normal(i));
    return error.degrees();
  };
  const double ours =
      mean_error([&](std::size_t i) { return to_double(stages.cloud().normal(i)); });
  for (std::size_t p = 0; p < peers.size(); ++p) {
    const double theirs = mean_error([&](std::size_t i) { return peers[p]->normal(i); });
    rows.add(is_filtered ? "normals/input:filtered" : "normals/input:raw", peers[p]->name(),
             times[0], times[p + 1], 0, errors(ours, theirs));
  }
}

void time_filter(const Settings& settings, Rows& rows) {
  const WallFrame wall(kWidth, kHeight);
  ThreadPool pool(1);
  SurfaceStages stages(kWidth, kHeight, wall.intrinsics, {}, best_isa());
  stages.read(wall.image(), pool);
  const auto peer = opencv_bilateral(wall.depth, kWidth, kHeight);
  const std::vector<Summary> times =
      time_in_turn({[&](int) { stages.filter(pool); }, [&](int) { peer->run(); }}, settings.frames,
                   settings.passes);
  const double ours = depth_error([&](std::size_t i) { return stages.depth()[i]; });
  const double theirs = depth_error([&](std::size_t i) { return peer->depth(i); });
  rows.add("filter/input:raw", peer->name(), times[0], times[1], 0, errors(ours, theirs));
}

Settings parse(int argc, char** argv) {
  Settings settings;
  CLI::App app("Other libraries beside ours in one run");
  app.add_option("--csv", settings.csv, "write what palpate_eval --peers reads");
  app.add_option("--commit", settings.commit, "of the source, for people");
  app.add_option("--passes", settings.passes)->check(CLI::Range(1, 1000));
  app.add_option("--poses", settings.poses, "of the tool")->check(CLI::Range(1, 100000));
  app.add_option("--frames", settings.frames, "per pass, of normals")->check(CLI::Range(1, 10000));
  app.add_option("--spheres", settings.spheres)->delimiter(',')->check(CLI::Range(1, 100000));
  app.add_option("--depths", settings.depths, "percent of the tool")
      ->delimiter(',')
      ->check(CLI::Range(1, 100));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    std::exit(app.exit(error));
  }
  settings.command = "bench_peers";
  for (int i = 1; i < argc; ++i) settings.command += std::string(" ") + argv[i];
  return settings;
}

int run(const Settings& settings) {
  const double load = machine_load();
  Rows rows;
  const std::vector<QueriedPeer> peers = boundary_peers(settings);
  for (const int spheres : settings.spheres) {
    for (const int depth : settings.depths) time_boundary(peers, spheres, depth, settings, rows);
  }
  for (const bool is_filtered : {false, true}) time_normals(is_filtered, settings, rows);
  time_filter(settings, rows);
  if (settings.csv.empty()) return 0;
  if (const Status written = rows.write(settings, load); !written) fail(written.error().message);
  return 0;
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) { return palpate::bench::run(palpate::bench::parse(argc, argv)); }
