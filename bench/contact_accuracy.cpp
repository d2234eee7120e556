// How accurate the contact methods are: every method on the way through every synthetic scene,
// against the exact wrench. An evaluation, not a test.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <tuple>

#include "eval/accuracy.h"

namespace palpate::bench {
namespace {

using eval::ContactCase;
using eval::DepthNoise;
using eval::Measure;

/// A contact query with these options, or the exact field sampled at each sphere.
struct Method {
  const char* name;
  std::optional<ContactOptions> query;
};
const Method kMethods[] = {
    {"oracle", std::nullopt},
    {"weighted", ContactOptions{.method = InsideMethod::weighted}},
    {"simplified", ContactOptions{.method = InsideMethod::simplified}},
    {"graph", ContactOptions{.method = InsideMethod::graph}},
    {"graph-cap", ContactOptions{.method = InsideMethod::graph, .inside = InsideVolume::cap}},
    {"field", ContactOptions{.method = InsideMethod::field}},
};

template <class Value>
struct Choice {
  const char* name;
  Value value;
};
constexpr Choice<DepthNoise> kNoises[] = {
    {"none", DepthNoise::none}, {"gaussian", DepthNoise::gaussian}, {"kinect", DepthNoise::kinect}};
constexpr Choice<SphereVolumes> kVolumes[] = {{"spheres", SphereVolumes::own},
                                              {"represented", SphereVolumes::represented}};

struct Settings {
  std::vector<std::string> cases, methods, noises{"none", "gaussian"}, volumes{"spheres"};
  std::vector<int> spheres{1000, 17000};
  std::string csv, json;
  bool quick = false;
  int num_threads = 1;

