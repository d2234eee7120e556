// Bodies against bodies: share of the common volume of two solids found by the distance fields of
// their meshes or by their packings, and the resulting force. The common volume of convex bodies is
// known in closed form; where a body is pushed into one face of a block, so is the direction.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <span>

#include "eval/figures/option_figures.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/common_volume.h"
#include "eval/studies/parallel.h"
#include "eval/studies/range.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "palpate/contact/body_contact.h"
#include "palpate/mesh/mesh.h"
#include "scenes/mesh_faces.h"
#include "scenes/truth.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

constexpr double kSize = 0.1;          // m, of a body
constexpr double kFace = 1;            // m, z of the block's face
constexpr double kBlock = 3 * kSize;   // m, its sides
constexpr double kAside = 0.01;        // m, from the middle of the face: far from its edges
constexpr double kMinShare = 0.02;     // of a body: less is too little to judge
constexpr double kFine = kBlock / 10;  // m, radius: a block of no larger spheres
constexpr int kLoopSteps = 4000;
constexpr double kStep = 5e-5;  // m, between poses of the path on which jumps are measured
constexpr double kWay = 0.3;    // length of the path, of the cube's extent

// Claims of the documentation.
constexpr double kAsTheFills = 0.1;  // relative to the product of the fills
constexpr double kConservative = 1e-6;
constexpr double kOffNormal = 25;      // degrees, rms
constexpr double kAboutVolume = 0.25;  // force, of the volume found
constexpr double kMuchWeaker = 0.5;    // force, where a block's spheres are small
constexpr double kOnePercent = 0.01, kOneDegree = 1, kMaxJump = 1.25;  // by the field

struct Bodies {
  const char *name, *a, *b;  ///< shapes
};
constexpr Bodies kBodies[] = {{"cube and cube", "box", "box"},
                              {"octahedron and cube", "octahedron", "box"},
                              {"tetrahedron and octahedron", "tetrahedron", "octahedron"}};

// Overlaps at random poses ------------------------------------------------------------------------

/// Volume found, relative to the exact common volume.
struct Found {
  double share = 0;   ///< of all poses together
  double spread = 0;  ///< rms over the poses, of `share`
  double rms = 0;     ///< error, of the smaller body
};

std::unique_ptr<BodyPairQuery> query(const Tool& a, const Tool& b, BodyMethod method) {
  return make_body_pair_query(palpate::Place::cpu(), a, b, {.method = method}).value();
}

Found found_of(const Tool& a, const Tool& b, BodyMethod method, int num_poses, Work& work) {
  const auto contact = query(a, b, method);
  Random random(5);
  const double smaller = std::min(a.mesh_mass().volume, b.mesh_mass().volume);
  double exact_sum = 0, found_sum = 0, errors = 0;
  std::vector<double> shares;
  while (shares.size() < static_cast<std::size_t>(num_poses)) {
    const Pose X_WA{{}, random.rotation(kPi)};
    const Quaternion turned = random.rotation(kPi);
    const Pose X_WB{random.in_box(kSize), turned};
    const double exact = common_volume(a.mesh(), X_WA, b.mesh(), X_WB);
    if (exact < kMinShare * smaller) continue;
    const double found = contact->measure(X_WA, X_WB).on_a.volume;
    exact_sum += exact;
    found_sum += found;
    errors += (found - exact) * (found - exact);
    shares.push_back(found / exact);
    work.step();
  }
  const double share = found_sum / exact_sum;
  double squares = 0;
  for (const double s : shares) squares += (s / share - 1) * (s / share - 1);
  return {share, std::sqrt(squares / num_poses), std::sqrt(errors / num_poses) / smaller};
}

double fill(const Tool& tool) { return tool.sphere_mass().volume / tool.mesh_mass().volume; }

// Pushed into a face ------------------------------------------------------------------------------

