// Options that several verbs share, declared and checked in one place.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
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

/// --method, --priority, --inside, --backend and --threads.
void add_contact_options(CLI::App& app, RunSettings& settings);
/// How surfaces come from depth images: --no-filter, --normal-radius, ...
void add_surface_options(CLI::App& app, SurfaceOptions& options);

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

/// A file can be written to `path` as far as one can see before hours of work: its folder exists
/// and no folder has its name.
Status check_output_file(const std::filesystem::path& path);

}  // namespace palpate::apps
