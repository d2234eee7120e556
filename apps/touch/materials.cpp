#include "apps/touch/materials.h"

#include <charconv>
#include <set>
#include <string_view>
#include <utility>

#include "apps/options.h"
#include "palpate/io/formats.h"

namespace palpate::apps {
namespace {

constexpr const char* kForm =
    "LABEL=NAME[,friction=MU][,static_ratio=R][,viscous=V][,ridges=S]"
    "[,grain=S]";

/// Typical values for a tool of hard plastic, not measured.
constexpr std::pair<std::string_view, Material> kKnown[] = {
    {"ice", {.friction = 0.05}},
    {"metal", {.friction = 0.2}},
    {"glass", {.friction = 0.25}},
    {"plastic", {.friction = 0.3}},
    {"paper", {.friction = 0.3, .grain = 0.2}},
    {"wood", {.friction = 0.35, .static_ratio = 1.1, .grain = 0.3}},
    {"cloth", {.friction = 0.5, .ridges = 0.3, .grain = 0.2}},
    {"rubber", {.friction = 0.9, .static_ratio = 1.2}},
};

std::string known_names() {
  std::string names;
  for (const auto& [name, material] : kKnown) {
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  return names;
}

[[noreturn]] void refuse(const std::string& text, const std::string& what) {
  usage_error("--material " + text + ": " + what + "; the form is " + kForm);
}

double parse_number(const std::string& whole, std::string_view name, std::string_view text,
                    double low, double high) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() ||
      !(value >= low && value <= high)) {
    char range[60];
    std::snprintf(range, sizeof range, " must be a number from %g to %g", low, high);
    refuse(whole, std::string(name) + range + ", not '" + std::string(text) + "'");
  }
  return value;
}

/// Parses "ice", or "friction=0.3".
void parse_property(const std::string& whole, std::string_view text, Material& material,
                    std::set<std::string_view>& given) {
  const std::string_view property = text.substr(0, text.find('='));
  const bool is_name = property.size() == text.size();
  if (!given.insert(is_name ? "" : property).second) {
    refuse(whole, is_name ? "give one name" : "give " + std::string(property) + " once");
  }
  for (const auto& [name, known] : kKnown) {
    if (text == name) material = known;
    if (text == name) return;
  }
  const struct {
    std::string_view name;
    double& value;
    double low, high;
  } properties[] = {{"friction", material.friction, 0, 10},
                    {"static_ratio", material.static_ratio, 1, 10},
                    {"viscous", material.viscous, 0, 100},
                    {"ridges", material.ridges, 0, 1},
                    {"grain", material.grain, 0, 1}};
  const std::size_t equals = text.find('=');
  for (const auto& [name, value, low, high] : properties) {
    if (equals == std::string_view::npos || text.substr(0, equals) != name) continue;
    value = parse_number(whole, name, text.substr(equals + 1), low, high);
    return;
  }
  refuse(whole, "'" + std::string(text) + "' is none of " + known_names() +
                    ", nor friction=, static_ratio=, viscous=, ridges= or grain=");
}

void parse_material(const std::string& text, MaterialOptions& options) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) refuse(text, "a label and what it is made of are wanted");
  std::string_view rest = std::string_view(text).substr(equals + 1);
  const double label = parse_number(text, "the label", text.substr(0, equals), 0, 255);
  const auto index = static_cast<std::size_t>(label);
  if (static_cast<double>(index) != label) refuse(text, "a label is a whole number");
  Material material;
  std::set<std::string_view> given;
  do {
    const std::size_t end = rest.find(',');
    parse_property(text, rest.substr(0, end), material, given);
    rest = end == std::string_view::npos ? "" : rest.substr(end + 1);
  } while (!rest.empty());
  if (material.friction == 0 &&
      (material.static_ratio != 1 || material.ridges > 0 || material.grain > 0)) {
    refuse(text, "static_ratio, ridges and grain need friction; add friction=0.3");
  }
  if (options.materials.size() <= index) options.materials.resize(index + 1);
  if (options.materials[index]) refuse(text, "this label has a material already");
  options.materials[index] = material;
}

}  // namespace

void add_material_options(CLI::App& app, MaterialOptions& options) {
  const std::string group = "Materials by region of the image";
  app.add_option("--labels", options.labels,
                 "label image, 8 bits per pixel, size of the depth image; with several cameras "
                 "one each, in their order")
      ->allow_extra_args(false)
      ->type_name("FILE.png")
      ->group(group);
  app.add_option_function<std::vector<std::string>>(
         "--material",
         [&options](const std::vector<std::string>& texts) {
           for (const std::string& text : texts) parse_material(text, options);
         },
         "what a label is made of: " + known_names() +
             ", or numbers, or both; labels without are as --friction and --texture say")
      ->allow_extra_args(false)
      ->type_name(kForm)
      ->group(group);
}

void check_materials(const MaterialOptions& options) {
  if (!options.labels.empty() && options.materials.empty()) {
    usage_error("--labels: no label has a material; add --material 1=wood");
  }
  if (options.labels.empty() && !options.materials.empty()) {
    usage_error("--material: there is no label image; add --labels FILE.png");
  }
}

Result<std::vector<std::shared_ptr<const MaterialRegions>>> load_regions(
    const MaterialOptions& options) {
  if (options.labels.size() > kMaxCameras) {
    return Error{Errc::invalid_argument,
                 "--labels is given " + std::to_string(options.labels.size()) +
                     " times; there are at most " + std::to_string(kMaxCameras) + " cameras"};
  }
  std::vector<std::shared_ptr<const MaterialRegions>> regions;
  for (const std::string& file : options.labels) {
    auto image = load_label_png(file);
    if (!image) return image.error();
    regions.push_back(std::make_shared<const MaterialRegions>(
        MaterialRegions{image->width, image->height, std::move(image->labels), options.materials}));
  }
  return regions;
}

}  // namespace palpate::apps