/// Depths of the push, in shares of the tool's extent along the normal of the face.
constexpr std::array kDepths{0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0};
constexpr std::size_t kShallow = 1, kDeep = 7;  // indices of 5 and 50 %
/// Number of depths at which no other face is nearer to any part of the cube.
constexpr std::size_t kNumFaceOn = 6;
/// Index of the largest depth where that often holds in an equal cube too: 15 %.
constexpr std::size_t kEqual = 3;

/// True if the face of a block of this side is the nearest one to all of the tool behind it.
bool is_nearest(const TriangleMesh& tool, const Pose& X_WT, double side) {
  bool all = true;
  scenes::for_each_face(tool, X_WT, [&](const scenes::Triangle& triangle) {
    scenes::Polygon behind(triangle);
    behind.clip({{0, 0, -1}, -kFace});
    behind.for_each_triangle([&](const scenes::Triangle& part) {
      for (const Vec3d& p : part) {
        const double inside = side / 2 - std::max(std::abs(p.x), std::abs(p.y));
        all = all && p.z - kFace <= inside;
      }
    });
  });
  return all;
}

/// A cube pushed into a face of a block at many places, in random orientations.
struct Push {
  std::array<double, kDepths.size()> share{};  ///< found, of the common volume of all places
  std::array<double, kDepths.size()> off{};    ///< degrees off the normal of the face, rms
  std::array<int, kDepths.size()> num{};       ///< number of places with a force
  double direction = 0, direction_max = 0;     ///< degrees off the normal of the face: rms, worst
  double strength = 0;                         ///< |force| / volume found, over all places
};

Push push_of(const Tool& tool, const Tool& block, double side, BodyMethod method, int num_places,
             Work& work) {
  const scenes::Environment face = scenes::Environment::wall(kFace);
  const Pose X_WB{{0, 0, kFace + side / 2}, {}};
  const auto contact = query(tool, block, method);
  Random random(9);
  Push push;
  std::array<double, kDepths.size()> exact{};
  double squares = 0, force = 0, volume = 0;
  int num_with_force = 0;
  for (int place = 0; place < num_places; ++place) {
    const Quaternion turned = random.rotation(kPi);
    const double x = random.uniform(-kAside, kAside), y = random.uniform(-kAside, kAside);
    const Reach reach = reach_along_z(tool.mesh(), turned);
    for (std::size_t d = 0; d < kDepths.size(); ++d) {
      work.step();
      const Pose X_WT{{x, y, kFace - reach.front + kDepths[d] * (reach.front + reach.rear)},
                      turned};
      // In a block as small as the tool other faces may be nearer.
      if (side < kBlock && !is_nearest(tool.mesh(), X_WT, side)) continue;
      const Penetration found = contact->measure(X_WT, X_WB).on_a;
      push.share[d] += found.volume;
      exact[d] += scenes::exact_volume(tool.mesh(), X_WT, face);
      const Vec3d& f = found.measure_W.force;
      force += norm(f);
      volume += found.volume;
      if (d >= kNumFaceOn || f == Vec3d{}) continue;
      const double off = std::atan2(std::hypot(f.x, f.y), -f.z) * 180 / kPi;
      push.off[d] += off * off;
      ++push.num[d];
      squares += off * off;
      ++num_with_force;
      push.direction_max = std::max(push.direction_max, off);
    }
  }
  for (std::size_t d = 0; d < kDepths.size(); ++d) {
    push.share[d] = exact[d] > 0 ? push.share[d] / exact[d] : 0;
    push.off[d] = push.num[d] > 0 ? std::sqrt(push.off[d] / push.num[d]) : 0;
  }
  push.direction = std::sqrt(squares / num_with_force);
  push.strength = force / volume;
  return push;
}

/// Forces on paths through the face.
struct Way {
  double loop = 0;  ///< net work of a closed loop, share of all work
  double jump = 0;  ///< largest step of the force going straight in, exact = 1
};

