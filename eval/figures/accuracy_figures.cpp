// Every method against the exact wrench, over all pairs of scene and tool with a known truth: the
// numbers that the guides quote. The field is also measured with many spheres, as it is used in
// practice.
#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <memory>

#include "eval/context.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/parallel.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr int kFew = 1000;                                 // spheres, as in the thesis
constexpr double kContinuous = 1.2, kConservative = 1e-6;  // as our docs say of the field

/// Depth noise of the camera.
struct Noise {
  DepthNoise noise;
  const char *name, *key;
};
constexpr std::array kNoises{Noise{DepthNoise::none, "noise-free", "clean"},
                             Noise{DepthNoise::gaussian, "1.5 mm noise", "noisy"}};
constexpr std::size_t kClean = 0, kNoisy = 1;

/// Resolution of the study.
struct Effort {
  int many = 17000;         ///< spheres
  int coarse_steps = 100;   ///< over the whole travel
  double fine_step = 5e-5;  ///< m, over its first half: a tick at 50 mm/s
  int loop_steps = 4000;
};

struct Way {
  std::string name, key;
  const char* style;
  ContactOptions options;
  bool is_many = false;  ///< spheres; else few

  bool counts_own() const { return options.counted() == SphereVolumes::own; }
};
/// Ways: every method by default, the field with many spheres, and every method with the volumes
/// that it does not count by default.
enum Index : std::size_t { kWeighted, kSimplified, kGraph, kGraphCap, kField, kMany, kOther };

std::vector<Way> all_ways(const Effort& effort) {
  std::vector<Way> ways, others;
  for (const Method& method : all_methods()) {
    Way way{method.name, method.name, method.name, method.options};
    ways.push_back(way);
    way.options.volumes = way.counts_own() ? SphereVolumes::represented : SphereVolumes::own;
    way.key += way.counts_own() ? "-own" : "-represented";
    others.push_back(way);
  }
  Way many = ways[kField];
  many.name += words(", %d spheres", effort.many), many.key += "-many", many.is_many = true;
  ways.push_back(many);
  ways.insert(ways.end(), others.begin(), others.end());
  return ways;
}

/// Errors of a way against the exact wrench, in the units of the tables.
struct Errors {
  double volume_rms = 0, volume_max = 0;  ///< % of the tool
  double lost = 0;                        ///< % of the steps
  double direction = 0;                   ///< degrees, rms
  double torque = 0;                      ///< % of force times radius of the tool, rms
  double jump = 0;                        ///< largest step of the force, exact = 1
  double loop = 0;                        ///< net work of a closed loop, % of all work
  double packing = 0;                     ///< volume error of exact planes at a wall, % rms
};

struct Quantity {
  const char *key, *column, *row, *unit;  ///< `column` and `row`: its name in tables
  int digits;                             ///< kFitting: as few as suffice
  double Errors::*value;
  bool is_rms;
};
constexpr int kFitting = -1;
constexpr Quantity kVolume{
    "volume_rms", "volume, % rms", "volume, % of the tool, rms", "%", 2, &Errors::volume_rms, true};
constexpr Quantity kVolumeMax{"volume_most",
                              "volume, % at most",
                              "volume, % of the tool, at most",
                              "%",
                              2,
                              &Errors::volume_max,
                              false};
constexpr Quantity kLost{
    "lost", "lost, % of steps", "contact lost, % of the steps", "%", 1, &Errors::lost, false};
constexpr Quantity kDirection{"direction_rms",
                              "direction, ° rms",
                              "force direction, °, rms",
                              "deg",
                              2,
                              &Errors::direction,
                              true};
constexpr Quantity kTorque{"torque_rms",
                           "torque, % rms",
                           "torque, % of force × radius of the tool, rms",
                           "%",
                           2,
                           &Errors::torque,
                           true};
constexpr Quantity kJump{"jump_ratio", "jump, exact = 1", "largest jump of the force, exact = 1",
                         "1",          kFitting,          &Errors::jump,
                         false};
