// 4.2, 4.3 and queries on a graphics card, from the rows that scripts/gpu_check.sh has written on a
// machine with a GPU.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "eval/report/csv.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

/// One row of times, microseconds.
struct Row {
  double median = 0, p99 = 0, p999 = 0, max = 0;
  double mean = 0, deviation = 0;  ///< NaN: an older file without them
};
/// Rows of one commit on one machine.
struct GpuRows {
  std::string date, machine, commit;
  std::map<std::string, Row> rows;  ///< by case

  std::string place() const { return machine + ", commit " + commit; }

  const Row* find(const std::string& name) const {
    const auto found = rows.find(name);
    return found == rows.end() ? nullptr : &found->second;
  }
};

/// Reads a file, which may have rows of several commits.
std::vector<GpuRows> read(const std::filesystem::path& path) {
  std::vector<GpuRows> all;
  for (auto& row : read_csv(path).rows) {
    if (row["program"] != "gpu_bench") continue;
    const auto number = [&](const char* column) { return finite_number(row[column]).value_or(0); };
    auto facts = named_values(row["facts"], ' ', '=');
    const auto fact = [&](const char* name) {
      return finite_number(facts[name]).value_or(std::nan(""));
    };
    auto of_commit = std::ranges::find(all, row["commit"], &GpuRows::commit);
    if (of_commit == all.end()) {
      of_commit = all.insert(all.end(), {row["date"], row["machine"], row["commit"], {}});
    }
    of_commit->rows[row["case"]] = {number("median_us"), number("p99_us"), number("p99.9_us"),
                                    number("max_us"),    fact("mean_us"),  fact("deviation_us")};
  }
  return all;
}

/// Returns the latest rows that have all these cases: by date, then by order of the files.
std::optional<GpuRows> newest_with(const Context& context, const std::vector<std::string>& cases) {
  std::optional<GpuRows> newest;
  for (const auto& path : context.settings().gpu) {
    for (GpuRows& rows : read(path)) {
      const bool has_all = std::ranges::all_of(
          cases, [&](const std::string& name) { return rows.find(name) != nullptr; });
      if (has_all && (!newest || rows.date >= newest->date)) newest = std::move(rows);
    }
  }
  return newest;
}

FigureResult not_here(const std::string& claim) {
  FigureResult result;
  result.claims.push_back(
      {claim,
       "No file of --gpu has its rows; scripts/gpu_check.sh writes them on a machine that has "
       "what they need.",
       Verdict::not_measured});
  return result;
}

constexpr const char* kClaim42 =
    "Sensing in 16 chunks takes the mean haptic frame from 0.74 ± 0.37 to 0.69 ± 0.28 ms.";
constexpr const char* kClaim43 =
    "With 1, 8 and 128 chunks haptic work waits less and less for sensing.";

std::string sharing(const char* method, const char* image, const char* how) {
  return words("sharing: %s at 1 kHz; %s at 30 Hz: %s", method, image, how);
}

constexpr const char* kMethods[] = {"field", "simplified"};
constexpr const char* kImages[] = {"640x480", "1920x1080"};

constexpr const char* kItsFrames = "; its frames";

std::string in_parts(int num) {
  return num == 1 ? std::string("whole frames; equal priority")
                  : words("%d parts spread over the frame time; equal priority", num);
}

std::string spread_words(const Row& row) {
  return std::isfinite(row.mean) ? words("%.1f ± %.1f", row.mean, row.deviation)
                                 : words("%.1f (median)", row.median);
}

