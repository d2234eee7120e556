#include "eval/report/store.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "palpate/core/core.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kFormat = "palpate figure 1";

// Numbers that are not finite become null, which JSON requires.

Json to_json(const Key& key) {
  return {{"program", key.program},     {"form", key.form},
          {"data", key.data},           {"gpu", key.gpu},
          {"peers", key.peers},         {"processor", key.processor},
          {"num_cores", key.num_cores}, {"isa", key.isa}};
}

Json to_json(const Plot& plot) {
  Json curves = Json::array();
  for (const Curve& curve : plot.curves) {
    curves.push_back(
        {{"label", curve.label}, {"style", curve.style}, {"x", curve.x}, {"y", curve.y}});
  }
  return {{"title", plot.title},        {"x_label", plot.x_label}, {"y_label", plot.y_label},
          {"log_x", plot.log_x},        {"log_y", plot.log_y},     {"caption", plot.caption},
          {"curves", std::move(curves)}};
}

}  // namespace

Json to_json(const StoredFigure& figure) {
  Json json{{"format", kFormat},
            {"id", figure.id},
            {"commit", figure.commit},
            {"made", figure.made},
            {"seconds", figure.seconds},
            {"key", to_json(figure.key)},
            {"failure", figure.failure},
            {"claims", Json::array()},
            {"numbers", Json::array()},
            {"plots", Json::array()},
            {"tables", Json::array()},
            {"pictures", Json::array()},
            {"notes", figure.result.notes},
            {"rows_of", figure.result.rows_of}};
  for (const Claim& claim : figure.result.claims) {
    json["claims"].push_back({{"source", name_of(claim.source)},
                              {"claim", claim.claim},
                              {"measured", claim.measured},
                              {"verdict", name_of(claim.verdict)}});
  }
  for (const Number& number : figure.result.numbers) {
    json["numbers"].push_back(
        {{"key", number.key}, {"value", number.value}, {"unit", number.unit}});
  }
  for (const Plot& plot : figure.result.plots) json["plots"].push_back(to_json(plot));
  for (const Picture& picture : figure.result.pictures) {
    json["pictures"].push_back({{"kind", name_of(picture.kind)},
                                {"title", picture.title},
                                {"caption", picture.caption},
                                {"data", Json::parse(picture.data)}});
  }
  for (const Table& table : figure.result.tables) {
    json["tables"].push_back(
        {{"title", table.title}, {"columns", table.columns}, {"rows", table.rows}});
  }
  return json;
}

namespace {

// The readers throw nlohmann's exceptions, which load_figure catches.

double number_of(const Json& json) {
  return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>();
}

std::vector<double> numbers_of(const Json& json) {
  std::vector<double> numbers;
  for (const Json& number : json) numbers.push_back(number_of(number));
  return numbers;
}

Key key_from(const Json& json) {
  return {json.at("program"), json.at("form"),      json.at("data"),      json.at("gpu"),
          json.at("peers"),   json.at("processor"), json.at("num_cores"), json.at("isa")};
}

Plot plot_from(const Json& json) {
  Plot plot{json.at("title"), json.at("x_label"), json.at("y_label"), {},
            json.at("log_x"), json.at("log_y"),   json.at("caption")};
  for (const Json& curve : json.at("curves")) {
    plot.curves.push_back({curve.at("label"), curve.at("style"), numbers_of(curve.at("x")),
                           numbers_of(curve.at("y"))});
  }
  return plot;
}

/// Parses a figure; nullopt: an unknown verdict or kind of picture.
std::optional<StoredFigure> figure_from(const Json& json) {
  StoredFigure figure;
  figure.id = json.at("id");
  figure.key = key_from(json.at("key"));
  figure.commit = json.at("commit");
  figure.made = json.at("made");
  figure.seconds = number_of(json.at("seconds"));
  figure.failure = json.at("failure");
  for (const Json& claim : json.at("claims")) {
    const auto verdict = value_named<Verdict>(claim.at("verdict").get<std::string>());
    const auto source = value_named<Source>(claim.at("source").get<std::string>());
    if (!verdict || !source) return std::nullopt;
    figure.result.claims.push_back({claim.at("claim"), claim.at("measured"), *verdict, *source});
  }
  for (const Json& number : json.at("numbers")) {
    figure.result.numbers.push_back(
        {number.at("key"), number_of(number.at("value")), number.at("unit")});
  }
  for (const Json& plot : json.at("plots")) figure.result.plots.push_back(plot_from(plot));
  for (const Json& table : json.at("tables")) {
    figure.result.tables.push_back({table.at("title"), table.at("columns"), table.at("rows")});
  }
  for (const Json& picture : json.at("pictures")) {
    const auto kind = value_named<Picture::Kind>(picture.at("kind").get<std::string>());
    if (!kind) return std::nullopt;
    figure.result.pictures.push_back(
        {*kind, picture.at("title"), picture.at("data").dump(), picture.at("caption")});
  }
  figure.result.notes = json.at("notes");
  figure.result.rows_of = json.value("rows_of", "");
  return figure;
}

std::string quoted(const std::string& text) {
  std::string cell = "\"";
  for (const char c : text) cell += c == '"' ? std::string("\"\"") : std::string(1, c);
  return cell + '"';
}

std::string to_csv(const std::vector<std::vector<std::string>>& rows) {
  std::string csv;
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) csv += (i > 0 ? "," : "") + quoted(row[i]);
    csv += '\n';
  }
  return csv;
}

