#include "apps/options.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <sstream>
#include <string_view>
#include <thread>
#include <vector>

#include "palpate/io/files.h"

namespace palpate::apps {
namespace {

/// All of the text, or nullopt.
template <class Number>
std::optional<Number> parse_number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  Number number{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || stop != end) return std::nullopt;
  return number;
}

/// The absolute path that a name leads to, links followed, whether or not it is there; without
/// links that lead nowhere or in a circle.
std::filesystem::path resolved(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::path absolute = std::filesystem::absolute(path, error);
  const std::filesystem::path target = std::filesystem::weakly_canonical(absolute, error);
  return error ? absolute.lexically_normal() : target;
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

void add_set_option(CLI::App& app, const SettingTable& table) {
  const auto take = [all = SettingTable(table)](const std::vector<std::string>& texts) mutable {
    for (const std::string& text : texts) {
      const std::size_t equals = text.find('=');
      if (equals == std::string::npos) {
        usage_error("--set: must be KEY=VALUE like surface.normal_radius=4, not '" + text + "'");
      }
      const std::string key = text.substr(0, equals), value = text.substr(equals + 1);
      const Setting* const setting = all.find(key);
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
    std::cerr << "palpate: note: --threads " << text << " is more than " << kPerCore
              << " per core; " << most << " are used\n";
  };
  app.add_option_function<std::string>("--threads", take, help)
      ->type_name("NUMBER")
      ->default_str("0");
}

void note_backend(const std::string& why_not_cuda) {
  if (why_not_cuda.empty()) return;
  std::cerr << "palpate: note: backend cpu is used: " << why_not_cuda << '\n';
}

void print_report(const std::string& run_folder) {
  const auto report = std::filesystem::path(run_folder) / "report.html";
  std::error_code ignored;
  if (std::filesystem::exists(report, ignored)) std::cout << "report: " << report.string() << '\n';
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

void add_sensor_option(CLI::App& app, std::optional<SensorKind>& sensor) {
  add_word(app, "--sensor", sensor,
           "kind of depth camera: selects defaults of surface settings; auto: as the camera "
           "reports");
}

void use_sensor(SensorKind sensor, std::span<const std::string> given, SurfaceOptions& surface) {
  if (sensor == SensorKind::none) return;
  copy_settings(settings_of(surface_options_for(sensor)), settings_of(surface), given);
  std::cerr << "palpate: note: using the surface settings for sensor kind " << name_of(sensor)
            << "; --sensor none turns this off\n";
}

void add_prefix_option(CLI::App& app, int& num_spheres) {
  add_number(app, "--spheres", num_spheres, {1, 1 << 30, "spheres"},
             "use only the first N spheres of the tool file")
      ->default_str("all");
}

void use_sensor(SensorKind sensor, std::span<const std::string> given, TimeOptions& time) {
  if (time.average.kind != DepthAverage::kalman) return;
  TimeOptions chosen = time;
  chosen.average = depth_average_options_for(sensor);
  chosen.average.kind = time.average.kind;
  chosen.average.rest_frames = time.average.rest_frames;
  copy_settings(settings_of(chosen), settings_of(time), given);
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

bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code ignored;
  return std::filesystem::equivalent(a, b, ignored) || resolved(a) == resolved(b);
}

Status check_output_file(const std::filesystem::path& path, const std::filesystem::path& input) {
  const auto refuse = [&path](const std::string& why) {
    return Error{Errc::io_failure, "cannot write " + path.string() + ": " + why};
  };
  std::error_code ignored;
  const std::filesystem::path target = resolved(path);
  const auto folder = target.parent_path();
  if (!std::filesystem::is_directory(folder, ignored)) {
    return refuse("there is no folder " + folder.string() + "; make it first");
  }
  if (std::filesystem::is_directory(target, ignored)) {
    return refuse("it is a folder; give the name of a file");
  }
  std::error_code error;
  const auto kind = std::filesystem::status(target, error).type();
  if (kind == std::filesystem::file_type::none) {
    return refuse(error.message() + "; give another name");
  }
  if (kind != std::filesystem::file_type::not_found &&
      kind != std::filesystem::file_type::regular) {
    return refuse("it is not a regular file; give the name of a new file");
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) {
    return refuse(std::string("its folder: ") + std::strerror(errno) + "; choose another one");
  }
  if (!input.empty() && is_same_file(path, input)) {
    return refuse("it is the input " + input.string() + "; give another name");
  }
  return Done{};
}

void check_mesh_name(const std::string& flag, const std::filesystem::path& path) {
  const auto extension = path.extension();
  if (extension != ".ply" && extension != ".stl" && extension != ".obj") {
    usage_error(flag + ": '" + path.string() + "' must end in .ply, .stl or .obj");
  }
}

}  // namespace palpate::apps
