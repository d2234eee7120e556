#include "apps/objects.h"

#include <map>
#include <memory>
#include <string_view>
#include <utility>

#include "apps/options.h"
#include "palpate/io/tool_file.h"
#include "palpate/io/trajectory_file.h"

namespace palpate::apps {
namespace {

/// The pose follows the last @, so that file names may have some too.
ObjectOption parse_object(const std::string& text) {
  const std::size_t at = text.rfind('@');
  if (at == std::string::npos || at == 0) {
    usage_error("--object: must be TOOL.palp@'tx ty tz qx qy qz qw', not '" + text + "'");
  }
  const auto pose = parse_pose(std::string_view(text).substr(at + 1));
  if (!pose) usage_error("--object " + text.substr(0, at) + ": " + pose.error().message);
  return {text.substr(0, at), *pose};
}

}  // namespace

void add_object_option(CLI::App& app, std::vector<ObjectOption>& objects) {
  app.add_option_function<std::vector<std::string>>(
         "--object",
         [&objects](const std::vector<std::string>& texts) {
           for (const std::string& text : texts) objects.push_back(parse_object(text));
         },
         "a rigid object to feel beside the depth images, where it stays in the camera frame; may "
         "be given several times")
      ->allow_extra_args(false)
      ->type_name("TOOL.palp@'tx ty tz qx qy qz qw'");
}

Result<std::vector<SceneObject>> load_objects(const std::vector<ObjectOption>& options) {
  std::map<std::string, std::shared_ptr<const Tool>> shapes;
  std::vector<SceneObject> objects;
  for (const ObjectOption& option : options) {
    std::shared_ptr<const Tool>& shape = shapes[option.file];
    if (shape == nullptr) {
      auto tool = load_tool(option.file);
      if (!tool) return tool.error();
      shape = std::make_shared<const Tool>(*std::move(tool));
    }
    objects.push_back({shape, option.X_WB});
  }
  return objects;
}

}  // namespace palpate::apps