Result<FigureResult> figure_4_2(Context& context) {
  const char *method = "simplified", *image = "640x480";
  const std::string low_priority = "whole frames; low priority";
  const std::string in_whole = sharing(method, image, in_parts(1).c_str()),
                    in_16 = sharing(method, image, in_parts(16).c_str()),
                    at_low_priority = sharing(method, image, low_priority.c_str());
  const auto gpu = newest_with(context, {in_whole, in_16, at_low_priority});
  if (!gpu) return not_here(kClaim42);
  FigureResult result;
  Table table{
      words("A query at 1 kHz beside a camera at 30 Hz on one %s, µs", gpu->machine.c_str()),
      {"method", "image", "sensing", "mean ± deviation", "median", "p99", "p99.9", "max"},
      {}};
  for (const char* each : kMethods) {
    for (const char* its_image : kImages) {
      for (const std::string& how :
           {std::string("no camera"), in_parts(1), in_parts(8), in_parts(16), in_parts(128),
            low_priority, std::string("16 parts spread over the frame time; low priority")}) {
        const Row* row = gpu->find(sharing(each, its_image, how.c_str()));
        if (row == nullptr) continue;
        table.rows.push_back({each, its_image, how, spread_words(*row), words("%.1f", row->median),
                              words("%.1f", row->p99), words("%.1f", row->p999),
                              words("%.1f", row->max)});
        result.numbers.push_back(
            {words("%s.%s.%s.median", each, its_image, how.c_str()), row->median, "µs"});
        result.numbers.push_back(
            {words("%s.%s.%s.p99.9", each, its_image, how.c_str()), row->p999, "µs"});
      }
    }
  }
  const Row *whole = gpu->find(in_whole), *parts = gpu->find(in_16),
            *calm = gpu->find(at_low_priority);
  const bool has_mean = std::isfinite(whole->mean) && std::isfinite(parts->mean);
  const double before = has_mean ? whole->mean : whole->median;
  const double after = has_mean ? parts->mean : parts->median;
  result.claims.push_back(
      {kClaim42,
       words("Simplified, 640x480: beside whole frames %s µs, beside 16 parts %s (worst %.0f and "
             "%.0f).",
             spread_words(*whole).c_str(), spread_words(*parts).c_str(), whole->max, parts->max),
       is_less(after, before)});
  result.claims.push_back(
      {"Whole frames at low priority disturb a query no more than 16 parts with pauses do.",
       words("p99.9 of a query %.0f µs beside whole frames at low priority, %.0f beside 16 parts.",
             calm->p999, parts->p999),
       is_better(calm->p999, parts->p999), Source::ours});
  const Row* whole_frames = gpu->find(at_low_priority + kItsFrames);
  const Row* frames_in_parts = gpu->find(in_16 + kItsFrames);
  if (whole_frames != nullptr && frames_in_parts != nullptr) {
    const double waits = 1e-3 * (frames_in_parts->median - whole_frames->median);
    result.claims.push_back(
        {"Leaving out the pauses of eq. 4.19 is right: they delay what is felt by more than they "
         "spare a query.",
         words(
             "In 16 parts a frame is finished %.1f ms later than as a whole at low priority (%.2f "
             "ms); the p99.9 of a query is %.3f ms with parts and %.3f ms with whole frames.",
             waits, 1e-3 * whole_frames->median, 1e-3 * parts->p999, 1e-3 * calm->p999),
         holds_above(waits, 1e-3 * (calm->p999 - parts->p999)), Source::docs});
    result.numbers.push_back({"parts.delay", waits, "ms"});
  }
  result.notes.push_back(words(
      "A frame takes %.2f ms on this GPU instead of 3 ms, so there is little to spread. Parts "
      "begin "
      "at fixed shares of the frame time; eq. 4.19 finds these times by a moving average of the "
      "work's, clamped. The program does not use it: frames are made whole, at low priority. "
      "Drawing "
      "on the same GPU at the same time was not measured.",
      whole_frames != nullptr ? 1e-3 * whole_frames->median : 0.2));
  result.rows_of = gpu->place();
  result.tables.push_back(std::move(table));
  return result;
}

/// Returns the rise of a query's p99 beside a camera whose frames come in `num_parts` parts, µs.
double blocked(const GpuRows& gpu, const char* method, const char* image, int num_parts) {
  const Row* none = gpu.find(sharing(method, image, "no camera"));
  const Row* parts = gpu.find(sharing(method, image, in_parts(num_parts).c_str()));
  return none != nullptr && parts != nullptr ? parts->p99 - none->p99 : std::nan("");
}

