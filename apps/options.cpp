#include "apps/options.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>
#include <string_view>
#include <thread>
#include <vector>

#include "apps/terminal/terminal.h"
#include "palpate/io/files.h"

namespace palpate::apps {
namespace {

/// Parses a number from all of the text, or returns nullopt.
template <class Number>
std::optional<Number> parse_number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  Number number{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || stop != end) return std::nullopt;
  return number;
}

}  // namespace

SettingValue parse_value(const Setting& setting, const std::string& text) {
  if (setting.kind == SettingKind::word) return text;
  if (setting.kind == SettingKind::flag) {
    return text == "true" || text == "false" ? SettingValue(text == "true") : text;
  }
  std::string blanks = text;
  std::replace(blanks.begin(), blanks.end(), ',', ' ');
  std::istringstream parts(setting.kind == SettingKind::pose ? blanks : text + " ");
  std::vector<double> numbers;
  for (std::string part; parts >> part;) {
    const auto number = parse_number<double>(part);
    if (!number) return text;
    numbers.push_back(*number);
  }
  if (setting.kind == SettingKind::pose) {
    const auto pose = pose_of(numbers);
    return pose ? SettingValue(*pose) : text;
  }
  const bool is_one = numbers.size() == 1 && text.find_first_of(" \t") == std::string::npos;
  const bool is_spelled_whole = text.find_first_of(".eE") == std::string::npos;
  if (!is_one || (setting.kind == SettingKind::whole && !is_spelled_whole)) return text;
  return numbers[0];
}

CLI::Option* add_setting(CLI::App& app, const std::string& flag, Setting setting) {
  const std::string help(setting.help);
  const SettingValue preset = setting.get();
  if (const bool* const is_on = std::get_if<bool>(&preset)) {
    return app.add_flag_callback(
        flag, [setting, value = !*is_on]() mutable { (void)setting.set(value); },
        (*is_on ? "switch off: " : "") + help);
  }
  const auto take = [setting, flag](const std::string& text) mutable {
    const Status status = setting.set(parse_value(setting, text), flag + ":");
    if (!status) usage_error(status.error().message);
  };
  const bool is_word = setting.kind == SettingKind::word;
  const double* const number = std::get_if<double>(&preset);
  return app.add_option_function<std::string>(flag, take, help + ": " + setting.range_text())
      ->type_name(is_word ? "NAME" : "NUMBER")
      ->default_str(is_word                  ? std::get<std::string>(preset)
                    : std::isfinite(*number) ? shortest_decimal(*number)
                                             : "no limit");
}

void add_setting_options(CLI::App& app, const std::string& group, const SettingTable& table,
                         std::span<const SettingOption> options) {
  for (const auto& [flag, key] : options) {
    const Setting* const setting = table.find(key);
    if (setting == nullptr) continue;  // this verb has none
    CLI::Option* const option = add_setting(app, flag, *setting);
    if (!group.empty()) option->group(group);
  }
}

namespace {

/// Options that are not settings themselves, but mean the same as one.
constexpr SettingOption kOtherOptions[] = {{"--threads", "loop.threads"},
                                           {"--wrench-frame", "output.wrench_frame"},
                                           {"--wrench-point", "output.wrench_point"},
                                           {"--tcp", "output.tcp"}};

/// Returns the option of a setting if the command line has it; else null.
const CLI::Option* option_given(const CLI::App& app, std::string_view key) {
  using Options = std::span<const SettingOption>;
  for (const Options options :
       {Options(kContactOptions), Options(kSurfaceOptions), Options(kTimeOptions),
        Options(kLoopOptions), Options(kHandOptions), Options(kOtherOptions)}) {
    for (const auto& [flag, of] : options) {
      if (of == key && app.get_option_no_throw(flag) != nullptr && app.count(flag) > 0) {
        return app.get_option_no_throw(flag);
      }
    }
  }
  return nullptr;
}

/// Returns the value that an option gives to a setting.
SettingValue value_given(const CLI::Option& option, const Setting& setting) {
  if (setting.kind == SettingKind::flag) return !option.get_name().starts_with("--no-");
  const std::string& text = option.results().back();
  SettingValue value = parse_value(setting, text);
  const bool is_point =
      setting.kind == SettingKind::pose && std::holds_alternative<std::string>(value);
  return is_point ? parse_value(setting, text + " 0 0 0 1") : value;
}

/// Checks that two options for the same setting agree: neither overrides the other silently.
void refuse_contradiction(const CLI::App& app, const Setting& setting, const std::string& text) {
  const CLI::Option* const option = option_given(app, setting.key());
  if (option == nullptr || value_given(*option, setting) == parse_value(setting, text)) return;
  usage_error(option->get_name() +
              (setting.kind == SettingKind::flag ? "" : " " + option->results().back()) +
              " and --set " + setting.key() + "=" + text +
              " contradict each other: leave one of them out");
}

}  // namespace

