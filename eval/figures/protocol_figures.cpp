// protocol: the comparison of methods in the thesis (section 5): a hand touches something that
// moves before a depth camera, the run is recorded, and every method gets the same hand and frames.
#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "eval/studies/mesh_truth.h"
#include "eval/studies/parallel.h"
#include "eval/studies/range.h"
#include "eval/studies/recorded_run.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "src/session/internal/probing_path.h"

namespace palpate::eval {
namespace {

constexpr const char* kRecordedHand = "sequences/hand_sr305_20210326-230536";
constexpr double kPen = 0.12;         // m
constexpr double kInContact = 0.005;  // share of the tool: less has no reliable direction
constexpr double kLost = 0.01;        // share of the tool where contact may not be lost
constexpr double kSpacing = 0.0006;   // m, of the points of the exact volume
constexpr std::size_t kTicksPerTruth = 20;
constexpr double kSameWay = 10, kAlmost = 20;        // degrees
constexpr std::size_t kNumOfThesis = 3, kField = 4;  // of all_methods_alike()

/// Results of one method on a run, tick by tick, in shares of the whole tool.
struct Measured {
  std::vector<Vec3d> force;
  std::vector<double> volume;

  /// Change of the force from tick to tick, %: the largest, and the rms.
  double largest_step() const {
    double largest = 0;
    for_each_step([&](double step) { largest = std::max(largest, step); });
    return largest;
  }
  double rms_step() const {
    double sum = 0;
    for_each_step([&](double step) { sum += step * step; });
    return std::sqrt(sum / static_cast<double>(force.size() - 1));
  }