  double fine_step() const { return quick ? 0.25e-3 : 0.05e-3; }  // m
  int loop_steps() const { return quick ? 1000 : 4000; }
};

struct Row {
  std::string name, noise, volumes, method;
  int num_spheres = 0;
  double packing = 0;  ///< rms volume error of the packing alone, at the wall
  eval::VolumeError volume;
  eval::WrenchError wrench;
  double loop = 0;
};

double degrees(double angle) { return angle * 180 / kPi; }

/// The numbers of a row, in the order of table and files.
struct Column {
  const char* key;      ///< in files
  const char* heading;  ///< in the table
  int digits;
  double (*value)(const Row&);
};
constexpr Column kColumns[] = {
    {"volume_rms_percent", "vol rms", 2, [](const Row& r) { return 100 * r.volume.rms; }},
    {"volume_max_percent", "vol max", 2, [](const Row& r) { return 100 * r.volume.worst; }},
    {"lost_percent", "lost", 1, [](const Row& r) { return 100 * r.volume.lost; }},
    {"direction_rms_deg", "dir rms", 2,
     [](const Row& r) { return degrees(r.wrench.direction_rms); }},
    {"direction_max_deg", "dir max", 2,
     [](const Row& r) { return degrees(r.wrench.direction_worst); }},
    {"torque_rms_percent", "trq rms", 2, [](const Row& r) { return 100 * r.wrench.torque_rms; }},
    {"torque_max_percent", "trq max", 2, [](const Row& r) { return 100 * r.wrench.torque_worst; }},
    {"jump_over_exact", "jump", 2,
     [](const Row& r) { return r.wrench.jump / r.wrench.exact_jump; }},
    {"loop_work_percent", "loop", 4, [](const Row& r) { return 100 * r.loop; }},
    {"packing_rms_percent", "packing", 2, [](const Row& r) { return 100 * r.packing; }},
};

constexpr const char* kLegend =
    "vol    measured - exact share of the tool, % of the tool; 0-100 % depth, steps in contact\n"
    "lost   % of these steps that measure nothing although more than 1 % of the tool is inside\n"
    "dir    angle between measured and exact force, degrees; 0-50 % depth\n"
    "trq    torque error, % of exact force times radius of the tool; 0-50 % depth\n"
    "jump   largest force change over a step of the fine sweep / largest exact one; 0-50 % depth\n"
    "loop   |net work| / total work over a closed loop of all six degrees of freedom, %\n"
    "packing  vol rms of the packing alone: exact caps at the wall\n";

void print_head(const char* first) {
  std::printf("%-30s %-8s %6s %-11s %-10s", first, "noise", "N", "volumes", "method");
  for (const Column& column : kColumns) std::printf(" %9s", column.heading);
  std::printf("\n");
}

void print_start(const Row& row) {
  std::printf("%-30s %-8s %6d %-11s %-10s", row.name.c_str(), row.noise.c_str(), row.num_spheres,
              row.volumes.c_str(), row.method.c_str());
}

void print(const Row& row) {
  print_start(row);
  for (const Column& column : kColumns) std::printf(" %9.*f", column.digits, column.value(row));
  std::printf("\n");
  std::fflush(stdout);
}

/// Over the cases: the root mean square of what is one already, the largest of the largest.
void print_summary(const std::vector<Row>& rows) {
  std::printf("\n");
  print_head("all cases (rms; max of max)");
  std::vector<bool> done(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (done[i]) continue;
    std::vector<const Row*> group;
    for (std::size_t j = i; j < rows.size(); ++j) {
      if (rows[j].noise == rows[i].noise && rows[j].num_spheres == rows[i].num_spheres &&
          rows[j].volumes == rows[i].volumes && rows[j].method == rows[i].method) {
        group.push_back(&rows[j]);
        done[j] = true;
      }
    }
    Row title = rows[i];
    title.name = std::to_string(group.size()) + " cases";
    print_start(title);
    for (const Column& column : kColumns) {
      const bool is_rms = std::string_view(column.key).find("_rms_") != std::string_view::npos;
      double sum = 0, worst = 0;
      for (const Row* row : group) {
        sum += column.value(*row) * column.value(*row);
        worst = std::max(worst, column.value(*row));
      }
      std::printf(" %9.*f", column.digits,
                  is_rms ? std::sqrt(sum / static_cast<double>(group.size())) : worst);
    }
    std::printf("\n");
  }
}

nlohmann::ordered_json to_json(const Row& row) {
  nlohmann::ordered_json json{{"case", row.name},
                              {"noise", row.noise},
                              {"spheres", row.num_spheres},
                              {"volumes", row.volumes},
                              {"method", row.method}};
  for (const Column& column : kColumns) json[column.key] = column.value(row);
  return json;
}

bool write_files(const Settings& settings, const std::vector<Row>& rows) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Row& row : rows) all.push_back(to_json(row));
  bool written = true;
  if (!settings.json.empty()) {
    std::ofstream file(settings.json);
    file << nlohmann::ordered_json{{"fine_step_m", settings.fine_step()},
                                   {"loop_steps", settings.loop_steps()},
                                   {"rows", all}}
                .dump(1)
         << '\n';
    written = written && file.flush().good();
  }
  if (!settings.csv.empty()) {
    std::ofstream file(settings.csv);
    const char* separator = "";
    const nlohmann::ordered_json keys = to_json({});
    for (const auto& [key, value] : keys.items()) {
      file << separator << key;
      separator = ",";
    }
    file << '\n';
    for (const auto& row : all) {
      separator = "";
      for (const auto& value : row) {
        file << separator << (value.is_string() ? value.get<std::string>() : value.dump());
        separator = ",";
      }
      file << '\n';
    }
    written = written && file.flush().good();
  }
  return written;
}

bool chosen(const std::vector<std::string>& names, const std::string& name) {
  return names.empty() || std::find(names.begin(), names.end(), name) != names.end();
}

/// The exact values of a case for one tool; all methods share them.
struct Ways {
  std::vector<eval::ExactStep> whole, fine;

  Ways(const ContactCase& c, const Tool& tool, const Settings& settings)
      : whole(eval::exact_steps(c, tool, 0, 1, 100)) {
    const double half_way = norm(c.end.translation - c.start.translation) / 2;
    fine = eval::exact_steps(c, tool, 0, 0.5,
                             static_cast<int>(std::lround(half_way / settings.fine_step())));
  }
};

/// What cutting the spheres exactly at the wall leaves: nothing but the packing.
double packing_error(const ContactCase& c, const Tool& tool, SphereVolumes volumes) {
  const ContactCase wall = eval::at_the_wall(c);
  return eval::volume_error(tool, eval::exact_steps(wall, tool, 0, 1, 100),
                            eval::oracle_measure(tool, wall.environment, volumes))
      .rms;
}

class Evaluation {
 public:
  explicit Evaluation(const Settings& settings)
      : settings_(settings), pool_(settings.num_threads) {}