void add_set_option(CLI::App& app, const SettingTable& table) {
  const auto take = [all = SettingTable(table),
                     &app](const std::vector<std::string>& texts) mutable {
    std::map<std::string, std::string> given;
    for (const std::string& text : texts) {
      const std::size_t equals = text.find('=');
      if (equals == std::string::npos) {
        usage_error("--set: must be KEY=VALUE like surface.normal_radius=4, not '" + text + "'");
      }
      const std::string key = text.substr(0, equals), value = text.substr(equals + 1);
      const Setting* const setting = all.find(key);
      if (setting != nullptr) refuse_contradiction(app, *setting, value);
      if (const auto first = given.emplace(key, value).first; first->second != value) {
        usage_error("--set: " + key + " is " + first->second + " and " + value +
                    ": leave one of them out");
      }
      const Status status = all.set(key, setting ? parse_value(*setting, value) : value);
      if (!status) usage_error("--set: " + status.error().message);
    }
  };
  app.add_option_function<std::vector<std::string>>(
         "--set", take,
         "any setting, by its name in a settings file (docs/settings.md); repeat for "
         "several")
      ->allow_extra_args(false)
      ->type_name("KEY=VALUE");
}

void check_use(const CLI::App& app, const RunSettings& settings) {
  if (app.count("--bodies") > 0 && app.count("--object") == 0) {
    usage_error(app.get_name() + ": --bodies goes with --object");
  }
  for (const char* const of_field : {"--unknown", "--fill-levels", "--unseen", "--thickness"}) {
    if (app.count(of_field) == 0 || settings.contact.method == MethodKind::field) continue;
    usage_error(std::string(of_field) + " goes with --method field, not " +
                name_of(settings.contact.method));
  }
  for (const char* const of_gpu : {"--contact-gpu", "--sensing-gpu"}) {
    if (app.get_option_no_throw(of_gpu) == nullptr || app.count(of_gpu) == 0) continue;
    if (settings.backend == Backend::cpu) {
      usage_error(std::string(of_gpu) + " does not go with --backend cpu");
    }
  }
}

std::vector<std::string> given_settings(const CLI::App& app,
                                        std::initializer_list<std::span<const SettingOption>> all) {
  std::vector<std::string> keys;
  for (const auto options : all) {
    for (const auto& [flag, key] : options) {
      if (app.count(flag) > 0) keys.emplace_back(key);
    }
  }
  for (const std::string& word : app["--set"]->results()) {
    keys.push_back(word.substr(0, word.find('=')));
  }
  return keys;
}

void add_seed_option(CLI::App& app, std::uint64_t& seed, const std::string& help) {
  const auto take = [&seed](const std::string& text) {
    const auto number = parse_number<std::uint64_t>(text);
    if (!number) {
      usage_error("--seed: must be a whole number from 0 to 18446744073709551615, not '" + text +
                  "'");
    }
    seed = *number;
  };
  app.add_option_function<std::string>("--seed", take, help)
      ->type_name("NUMBER")
      ->default_str(std::to_string(seed));
}

void add_threads_option(CLI::App& app, int& num_threads, const std::string& help) {
  SettingTable table;
  table.add("threads", num_threads, {0, 256, "threads"}, help);  // as loop.threads
  const auto take = [&num_threads, setting = *table.begin()](const std::string& text) mutable {
    constexpr int kPerCore = 4;
    const int most = kPerCore * static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
    const Status status = setting.set(parse_value(setting, text), "--threads:");
    if (!status) usage_error(status.error().message);
    if (num_threads <= most) return;
    num_threads = most;
    print_note("--threads " + text + " is more than " + std::to_string(kPerCore) + " per core; " +
               std::to_string(most) + " are used");
  };
  app.add_option_function<std::string>("--threads", take, help)
      ->type_name("NUMBER")
      ->default_str("0");
}

void note_backend(const std::string& why_not_cuda) {
  if (why_not_cuda.empty()) return;
  print_note("backend cpu is used: " + why_not_cuda);
}

void print_kind(bool is_usable, const std::string& kind, const std::string& about) {
  constexpr std::size_t kColumn = 16, kWidth = 80;
  std::string row = (is_usable ? "  " : "- ") + kind;
  row.resize(std::max(row.size() + 1, kColumn), ' ');
  row += about.substr(0, std::min(about.find(": tried"), about.find("; ")));
  if (row.size() > kWidth) row.resize(std::min(kWidth, row.rfind(", ", kWidth)));
  std::cout << row << '\n';
}

std::shared_ptr<bool> add_details_flag(CLI::App& app) {
  const auto has_details = std::make_shared<bool>(false);
  app.add_flag("-v,--details", *has_details, "print forms, libraries and what was tried, too");
  return has_details;
}

