// Figures on disk: results, their settings, and curves for other programs.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "eval/context.h"
#include "eval/figure.h"
#include "palpate/settings/setting_table.h"

namespace palpate::eval {

/// Settings and inputs that the numbers of a figure depend on.
struct Key {
  std::string program;     ///< checksum of the running program
  std::string form;        ///< "full" or "quick"
  std::string data;        ///< real frames: "present" or "absent"
  std::string gpu, peers;  ///< checksums of the CSV files; empty: not given
  std::string processor;   ///< name, as the system reports it
  int num_cores = 0;
  std::string isa;  ///< vector instructions in use

  friend bool operator==(const Key&, const Key&) = default;
};
/// Returns the key of this program on this machine.
Key key_of(const Settings& settings);

struct StoredFigure {
  std::string id;
  Key key;
  std::string commit;   ///< for humans; may be empty
  std::string made;     ///< UTC, "2026-11-21 23:10"
  double seconds = 0;   ///< time of making it
  std::string failure;  ///< error message; empty: there is a result
  FigureResult result;
};

/// Subfolder of a report with the data of its figures.
inline constexpr const char* kDataFolder = "data";

/// Serializes a figure as in its file; numbers that are not finite are null.
nlohmann::ordered_json to_json(const StoredFigure& figure);

/// Writes FOLDER/ID.json, and FOLDER/ID-plot1.csv, -table1.csv, -numbers.csv for other programs.
/// Each file is complete or absent; the JSON comes last.
Status save_figure(const StoredFigure& figure, const std::filesystem::path& folder);
/// Loads a figure. Error: absent, truncated, or not a figure of this id.
Result<StoredFigure> load_figure(const std::string& id, const std::filesystem::path& folder);

/// Returns the id as part of a file's name.
std::string file_stem(const std::string& id);

}  // namespace palpate::eval
