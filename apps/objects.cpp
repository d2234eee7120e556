#include "apps/objects.h"

#include <charconv>
#include <iostream>
#include <map>
#include <memory>
#include <string_view>
#include <utility>

#include "apps/options.h"
#include "palpate/io/tool_file.h"
#include "palpate/io/trajectory_file.h"

namespace palpate::apps {
namespace {

constexpr std::string_view kFriction = ",friction=";

double parse_friction(const std::string& object, std::string_view text) {
  double friction = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), friction);
  if (error != std::errc{} || end != text.data() + text.size() ||
      !(friction >= 0 && friction <= 10)) {
    usage_error("--object " + object + ": friction must be a number from 0 to 10, not '" +
                std::string(text) + "'");
  }
  return friction;
}

/// The pose follows the last @, so that file names may have some too.
ObjectOption parse_object(const std::string& text) {
  const std::size_t at = text.rfind('@');
  if (at == std::string::npos || at == 0) {
    usage_error("--object: must be TOOL.palp@'tx ty tz qx qy qz qw'[,friction=MU], not '" + text +
                "'");
  }
  const std::string name = text.substr(0, at);
  std::string_view rest = std::string_view(text).substr(at + 1);
  ObjectOption object{name, {}, {}};
  if (const std::size_t comma = rest.find(kFriction); comma != std::string_view::npos) {
    object.friction = parse_friction(name, rest.substr(comma + kFriction.size()));
    rest = rest.substr(0, comma);
  }
  const auto pose = parse_pose(rest);
  if (!pose) usage_error("--object " + name + ": " + pose.error().message);
  object.X_WB = *pose;
  return object;
}

}  // namespace

void add_object_option(CLI::App& app, std::vector<ObjectOption>& objects) {
  app.add_option_function<std::vector<std::string>>(
         "--object",
         [&objects](const std::vector<std::string>& texts) {
           for (const std::string& text : texts) objects.push_back(parse_object(text));
         },
         "a rigid object to feel beside the depth images, where it stays in the camera frame; may "
         "be given several times; with friction=MU it has its own")
      ->allow_extra_args(false)
      ->type_name("TOOL.palp@'tx ty tz qx qy qz qw'[,friction=MU]");
}

Result<std::vector<SceneObject>> load_objects(const std::vector<ObjectOption>& options) {
  std::map<std::string, std::shared_ptr<const Tool>> shapes;
  std::vector<SceneObject> objects;
  for (const ObjectOption& option : options) {
    std::shared_ptr<const Tool>& shape = shapes[option.file];
    if (shape == nullptr) {
      auto tool = load_tool(option.file);
      if (!tool) return tool.error();
      if (tool->solid_field() == nullptr) {
        std::cerr << "palpate: note: " << option.file
                  << " holds no distance field, one is made now; pack the mesh again to keep it\n";
        tool = std::move(*tool).with_solid_field();
      }
      shape = std::make_shared<const Tool>(*std::move(tool));
    }
    objects.push_back({shape, option.X_WB, option.friction});
  }
  return objects;
}

}  // namespace palpate::apps
