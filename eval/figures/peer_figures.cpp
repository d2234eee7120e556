// Other libraries beside ours: point-in-sphere queries and normals. The times come from
// bench_peers, which measures all of them and ours in one run.
#include <algorithm>
#include <array>
#include <cctype>
#include <limits>
#include <map>

#include "eval/report/csv.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr const char* kHowTo =
    "scripts/setup.sh --peers && cmake --preset peers && cmake --build --preset peers --target "
    "bench_peers && build/peers/bin/bench_peers --csv peers.csv, then palpate_eval peers -o REPORT "
    "--peers peers.csv";
constexpr double kFrame = 1e6 / 30;  ///< µs

/// One library and ours on the same task. Microseconds.
struct Row {
  std::string stage, peer;
  std::map<std::string, std::string> setup, facts;
  double ours = 0, theirs = 0;
  double build = 0;  ///< of its tree over the points of a frame

  double ratio() const { return theirs / ours; }
  double number(const std::string& name) const {
    const auto found = setup.find(name);
    return found == setup.end() ? 0 : finite_number(found->second).value_or(0);
  }
  std::string word(const std::string& name) const {
    const auto found = setup.find(name);
    return found == setup.end() ? "" : found->second;
  }
  /// NaN: not reported.
  double fact(const std::string& name) const {
    const auto found = facts.find(name);
    const double none = std::numeric_limits<double>::quiet_NaN();
    return found == facts.end() ? none : finite_number(found->second).value_or(none);
  }
};

struct PeerRows {
  std::vector<Row> rows;
  std::vector<std::string> peers;  ///< in the order of the file
  std::vector<std::string> notes;
  std::string place;  ///< machine of the measurement

  /// Returns the rows of one library.
  std::vector<Row> of(const std::string& peer) const {
    std::vector<Row> some;
    std::copy_if(rows.begin(), rows.end(), std::back_inserter(some),
                 [&](const Row& row) { return row.peer == peer; });
    return some;
  }
};

/// Makes a key: "Embree best tree" becomes "embree-best-tree".
std::string key_of(const std::string& peer) {
  std::string key;
  for (const char c : peer) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
      key += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else if (!key.empty() && key.back() != '-') {
      key += '-';
    }
  }
  while (key.ends_with('-')) key.pop_back();
  return key;
}

/// Reads the rows of some stages; `is_whole` is true for a row with all values for its figure.
PeerRows read(const Context& context, const std::vector<std::string>& stages,
              bool (*is_whole)(const Row&)) {
  const CsvFile file = read_csv(context.settings().peers);
  PeerRows result;
  int num_damaged = file.num_damaged;
  for (const auto& line : file.rows) {
    const auto field = [&](const char* column) {
      const auto found = line.find(column);
      return found == line.end() ? "" : found->second;
    };
    Row row;
    row.setup = named_values(field("case"), '/', ':');
    row.stage = field("case").substr(0, field("case").find('/'));
    row.facts = named_values(field("facts"), ' ', '=');
    row.peer = field("peer");
    row.ours = finite_number(field("ours_median_us")).value_or(0);
    row.theirs = finite_number(field("peer_median_us")).value_or(0);
    row.build = finite_number(field("build_us")).value_or(0);
    const bool is_good = row.ours > 0 && row.theirs > 0 && row.build >= 0 &&
                         !key_of(row.peer).empty() && is_whole(row);
    const bool is_requested = std::find(stages.begin(), stages.end(), row.stage) != stages.end();
    if (!is_good) num_damaged += is_requested;
    if (!is_good || !is_requested) continue;
    // Repeated measurement: the last one counts.
    std::erase_if(result.rows, [&](const Row& other) {
      return other.stage == row.stage && other.setup == row.setup &&
             key_of(other.peer) == key_of(row.peer);
    });
    result.rows.push_back(std::move(row));
  }
  for (const Row& row : result.rows) {
    if (std::find(result.peers.begin(), result.peers.end(), row.peer) == result.peers.end()) {
      result.peers.push_back(row.peer);
    }
  }
  result.place = file.fact("machine") + ", commit " + file.fact("commit");
  result.notes.push_back(words("Measured on %s, one thread; %s.", file.fact("date").c_str(),
                               file.fact("settings").c_str()));
  if (const std::string names = file.fact("libraries"); !names.empty()) {
    result.notes.push_back(names + ".");
  }
  if (num_damaged > 0) {
    result.notes.push_back(words("%d damaged lines were left out.", num_damaged));
  }
  return result;
}

FigureResult not_here(const Context& context, const std::string& claim) {
  FigureResult result;
  const std::filesystem::path& file = context.settings().peers;
  result.claims.push_back({claim,
                           (file.empty() ? "Needs times of other libraries: "
                                         : file.string() + " has no such times: ") +
                               kHowTo + ".",
                           Verdict::not_measured, Source::ours});
  return result;
}

std::string style(std::size_t i) { return words("other%zu", i % 4 + 1); }