Way way_of(const Tool& tool, const Tool& block, BodyMethod method, int num_steps, Work& work) {
  const Pose X_WB{{0, 0, kFace + kBlock / 2}, {}};
  const auto contact = query(tool, block, method);
  const Measure measured{tool.mesh_mass().volume, [&](const Pose& X_WT) {
                           work.step();
                           return contact->measure(X_WT, X_WB).on_a;
                         }};
  Way way;
  for (const std::vector<ContactCase>& cases : {thesis_cases(), tilted_cases()}) {
    for (const ContactCase& c : cases) {
      if (c.scene != "wall" || c.tool_shape != "box") continue;
      const auto steps = exact_steps(c, tool, 0, kWay, num_steps_over(c, kWay, kStep));
      way.jump = std::max(way.jump, wrench_error(tool, steps, measured).jump_ratio());
      way.loop = std::max(way.loop, loop_work(c, tool, measured, num_steps));
    }
  }
  return way;
}

// The figure --------------------------------------------------------------------------------------

/// Results of one method.
struct ByMethod {
  std::array<Found, std::size(kBodies)> found;  ///< by bodies
  Push push, fine;  ///< into the default packing of a block, and into one of small spheres
  Push equal;       ///< into a cube of equal size
  Way way;
};
constexpr BodyMethod kMethods[] = {BodyMethod::field, BodyMethod::spheres};

/// Results for one number of spheres in each body.
struct Row {
  int num_spheres = 0;
  std::array<double, std::size(kBodies)> fill_a{}, fill_b{};
  std::array<ByMethod, std::size(kMethods)> by;

  const ByMethod& field() const { return by[0]; }
  const ByMethod& spheres() const { return by[1]; }
  /// Expected share if both packings are independent: the product of their fills.
  double multiplied(std::size_t bodies) const { return fill_a[bodies] * fill_b[bodies]; }
};

/// Packs a block without large spheres.
Result<std::shared_ptr<const Tool>> fine_block(const Context& context, int num_spheres) {
  const int num_threads = context.settings().num_threads;
  auto tool =
      Tool::pack(make_box({kBlock, kBlock, kBlock}),
                 {.max_spheres = num_spheres, .max_radius = kFine, .num_threads = num_threads},
                 {.source = "block", .num_threads = num_threads});
  if (!tool) return tool.error();
  return std::make_shared<const Tool>(*std::move(tool));
}

Result<std::vector<Row>> measure(Context& context) {
  const auto numbers = context.choose<std::vector<int>>({100, 1000, 10000}, {100, 1000});
  const int num_poses = context.choose(1000, 60), num_places = context.choose(200, 20);
  const int loop_steps = context.choose(kLoopSteps, kLoopSteps / 2);
  std::vector<Row> rows(numbers.size());
  std::vector<std::function<void(Work&)>> tasks;
  // The largest first: the others are its prefixes, and packing it takes longest.
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
    for (std::size_t k = 0; k < std::size(kBodies); ++k) {
      const auto a = context.tool(kBodies[k].a, kSize, num);
      if (!a) return a.error();
      const auto b = context.tool(kBodies[k].b, kSize, num);
      if (!b) return b.error();
      row.fill_a[k] = fill(**a);
      row.fill_b[k] = fill(**b);
      for (std::size_t m = 0; m < std::size(kMethods); ++m) {
        tasks.push_back([=, &to = row.by[m].found[k], a = *a, b = *b](Work& work) {
          to = found_of(*a, *b, kMethods[m], num_poses, work);
        });
      }
    }
    for (std::size_t m = 0; m < std::size(kMethods); ++m) {
      tasks.push_back([=, &to = row.by[m].way, tool = *tool, block = *block](Work& work) {
        to = way_of(*tool, *block, kMethods[m], loop_steps, work);
      });
      tasks.push_back([=, &to = row.by[m].push, tool = *tool, block = *block](Work& work) {
        to = push_of(*tool, *block, kBlock, kMethods[m], num_places, work);
      });
      tasks.push_back([=, &to = row.by[m].equal, tool = *tool](Work& work) {
        to = push_of(*tool, *tool, kSize, kMethods[m], 3 * num_places, work);
      });
      tasks.push_back([=, &to = row.by[m].fine, tool = *tool, block = *fine](Work& work) {
        to = push_of(*tool, *block, kBlock, kMethods[m], num_places, work);
      });
    }
    context.progress(0);
  }
  // Approximate, because of the paths straight in.
  const auto steps = std::size(kMethods) *
                     (static_cast<double>(num_poses * std::size(kBodies)) +
                      5.0 * num_places * static_cast<double>(kDepths.size()) + 3.0 * loop_steps);
  run_tasks(context, static_cast<int>(tasks.size()), steps * static_cast<double>(rows.size()),
            [&](int i, Work& work) { tasks[static_cast<std::size_t>(i)](work); });
  return rows;
}

