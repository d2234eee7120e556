// Bodies against bodies: how much of what two solids share is found by their packings, and what
// force comes of it. The common volume of convex bodies is known in closed form; where a body is
// pushed into one face of a block, so is the direction.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <span>

#include "eval/figures/option_figures.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/parallel.h"
#include "eval/studies/random.h"
#include "eval/studies/range.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "palpate/contact/body_contact.h"
#include "palpate/mesh/shapes.h"
#include "scenes/mesh_faces.h"
#include "scenes/truth.h"

namespace palpate::eval {
namespace {

constexpr double kSize = 0.1;          // m, of a body
constexpr double kFace = 1;            // m, z of the block's face
constexpr double kBlock = 3 * kSize;   // m, its sides
constexpr double kAside = 0.06;        // m, from the middle of the face: far from its edges
constexpr double kLeastShare = 0.02;   // of a body: what is less says nothing
constexpr double kFine = kBlock / 10;  // m, radius: a block of no larger spheres
constexpr int kLoopSteps = 4000;

// What our docs say.
constexpr double kAsTheFills = 0.1;  // of what the fills multiplied say
constexpr double kConservative = 1e-6;
constexpr double kOffNormal = 25;      // degrees, rms
constexpr double kAboutVolume = 0.25;  // force, of the volume found
constexpr double kMuchWeaker = 0.5;    // force, where a block's spheres are small

struct Bodies {
  const char *name, *a, *b;  ///< shapes
};
constexpr Bodies kBodies[] = {{"cube and cube", "box", "box"},
                              {"octahedron and cube", "octahedron", "box"},
                              {"tetrahedron and octahedron", "tetrahedron", "octahedron"}};

// The truth ---------------------------------------------------------------------------------------

std::vector<Plane<double>> planes_of(const TriangleMesh& mesh, const Pose& X_WB) {
  std::vector<Plane<double>> planes;
  scenes::for_each_face(mesh, X_WB, [&](const scenes::Triangle& face) {
    const Vec3d normal = normalized(scenes::doubled_area(face));
    planes.push_back({normal, dot(normal, face[0])});
  });
  return planes;
}

/// Calls visit(triangle) for triangles that make up the part of a face behind all planes. At most
/// three of them at a time: more corners a polygon does not hold.
template <class Visit>
void cut(const scenes::Triangle& face, std::span<const Plane<double>> planes, const Visit& visit) {
  const auto now = planes.first(std::min<std::size_t>(3, planes.size()));
  const auto later = planes.subspan(now.size());
  scenes::Polygon polygon(face);
  for (const Plane<double>& plane : now) polygon.clip(plane);
  polygon.for_each_triangle([&](const scenes::Triangle& part) {
    if (later.empty()) {
      visit(part);
    } else {
      cut(part, later, visit);
    }
  });
}

/// Common volume of two convex bodies: what lies within the other of the surface of either bounds
/// it, and cones over that, from any point, make it up.
double common_volume(const TriangleMesh& a, const Pose& X_WA, const TriangleMesh& b,
                     const Pose& X_WB) {
  const Vec3d apex = X_WA.translation;
  double sum = 0;
  const auto add = [&](const TriangleMesh& mesh, const Pose& X_WM,
                       const std::vector<Plane<double>>& within) {
    scenes::for_each_face(mesh, X_WM, [&](const scenes::Triangle& face) {
      cut(face, within, [&](const scenes::Triangle& t) {
        sum += dot(t[0] - apex, cross(t[1] - apex, t[2] - apex)) / 6;
      });
    });
  };
  add(a, X_WA, planes_of(b, X_WB));
  add(b, X_WB, planes_of(a, X_WA));
  return sum;
}

// Overlaps at random poses ------------------------------------------------------------------------

/// How much of the common volume is found.
struct Found {
  double share = 0;   ///< of all poses together
  double spread = 0;  ///< rms over the poses, of `share`
};

Found found_of(const Tool& a, const Tool& b, int num_poses, Work& work) {
  BodyContact contact(a, b);
  Random random(5);
  const double least = kLeastShare * std::min(a.mesh_mass().volume, b.mesh_mass().volume);
  double exact_sum = 0, found_sum = 0;
  std::vector<double> shares;
  while (shares.size() < static_cast<std::size_t>(num_poses)) {
    const Pose X_WA{{}, random.rotation(kPi)};
    const Quaternion turned = random.rotation(kPi);
    const Pose X_WB{random.in_box(kSize), turned};
    const double exact = common_volume(a.mesh(), X_WA, b.mesh(), X_WB);
    if (exact < least) continue;
    const double found = contact.measure(X_WA, X_WB).on_a.volume;
    exact_sum += exact;
    found_sum += found;
    shares.push_back(found / exact);
    work.step();
  }
  const double share = found_sum / exact_sum;
  double squares = 0;
  for (const double s : shares) squares += (s / share - 1) * (s / share - 1);
  return {share, std::sqrt(squares / num_poses)};
}

double fill(const Tool& tool) { return tool.sphere_mass().volume / tool.mesh_mass().volume; }

// Pushed into a face ------------------------------------------------------------------------------

/// Of the tool's extent along the normal of the face.
constexpr std::array kDepths{0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0};
constexpr std::size_t kShallow = 1, kDeep = 7;  // of them: 5 and 50 %

/// A cube goes into a face of a block at many places, turned at random.
struct Push {
  std::array<double, kDepths.size()> share{};  ///< found, of the common volume of all places
  double direction = 0, direction_most = 0;    ///< degrees off the normal of the face: rms, worst
  double strength = 0;                         ///< |force| / volume found, of all
};

Push push_of(const Tool& tool, const Tool& block, int num_places, Work& work) {
  const scenes::Environment face = scenes::Environment::wall(kFace);
  const Pose X_WB{{0, 0, kFace + kBlock / 2}, {}};
  BodyContact contact(tool, block);
  Random random(9);
  Push push;
  std::array<double, kDepths.size()> exact{};
  double squares = 0, force = 0, volume = 0;
  int num_felt = 0;
  for (int place = 0; place < num_places; ++place) {
    const Quaternion turned = random.rotation(kPi);
    const double x = random.uniform(-kAside, kAside), y = random.uniform(-kAside, kAside);
    const Reach reach = reach_along_z(tool.mesh(), turned);
    for (std::size_t d = 0; d < kDepths.size(); ++d) {
      work.step();
      const Pose X_WT{{x, y, kFace - reach.front + kDepths[d] * (reach.front + reach.rear)},
                      turned};
      const Penetration found = contact.measure(X_WT, X_WB).on_a;
      push.share[d] += found.volume;
      exact[d] += scenes::exact_volume(tool.mesh(), X_WT, face);
      const Vec3d& f = found.measure_W.force;
      force += norm(f);
      volume += found.volume;
      if (f == Vec3d{}) continue;
      const double off = std::atan2(std::hypot(f.x, f.y), -f.z) * 180 / kPi;
      squares += off * off;
      ++num_felt;
      push.direction_most = std::max(push.direction_most, off);
    }
  }
  for (std::size_t d = 0; d < kDepths.size(); ++d) push.share[d] /= exact[d];
  push.direction = std::sqrt(squares / num_felt);
  push.strength = force / volume;
  return push;
}

/// Net work of a closed loop through the face, share of all work.
double body_loop_work(const Tool& tool, const Tool& block, int num_steps, Work& work) {
  ContactCase tilted;
  for (ContactCase& c : tilted_cases()) {
    if (c.scene == "wall") tilted = std::move(c);
  }
  const Pose X_WB{{0, 0, kFace + kBlock / 2}, {}};
  BodyContact contact(tool, block);
  const Measure measured{tool.mesh_mass().volume, [&](const Pose& X_WT) {
                           work.step();
                           return contact.measure(X_WT, X_WB).on_a;
                         }};
  return loop_work(tilted, tool, measured, num_steps);
}

// The figure --------------------------------------------------------------------------------------

/// What comes of one number of spheres in each body.
struct Row {
  int num_spheres = 0;
  std::array<Found, std::size(kBodies)> found;  ///< by bodies
  std::array<double, std::size(kBodies)> fill_a{}, fill_b{};
  Push push, fine;  ///< into a block as it is packed by default, and of small spheres
  double loop = 0;