/// Formats a range: "3.1", "3.1 to 12", "0.42".
std::string range(double low, double high) {
  const std::string from = words("%.2g", low), to = words("%.2g", high);
  return from == to ? from : from + " to " + to;
}

// ---- Points in spheres ----

/// Output of a query for each sphere: its word in the file, and a description.
struct Question {
  const char* word;
  const char* text;
};
constexpr std::array<Question, 2> kQuestions{{
    {"sums", "the points of every sphere, added up"},
    {"which", "only which spheres hold a point"},
}};

bool is_boundary_row(const Row& row) {
  return row.number("spheres") > 0 && row.number("depth") > 0 &&
         std::any_of(kQuestions.begin(), kQuestions.end(),
                     [&](const Question& q) { return row.word("ask") == q.word; });
}

/// Makes the claim that one library is slower than ours for one output.
Claim boundary_claim(const std::vector<Row>& rows, const std::string& claim) {
  const auto [low, high] = std::minmax_element(
      rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.ratio() < b.ratio(); });
  std::string ours = words(
      "%s takes %s times as long as ours (at %.0f spheres, %.0f %% deep: %.0f against %.0f "
      "µs)",
      low->peer.c_str(), range(low->ratio(), high->ratio()).c_str(), low->number("spheres"),
      low->number("depth"), low->theirs, low->ours);
  if (low->build > 1000) {
    ours += words(", and building its tree takes %.0f ms for each frame, which lasts 33 ms",
                  low->build / 1000);
  }
  std::vector<Verdict> verdicts;
  for (const Row& row : rows) verdicts.push_back(is_better(row.ours, row.theirs));
  return {claim, ours + ".", is_better_throughout(verdicts), Source::ours};
}

Result<FigureResult> boundary(Context& context) {
  const PeerRows all = read(context, {"boundary"}, is_boundary_row);
  if (all.rows.empty()) {
    return not_here(context,
                    "The points of every sphere are found faster than by any "
                    "other library.");
  }
  FigureResult result;
  result.rows_of = all.place;
  Table table{"A cube in a bumpy wall seen by a camera of 640x480, medians over 200 poses",
              {"asked", "library", "spheres", "depth, %", "ours, µs", "theirs, µs", "ratio",
               "its tree, ms per frame"},
              {}};
  const double depth = std::any_of(all.rows.begin(), all.rows.end(),
                                   [](const Row& row) { return row.number("depth") == 50; })
                           ? 50
                           : all.rows.front().number("depth");
  for (const Question& question : kQuestions) {
    Plot plot{words("Asked for %s, %.0f %% deep", question.text, depth),
              "spheres",
              "time of the library / ours (medians)",
              {},
              true,
              true,
              ""};
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < all.peers.size(); ++i) {
      std::vector<Row> rows = all.of(all.peers[i]);
      std::erase_if(rows, [&](const Row& row) { return row.word("ask") != question.word; });
      if (rows.empty()) continue;
      std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) {
        return a.number("spheres") < b.number("spheres");
      });
      Curve curve{all.peers[i], style(i), {}, {}};
      for (const Row& row : rows) {
        const double spheres = row.number("spheres");
        if (row.number("depth") == depth) {
          curve.x.push_back(spheres), curve.y.push_back(row.ratio());
          if (row.ratio() < least) {
            least = row.ratio();
            plot.caption = words(
                "The nearest to ours is %s with %.2g times our time at %.0f "
                "spheres.",
                row.peer.c_str(), row.ratio(), spheres);
          }
        }
        table.rows.push_back({question.text, row.peer, words("%.0f", spheres),
                              words("%.0f", row.number("depth")), words("%.1f", row.ours),
                              words("%.1f", row.theirs), words("%.2f", row.ratio()),
                              words("%.2f", row.build / 1000)});
        result.numbers.push_back({words("%s.%s.%.0f.%.0f.ratio", key_of(row.peer).c_str(),
                                        question.word, spheres, row.number("depth")),
                                  row.ratio(), ""});
      }
      if (!curve.x.empty()) plot.curves.push_back(std::move(curve));
      result.claims.push_back(boundary_claim(rows, words("Asked for %s, %s is slower than ours.",
                                                         question.text, all.peers[i].c_str())));
    }
    if (plot.curves.empty()) continue;
    const std::vector<double>& x = plot.curves.front().x;
    plot.curves.push_back({"as fast as ours", "exact", {x.front(), x.back()}, {1, 1}});
    result.plots.push_back(std::move(plot));
  }
  Table short_table{"Other libraries, time over ours, over all sizes and depths",
                    {"library", "asked", "least", "most", "its tree, ms per frame"},
                    {}};
  for (const std::string& peer : all.peers) {
    for (const Question& question : kQuestions) {
      double least = std::numeric_limits<double>::infinity(), most = 0, build = 0;
      for (const Row& row : all.of(peer)) {
        if (row.word("ask") != question.word) continue;
        least = std::min(least, row.ratio()), most = std::max(most, row.ratio());
        build = std::max(build, row.build);
      }
      if (most == 0) continue;
      short_table.rows.push_back({peer, question.text, words("%.2f", least), words("%.1f", most),
                                  words("%.1f", build / 1000)});
    }
  }
  for (const std::string& peer : all.peers) {
    const double build = all.of(peer).front().build;
    result.numbers.push_back({key_of(peer) + ".tree_share_of_frame", build / kFrame, ""});
  }
  result.tables.push_back(std::move(table));
  result.tables.push_back(std::move(short_table));
  result.notes = all.notes;
  result.notes.push_back(
      "Ours adds up points and normals in both questions and needs no tree; the libraries get the "
      "centers of all spheres one by one, and leaving out those far from every point beforehand "
      "would help them. All answers were compared before they were timed.");
  return result;
}

