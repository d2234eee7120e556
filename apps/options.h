// Options that several verbs share, declared and checked in one place.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/cloud/depth_noise.h"
#include "palpate/run/run_loop.h"

namespace palpate::apps {

/// Wrong usage: exit status 2.
[[noreturn]] inline void usage_error(const std::string& message) {
  throw CLI::ParseError(message, CLI::ExitCodes::ValidationError);
}

/// Parses the value of a setting; returns the text itself if the setting does not accept it.
SettingValue parse_value(const Setting& setting, const std::string& text);

/// Adds an option for a setting, with its help, range and default; a Boolean one becomes a flag
/// that inverts the default.
CLI::Option* add_setting(CLI::App& app, const std::string& flag, Setting setting);
/// The same for a setting of a table.
struct SettingOption {
  const char* flag;
  const char* key;  ///< "surface.normal_radius"
};
void add_setting_options(CLI::App& app, const std::string& group, const SettingTable& table,
                         std::span<const SettingOption> options);
/// Adds an option for a number in a range or a word of an enumeration.
template <class Number>
CLI::Option* add_number(CLI::App& app, const std::string& flag, Number& value,
                        const NumberRange& range, const std::string& help) {
  SettingTable table;
  table.add(flag, value, range, help);
  return add_setting(app, flag, *table.begin());
}
template <class Word>
CLI::Option* add_word(CLI::App& app, const std::string& flag, Word& value,
                      const std::string& help) {
  SettingTable table;
  table.add(flag, value, help);
  return add_setting(app, flag, *table.begin());
}
/// Adds --set KEY=VALUE for any setting of the table, named as in a settings file.
void add_set_option(CLI::App& app, const SettingTable& table);
/// Ends in wrong usage for options that the chosen method or backend does not use.
void check_use(const CLI::App& app, const RunSettings& settings);
/// Returns the keys of settings on the command line, with options of their own or with --set.
std::vector<std::string> given_settings(const CLI::App& app,
                                        std::initializer_list<std::span<const SettingOption>> all);
/// Parses a whole number below 2^64.
void add_seed_option(CLI::App& app, std::uint64_t& seed, const std::string& help);

/// Adds --threads; a few per core are allowed.
void add_threads_option(CLI::App& app, int& num_threads, const std::string& help);
inline constexpr const char* kThreadsHelp =
    "threads; 0: one per core for surfaces, one for queries, live one more per 50,000 spheres";

/// Settings of a run that have an option of their own.
inline constexpr SettingOption kContactOptions[] = {
    {"--method", "contact.method"},         {"--priority", "contact.priority"},
    {"--inside", "contact.inside"},         {"--volumes", "contact.volumes"},
    {"--edges", "contact.edges"},           {"--continuity", "contact.continuity"},
    {"--bodies", "contact.bodies"},         {"--unknown", "field.unknown"},
    {"--fill-levels", "field.fill_levels"}, {"--unseen", "field.unseen"},
    {"--thickness", "field.thickness"},     {"--backend", "loop.backend"},
    {"--contact-gpu", "loop.contact_gpu"}};
/// Options of surfaces from depth images.
inline constexpr SettingOption kSurfaceOptions[] = {{"--no-filter", "surface.filter"},
                                                    {"--smoothing", "surface.smoothing"},
                                                    {"--min-depth", "surface.min_depth"},
                                                    {"--max-depth", "surface.max_depth"},
                                                    {"--normal-radius", "surface.normal_radius"},
                                                    {"--plane-fit", "surface.plane_fit"},
                                                    {"--weighting", "surface.weighting"},
                                                    {"--anchoring", "surface.anchoring"},
                                                    {"--normalization", "surface.normalization"}};
/// Options of the time between depth images.
inline constexpr SettingOption kTimeOptions[] = {{"--time", "time.mode"},
                                                 {"--average", "time.average"},
                                                 {"--average-frames", "time.average_frames"},
                                                 {"--average-weight", "time.average_weight"},
                                                 {"--memory", "time.memory"},
                                                 {"--memory-horizon", "time.memory_horizon"},
                                                 {"--memory-thickness", "time.memory_thickness"},
                                                 {"--memory-frames", "time.memory_frames"}};
inline constexpr SettingOption kLoopOptions[] = {
    {"--rate", "loop.contact_rate"}, {"--std", "loop.std"}, {"--sensing-gpu", "loop.sensing_gpu"}};
/// Options of tool, surface and hand.
inline constexpr SettingOption kHandOptions[] = {{"--coupling", "coupling.kind"},
                                                 {"--friction", "friction.coefficient"},
                                                 {"--texture", "texture.kind"},
                                                 {"--dead-man", "safety.dead_man"}};
/// Options of a robot that cameras see.
inline constexpr SettingOption kRobotOptions[] = {{"--robot-padding", "robot.padding"},
                                                  {"--robot-scale", "robot.scale"},
                                                  {"--robot-max-age", "robot.max_age"},
                                                  {"--robot-geometry", "robot.geometry"}};
/// Options of `pack`: limits of a packing except --spheres, which takes a word too.
inline constexpr SettingOption kPackLimits[] = {{"--max-radius", "packing.max_radius"},
                                                {"--min-radius", "packing.min_radius"},
                                                {"--max-fill", "packing.max_fill"},
                                                {"--max-seconds", "packing.max_seconds"}};
/// Prints a note on stderr if --backend auto did not find a GPU.
void note_backend(const std::string& why_not_cuda);
/// Prints a row of a list of kinds: "- " before one that is not usable, its name, and the first
/// part of what is known of it, in a line of 80 columns.
void print_kind(bool is_usable, const std::string& kind, const std::string& about);
/// Adds -v,--details, of such a list.
std::shared_ptr<bool> add_details_flag(CLI::App& app);
/// Prints the path of a run's report on stdout, if it has one.
void print_report(const std::string& run_folder);
/// --intrinsics fx,fy,cx,cy and --depth-unit.
struct CameraOptions {
  std::optional<Intrinsics> intrinsics;
  double unit = 0.001;
};
void add_camera_options(CLI::App& app, CameraOptions& options);
/// Adds --intrinsics fx,fy,cx,cy; calls `take` with each plausible one, else wrong usage.
CLI::Option* add_intrinsics_option(CLI::App& app, std::function<void(const Intrinsics&)> take,
                                   const std::string& help);
/// Adds an option for a duration from 1 ms to a day.
void add_seconds_option(CLI::App& app, const std::string& flag, std::optional<double>& seconds,
                        const std::string& help);

/// Sets the defaults of surfaces for this kind of camera, except the settings `given`, with a note.
void use_sensor(SensorKind sensor, std::span<const std::string> given, SurfaceOptions& surface);
/// The same for estimates of depth over time; other averages stay as they are.
void use_sensor(SensorKind sensor, std::span<const std::string> given, TimeOptions& time);
/// The same with the noise of a sensor file.
void use_noise(const SensorNoise& sensor, std::span<const std::string> given, TimeOptions& time);
/// Sets the filter of the depth that is usual with a method, unless it is among the settings
/// `given`.
void use_method(MethodKind method, std::span<const std::string> given, SurfaceOptions& surface);

/// Adds --spheres: number of spheres of a tool file to use; 0: all.
void add_prefix_option(CLI::App& app, int& num_spheres);
/// Reads a tool file, the first `num_spheres` of it unless that is 0.
Result<Tool> load_tool_prefix(const std::filesystem::path& path, int num_spheres, int num_threads);

}  // namespace palpate::apps
