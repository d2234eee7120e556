// Force on the hand at the arrival of a depth frame: steps, lag and noise, for each way of going
// from frame to frame.
#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <utility>

#include "eval/studies/frame_study.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

// -- Tables, each with the claims that it bears out --

void add_steps(FigureResult& result, const Study& study) {
  Table table{"Steps of the force when a frame arrives, usual step = 1",
              {"scene", "method", "latest", "interpolate", "predict", "surprise of predict"},
              {}};
  Range latest, others, steady, shaken;
  for (const StudyCase* studied : study.moving()) {
    const bool is_recorded = study.recorded && studied == &*study.recorded;
    for (std::size_t m = 0; m < study.methods.size(); ++m) {
      std::vector<std::string> row{m == 0 ? studied->name : "", study.methods[m].name};
      for (const Way* way : kModes) {
        const double ratio = study.step_ratio(*studied, *way, m);
        (way == &kLatest ? latest : others).add(ratio);
        row.push_back(words(way == &kLatest ? "%.0f" : "%.2f", ratio));
      }
      const double off = study.surprise(*studied, m);
      (is_recorded ? shaken : steady).add(off);
      row.push_back(words("%.2f", off));
      table.rows.push_back(std::move(row));
    }
  }
  result.tables.push_back(std::move(table));
  result.claims.push_back(
      {"Only `latest` makes a force step when a frame arrives.",
       words("The step at an arrival is %.0f to %.0f times the usual one with the latest frame, at "
             "most %.1f times it interpolated or predicted.",
             latest.low, latest.high, others.high),
       holds_with({holds_above(latest.low, 10), holds_below(others.high, 2)}), Source::docs});
  const char* claim =
      "Predicting is for steady motion; where a hand shakes the camera it does "
      "harm.";
  const std::string simulated = words(
      "Simulated motion: when a frame arrives the predicted force is off by %.2f to %.2f of what "
      "the frame changes",
      steady.low, steady.high);
  if (!study.recorded) {
    result.claims.push_back(
        {claim, simulated + "; the other half needs the recording visp_rbt, in the full form.",
         Verdict::not_measured, Source::docs});
    return;
  }
  result.claims.push_back(
      {claim,
       simulated + words("; a camera in the hand: by %.2f to %.2f.", shaken.low, shaken.high),
       holds_with({holds_below(steady.high, 1), holds_above(shaken.low, 1)}), Source::docs});
}

void add_lags(FigureResult& result, const Study& study) {
  Table table{"Lag (ms) and error (%) on a moving wall",
              {"noise", "method", "latest, ms", "interpolate, ms", "predict, ms", "latest, %",
               "interpolate, %", "predict, %"},
              {}};
  Range lags[std::size(kModes)];
  for (const StudyCase* studied : {&study.gaussian, &study.kinect}) {
    const char* noise = studied == &study.kinect ? "Kinect" : "1.5 mm";
    for (std::size_t m = 0; m < study.methods.size(); ++m) {
      std::vector<std::string> row{m == 0 ? noise : "", study.methods[m].name};
      for (std::size_t i = 0; i < std::size(kModes); ++i) {
        const double lag = 1e3 * studied->late_by(*kModes[i], m).lag;
        lags[i].add(lag);
        row.push_back(words("%.0f", lag));
      }
      for (const Way* way : kModes) {
        row.push_back(words("%.1f", 100 * studied->late_by(*way, m).error));
      }
      table.rows.push_back(std::move(row));
    }
  }
  result.tables.push_back(std::move(table));
  constexpr double kClose = 4;  // ms
  const double frame = 1e3 / study.kinect.touch.stream.rate;
  const double expected[] = {frame / 2, frame, 0};
  const auto is_as_expected = [&](std::size_t i) {
    return holds_between(lags[i], expected[i] - kClose, expected[i] + kClose);
  };
  result.claims.push_back(
      {"Behind a steady motion the force lags half a frame with the latest "
       "frame, a frame interpolated, not at all predicted.",
       words("A frame is %.0f ms; lags: %.0f to %.0f ms with the latest, %.0f to %.0f ms "
             "interpolated, %.0f to %.0f ms predicted.",
             frame, lags[0].low, lags[0].high, lags[1].low, lags[1].high, lags[2].low,
             lags[2].high),
       holds_with({is_as_expected(0), is_as_expected(1), is_as_expected(2)}), Source::docs});
}