 private:
  template <class F>
  void for_each_step(const F& f) const {
    for (std::size_t i = 0; i + 1 < force.size(); ++i) f(100 * norm(force[i + 1] - force[i]));
  }
};

/// A recorded run and all its replays.
struct Replays {
  std::string key, name;
  std::vector<double> time;  ///< s
  std::vector<Pose> X_WT;
  std::vector<Measured> measured;  ///< as all_methods_alike()
  std::string difference;          ///< of its repetition
};

double degrees_between(const Vec3d& a, const Vec3d& b) {
  return 180 / kPi * std::atan2(norm(cross(a, b)), dot(a, b));
}

/// Records a pen in a simulated hand that touches the frames' scene, and replays every method.
Result<Replays> replays(Context& context, std::string key, std::string name,
                        const DepthStreamInfo& stream, const std::vector<DepthFrame>& frames,
                        const Tool& tool, const std::vector<TimedPose>& path, double done) {
  const auto run =
      RecordedRun::touch(tool, stream, frames, [&](double time) { return pose_at(path, time); });
  if (!run) return run.error();
  auto difference = run->repeat();
  if (!difference) return difference.error();
  Replays all{std::move(key), std::move(name), {}, {}, {}, *std::move(difference)};
  for (const Method& method : all_methods_alike()) {
    const auto ticks = run->by(method.options);
    if (!ticks) return ticks.error();
    const double whole = full_volume(tool, method.options);
    Measured& measured = all.measured.emplace_back();
    all.time.clear(), all.X_WT.clear();
    for (const TickRecord& tick : *ticks) {
      measured.force.push_back(tick.penetration.measure_W.force / whole);
      measured.volume.push_back(tick.penetration.volume / whole);
      all.time.push_back(tick.time), all.X_WT.push_back(tick.step.X_WT);
    }
    context.progress(done + 0.08 * static_cast<double>(all.measured.size()));
  }
  return all;
}

/// Angles to the force of the field where both are in contact, degrees, and share of ticks at which
/// only the field is in contact, %.
struct AgainstField {
  std::vector<double> angles;
  double lost = 0, volume_rms = 0;  ///< %, % of the tool
};
AgainstField against_field(const Measured& measured, const Measured& field) {
  AgainstField result;
  double num = 0, squares = 0;
  for (std::size_t i = 0; i < measured.force.size(); ++i) {
    const double off = 100 * (measured.volume[i] - field.volume[i]);
    squares += off * off;
    if (field.volume[i] > kLost) ++num, result.lost += measured.volume[i] == 0;
    if (field.volume[i] < kInContact || norm(measured.force[i]) == 0) continue;
    result.angles.push_back(degrees_between(measured.force[i], field.force[i]));
  }
  result.lost *= 100 / std::max(1.0, num);
  result.volume_rms = std::sqrt(squares / static_cast<double>(measured.force.size()));
  return result;
}

void add_run(FigureResult& result, const Replays& run) {
  const auto methods = all_methods_alike();
  Table table{"Replayed with every method: " + run.name,
              {"method", "largest volume, %", "largest step of the force, %", "rms step, %",
               "volume off the field, % rms", "force off the field, ° median / 95 %",
               "contact lost, % of the ticks"},
              {}};
  Plot plot{run.name, "time, s", "force towards the camera, N", {}, false, false, ""};
  std::vector<double> steps, medians;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Measured& measured = run.measured[m];
    const AgainstField off = against_field(measured, run.measured[kField]);
    steps.push_back(measured.largest_step());
    medians.push_back(off.angles.empty() ? std::nan("") : percentile(off.angles, 0.5));
    table.rows.push_back(
        {methods[m].name, words("%.2f", 100 * largest_of(measured.volume)), words("%.3f", steps[m]),
         words("%.4f", measured.rms_step()), words("%.2f", off.volume_rms),
         off.angles.empty() ? "none"
                            : words("%.2f / %.2f", medians[m], percentile(off.angles, 0.95)),
         words("%.1f", off.lost)});
    const std::string key = run.key + "." + methods[m].name + ".";
    result.numbers.push_back({key + "largest_step", steps[m], "%"});
    result.numbers.push_back({key + "rms_step", measured.rms_step(), "%"});
    result.numbers.push_back({key + "lost", off.lost, "%"});
    Curve curve{methods[m].name, methods[m].name, run.time, {}};
    for (const Vec3d& f : measured.force) curve.y.push_back(-kFullForce * f.z);
    plot.curves.push_back(std::move(curve));
  }
  const std::string of_thesis = words(
      "weighted %.2f %% of the whole force, simplified %.2f, graph "
      "%.2f",
      steps[0], steps[1], steps[2]);
  plot.caption = "Largest step from tick to tick: " + of_thesis + words(", field %.2f.", steps[4]);
  result.claims.push_back(
      {"Replayed on one recorded run (5.10 to 5.12), weighted is best, simplified good and the "
       "graph "
       "bad: " +
           run.name + ".",
       "Largest steps: " + of_thesis + ".", are_ranked(steps[0], steps[1], steps[2])});
  result.claims.push_back(
      {"On the same run the field is smoother than the smoothest of the thesis' "
       "methods: " +
           run.name + ".",
       words("Largest step of the field %.2f %%; ", steps[kField]) + of_thesis + ".",
       is_better(steps[kField], std::min({steps[0], steps[1], steps[2]})), Source::ours});
  const double farthest = std::max({medians[0], medians[1], medians[2]});
  result.claims.push_back(
      {words("The field pushes where the methods of the thesis push, within %.0f° in the median: ",
             kSameWay) +
           run.name + ".",
       words("Weighted %.2f°, simplified %.2f°, graph %.2f° off.", medians[0], medians[1],
             medians[2]),
       holds_up_to(farthest, kSameWay, kAlmost), Source::docs});
  result.claims.push_back({"A recorded run repeats to the bit: " + run.name + ".",
                           run.difference.empty() ? words("All of %zu ticks.", run.time.size())
                                                  : "First difference: " + run.difference + ".",
                           run.difference.empty() ? Verdict::holds : Verdict::fails, Source::docs});
  result.tables.push_back(std::move(table));
  result.plots.push_back(std::move(plot));
}

/// Adds errors against the mesh of the simulated hand, which is known, as it was `late` s ago.
void add_truth(FigureResult& result, Context& context, const Replays& run, const Tool& tool,
               const scenes::Body& hand, double late) {
  const std::vector<Vec3d> points =
      points_inside(tool.mesh(), context.choose(kSpacing, 2 * kSpacing));
  const MeshInside inside(hand.mesh);
  const std::size_t num = run.time.size() / kTicksPerTruth;
  std::vector<SampledPenetration> truth(num);
  const auto tick_of = [](std::size_t i) { return i * kTicksPerTruth; };
  run_tasks(context, static_cast<int>(num), static_cast<double>(num), [&](int task, Work& work) {
    const auto i = static_cast<std::size_t>(task);
    const Pose X_WB = hand.motion(run.time[tick_of(i)] - late);
    truth[i] = sampled_penetration(points, inverse(X_WB) * run.X_WT[tick_of(i)], inside);
    truth[i].force = rotate(X_WB.rotation, truth[i].force);
    work.step();
  });
  const auto methods = all_methods_alike();
  Table table{"Against the mesh of the simulated hand",
              {"method", "volume, % rms", "direction, ° rms", "contact lost, % of the ticks"},
              {}};
  std::vector<double> volume, direction;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Measured& measured = run.measured[m];
    double squares = 0, turned = 0, num_turned = 0, num_lost = 0, num_in = 0;
    for (std::size_t i = 0; i < num; ++i) {
      const double off = 100 * (measured.volume[tick_of(i)] - truth[i].share);
      squares += off * off;
      num_in += truth[i].share > kLost;
      num_lost += truth[i].share > kLost && measured.volume[tick_of(i)] == 0;
      if (truth[i].share < kInContact || norm(measured.force[tick_of(i)]) == 0) continue;
      const double angle = degrees_between(measured.force[tick_of(i)], truth[i].force);
      turned += angle * angle, ++num_turned;
    }
    volume.push_back(std::sqrt(squares / static_cast<double>(num)));
    direction.push_back(std::sqrt(turned / num_turned));
    table.rows.push_back({methods[m].name, words("%.2f", volume[m]), words("%.2f", direction[m]),
                          words("%.1f", 100 * num_lost / std::max(1.0, num_in))});
    const std::string key = run.key + "." + methods[m].name + ".";
    result.numbers.push_back({key + "volume_rms", volume[m], "%"});
    result.numbers.push_back({key + "direction_rms", direction[m], "deg"});
  }
  const auto add = [&](const char* claim, const std::vector<double>& errors, const char* unit) {
    const auto best = static_cast<std::size_t>(
        std::min_element(errors.begin(), errors.begin() + kNumOfThesis) - errors.begin());
    result.claims.push_back({claim,
                             words("%.3g%s rms; %s, the best of them, %.3g%s.", errors[kField],
                                   unit, methods[best].name, errors[best], unit),
                             is_better(errors[kField], errors[best]), Source::ours});
  };
  add("On the simulated hand the field is nearer to the volume in its mesh than any method of the "
      "thesis.",
      volume, " % of the tool");
  add("On the simulated hand its force is nearer to the normals of the mesh than that of any "
      "method "
      "of the thesis.",
      direction, "°");
  result.tables.push_back(std::move(table));
}