std::string decimal(double value) { return std::isfinite(value) ? Json(value).dump() : ""; }

/// Formats each point of each curve as a line; the header has the labels of the axes.
std::string to_csv(const Plot& plot) {
  std::string csv = "curve," + quoted(plot.x_label) + ',' + quoted(plot.y_label) + '\n';
  for (const Curve& curve : plot.curves) {
    for (std::size_t i = 0; i < std::min(curve.x.size(), curve.y.size()); ++i) {
      csv += quoted(curve.label) + ',' + decimal(curve.x[i]) + ',' + decimal(curve.y[i]) + '\n';
    }
  }
  return csv;
}

/// Returns the files beside the JSON: name and content.
std::vector<std::pair<std::string, std::string>> csv_files(const StoredFigure& figure) {
  const FigureResult& result = figure.result;
  const std::string stem = file_stem(figure.id);
  std::vector<std::pair<std::string, std::string>> files;
  for (std::size_t i = 0; i < result.plots.size(); ++i) {
    files.emplace_back(stem + "-plot" + std::to_string(i + 1) + ".csv", to_csv(result.plots[i]));
  }
  for (std::size_t i = 0; i < result.tables.size(); ++i) {
    std::vector<std::vector<std::string>> rows{result.tables[i].columns};
    rows.insert(rows.end(), result.tables[i].rows.begin(), result.tables[i].rows.end());
    files.emplace_back(stem + "-table" + std::to_string(i + 1) + ".csv", to_csv(rows));
  }
  if (!result.numbers.empty()) {
    std::string csv = "key,value,unit\n";
    for (const Number& number : result.numbers) {
      csv += quoted(number.key) + ',' + decimal(number.value) + ',' + quoted(number.unit) + '\n';
    }
    files.emplace_back(stem + "-numbers.csv", std::move(csv));
  }
  return files;
}

/// Removes CSV files that an earlier result with more plots and tables has left.
void remove_older_csv(const std::string& stem, const fs::path& folder) {
  std::error_code ignored;
  for (const char* kind : {"-plot", "-table"}) {
    for (int i = 1; fs::remove(folder / (stem + kind + std::to_string(i) + ".csv"), ignored); ++i) {
    }
  }
  fs::remove(folder / (stem + "-numbers.csv"), ignored);
}

}  // namespace

std::string file_stem(const std::string& id) {
  std::string stem = id;
  for (char& c : stem) {
    const bool is_plain = (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') ||
                          (c >= 'A' && c <= 'Z') || c == '.' || c == '-';
    if (!is_plain) c = '_';
  }
  return stem;
}

Status save_figure(const StoredFigure& figure, const fs::path& folder) {
  const std::string stem = file_stem(figure.id);
  std::error_code error;
  fs::create_directories(folder, error);
  // A partly replaced figure must not look complete.
  fs::remove(folder / (stem + ".json"), error);
  remove_older_csv(stem, folder);
  for (const auto& [name, content] : csv_files(figure)) {
    if (Status status = write_file_atomically(folder / name, content); !status) return status;
  }
  const std::string text =
      to_json(figure).dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
  return write_file_atomically(folder / (stem + ".json"), text);
}

Result<StoredFigure> load_figure(const std::string& id, const fs::path& folder) {
  constexpr std::size_t kLargest = std::size_t(64) << 20;
  const fs::path path = folder / (file_stem(id) + ".json");
  const auto text = read_file(path, kLargest);
  if (!text) return text.error();
  const Error unusable{Errc::bad_input, path.string() + " is not a whole figure " + id +
                                            ": it is made again unless you put it back"};
  try {
    const Json json = Json::parse(*text);
    if (json.at("format") != kFormat || json.at("id") != id) return unusable;
    auto figure = figure_from(json);
    if (!figure) return unusable;
    return *std::move(figure);
  } catch (const Json::exception&) {
    return unusable;
  }
}

}  // namespace palpate::eval