  /// What is to be expected if the spheres of either know nothing of those of the other.
  double multiplied(std::size_t bodies) const { return fill_a[bodies] * fill_b[bodies]; }
};

/// A block without large spheres.
Result<std::shared_ptr<const Tool>> fine_block(const Context& context, int num_spheres) {
  const TriangleMesh mesh = make_box({kBlock, kBlock, kBlock});
  PackOptions options;
  options.max_spheres = num_spheres;
  options.max_radius = kFine;
  options.num_threads = context.settings().num_threads;
  auto packing = pack_spheres(mesh, options);
  if (!packing) return packing.error();
  auto tool =
      Tool::build(mesh, *std::move(packing), GapRule::relative, "block", options.num_threads);
  if (!tool) return tool.error();
  return std::make_shared<const Tool>(*std::move(tool));
}

Result<std::vector<Row>> measure(Context& context) {
  const auto numbers = context.choose<std::vector<int>>({100, 1000, 10000}, {100, 1000});
  const int num_poses = context.choose(1000, 60), num_places = context.choose(200, 20);
  const int loop_steps = context.choose(kLoopSteps, kLoopSteps / 2);
  std::vector<Row> rows(numbers.size());
  std::vector<std::function<void(Work&)>> tasks;
  // The largest first: the others are its prefixes, and they fill the time that it takes.
  for (std::size_t i = numbers.size(); i-- > 0;) {
    const int num = numbers[i];
    Row& row = rows[i];
    row.num_spheres = num;
    const auto tool = context.tool("box", kSize, num);
    if (!tool) return tool.error();
    const auto block = context.tool("box", kBlock, num);
    if (!block) return block.error();
    const auto fine = fine_block(context, num);
    if (!fine) return fine.error();
    tasks.push_back([=, &row, tool = *tool, block = *block](Work& work) {
      row.loop = body_loop_work(*tool, *block, loop_steps, work);
    });
    tasks.push_back([=, &row, tool = *tool, block = *block](Work& work) {
      row.push = push_of(*tool, *block, num_places, work);
    });
    tasks.push_back([=, &row, tool = *tool, block = *fine](Work& work) {
      row.fine = push_of(*tool, *block, num_places, work);
    });
    for (std::size_t k = 0; k < std::size(kBodies); ++k) {
      const auto a = context.tool(kBodies[k].a, kSize, num);
      if (!a) return a.error();
      const auto b = context.tool(kBodies[k].b, kSize, num);
      if (!b) return b.error();
      row.fill_a[k] = fill(**a);
      row.fill_b[k] = fill(**b);
      tasks.push_back([=, &row, a = *a, b = *b](Work& work) {
        row.found[k] = found_of(*a, *b, num_poses, work);
      });
    }
    context.progress(0);
  }
  const auto steps = static_cast<double>(num_poses * std::size(kBodies)) +
                     2.0 * num_places * static_cast<double>(kDepths.size()) + loop_steps;
  run_tasks(context, static_cast<int>(tasks.size()), steps * static_cast<double>(rows.size()),
            [&](int i, Work& work) { tasks[static_cast<std::size_t>(i)](work); });
  return rows;
}

Table volume_table(const std::vector<Row>& rows) {
  Table table{"Found of the common volume, random poses",
              {"bodies", "spheres in each", "first filled, %", "second filled, %", "multiplied, %",
               "found, %", "spread over the poses, ± %"},
              {}};
  for (std::size_t k = 0; k < std::size(kBodies); ++k) {
    for (const Row& row : rows) {
      table.rows.push_back(
          {kBodies[k].name, words("%d", row.num_spheres), words("%.1f", 100 * row.fill_a[k]),
           words("%.1f", 100 * row.fill_b[k]), words("%.1f", 100 * row.multiplied(k)),
           words("%.1f", 100 * row.found[k].share), words("%.0f", 100 * row.found[k].spread)});
    }
  }
  return table;
}

Table push_table(const std::vector<Row>& rows) {
  Table table{"A cube in the face of a block",
              {"spheres in each", "spheres of the block", "found at 5 % depth, %",
               "at 50 % depth, %", "direction, ° rms", "force / volume found"},
              {}};
  for (const bool is_fine : {false, true}) {
    for (const Row& row : rows) {
      const Push& push = is_fine ? row.fine : row.push;
      table.rows.push_back({words("%d", row.num_spheres),
                            is_fine ? words("radius up to %g cm", 100 * kFine) : "as large as fit",
                            words("%.1f", 100 * push.share[kShallow]),
                            words("%.1f", 100 * push.share[kDeep]), words("%.0f", push.direction),
                            words("%.2f", push.strength)});
    }
  }
  return table;
}

Plot depth_plot(const std::vector<Row>& rows) {
  Plot plot{"A cube in the face of a block",
            "depth, % of the cube's extent",
            "found, % of the common volume",
            {},
            false,
            false,
            ""};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Curve curve{words("%d spheres", rows[i].num_spheres), words("other%zu", i % 4 + 1), {}, {}};
    for (std::size_t d = 0; d < kDepths.size(); ++d) {
      curve.x.push_back(100 * kDepths[d]);
      curve.y.push_back(100 * rows[i].push.share[d]);
    }
    plot.curves.push_back(std::move(curve));
  }
  const Row &first = rows.front(), &last = rows.back();
  plot.caption = words(
      "Light touches fall into the gaps below the face: at 5 %% depth %.0f %% are found with %d "
      "spheres in each body and %.0f %% with %d, at 50 %% depth %.0f and %.0f %%.",
      100 * first.push.share[kShallow], first.num_spheres, 100 * last.push.share[kShallow],
      last.num_spheres, 100 * first.push.share[kDeep], 100 * last.push.share[kDeep]);
  return plot;
}

void add_numbers(FigureResult& result, const std::vector<Row>& rows) {
  for (const Row& row : rows) {
    const auto add = [&](const std::string& name, double value, const char* unit) {
      result.numbers.push_back({words("%d.", row.num_spheres) + name, value, unit});
    };
    for (std::size_t k = 0; k < std::size(kBodies); ++k) {
      const std::string bodies = kBodies[k].name;
      add(bodies + ".found", 100 * row.found[k].share, "%");
      add(bodies + ".multiplied", 100 * row.multiplied(k), "%");
      add(bodies + ".spread", 100 * row.found[k].spread, "%");
    }
    for (const bool is_fine : {false, true}) {
      const Push& push = is_fine ? row.fine : row.push;
      const std::string key = is_fine ? "fine_face." : "face.";
      add(key + "found_shallow", 100 * push.share[kShallow], "%");
      add(key + "found_deep", 100 * push.share[kDeep], "%");
      add(key + "direction_rms", push.direction, "deg");
      add(key + "direction_most", push.direction_most, "deg");
      add(key + "force_over_volume", push.strength, "1");
    }
    add("loop_work", 100 * row.loop, "%");
  }
}

void add_claims(FigureResult& result, const std::vector<Row>& rows) {
  Range ratio, loop, direction, strength, fine;
  for (const Row& row : rows) {
    for (std::size_t k = 0; k < std::size(kBodies); ++k) {
      ratio.add(row.found[k].share / row.multiplied(k));
    }
    loop.add(row.loop);
    direction.add(row.push.direction);
    strength.add(row.push.strength);
    fine.add(row.fine.strength);
  }
  const int least = rows.front().num_spheres, most = rows.back().num_spheres;
  result.claims.push_back(
      {"Of the volume that two bodies share as much is found "
       "as their fills multiplied.",
       words("%.2f to %.2f times that, with %d to %d spheres in each body.", ratio.low, ratio.high,
             least, most),
       holds_between(ratio, 1 - kAsTheFills, 1 + kAsTheFills), Source::docs});
  result.claims.push_back(
      {"The force between bodies has a potential, so that a "
       "closed path gives no energy.",
       words("A closed loop gives away at most %.0e of all work.", loop.high),
       holds_below(loop.high, kConservative), Source::docs});
  result.claims.push_back(
      {"A face of a body is felt as the spheres behind it: "
       "off its normal, however many they are, and much weaker if they are small.",
       words("With %d to %d spheres %.0f to %.0f° rms off the normal, and %.2f to %.2f times as "
             "strong as the volume found; at most %.2f times if the block has no large ones.",
             least, most, direction.low, direction.high, strength.low, strength.high, fine.high),
       holds_with({holds_below(direction.high, kOffNormal),
                   holds_between(strength, 1 - kAboutVolume, 1 + kAboutVolume),
                   holds_below(fine.high, kMuchWeaker * strength.low)}),
       Source::docs});
}

}  // namespace

Result<FigureResult> figure_bodies(Context& context) {
  const auto rows = measure(context);
  if (!rows) return rows.error();
  FigureResult result;
  add_claims(result, *rows);
  result.plots = {depth_plot(*rows)};
  result.tables = {volume_table(*rows), push_table(*rows)};
  add_numbers(result, *rows);
  result.notes = {
      words("Random poses: all that share at least %.0f %% of the smaller body; found is that of "
            "all poses together, spread the rms over single ones.",
            100 * kLeastShare),
      words("The block's face is wide enough that no other face of it is near; places and turns "
            "are random. The loop is closed, smooth, in all six degrees of freedom, %d steps.",
            context.choose(kLoopSteps, kLoopSteps / 2))};
  return result;
}

}  // namespace palpate::eval
