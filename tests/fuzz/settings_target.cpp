// Settings files, and settings as a page sends them.
#include "palpate/run/run_loop.h"
#include "palpate/session/run.h"
#include "src/session/internal/settings_json.h"
#include "src/viewer/protocol/command.h"
#include "src/viewer/protocol/controls.h"
#include "src/viewer/protocol/messages.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {
namespace {

void read_toml(std::string_view text) {
  static ScratchFile file(".toml"), again(".again.toml");
  auto settings = load_settings<RunSettings>(file.write(text));
  if (!settings) {
    require(settings.error().message.size() > 10, "an error has a message");
    return;
  }
  const std::string written = settings_toml(settings_of(*settings));
  auto back = load_settings<RunSettings>(again.write(written));
  require(back.has_value(), "settings that were written can be read");
  require(settings_toml(settings_of(*back)) == written, "settings come back with the same text");
}

void take_command(std::string_view text) {
  const ViewRequest request = parse_request(text);
  (void)error_text(request.id, request.error.empty() ? text : request.error);
  const auto command = ViewCommand::parse(text);
  if (!command) return;
  (void)command->number("time", 0, 1e9);
  const auto key = command->text("key", 100);
  if (!key) return;
  RunSettings settings;
  const std::string before = settings_toml(settings_of(settings));
  const auto value = set_control(settings_of(settings), is_live_control, *key, (*command)["value"]);
  if (!value) {
    require(settings_toml(settings_of(settings)) == before, "what is refused changes nothing");
  }
}

}  // namespace

std::vector<std::string> seeds() {
  RunSettings settings;
  return {settings_toml(settings_of(settings)),
          "[contact]\nmethod = \"graph\"\ninside = \"cap\"\n[coupling]\nstiffness = 800\n",
          "[coupling]\nbase_in_scene = [0, 0, 0.5, 1, 0, 0, 0]\n[safety]\nmax_tick = 0.1\n",
          R"({"command":"set","id":1,"key":"contact.method","value":"graph"})",
          R"({"command":"set","id":2,"key":"coupling.stiffness","value":800.5})",
          R"({"command":"set","key":"coupling.tool_in_hand","value":[0,0,0.1,0,0,0,1]})",
          R"({"command":"seek","time":0.5,"id":3})",
          R"({"ack":7})"};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::fuzz;
  const std::string_view text = text_of(data, size);
  take_command(text);
  read_toml(text);
  return 0;
}
