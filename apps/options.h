// Options that several verbs share, declared and checked in one place.
#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <filesystem>
#include <limits>
#include <optional>
#include <sstream>
#include <string>

#include "palpate/session/names.h"
#include "palpate/session/session.h"

namespace palpate::apps {

/// Wrong usage: exit status 2.
[[noreturn]] inline void usage_error(const std::string& message) {
  throw CLI::ParseError(message, CLI::ExitCodes::ValidationError);
}

template <class Table>
std::string list_names(const Table& table) {
  std::string text;
  for (const auto& entry : table) text += (text.empty() ? "" : ", ") + std::string(entry.name);
  return text;
}

/// An option whose value is one of the names in a table.
template <class Value, std::size_t n>
CLI::Option* add_named(CLI::App& app, const std::string& flag, Value& value,
                       const std::array<Named<Value>, n>& table, const std::string& help) {
  const auto parse = [&value, &table, flag](const std::string& name) {
    const auto found = value_of(table, name);
    if (!found)
      usage_error(flag + ": '" + name + "' is not known; choose one of " + list_names(table));
    value = *found;
  };
  return app.add_option_function<std::string>(flag, parse, help + ": " + list_names(table))
      ->type_name("NAME")
      ->default_str(name_of(table, value));
}

/// The numbers that an option takes, both ends included, and how people call them.
struct NumberRange {
  double low, high;
  std::string words;
};
inline constexpr double kLeastPositive = std::numeric_limits<double>::min();
inline constexpr double kGreatest = std::numeric_limits<double>::max();

/// The number that a text spells, if it is finite and in the range; else wrong usage.
template <class Number>
Number parse_number_in(const std::string& flag, const NumberRange& range, const std::string& text) {
  const char* begin = text.data() + (text.starts_with('+') ? 1 : 0);
  const char* end = text.data() + text.size();
  Number number{};
  const auto [stop, error] = std::from_chars(begin, end, number);
  const auto value = static_cast<double>(number);
  if (error != std::errc() || stop != end || !(value >= range.low && value <= range.high)) {
    usage_error(flag + ": must be " + range.words + ", not '" + text + "'");
  }
  return number;
}

/// An option whose value is a number in a range.
template <class Number>
CLI::Option* add_number(CLI::App& app, const std::string& flag, Number& value,
                        const NumberRange& range, const std::string& help) {
  std::ostringstream preset;
  preset << value;
  return app
      .add_option_function<std::string>(
          flag,
          [&value, flag, range](const std::string& text) {
            value = parse_number_in<Number>(flag, range, text);
          },
          help)
      ->type_name("NUMBER")
      ->default_str(preset.str());
}

/// --threads, of which there may be a few per core.
void add_threads_option(CLI::App& app, int& num_threads, const std::string& help);
/// --method, --priority, --inside, --backend, --contact-gpu and --threads.
void add_contact_options(CLI::App& app, RunSettings& settings);
/// --sensing-gpu.
void add_sensing_gpu_option(CLI::App& app, int& gpu);
/// Tells people on stderr that --backend auto did not find a GPU, if so.
void note_backend(const std::string& why_not_cuda);
/// How surfaces come from depth images: --min-depth, --no-filter, --normal-radius, ...
void add_surface_options(CLI::App& app, SurfaceOptions& options);

/// What happens between depth frames: --time, --average, ...
void add_time_options(CLI::App& app, TimeOptions& options);

/// --intrinsics fx,fy,cx,cy and --depth-unit.
struct CameraOptions {
  std::optional<Intrinsics> intrinsics;
  double unit = 0.001;
};
void add_camera_options(CLI::App& app, CameraOptions& options);

/// --spheres: how many spheres of a tool file to use; 0: all.
void add_prefix_option(CLI::App& app, int& num_spheres);
/// Reads a tool file, the first `num_spheres` of it unless that is 0.
Result<Tool> load_tool_prefix(const std::filesystem::path& path, int num_spheres, int num_threads);

/// Do two names, through links too, mean one file?
bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b);
/// A file can be written to `path` as far as one can see before hours of work: its folder exists
/// and may be written to, nothing but a file has its name, and it is not the file `input`.
Status check_output_file(const std::filesystem::path& path, const std::filesystem::path& input);
/// Wrong usage unless a mesh can be written under this name.
void check_mesh_name(const std::string& flag, const std::filesystem::path& path);

}  // namespace palpate::apps