constexpr Quantity kLoop{"loop_work", "loop, %", "net work of a closed loop, % of all work",
                         "%",         kFitting,  &Errors::loop,
                         false};
constexpr Quantity kPacking{
    "packing_rms", "packing, % rms", "volume by the packing alone, % rms", "%", 2, &Errors::packing,
    true};
constexpr std::array kQuantities{kVolume, kVolumeMax, kLost, kDirection,
                                 kTorque, kJump,      kLoop, kPacking};

std::string text_of(const Quantity& q, const Errors& errors) {
  const double value = errors.*q.value;
  if (q.digits != kFitting) return words("%.*f", q.digits, value);
  return words(value >= 10 ? "%.0f" : value >= 0.01 ? "%.2f" : "%.0e", value);
}

/// Errors of one way and noise, by pair.
using Row = std::vector<Errors>;

/// Aggregates the pairs: root mean square of rms quantities, maximum of the others.
Errors overall(const Row& row) {
  Errors result;
  for (const Quantity& q : kQuantities) {
    double squares = 0, most = 0;
    for (const Errors& errors : row) {
      squares += errors.*q.value * (errors.*q.value);
      most = std::max(most, errors.*q.value);
    }
    result.*q.value = q.is_rms ? std::sqrt(squares / static_cast<double>(row.size())) : most;
  }
  return result;
}

std::size_t worst_pair(const Row& row, const Quantity& q) {
  const auto most = std::max_element(row.begin(), row.end(), [&](const Errors& a, const Errors& b) {
    return a.*q.value < b.*q.value;
  });
  return static_cast<std::size_t>(most - row.begin());
}

struct Study {
  Effort effort;
  std::vector<ContactCase> pairs;
  std::vector<Way> ways;
  std::vector<std::array<Row, kNoises.size()>> rows;  ///< [way][noise]

  const Row& of(std::size_t way, std::size_t noise) const { return rows[way][noise]; }
  double worst(std::size_t way, std::size_t noise, const Quantity& q) const {
    return of(way, noise)[worst_pair(of(way, noise), q)].*q.value;
  }
};

std::vector<ContactCase> pairs_of(const Context& context) {
  std::vector<ContactCase> pairs;
  for (ContactCase& c : accuracy_cases()) {
    const bool is_quick = c.name == "wall box" || c.name == "sphere-out-160 box tilted";
    if (is_quick || !context.quick()) pairs.push_back(std::move(c));
  }
  return pairs;
}

/// Returns the rms volume error of the packing alone, %.
double packing_error(const ContactCase& c, const Tool& tool, SphereVolumes volumes, int num_steps) {
  const ContactCase wall = at_the_wall(c);
  return 100 * volume_error(tool, exact_steps(wall, tool, 0, 1, num_steps),
                            oracle_measure(tool, wall.environment, volumes))
                   .rms;
}

/// Measures all errors of one pair with few or many spheres.
void measure(Study& study, std::size_t pair, const Tool& tool, bool is_many, Work& work) {
  const ContactCase& c = study.pairs[pair];
  const Effort& effort = study.effort;
  const auto coarse = exact_steps(c, tool, 0, 1, effort.coarse_steps);
  const auto fine = exact_steps(c, tool, 0, 0.5, num_steps_over(c, 0.5, effort.fine_step));
  const double packing[] = {
      packing_error(c, tool, SphereVolumes::own, effort.coarse_steps),
      packing_error(c, tool, SphereVolumes::represented, effort.coarse_steps)};
  for (std::size_t n = 0; n < kNoises.size(); ++n) {
    const RenderedScene seen = see(c, kNoises[n].noise);
    for (std::size_t w = 0; w < study.ways.size(); ++w) {
      const Way& way = study.ways[w];
      if (way.is_many != is_many) continue;
      Measure measured = query_measure(tool, seen, way.options);
      measured.at = [&work, at = measured.at](const Pose& X_WT) {
        work.step();
        return at(X_WT);
      };
      const VolumeError volume = volume_error(tool, coarse, measured);
      const WrenchError wrench = wrench_error(tool, fine, measured);
      study.rows[w][n][pair] = {100 * volume.rms,
                                100 * volume.worst,
                                100 * volume.lost,
                                wrench.direction_rms * 180 / kPi,
                                100 * wrench.torque_rms,
                                wrench.jump_ratio(),
                                100 * loop_work(c, tool, measured, effort.loop_steps),
                                packing[way.counts_own() ? 0 : 1]};
    }
  }
}

