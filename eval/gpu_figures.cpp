// 4.2, 4.3 and queries on a graphics card, from the rows that scripts/gpu_check.sh has written on a
// machine that has one.
#include <cmath>
#include <map>
#include <optional>

#include "eval/csv.h"
#include "eval/speed.h"

namespace palpate::eval {
namespace {

/// One line: microseconds.
struct Row {
  double median = 0, p99 = 0, p999 = 0, max = 0;
};
struct GpuRows {
  std::string machine, commit;
  std::map<std::string, Row> rows;  ///< by case

  const Row* find(const std::string& name) const {
    const auto found = rows.find(name);
    return found == rows.end() ? nullptr : &found->second;
  }
};

std::optional<GpuRows> read(const std::filesystem::path& path) {
  GpuRows result;
  for (auto& row : read_csv(path).rows) {
    if (row["program"] != "gpu_bench") continue;
    const auto number = [&](const char* column) { return finite_number(row[column]).value_or(0); };
    result.machine = row["machine"];
    result.commit = row["commit"];
    result.rows[row["case"]] = {number("median_us"), number("p99_us"), number("p99.9_us"),
                                number("max_us")};
  }
  if (result.rows.empty()) return std::nullopt;
  return result;
}

FigureResult not_here(const std::string& claim) {
  FigureResult result;
  result.claims.push_back(
      {claim, "Needs the rows of scripts/gpu_check.sh from a machine with a GPU (--gpu FILE.csv).",
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

Result<FigureResult> figure_4_2(Context& context) {
  const auto gpu = read(context.settings().gpu);
  if (!gpu) return not_here(kClaim42);
  FigureResult result;
  Table table{
      words("A query at 1 kHz beside a camera at 30 Hz on one %s, µs", gpu->machine.c_str()),
      {"method", "image", "sensing", "median", "p99", "p99.9", "max"},
      {}};
  double whole = 0, parts = 0, none = 0, worst = 0;
  for (const char* method : {"field", "simplified"}) {
    for (const char* image : {"640x480", "1920x1080"}) {
      for (const char* how :
           {"no camera", "whole frames; equal priority", "whole frames; low priority",
            "16 parts spread over the frame time; equal priority",
            "16 parts spread over the frame time; low priority"}) {
        const Row* row = gpu->find(sharing(method, image, how));
        if (row == nullptr) continue;
        table.rows.push_back({method, image, how, words("%.1f", row->median),
                              words("%.1f", row->p99), words("%.1f", row->p999),
                              words("%.1f", row->max)});
        result.numbers.push_back({words("%s.%s.%s.p99.9", method, image, how), row->p999, "µs"});
        worst = std::max(worst, row->p999);
        const bool is_first = std::string(method) == "field" && std::string(image) == "640x480";
        if (is_first && std::string(how) == "no camera") none = row->median;
        if (is_first && std::string(how).starts_with("whole frames; equal")) whole = row->median;
        if (is_first &&
            std::string(how).starts_with("16 parts spread over the frame time; equal")) {
          parts = row->median;
        }
      }
    }
  }
  if (table.rows.empty()) return not_here(kClaim42);
  result.claims.push_back({kClaim42,
                           words("Median query without camera %.1f, beside whole frames %.1f, "
                                 "beside 16 parts %.1f µs; p99.9 "
                                 "at most %.0f µs in every schedule.",
                                 none, whole, parts, worst),
                           worst < 280 ? Verdict::better : Verdict::differs});
  result.notes.push_back(
      "A frame takes 0.1 ms on this GPU instead of 3 ms, so there is little to spread.");
  result.notes.push_back("Rows of commit " + gpu->commit + ".");
  result.tables.push_back(std::move(table));
  return result;
}

Result<FigureResult> figure_4_3(Context& context) {
  const auto gpu = read(context.settings().gpu);
  if (!gpu) return not_here(kClaim43);
  FigureResult result;
  double largest = 0;
  std::string where;
  for (const char* method : {"field", "simplified"}) {
    for (const char* image : {"640x480", "1920x1080"}) {
      const Row* none = gpu->find(sharing(method, image, "no camera"));
      const Row* whole = gpu->find(sharing(method, image, "whole frames; equal priority"));
      if (none == nullptr || whole == nullptr) continue;
      const double blocked = whole->p99 - none->p99;
      result.numbers.push_back({words("%s.%s.blocked", method, image), blocked, "µs"});
      if (blocked > largest) largest = blocked, where = words("%s, %s", method, image);
    }
  }
  if (result.numbers.empty()) return not_here(kClaim43);
  result.claims.push_back(
      {kClaim43,
       largest > 0
           ? words("Already with whole frames the p99 of a query rises by at most %.1f µs (%s).",
                   largest, where.c_str())
           : "Already with whole frames the p99 of a query does not rise.",
       largest < 50 ? Verdict::better : Verdict::differs});
  result.notes.push_back("Rows of commit " + gpu->commit + ".");
  return result;
}

Result<FigureResult> gpu_queries(Context& context) {
  const auto gpu = read(context.settings().gpu);
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
  bool reaches_all = true;
  const std::vector<int> sizes{1000, 5000, 17000, 100000, 1000000};
  Table table{"Median time of a query, 10 % deep, on the GPU, µs", {"spheres"}, {}};
  for (const int size : sizes) table.rows.push_back({words("%d", size)});
  for (const char* method : {"weighted", "simplified", "graph", "field"}) {
    Curve curve{method, method, {}, {}};
    table.columns.emplace_back(method);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const Row* row = gpu->find(words("%s/spheres:%d/depth:10", method, sizes[i]));
      table.rows[i].push_back(row != nullptr ? time_words(row->median) : "");
      if (row == nullptr) continue;
      curve.x.push_back(sizes[i]), curve.y.push_back(row->median);
      result.numbers.push_back({words("%s.%d.median", method, sizes[i]), row->median, "µs"});
    }
    if (curve.x.empty()) return not_here(claim);
    const double limit = reaches(curve.x, curve.y, 1000);
    reaches_all = reaches_all && limit >= 17000;
    limits += words("%s%s %s%.0f", limits.empty() ? "" : ", ", method,
                    limit >= curve.x.back() ? "beyond " : "", limit);
    plot.curves.push_back(std::move(curve));
  }
  plot.caption = "Spheres at 1 kHz: " + limits + ".";
  result.claims.push_back({claim, plot.caption, reaches_all ? Verdict::better : Verdict::differs});
  result.notes.push_back("Rows of commit " + gpu->commit + ".");
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
  };
}

}  // namespace palpate::eval