void print_report(const std::string& run_folder) {
  const auto report = std::filesystem::path(run_folder) / "report.html";
  std::error_code ignored;
  if (std::filesystem::exists(report, ignored)) results() << "report: " << report.string() << '\n';
}

namespace {

/// "fx,fy,cx,cy"
Intrinsics parse_intrinsics(const std::string& text) {
  constexpr double kMaxCoordinate = 1e6;
  std::vector<double> k;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    const auto number = parse_number<double>(part);
    if (!number) break;
    k.push_back(*number);
  }
  if (k.size() != 4 || std::ranges::count(text, ',') != 3) {
    usage_error("--intrinsics: give fx,fy,cx,cy, not '" + text + "'");
  }
  for (const double value : k) {
    if (!(std::abs(value) <= kMaxCoordinate)) {
      usage_error("--intrinsics: must be fx,fy,cx,cy, numbers of pixels up to a million");
    }
  }
  if (!(k[0] >= 1 && k[1] >= 1)) {
    usage_error("--intrinsics: must be fx,fy,cx,cy with fx and fy of at least 1 pixel");
  }
  return {k[0], k[1], k[2], k[3]};
}

}  // namespace

CLI::Option* add_intrinsics_option(CLI::App& app, std::function<void(const Intrinsics&)> take,
                                   const std::string& help) {
  const auto take_all = [take = std::move(take)](const std::vector<std::string>& texts) {
    for (const std::string& text : texts) take(parse_intrinsics(text));
  };
  return app.add_option_function<std::vector<std::string>>("--intrinsics", take_all, help)
      ->allow_extra_args(false)
      ->type_name("fx,fy,cx,cy")
      ->option_text("fx,fy,cx,cy");
}

void add_seconds_option(CLI::App& app, const std::string& flag, std::optional<double>& seconds,
                        const std::string& help) {
  const auto take = [&seconds, flag](const std::string& text) {
    constexpr double kDay = 86400;
    double value = 0;
    SettingTable table;
    table.add(flag, value, {1e-3, kDay, "s"}, "");
    Setting& setting = *table.begin();
    const Status status = setting.set(parse_value(setting, text), flag + ":");
    if (!status) usage_error(status.error().message);
    seconds = value;
  };
  app.add_option_function<std::string>(flag, take, help)->type_name("SECONDS");
}

void add_camera_options(CLI::App& app, CameraOptions& options) {
  add_intrinsics_option(
      app, [&options](const Intrinsics& k) { options.intrinsics = k; },
      "intrinsics of the depth camera, in pixels")
      ->expected(1);
  add_number(app, "--depth-unit", options.unit, {1e-6, 1, "m"}, "depth scale, meters per count");
}

void use_sensor(SensorKind sensor, std::span<const std::string> given, SurfaceOptions& surface) {
  if (sensor == SensorKind::none) return;
  copy_settings(settings_of(surface_options_for(sensor)), settings_of(surface), given);
  print_note("using the surface settings for sensor kind " + name_of(sensor) +
             "; --sensor none turns this off");
}

void use_method(MethodKind method, std::span<const std::string> given, SurfaceOptions& surface) {
  if (std::ranges::find(given, "surface.smoothing") == given.end()) {
    surface.filter.smoothing = usual_smoothing(method);
  }
}

void add_prefix_option(CLI::App& app, int& num_spheres) {
  add_number(app, "--spheres", num_spheres, {1, 1 << 30, "spheres"},
             "use only the first N spheres of the tool file")
      ->default_str("all");
}

namespace {

/// Copies settings of averages that a sensor decides.
void use_average(const DepthAverageOptions& average, std::span<const std::string> given,
                 TimeOptions& time) {
  if (time.average.kind != DepthAverage::kalman) return;
  TimeOptions chosen = time;
  chosen.average = average;
  chosen.average.kind = time.average.kind;
  chosen.average.rest_frames = time.average.rest_frames;
  copy_settings(settings_of(chosen), settings_of(time), given);
}

}  // namespace

void use_sensor(SensorKind sensor, std::span<const std::string> given, TimeOptions& time) {
  use_average(depth_average_options_for(sensor), given, time);
}

void use_noise(const SensorNoise& sensor, std::span<const std::string> given, TimeOptions& time) {
  use_average(depth_average_options_for(sensor), given, time);
}

Result<Tool> load_tool_prefix(const std::filesystem::path& path, int num_spheres, int num_threads) {
  auto tool = load_tool(path);
  if (!tool || num_spheres == 0) return tool;
  auto prefix = tool->prefix(num_spheres, num_threads);
  if (!prefix) {
    return Error{prefix.error().code, path.string() + ": --spheres: " + prefix.error().message};
  }
  return prefix;
}

}  // namespace palpate::apps