// ---- Normals and the filter of depth ----

bool is_surface_row(const Row& row) { return !row.word("input").empty(); }

std::string input_of(const Row& row) {
  return row.stage == "filter" ? "depth filter" : "normals of " + row.word("input") + " depth";
}

/// Faster and as exact is better; slower and no more exact contradicts.
Claim surface_claim(const std::vector<Row>& rows) {
  std::vector<Verdict> verdicts;
  std::string ours;
  for (const Row& row : rows) {
    const double our_error = row.fact("ours_error"), their_error = row.fact("peer_error");
    const bool is_known = our_error > 0 && their_error > 0;
    verdicts.push_back(is_faster_and_as_exact({row.ours, our_error}, {row.theirs, their_error}));
    ours += words("%s%s: %.2f times our time (%.2f against %.2f ms)", ours.empty() ? "" : "; ",
                  input_of(row).c_str(), row.ratio(), row.theirs / 1000, row.ours / 1000);
    if (is_known) {
      ours += words(", error %.2f against %.2f %s", their_error, our_error,
                    row.stage == "filter" ? "mm" : "degrees");
    }
  }
  return {rows.front().peer + " is slower than ours and no more exact.", ours + ".",
          is_better_throughout(verdicts), Source::ours};
}

Result<FigureResult> normals(Context& context) {
  const PeerRows all = read(context, {"normals", "filter"}, is_surface_row);
  if (all.rows.empty()) {
    return not_here(context, "Normals are estimated faster than by any other library.");
  }
  FigureResult result;
  result.rows_of = all.place;
  Table table{"Stages of surface estimation, a noisy wall of 640x480, one thread",
              {"work", "library", "ours, ms", "theirs, ms", "ratio", "our error", "their error"},
              {}};
  Plot plot{"Normals of raw and of filtered depth",
            "mean error of a normal, degrees",
            "time, ms (median)",
            {},
            false,
            true,
            ""};
  Curve our_curve{"ours", "field", {}, {}};
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < all.peers.size(); ++i) {
    const std::vector<Row> rows = all.of(all.peers[i]);
    if (rows.empty()) continue;
    Curve curve{all.peers[i], style(i), {}, {}};
    for (const Row& row : rows) {
      const double our_error = row.fact("ours_error"), their_error = row.fact("peer_error");
      const char* unit = row.stage == "filter" ? "mm" : "°";
      table.rows.push_back({input_of(row), row.peer, words("%.2f", row.ours / 1000),
                            words("%.2f", row.theirs / 1000), words("%.2f", row.ratio()),
                            our_error > 0 ? words("%.2f %s", our_error, unit) : "",
                            their_error > 0 ? words("%.2f %s", their_error, unit) : ""});
      result.numbers.push_back({words("%s.%s.%s.ratio", key_of(row.peer).c_str(), row.stage.c_str(),
                                      row.word("input").c_str()),
                                row.ratio(), ""});
      if (row.stage != "normals") continue;
      curve.x.push_back(their_error), curve.y.push_back(row.theirs / 1000);
      if (std::find(our_curve.x.begin(), our_curve.x.end(), our_error) == our_curve.x.end()) {
        our_curve.x.push_back(our_error), our_curve.y.push_back(row.ours / 1000);
      }
      if (row.ratio() < least) {
        least = row.ratio();
        plot.caption = words(
            "The nearest to ours in time is %s with %.2f times our time for the "
            "%s.",
            row.peer.c_str(), row.ratio(), input_of(row).c_str());
      }
    }
    if (!curve.x.empty()) plot.curves.push_back(std::move(curve));
    result.claims.push_back(surface_claim(rows));
  }
  if (!plot.curves.empty()) {
    plot.curves.insert(plot.curves.begin(), std::move(our_curve));
    result.plots.push_back(std::move(plot));
  }
  result.tables.push_back(std::move(table));
  result.notes = all.notes;
  return result;
}

}  // namespace

std::vector<FigureSpec> peer_figures() {
  return {
      {"peers-boundary", "Which points are in which sphere: other libraries beside ours", "Peers",
       boundary},
      {"peers-normals", "Normals and depth filter: other libraries beside ours", "Peers", normals},
  };
}

}  // namespace palpate::eval