Result<FigureResult> protocol(Context& context) {
  FigureResult result;
  const auto tool = context.thesis_tool("stylus", kPen, context.choose(5000, 500));
  if (!tool) return tool.error();

  DepthStreamInfo stream;
  auto recorded = context.recorded(kRecordedHand, stream);
  if (!recorded) return recorded.error();
  const std::string name = "a recorded hand, every 20th frame";
  if (*recorded) {
    const auto path = probing_path(
        [&]() -> Result<std::unique_ptr<DepthSource>> {
          return frames_in_memory(stream, **recorded);
        },
        **tool, std::nullopt);
    if (!path) return path.error();
    const auto run = replays(context, "recorded", name, stream, **recorded, **tool, path->poses, 0);
    if (!run) return run.error();
    add_run(result, *run);
  } else {
    result.claims.push_back({"Replayed on one recorded run: " + name + ".",
                             "The recording is not here: give its folder with --data.",
                             Verdict::not_measured});
  }

  auto scene = scenes::make_scene("hand");
  if (!scene) return scene.error();
  if (context.quick()) scenes::set_image_size(*scene, 320, 240);
  const auto frames = context.simulated(*scene, {}, stream);
  if (!frames) return frames.error();
  std::vector<TimedPose> path;
  for (std::size_t i = 0; i < scene->path_times.size(); ++i) {
    path.push_back({scene->path_times[i], scene->path_poses[i]});
  }
  const auto run = replays(context, "simulated", "a simulated hand at 30 Hz", stream, *frames,
                           **tool, path, 0.45);
  if (!run) return run.error();
  add_run(result, *run);
  const auto hand = std::ranges::find(scene->bodies, "hand", &scenes::Body::name);
  add_truth(result, context, *run, **tool, *hand, 1 / stream.rate);

  result.notes.push_back(words(
      "A pen of 12 cm with %zu spheres in a simulated hand, on a simulated device at 1 kHz that "
      "feels the field (%.0f N of a tool wholly inside), touches a hand that moves; palpate "
      "records "
      "the run and replays it with each method, as palpate replay does. Depth is interpolated "
      "between frames and averaged over time as palpate touch does by default. All methods count "
      "the volumes that spheres represent; steps and volumes are shares of the whole tool.",
      (*tool)->spheres().size(), kFullForce));
  result.notes.push_back(
      "Of the recorded hand (a SR305 at 30 Hz, 8 frames, every 20th of the recording, so that the "
      "hand moves two thirds of a second between two frames; the path that palpate touch chooses) "
      "nobody knows the truth. The simulated hand sways before a Kinect with its noise; its truth "
      "is "
      "its own mesh at the instant that the two frames in use blend to, by points in a grid, every "
      "20th tick.");
  return result;
}

}  // namespace

std::vector<FigureSpec> protocol_figures() {
  return {{"protocol", "A moving hand, recorded once and replayed with every method", "Quality",
           protocol}};
}

}  // namespace palpate::eval