Table volume_table(const std::vector<Row>& rows) {
  Table table{"Share of the common volume found, random poses",
              {"bodies", "spheres in each", "by the field: found, %", "spread over the poses, ± %",
               "error, % of the smaller body, rms", "by spheres: found, %",
               "spread over the poses, ± %", "fills multiplied, %"},
              {}};
  for (std::size_t k = 0; k < std::size(kBodies); ++k) {
    for (const Row& row : rows) {
      const Found &field = row.field().found[k], &spheres = row.spheres().found[k];
      table.rows.push_back({kBodies[k].name, words("%d", row.num_spheres),
                            words("%.1f", 100 * field.share), words("%.1f", 100 * field.spread),
                            words("%.2f", 100 * field.rms), words("%.1f", 100 * spheres.share),
                            words("%.0f", 100 * spheres.spread),
                            words("%.1f", 100 * row.multiplied(k))});
    }
  }
  return table;
}

Table push_table(const std::vector<Row>& rows) {
  Table table{"A cube in the face of a block",
              {"by", "spheres in each", "spheres of the block", "found at 5 % depth, %",
               "at 50 % depth, %", "direction, ° rms", "worst", "force / volume found"},
              {}};
  for (std::size_t m = 0; m < std::size(kMethods); ++m) {
    for (const bool is_fine : {false, true}) {
      for (const Row& row : rows) {
        const Push& push = is_fine ? row.by[m].fine : row.by[m].push;
        table.rows.push_back(
            {name_of(kMethods[m]), words("%d", row.num_spheres),
             is_fine ? words("radius up to %g cm", 100 * kFine) : "as large as fit",
             words("%.1f", 100 * push.share[kShallow]), words("%.1f", 100 * push.share[kDeep]),
             words("%.1f", push.direction), words("%.1f", push.direction_max),
             words("%.2f", push.strength)});
      }
    }
  }
  return table;
}

Table equal_table(const std::vector<Row>& rows) {
  Table table{"A cube in the face of an equal cube", {"by", "spheres in each"}, {}};
  for (std::size_t d = 0; d <= kEqual; ++d) {
    table.columns.push_back(words("off at %.0f %% depth, ° rms", 100 * kDepths[d]));
  }
  for (std::size_t d : {kShallow, kEqual}) {
    table.columns.push_back(words("found at %.0f %%, %%", 100 * kDepths[d]));
  }
  for (std::size_t m = 0; m < std::size(kMethods); ++m) {
    for (const Row& row : rows) {
      const Push& push = row.by[m].equal;
      std::vector<std::string> cells{name_of(kMethods[m]), words("%d", row.num_spheres)};
      for (std::size_t d = 0; d <= kEqual; ++d) cells.push_back(words("%.1f", push.off[d]));
      for (std::size_t d : {kShallow, kEqual}) cells.push_back(words("%.0f", 100 * push.share[d]));
      table.rows.push_back(std::move(cells));
    }
  }
  return table;
}