void add_averages(FigureResult& result, const Study& study) {
  Table table{"Averages: noise on a wall at rest by method, and the field on a moving wall",
              {"way", "rest: field, %", "rest: weighted, %", "rest: simplified, %",
               "rest: graph, %", "moving: step ratio", "moving: lag, ms", "moving: error, %"},
              {}};
  Range plain, calmed, steps, lags;  // with the latest frame; the last three with its averages
  for (const Way* way : kAverages) {
    const bool is_latest = way->mode == TimeMode::latest, is_plain = way == &kLatest;
    std::vector<std::string> row{way->name};
    for (std::size_t m = 0; m < study.methods.size(); ++m) {
      const double noise = 100 * study.noise(*way, m);
      if (is_latest) (is_plain ? plain : calmed).add(noise);
      row.push_back(words("%.2f", noise));
    }
    const double ratio = study.step_ratio(study.kinect, *way, 0);
    const double lag = 1e3 * study.kinect.late_by(*way, 0).lag;
    if (is_latest && !is_plain) steps.add(ratio), lags.add(lag);
    row.push_back(words(is_latest ? "%.0f" : "%.2f", ratio));
    row.push_back(words("%.0f", lag));
    row.push_back(words("%.1f", 100 * study.kinect.late_by(*way, 0).error));
    table.rows.push_back(std::move(row));
  }
  result.tables.push_back(std::move(table));
  result.claims.push_back(
      {"A moving average lessens what a frame changes, but data still change only when a frame "
       "arrives, and the picture is washed out.",
       words("Averages calm the force on a wall at rest from %.2f-%.2f %% to %.2f-%.2f %%; on a "
             "moving wall they lag %.0f to %.0f ms, and the step at an arrival is still %.0f to "
             "%.0f times the usual one.",
             plain.low, plain.high, calmed.low, calmed.high, lags.low, lags.high, steps.low,
             steps.high),
       holds_with({holds_below(calmed.high, plain.low), holds_above(steps.low, 10),
                   holds_above(lags.low, 0)}),
       Source::docs});
}

void add_mixing(FigureResult& result, const Study& study) {
  Table table{"Moving the points or weighing the measures, on a moving wall",
              {"method", "step ratio: points", "step ratio: measures", "error: points, %",
               "error: measures, %"},
              {}};
  Range ratios, differences;
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    const double points = study.step_ratio(study.gaussian, kPoints, m);
    const double measures = study.step_ratio(study.gaussian, kInterpolate, m);
    const double points_error = 100 * study.gaussian.late_by(kPoints, m).error;
    const double measures_error = 100 * study.gaussian.late_by(kInterpolate, m).error;
    ratios.add(points), ratios.add(measures);
    differences.add(std::abs(points_error - measures_error));
    table.rows.push_back({study.methods[m].name, words("%.2f", points), words("%.2f", measures),
                          words("%.2f", points_error), words("%.2f", measures_error)});
  }
  result.tables.push_back(std::move(table));
  result.claims.push_back(
      {"Points are moved from frame to frame (eq. 3.18); ours weighs two measures instead.",
       words("On a moving wall both have the same error: they differ by at most %.2f %% of the "
             "largest "
             "force, steps at an arrival are at most %.2f times the usual one.",
             differences.high, ratios.high),
       holds_with({holds_below(differences.high, 0.2), holds_below(ratios.high, 2)}),
       Source::docs});
}

