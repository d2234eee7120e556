#include "apps/touch/objects.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <string_view>
#include <utility>

#include "apps/options.h"
#include "apps/terminal/terminal.h"
#include "palpate/io/files.h"

namespace palpate::apps {
namespace {

constexpr const char* kForm =
    "TOOL.palp@'tx ty tz qx qy qz qw'[,frame=NAME][,friction=MU][,static_ratio=R][,viscous=V]";
constexpr const char* kFormMoving =
    "TOOL.palp@'tx ty tz qx qy qz qw'[,frame=NAME][,friction=MU][,static_ratio=R][,viscous=V]"
    "[,moving[,mass=KG]]";

double parse_number(const std::string& object, const char* what, std::string_view text, double low,
                    double high) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() ||
      !(value >= low && value <= high)) {
    usage_error("--object " + object + ": " + what + ", not '" + std::string(text) + "'");
  }
  return value;
}

/// Parses "friction=0.3", "static_ratio=1.2", "viscous=0.1", "mass=0.5" or "moving".
void parse_property(std::string_view text, bool can_move, ObjectOption& object) {
  constexpr std::string_view kFriction = "friction=", kMass = "mass=", kFrame = "frame=";
  constexpr std::string_view kStaticRatio = "static_ratio=", kViscous = "viscous=";
  if (text.starts_with(kFriction)) {
    object.friction = parse_number(object.file, "friction must be a number from 0 to 10",
                                   text.substr(kFriction.size()), 0, 10);
  } else if (text.starts_with(kStaticRatio)) {
    object.static_ratio = parse_number(object.file, "static_ratio must be a number from 1 to 10",
                                       text.substr(kStaticRatio.size()), 1, 10);
  } else if (text.starts_with(kViscous)) {
    object.viscous = parse_number(object.file, "viscous must be a number from 0 to 100 (s/m)",
                                  text.substr(kViscous.size()), 0, 100);
  } else if (text.starts_with(kFrame) && text.size() > kFrame.size()) {
    object.frame = text.substr(kFrame.size());
  } else if (can_move && text.starts_with(kMass)) {
    object.mass = parse_number(object.file, "mass must be a number from 1e-4 to 1000 (kg)",
                               text.substr(kMass.size()), 1e-4, 1000);
  } else if (can_move && text == "moving") {
    object.moves = true;
  } else {
    usage_error(
        "--object " + object.file +
        ": what follows the pose must be frame=NAME, friction=MU, static_ratio=R, viscous=V" +
        (can_move ? ", mass=KG or moving" : "") + ", not '" + std::string(text) + "'");
  }
}

/// The pose follows the last @, so that file names may have some too.
ObjectOption parse_object(const std::string& text, bool can_move) {
  const std::size_t at = text.rfind('@');
  if (at == std::string::npos || at == 0) {
    usage_error("--object: must be " + std::string(can_move ? kFormMoving : kForm) + ", not '" +
                text + "'");
  }
  ObjectOption object;
  object.file = text.substr(0, at);
  std::string_view rest = std::string_view(text).substr(at + 1);
  // A pose has no letters but those of exponents: properties begin at the first comma before one.
  std::size_t comma = rest.find(',');
  while (comma != std::string_view::npos && comma + 1 < rest.size() &&
         (rest[comma + 1] < 'a' || rest[comma + 1] > 'z')) {
    comma = rest.find(',', comma + 1);
  }
  std::string_view properties = comma == std::string_view::npos ? "" : rest.substr(comma + 1);
  const auto pose = parse_pose(rest.substr(0, comma));
  if (!pose) usage_error("--object " + object.file + ": " + pose.error().message);
  object.X_WB = *pose;
  std::set<std::string_view> given;
  while (!properties.empty()) {
    const std::size_t end = properties.find(',');
    const std::string_view name = properties.substr(0, std::min(end, properties.find('=')));
    if (!given.insert(name).second) {
      usage_error("--object " + object.file + ": give " + std::string(name) + " once");
    }
    parse_property(properties.substr(0, end), can_move, object);
    properties = end == std::string_view::npos ? "" : properties.substr(end + 1);
  }
  if (object.mass > 0 && !object.moves) {
    usage_error("--object " + object.file + ": only what moves has a mass; add ,moving");
  }
  return object;
}

/// Gives each object a name of its own: block, block_2, block_3, ...
class ObjectNames {
 public:
  std::string take(const std::string& file) {
    constexpr std::size_t kLongest = 60;
    std::string stem = std::filesystem::path(file).stem().string().substr(0, kLongest);
    for (char& letter : stem) {
      if (std::isalnum(static_cast<unsigned char>(letter)) == 0) letter = '_';
    }
    int& number = last_numbers_[stem];
    std::string name;
    do {
      ++number;
      name = number == 1 ? stem : stem + "_" + std::to_string(number);
    } while (!taken_.insert(name).second);
    return name;
  }

 private:
  std::set<std::string> taken_;
  std::map<std::string, int> last_numbers_;  // by stem
};

}  // namespace

void add_object_option(CLI::App& app, std::vector<ObjectOption>& objects, bool can_move) {
  const std::string moving =
      can_move ? "; with moving it falls and is pushed, with a mass in kg (without: that of wood)"
               : "";
  app.add_option_function<std::vector<std::string>>(
         "--object",
         [&objects, can_move](const std::vector<std::string>& texts) {
           for (const std::string& text : texts) objects.push_back(parse_object(text, can_move));
         },
         "rigid CAD object in the scene, with its pose in the world, or with frame=NAME "
         "in a frame of the rig; repeat for several; friction=MU, static_ratio=R, viscous=V: its "
         "own friction" +
             moving)
      ->allow_extra_args(false)
      ->type_name(can_move ? kFormMoving : kForm);
}

Result<std::vector<SceneObject>> load_objects(const std::vector<ObjectOption>& options) {
  std::map<std::string, std::shared_ptr<const Tool>> shapes;
  std::vector<SceneObject> objects;
  ObjectNames names;
  for (const ObjectOption& option : options) {
    std::shared_ptr<const Tool>& shape = shapes[option.file];
    if (shape == nullptr) {
      auto tool = load_tool(option.file);
      if (!tool) return tool.error();
      if (tool->solid_field() == nullptr) {
        print_note(option.file +
                   " has no distance field; it is computed now. Pack the mesh again to store it");
        tool = std::move(*tool).with_solid_field();
      }
      shape = std::make_shared<const Tool>(*std::move(tool));
    }
    objects.push_back({shape, option.X_WB, option.friction, option.moves, option.mass,
                       names.take(option.file), option.static_ratio, option.viscous});
  }
  return objects;
}

}  // namespace palpate::apps
