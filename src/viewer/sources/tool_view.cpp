#include <utility>

#include "palpate/viewer/viewer.h"
#include "src/viewer/protocol/command.h"

namespace palpate { inline namespace v0 {
namespace {

/// Shows a tool alone: nothing moves, and there are no controls.
class ToolView final : public ViewSource {
 public:
  ToolView(const Tool& tool, std::string title) : content_{"tool", std::move(title), &tool} {}

  const ViewContent& content() const override { return content_; }
  ViewUpdate poll(const ViewSubscription&) override { return {}; }
  std::string state() override {
    return R"({"time": 0, "running": false, "fault": null, "note": null, "paused": false, )"
           R"("revision": 0, "settings": {}, "frame_number": 0})";
  }
  std::string controls() override { return "[]"; }
  Result<std::string> command(std::string_view json) override {
    const auto command = ViewCommand::parse(json);
    if (!command) return command.error();
    return command->unknown("show and get");
  }

 private:
  ViewContent content_;
};

}  // namespace

std::unique_ptr<ViewSource> view_tool(const Tool& tool, std::string title) {
  return std::make_unique<ToolView>(tool, std::move(title));
}

}}  // namespace palpate::v0