  void add(const ContactCase& c, const Tool& tool) {
    const Ways ways(c, tool, settings_);
    for (const auto& noise : kNoises) {
      if (!chosen(settings_.noises, noise.name)) continue;
      const eval::SeenScene seen = eval::see(c, noise.value);
      for (const auto& volumes : kVolumes) {
        if (!chosen(settings_.volumes, volumes.name)) continue;
        for (const Method& method : kMethods) {
          // The oracle sees no depth image: once is enough.
          const bool again =
              !method.query &&
              !seen_by_oracle_.insert({c.name, tool.spheres().size(), volumes.name}).second;
          if (again || !chosen(settings_.methods, method.name)) continue;
          const Measure measure = measure_of(method, c, tool, seen, volumes.value);
          const Row row{.name = c.name,
                        .noise = method.query ? noise.name : "-",
                        .volumes = volumes.name,
                        .method = method.name,
                        .num_spheres = static_cast<int>(tool.spheres().size()),
                        .packing = packing_error(c, tool, volumes.value),
                        .volume = eval::volume_error(tool, ways.whole, measure),
                        .wrench = eval::wrench_error(tool, ways.fine, measure),
                        .loop = eval::loop_work(c, tool, measure, settings_.loop_steps())};
          print(row);
          rows_.push_back(row);
        }
      }
    }
  }

  const std::vector<Row>& rows() const { return rows_; }

 private:
  Measure measure_of(const Method& method, const ContactCase& c, const Tool& tool,
                     const eval::SeenScene& seen, SphereVolumes volumes) {
    if (!method.query) return eval::oracle_measure(tool, c.environment, volumes);
    ContactOptions options = *method.query;
    options.volumes = volumes;
    return eval::query_measure(tool, seen, options, &pool_);
  }

  const Settings& settings_;
  ThreadPool pool_;
  std::vector<Row> rows_;
  std::set<std::tuple<std::string, std::size_t, std::string>> seen_by_oracle_;
};

template <class Table>
std::vector<std::string> names_in(const Table& table) {
  std::vector<std::string> names;
  for (const auto& entry : table) names.emplace_back(entry.name);
  return names;
}

int run(int argc, char** argv) {
  std::vector<ContactCase> cases = eval::thesis_cases();
  for (ContactCase& c : eval::tilted_cases()) cases.push_back(std::move(c));

  Settings settings;
  CLI::App app("How accurate the contact methods are, against the exact wrench.");
  const auto add_list = [&](const char* flag, std::vector<std::string>& list,
                            const std::vector<std::string>& names, const char* help) {
    app.add_option(flag, list, help)->delimiter(',')->check(CLI::IsMember(names));
  };
  add_list("--cases", settings.cases, names_in(cases), "scene and tool; default: all");
  add_list("--methods", settings.methods, names_in(kMethods), "default: all");
  add_list("--noise", settings.noises, names_in(kNoises), "default: none, gaussian (1.5 mm)");
  add_list("--volumes", settings.volumes, names_in(kVolumes), "default: spheres");
  app.add_option("--spheres", settings.spheres, "numbers of spheres; default: 1000, 17000")
      ->delimiter(',')
      ->check(CLI::Range(1, 1000000));
  app.add_flag("--quick", settings.quick,
               "fine sweep in steps of 0.25 instead of 0.05 mm, loop of 1000 instead of 4000");
  app.add_option("--threads", settings.num_threads, "per query; default: 1")
      ->check(CLI::Range(1, 256));
  app.add_option("--csv", settings.csv, "write the rows to this file");
  app.add_option("--json", settings.json, "write the rows to this file");
  CLI11_PARSE(app, argc, argv);

  std::sort(settings.spheres.begin(), settings.spheres.end());
  std::map<std::string, Tool> tools;  // the largest of each shape
  Evaluation evaluation(settings);
  print_head("case");
  for (const ContactCase& c : cases) {
    if (!chosen(settings.cases, c.name)) continue;
    if (!tools.contains(c.tool_shape)) {
      tools.emplace(c.tool_shape, eval::packed_tool(c, settings.spheres.back()));
    }
    const Tool& largest = tools.at(c.tool_shape);
    for (int num_spheres : settings.spheres) {
      const int available = static_cast<int>(largest.spheres().size());
      evaluation.add(c, largest.prefix(std::min(num_spheres, available)).value());
    }
  }
  print_summary(evaluation.rows());
  std::printf("\n%s", kLegend);
  if (!write_files(settings, evaluation.rows())) {
    std::fprintf(stderr, "contact_accuracy: the result files could not be written\n");
    return 1;
  }
  return 0;
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) { return palpate::bench::run(argc, argv); }