Result<Study> make_study(Context& context) {
  Study study;
  study.effort = context.choose(Effort{}, Effort{3000, 40, 5e-4, 500});
  study.pairs = pairs_of(context);
  study.ways = all_ways(study.effort);
  const Row row(study.pairs.size());
  study.rows.resize(study.ways.size());
  for (auto& rows : study.rows) rows.fill(row);

  struct Task {
    std::size_t pair;
    std::shared_ptr<const Tool> tool;
    bool is_many;
  };
  std::vector<Task> tasks;
  double num_steps = 0;
  for (const bool is_many : {true, false}) {  // the long ones first; each shape is packed once
    for (std::size_t pair = 0; pair < study.pairs.size(); ++pair) {
      const ContactCase& c = study.pairs[pair];
      const auto tool = context.tool(c.tool_shape, c.tool_size, is_many ? study.effort.many : kFew);
      if (!tool) return tool.error();
      tasks.push_back({pair, *tool, is_many});
      for (const Way& way : study.ways) {
        if (way.is_many != is_many) continue;
        num_steps += static_cast<double>(kNoises.size()) *
                     (study.effort.coarse_steps + study.effort.loop_steps +
                      num_steps_over(c, 0.5, study.effort.fine_step));
      }
      context.progress(0);
    }
  }
  run_tasks(context, static_cast<int>(tasks.size()), num_steps, [&](int i, Work& work) {
    const Task& task = tasks[static_cast<std::size_t>(i)];
    measure(study, task.pair, *task.tool, task.is_many, work);
  });
  return study;
}

