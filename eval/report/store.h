// Figures on disk: what came of them, what with, and their curves for other programs.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "eval/context.h"
#include "eval/figure.h"
#include "palpate/settings/setting_table.h"

namespace palpate::eval {

/// All that the numbers of a figure depend on.
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
/// Of this program on this machine.
Key key_of(const Settings& settings);

struct StoredFigure {
  std::string id;
  Key key;
  std::string commit;   ///< for humans; may be empty
  std::string made;     ///< UTC, "2026-11-21 23:10"
  double seconds = 0;   ///< that it took
  std::string failure;  ///< why there is no result; empty: there is one
  FigureResult result;
};

/// Where the figures of a report lie.
inline constexpr const char* kDataFolder = "data";

/// As in its file; numbers that are not finite are null.
nlohmann::ordered_json to_json(const StoredFigure& figure);

/// FOLDER/ID.json, and FOLDER/ID-plot1.csv, -table1.csv, -numbers.csv for other programs. Each file
/// is whole or absent; the JSON comes last.
Status save_figure(const StoredFigure& figure, const std::filesystem::path& folder);
/// Error: absent, cut off, or not a figure of this id.
Result<StoredFigure> load_figure(const std::string& id, const std::filesystem::path& folder);

/// The id as part of a file's name.
std::string file_stem(const std::string& id);

}  // namespace palpate::eval