Result<FigureResult> figure_4_3(Context& context) {
  std::vector<std::string> needed{sharing("simplified", "640x480", "no camera")};
  for (const int num : {1, 8, 128}) {
    needed.push_back(sharing("simplified", "640x480", in_parts(num).c_str()));
  }
  const auto gpu = newest_with(context, needed);
  if (!gpu) return not_here(kClaim43);
  FigureResult result;
  Plot plot{words("Beside a camera on one %s", gpu->machine.c_str()),
            "parts of a frame",
            "rise of a query's p99, µs",
            {},
            true,
            false,
            ""};
  const char* styles[] = {"field", "other1", "simplified", "other2"};
  std::size_t style = 0;
  double one = std::nan(""), eight = one, many = one;
  for (const char* method : kMethods) {
    for (const char* image : kImages) {
      Curve curve{words("%s, %s", method, image), styles[style++], {}, {}};
      for (const int num : {1, 8, 16, 128}) {
        const double rise = blocked(*gpu, method, image, num);
        if (!std::isfinite(rise)) continue;
        curve.x.push_back(num), curve.y.push_back(rise);
        result.numbers.push_back({words("%s.%s.%d.blocked", method, image, num), rise, "µs"});
      }
      if (!curve.x.empty()) plot.curves.push_back(std::move(curve));
    }
  }
  one = blocked(*gpu, "simplified", "640x480", 1);
  eight = blocked(*gpu, "simplified", "640x480", 8);
  many = blocked(*gpu, "simplified", "640x480", 128);
  const Verdict verdict = waits_less_and_less({one, eight, many});
  plot.caption = words(
      "Simplified, 640x480: the p99 of a query changes by %+.1f µs beside whole frames, %+.1f "
      "beside 8 parts, %+.1f beside 128%s.",
      one, eight, many,
      verdict == Verdict::not_comparable ? ": no query waits for a frame of this GPU" : "");
  result.claims.push_back({kClaim43, plot.caption, verdict});
  result.plots.push_back(std::move(plot));
  result.rows_of = gpu->place();
  return result;
}

/// Section 6 of the thesis: a second GPU for sensing.
Result<FigureResult> two_gpus(Context& context) {
  const char* claim = "A second GPU for sensing relieves the one that measures contacts.";
  const auto name = [](const char* method, int sensing_gpu, const char* what) {
    return words("two GPUs: %s; sensing on GPU %d; contact on GPU 0: %s", method, sensing_gpu,
                 what);
  };
  constexpr const char *kFirst = "first query of a frame", *kOthers = "other queries";
  std::vector<std::string> needed;
  for (const char* method : kMethods) {
    for (const int sensing_gpu : {0, 1}) {
      for (const char* what : {kFirst, kOthers}) needed.push_back(name(method, sensing_gpu, what));
    }
  }
  const auto gpu = newest_with(context, needed);
  if (!gpu) return not_here(claim);
  FigureResult result;
  Table table{
      "Sensing at 30 Hz and queries at 1 kHz on one GPU and on two, 640x480, median / p99, µs",
      {"method", "sensing on", kFirst, kOthers},
      {}};
  for (const char* method : kMethods) {
    for (const int sensing_gpu : {0, 1}) {
      std::vector<std::string> cells{method, sensing_gpu == 0 ? "the same GPU" : "another GPU"};
      for (const char* what : {kFirst, kOthers}) {
        const Row* row = gpu->find(name(method, sensing_gpu, what));
        cells.push_back(words("%.1f / %.1f", row->median, row->p99));
        result.numbers.push_back({words("%s.%d.%s", method, sensing_gpu, what), row->median, "µs"});
      }
      table.rows.push_back(std::move(cells));
    }
  }
  const auto median = [&](int sensing_gpu, const char* what) {
    return gpu->find(name("simplified", sensing_gpu, what))->median;
  };
  result.claims.push_back(
      {claim,
       words("Simplified, 640x480: the first query of a frame takes %.1f µs with one GPU and %.1f "
             "with two, where its cloud is copied; the others %.1f and %.1f.",
             median(0, kFirst), median(1, kFirst), median(0, kOthers), median(1, kOthers)),
       agrees_with({is_less(median(1, kFirst), median(0, kFirst)),
                    is_less(median(1, kOthers), median(0, kOthers))})});
  result.rows_of = gpu->place();
  result.tables.push_back(std::move(table));
  return result;
}