/// Adds all results, by scene, method and way.
void add_numbers(FigureResult& result, const Study& study) {
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    const auto add = [&](const StudyCase& studied, const Way& way, const char* what, double value,
                         const char* unit) {
      result.numbers.push_back(
          {words("%s.%s.%s.%s", studied.key, study.methods[m].name, way.key, what), value, unit});
    };
    for (const StudyCase* studied : study.moving()) {
      add(*studied, kPredict, "surprise", study.surprise(*studied, m), "1");
      for (const Way* way : studied->ways) {
        add(*studied, *way, "step_ratio", study.step_ratio(*studied, *way, m), "1");
        if (studied != &study.gaussian && studied != &study.kinect) continue;
        add(*studied, *way, "lag", 1e3 * studied->late_by(*way, m).lag, "ms");
        add(*studied, *way, "error", 100 * studied->late_by(*way, m).error, "%");
      }
    }
    for (const Way* way : study.resting.ways) {
      add(study.resting, *way, "noise", 100 * study.noise(*way, m), "%");
    }
  }
}

// -- Plots --

/// Plots a way's force on the moving wall over time, by the field.
Curve force_curve(const Study& study, const Way& way, const char* style, double from, double to) {
  Curve curve{way.name, style, {}, {}};
  const ForceSeries& series = study.kinect.by(way, 0);
  for (std::size_t k = 0; k < series.force.size(); ++k) {
    const double time = static_cast<double>(k) * kTick;
    if (time < from || time > to) continue;
    curve.x.push_back(time);
    curve.y.push_back(-100 * series.force[k].z);
  }
  return curve;
}

struct Drawn {
  const Way* way;
  const char* style;
};
Plot force_plot(const Study& study, const char* title, double from, double to,
                std::initializer_list<Drawn> drawn) {
  Plot plot{title, "time, s", "force, % of the whole tool's", {}, false, false, ""};
  for (const Drawn& each : drawn) {
    plot.curves.push_back(force_curve(study, *each.way, each.style, from, to));
  }
  Curve exact{"exact", "exact", plot.curves[0].x, {}};
  for (const double time : exact.x) exact.y.push_back(100 * study.wall.exact(0, time));
  plot.curves.insert(plot.curves.begin(), std::move(exact));
  return plot;
}

void add_plots(FigureResult& result, const Study& study) {
  const auto lag_of = [&](const Way& way) { return 1e3 * study.kinect.late_by(way, 0).lag; };
  const double end = static_cast<double>(study.kinect.by(kLatest, 0).force.size()) * kTick;
  Plot arrivals =
      force_plot(study, "Force around arriving frames, moving wall, field", 0.45, 0.56,
                 {{&kLatest, "other1"}, {&kInterpolate, "field"}, {&kPredict, "other2"}});
  arrivals.caption = words(
      "The latest frame makes a stair; interpolated the force is smooth and %.0f ms late, "
      "predicted it is smooth and %.0f ms late.",
      lag_of(kInterpolate), lag_of(kPredict));
  Plot averages = force_plot(study, "Averages, moving wall, field", 0, end,
                             {{&kLatest, "other1"}, {&kMean, "other3"}, {&kExponential, "other4"}});
  averages.caption =
      words("Averages of the latest frames keep the stair and come %.0f and %.0f ms late.",
            lag_of(kMean), lag_of(kExponential));
  result.plots.push_back(std::move(arrivals));
  result.plots.push_back(std::move(averages));
}

Result<FigureResult> frames(Context& context) {
  const auto study = make_study(context);
  if (!study) return study.error();
  FigureResult result;
  add_steps(result, *study);
  add_lags(result, *study);
  add_averages(result, *study);
  add_mixing(result, *study);
  add_numbers(result, *study);
  add_plots(result, *study);
  result.notes.push_back(kFrameScenesNote);
  if (!study->recorded) {
    result.notes.push_back(
        "A row of a camera in the hand needs the recording visp_rbt, in the full form.");
  }
  return result;
}

}  // namespace

std::vector<FigureSpec> frame_figures() {
  return {{"frames", "Steps, lag and noise between depth frames", "Time and edges", frames}};
}

}  // namespace palpate::eval