/// Makes the table of worst errors of the default method with many spheres.
Table worst_table(const Study& study) {
  Table table{
      "Field, worst pair", {"error", "noise-free", "worst pair", "1.5 mm noise", "worst pair"}, {}};
  for (const Quantity& q : kQuantities) {
    std::vector<std::string> cells{q.row};
    for (std::size_t n = 0; n < kNoises.size(); ++n) {
      const Row& row = study.of(kMany, n);
      const std::size_t worst = worst_pair(row, q);
      cells.push_back(text_of(q, row[worst]));
      cells.push_back(row[worst].*q.value > 0 ? study.pairs[worst].name : "");
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

/// Makes the row of a table for one variant over all pairs.
std::vector<std::string> cells_of(const Study& study, std::size_t way, const char* second,
                                  std::size_t noise) {
  std::vector<std::string> cells{study.ways[way].name, second};
  const Errors errors = overall(study.of(way, noise));
  for (const Quantity& q : kQuantities) cells.push_back(text_of(q, errors));
  return cells;
}

Table methods_table(const Study& study) {
  Table table{"All methods, over all pairs", {"method", "noise"}, {}};
  for (const Quantity& q : kQuantities) table.columns.emplace_back(q.column);
  for (std::size_t n = 0; n < kNoises.size(); ++n) {
    for (std::size_t w = 0; w < kOther; ++w) {
      table.rows.push_back(cells_of(study, w, kNoises[n].name, n));
    }
  }
  return table;
}

Table volumes_table(const Study& study) {
  Table table{"Whose volumes, over all pairs, 1.5 mm noise", {"method", "volumes"}, {}};
  for (const Quantity& q : kQuantities) table.columns.emplace_back(q.column);
  for (std::size_t method = 0; method <= kField; ++method) {
    for (const bool is_own : {true, false}) {
      const std::size_t way = study.ways[method].counts_own() == is_own ? method : kOther + method;
      table.rows.push_back(cells_of(study, way, is_own ? "spheres" : "represented", kNoisy));
    }
  }
  return table;
}

/// Quantities reported by pair.
constexpr std::array kOfPairs{kVolume, kDirection, kTorque, kJump, kLoop};

/// Makes the table of the field with many spheres; the other methods are among the numbers.
Table pairs_table(const Study& study) {
  Table table{"Field, every pair", {"pair"}, {}};
  for (const Quantity& q : kOfPairs) {
    table.columns.emplace_back(q.column);
    table.columns.emplace_back("with noise");
  }
  for (std::size_t pair = 0; pair < study.pairs.size(); ++pair) {
    std::vector<std::string> cells{study.pairs[pair].name};
    for (const Quantity& q : kOfPairs) {
      for (std::size_t n = 0; n < kNoises.size(); ++n) {
        cells.push_back(text_of(q, study.of(kMany, n)[pair]));
      }
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

/// Plots the pairs of each method with noise, from the best one to the worst.
Plot sorted_plot(const Study& study, const Quantity& q, const char* title, const char* unit) {
  Plot plot{title, "pairs, from the best to the worst of each method", q.column, {}, false, true,
            ""};
  double least = INFINITY, most = 0;
  const char *best = "", *worst = "";
  for (std::size_t w = kWeighted; w <= kField; ++w) {
    Curve curve{study.ways[w].name, study.ways[w].style, {}, {}};
    for (const Errors& errors : study.of(w, kNoisy)) curve.y.push_back(errors.*q.value);
    std::sort(curve.y.begin(), curve.y.end());
    for (std::size_t i = 1; i <= curve.y.size(); ++i) curve.x.push_back(static_cast<double>(i));
    if (curve.y.back() < least) least = curve.y.back(), best = study.ways[w].style;
    if (curve.y.back() > most) most = curve.y.back(), worst = study.ways[w].style;
    plot.curves.push_back(std::move(curve));
  }
  plot.caption = words("With 1.5 mm noise the worst pair has %.3g%s with %s and %.3g%s with %s.",
                       least, unit, best, most, unit, worst);
  return plot;
}

void add_claims(FigureResult& result, const Study& study) {
  const auto worst_of = [&](std::initializer_list<std::size_t> ways, const Quantity& q) {
    double most = 0;
    for (const std::size_t way : ways) {
      for (std::size_t n = 0; n < kNoises.size(); ++n)
        most = std::max(most, study.worst(way, n, q));
    }
    return most;
  };
  const auto worst_of_field = [&](const Quantity& q) {
    return worst_of({kField, kMany, kOther + kField}, q);
  };
  const auto worst_of_others = [&](const Quantity& q) {
    return worst_of({kWeighted, kSimplified, kGraph, kGraphCap}, q);
  };
  const double jump = worst_of_field(kJump), loop = worst_of_field(kLoop) / 100;
  result.claims.push_back(
      {words("The force of the field is continuous, no jump "
             "being more than %.1f times the exact one.",
             kContinuous),
       words("Within %g mm at most %.2f times the exact change, over %zu pairs, with and without "
             "noise; of the others up to %.0f times.",
             1e3 * study.effort.fine_step, jump, study.pairs.size(), worst_of_others(kJump)),
       holds_up_to(jump, kContinuous), Source::docs});
  result.claims.push_back(
      {words("The field has a potential, a closed loop giving "
             "less than %g of its work away.",
             kConservative),
       words("At most %.1e of all work, over %zu pairs.", loop, study.pairs.size()),
       holds_below(loop, kConservative), Source::docs});
  const double lost = worst_of_field(kLost);
  result.claims.push_back(
      {"With the field a tool pushed clean through never "
       "loses contact.",
       words("Contact is lost in %.1f %% of the steps with the field, in up to %.1f %% with the "
             "others.",
             lost, worst_of_others(kLost)),
       holds_up_to(lost, 0), Source::docs});

  // Smaller error of two ways, quantity by quantity.
  const auto least = [](Errors errors, const Errors& other) {
    for (const Quantity& q : kQuantities) {
      errors.*q.value = std::min(errors.*q.value, other.*q.value);
    }
    return errors;
  };
  const auto all = [&](std::size_t way) { return overall(study.of(way, kNoisy)); };
  Errors best = least(all(kWeighted), all(kOther + kWeighted));
  for (const std::size_t method : {kSimplified, kGraph, kGraphCap}) {
    best = least(best, least(all(method), all(kOther + method)));
  }
  const Errors field = all(kField);
  std::vector<Verdict> verdicts;
  for (const Quantity& q : kQuantities)
    verdicts.push_back(is_better(field.*q.value, best.*q.value));
  result.claims.push_back(
      {"The field is nearer to the exact wrench than the best of the thesis' methods.",
       words("%d spheres, 1.5 mm noise: the field errs by %.2f %% of the "
             "volume, %.2f° and %.2f %% of the torque; of the others, whatever "
             "volumes they count, the best by %.2f %%, %.2f° and %.2f %%.",
             kFew, field.volume_rms, field.direction, field.torque, best.volume_rms, best.direction,
             best.torque),
       is_better_in_all(verdicts), Source::ours});
}

/// Adds all quantities over all pairs, and those of its table for every pair.
void add_numbers(FigureResult& result, const Study& study) {
  for (std::size_t w = 0; w < study.ways.size(); ++w) {
    for (std::size_t n = 0; n < kNoises.size(); ++n) {
      const std::string key = words("%s.%s.", kNoises[n].key, study.ways[w].key.c_str());
      const Errors errors = overall(study.of(w, n));
      for (const Quantity& q : kQuantities) {
        result.numbers.push_back({key + q.key, errors.*q.value, q.unit});
      }
      if (w >= kOther) continue;
      for (std::size_t pair = 0; pair < study.pairs.size(); ++pair) {
        for (const Quantity& q : kOfPairs) {
          result.numbers.push_back(
              {key + study.pairs[pair].name + "." + q.key, study.of(w, n)[pair].*q.value, q.unit});
        }
      }
    }
  }
}

Result<FigureResult> accuracy(Context& context) {
  const auto study = make_study(context);
  if (!study) return study.error();
  FigureResult result;
  add_claims(result, *study);
  result.plots = {sorted_plot(*study, kVolume, "Volume", " %"),
                  sorted_plot(*study, kDirection, "Direction of the force", "°"),
                  sorted_plot(*study, kJump, "Continuity", " times the exact jump")};
  result.tables = {worst_table(*study), methods_table(*study), volumes_table(*study),
                   pairs_table(*study)};
  add_numbers(result, *study);
  const Effort& effort = study->effort;
  result.notes = {
      words("%zu pairs of scene and tool: those of Figs. 5.17-5.29, and some with the tool turned "
            "by 20° and off the axis. %d spheres for all methods; %d for the tables of the field "
            "alone, too.",
            study->pairs.size(), kFew, effort.many),
      words("Volume and lost contact: 0-100 %% depth. Direction, torque (of force times radius of "
            "the tool) and jumps: 0-50 %% depth, in steps of %g mm. Loop: net work of a closed "
            "smooth one in all six degrees of freedom, %d steps. Packing: error of the volume "
            "where exact planes cut the spheres, at a wall.",
            1e3 * effort.fine_step, effort.loop_steps),
      "Over all pairs: root mean square of what is rms, the largest of the rest.",
      "Each method counts the volumes that it counts by default, the field those that its spheres "
      "stand for, the others those of the spheres; \"whose volumes\" has both for all.",
  };
  return result;
}

}  // namespace

std::vector<FigureSpec> accuracy_figures() {
  return {{"accuracy", "Every method against the exact wrench", "Quality", accuracy}};
}

}  // namespace palpate::eval