Result<FigureResult> gpu_queries(Context& context) {
  constexpr const char* kAll[] = {"weighted", "simplified", "graph", "field"};
  const std::vector<int> sizes{1000, 5000, 17000, 100000, 1000000};
  const auto name = [](const char* method, int size) {
    return words("%s/spheres:%d/depth:10", method, size);
  };
  std::vector<std::string> needed;
  for (const char* method : kAll) {
    for (const int size : sizes) needed.push_back(name(method, size));
  }
  const auto gpu = newest_with(context, needed);
  const char* claim =
      "1 kHz (GTX 780): graph to about 5,000 spheres, simplified beyond 2,000, "
      "weighted about 1,000.";
  if (!gpu) return not_here(claim);
  FigureResult result;
  Plot plot{words("Cube into a bumpy wall, 10 %% deep, %s", gpu->machine.c_str()),
            "spheres",
            "time of one query, µs (median)",
            {},
            true,
            true,
            ""};
  std::string limits;
  Table table{"Median time of a query, 10 % deep, on the GPU, µs", {"spheres"}, {}};
  for (const int size : sizes) table.rows.push_back({words("%d", size)});
  for (const char* method : kAll) {
    Curve curve{method, method, {}, {}};
    table.columns.emplace_back(method);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const Row* row = gpu->find(name(method, sizes[i]));
      table.rows[i].push_back(time_words(row->median));
      curve.x.push_back(sizes[i]), curve.y.push_back(row->median);
      result.numbers.push_back({words("%s.%d.median", method, sizes[i]), row->median, "µs"});
    }
    const double limit = reaches(curve.x, curve.y, 1000);
    limits += words("%s%s %s%.0f", limits.empty() ? "" : ", ", method,
                    limit >= curve.x.back() ? "beyond " : "", limit);
    plot.curves.push_back(std::move(curve));
  }
  plot.caption = "Spheres at 1 kHz: " + limits + ".";
  result.claims.push_back({claim, "Another machine. " + plot.caption, Verdict::not_comparable});
  // The thesis' central finding, on a machine of the kind that it is about.
  const auto& graph = plot.curves[2];
  const auto& simplified = plot.curves[1];
  const auto& weighted = plot.curves[0];
  result.claims.push_back(
      {"At 10 % depth the graph is always the fastest (on a GPU).",
       words("The graph beats simplified %s; with 5,000 spheres %.0f against %.0f µs: on this GPU "
             "its rounds wait for each other, and brute force has threads enough.",
             where_below(graph.x, graph.y, simplified.y).c_str(), graph.y[1], simplified.y[1]),
       is_below_until(graph.x, graph.y, simplified.y, INFINITY)});
  // µs for a thousand spheres more, up to 17,000 and from there to 100,000.
  const auto slope = [](const Curve& curve, std::size_t from) {
    return 1000 * (curve.y[from + 1] - curve.y[from]) / (curve.x[from + 1] - curve.x[from]);
  };
  result.claims.push_back(
      {"Brute force's time rises more steeply beyond 12,000 spheres (on a GPU).",
       words("For a thousand spheres more weighted takes %.2f µs from 5,000 to 17,000, %.2f from "
             "there to 100,000 and %.2f to 1,000,000; simplified %.2f, %.2f and %.2f.",
             slope(weighted, 1), slope(weighted, 2), slope(weighted, 3), slope(simplified, 1),
             slope(simplified, 2), slope(simplified, 3)),
       agrees_with({is_less(slope(weighted, 1), slope(weighted, 2)),
                    is_less(slope(simplified, 1), slope(simplified, 2))})});
  result.claims.push_back({"Simplified brute force is 1.7 times as fast as weighted (on a GPU).",
                           words("%.1f times with 5,000 spheres, %.1f with 100,000.",
                                 weighted.y[1] / simplified.y[1], weighted.y[3] / simplified.y[3]),
                           is_times(weighted.y[1], simplified.y[1], 1.7)});
  result.notes.push_back(
      "The graph is that of our packings (gap rule relative): these rows are a benchmark's.");
  result.rows_of = gpu->place();
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
  return result;
}

}  // namespace

std::vector<FigureSpec> gpu_figures() {
  return {
      {"4.2", "Haptic frame time beside sensing on one GPU", "Speed", figure_4_2},
      {"4.3", "Does sensing block the hand on a GPU?", "Speed", figure_4_3},
      {"gpu", "Queries on a graphics card", "Speed", gpu_queries},
      {"two-gpus", "Sensing on a second GPU", "Speed", two_gpus},
  };
}

}  // namespace palpate::eval