Table way_table(const std::vector<Row>& rows) {
  Table table{
      "A cube on its way through the face of a block",
      {"by", "spheres in each", "worst step of the force / exact", "net work round a loop, %"},
      {}};
  for (std::size_t m = 0; m < std::size(kMethods); ++m) {
    for (const Row& row : rows) {
      const Way& way = row.by[m].way;
      table.rows.push_back({name_of(kMethods[m]), words("%d", row.num_spheres),
                            words("%.2f", way.jump), words("%.1g", 100 * way.loop)});
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
  for (std::size_t m = 0; m < std::size(kMethods); ++m) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      // The field's curves coincide.
      if (m == 0 && i + 1 < rows.size()) continue;
      Curve curve{words("%s, %d spheres", name_of(kMethods[m]).c_str(), rows[i].num_spheres),
                  words("other%zu", m == 0 ? 4 : i % 3 + 1),
                  {},
                  {}};
      for (std::size_t d = 0; d < kDepths.size(); ++d) {
        curve.x.push_back(100 * kDepths[d]);
        curve.y.push_back(100 * rows[i].by[m].push.share[d]);
      }
      plot.curves.push_back(std::move(curve));
    }
  }
  const Push &first = rows.front().spheres().push, &last = rows.back().spheres().push;
  plot.caption = words(
      "By spheres, light touches fall into the gaps below the face: at 5 %% depth %.0f %% are "
      "found with %d spheres in each body and %.0f %% with %d, at 50 %% depth %.0f and %.0f %%.",
      100 * first.share[kShallow], rows.front().num_spheres, 100 * last.share[kShallow],
      rows.back().num_spheres, 100 * first.share[kDeep], 100 * last.share[kDeep]);
  return plot;
}

void add_numbers(FigureResult& result, const std::vector<Row>& rows) {
  for (const Row& row : rows) {
    for (std::size_t m = 0; m < std::size(kMethods); ++m) {
      const ByMethod& by = row.by[m];
      const auto add = [&](const std::string& name, double value, const char* unit) {
        result.numbers.push_back(
            {words("%d.%s.", row.num_spheres, name_of(kMethods[m]).c_str()) + name, value, unit});
      };
      for (std::size_t k = 0; k < std::size(kBodies); ++k) {
        const std::string bodies = kBodies[k].name;
        add(bodies + ".found", 100 * by.found[k].share, "%");
        add(bodies + ".multiplied", 100 * row.multiplied(k), "%");
        add(bodies + ".spread", 100 * by.found[k].spread, "%");
        add(bodies + ".rms", 100 * by.found[k].rms, "%");
      }
      for (const bool is_fine : {false, true}) {
        const Push& push = is_fine ? by.fine : by.push;
        const std::string key = is_fine ? "fine_face." : "face.";
        add(key + "found_shallow", 100 * push.share[kShallow], "%");
        add(key + "found_deep", 100 * push.share[kDeep], "%");
        add(key + "direction_rms", push.direction, "deg");
        add(key + "direction_most", push.direction_max, "deg");
        add(key + "force_over_volume", push.strength, "1");
      }
      for (std::size_t d = 0; d <= kEqual; ++d) {
        add(words("equal.direction_rms.%.0f", 100 * kDepths[d]), by.equal.off[d], "deg");
        add(words("equal.found.%.0f", 100 * kDepths[d]), 100 * by.equal.share[d], "%");
      }
      add("loop_work", 100 * by.way.loop, "%");
      add("jump_ratio", by.way.jump, "1");
    }
  }
}

void add_claims_of_field(FigureResult& result, const std::vector<Row>& rows) {
  Range share, rms, direction, jump, loop;
  for (const Row& row : rows) {
    const ByMethod& by = row.field();
    for (const Found& found : by.found) {
      share.add(found.share);
      rms.add(found.rms);
    }
    for (const Push* push : {&by.push, &by.fine}) direction.add(push->direction_max);
    jump.add(by.way.jump);
    loop.add(by.way.loop);
  }
  result.claims.push_back(
      {"By the fields of the meshes, what two bodies share is found to a percent.",
       words(
           "%.1f to %.1f %% of what random poses share is found, with an error of %.2f to %.2f %% "
           "of the smaller body, rms.",
           100 * share.low, 100 * share.high, 100 * rms.low, 100 * rms.high),
       holds_with({holds_between(share, 1 - kOnePercent, 1 + kOnePercent),
                   holds_below(rms.high, kOnePercent)}),
       Source::docs});
  result.claims.push_back(
      {"With the fields, the contact with a face is exact, without jumps and without energy gain.",
       words(
           "At most %.2f° off the normal of a face that is the nearest one; the worst step of the "
           "force is %.2f to %.2f times the exact one; a closed loop gives away at most %.0e of "
           "all work.",
           direction.high, jump.low, jump.high, loop.high),
       holds_with({holds_below(direction.high, kOneDegree), holds_below(jump.high, kMaxJump),
                   holds_below(loop.high, kConservative)}),
       Source::docs});
  Range deep, light;
  for (const Row& row : rows) {
    if (row.num_spheres < 1000) continue;  // a cube of a hundred spheres has only large ones
    const Push& equal = row.field().equal;
    light.add(equal.off[0]);
    for (std::size_t d = kShallow; d <= kEqual; ++d) deep.add(equal.off[d]);
  }
  result.claims.push_back(
      {"With the fields, a face pushes along its normal against an equally fine body, too.",
       words(
           "With 1000 spheres or more, %.1f to %.1f° off, rms, from 5 to 15 %% depth, and %.1f to "
           "%.1f° at 2 %%.",
           deep.low, deep.high, light.low, light.high),
       holds_with({holds_below(deep.high, kOneDegree), holds_below(light.high, kOneDegree)}),
       Source::docs});
}

void add_claims_of_spheres(FigureResult& result, const std::vector<Row>& rows) {
  Range ratio, loop, direction, strength, fine;
  for (const Row& row : rows) {
    const ByMethod& by = row.spheres();
    for (std::size_t k = 0; k < std::size(kBodies); ++k) {
      ratio.add(by.found[k].share / row.multiplied(k));
    }
    loop.add(by.way.loop);
    direction.add(by.push.direction);
    strength.add(by.push.strength);
    fine.add(by.fine.strength);
  }
  const int least = rows.front().num_spheres, most = rows.back().num_spheres;
  result.claims.push_back(
      {"By spheres, of the volume that two bodies share as much is found "
       "as their fills multiplied.",
       words("%.2f to %.2f times that, with %d to %d spheres in each body.", ratio.low, ratio.high,
             least, most),
       holds_between(ratio, 1 - kAsTheFills, 1 + kAsTheFills), Source::docs});
  result.claims.push_back(
      {"The force between the spheres of bodies has a potential, so that a "
       "closed path gives no energy.",
       words("A closed loop gives away at most %.0e of all work.", loop.high),
       holds_below(loop.high, kConservative), Source::docs});
  result.claims.push_back(
      {"With spheres, the force of a face is that of the spheres behind it: off the normal for any "
       "number of them, and much weaker if they are small.",
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
  add_claims_of_field(result, *rows);
  add_claims_of_spheres(result, *rows);
  result.plots = {depth_plot(*rows)};
  result.tables = {volume_table(*rows), push_table(*rows), equal_table(*rows), way_table(*rows)};
  add_numbers(result, *rows);
  result.notes = {
      words("Random poses: all that share at least %.0f %% of the smaller body; found is that of "
            "all poses together, spread the rms over single ones.",
            100 * kMinShare),
      words(
          "A cube of 10 cm in a block of 30 cm; places and turns are random. Directions are those "
          "at 2 to %.0f %% depth, where no other face is nearer to any part of the cube; nothing "
          "felt has none. The way in is in steps of %g mm over %.0f %% of the cube's extent, face "
          "on and tilted; the loop is closed, smooth, in all six degrees of freedom, %d steps.",
          100 * kDepths[kNumFaceOn - 1], 1000 * kStep, 100 * kWay,
          context.choose(kLoopSteps, kLoopSteps / 2))};
  return result;
}

}  // namespace palpate::eval
