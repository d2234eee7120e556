#include <cmath>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "palpate/viewer/viewer.h"
#include "src/session/internal/run_folder.h"
#include "src/viewer/protocol/command.h"
#include "src/viewer/protocol/view_contact.h"
#include "src/viewer/sources/run_player.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kMaxSteps = 100000, kLongest = 1e9;

class RunView final : public ViewSource {
 public:
  RunView(std::unique_ptr<RecordedRun> run, std::string title)
      : player_(std::move(run)),
        content_{"recording",
                 std::move(title),
                 &player_.tool(),
                 player_.streams(),
                 {},
                 shapes_of(player_.objects())} {}

  const ViewContent& content() const override { return content_; }
  ViewUpdate poll(const ViewSubscription& subscription) override {
    return player_.poll(subscription);
  }
  std::string state() override;
  std::string controls() override {
    return list_controls(settings_of(player_.shown().settings), is_recorded_control).dump();
  }
  Result<std::string> command(std::string_view json) override;

 private:
  Result<std::string> set(const ViewCommand& command);
  std::string marks() const;

  RunPlayer player_;
  const ViewContent content_;
};

std::string RunView::state() {
  const PlayerState shown = player_.shown();
  Json note;
  if (!shown.note.empty()) {
    note = shown.note;
  } else if (shown.is_paused && shown.time >= shown.duration) {
    note = "the recording has ended: Play (Space) begins it again";
  }
  const Json state{{"time", shown.time},
                   {"running", !shown.is_paused},
                   {"fault", nullptr},
                   {"note", note},
                   {"paused", shown.is_paused},
                   {"revision", shown.revision},
                   {"settings", control_values(settings_of(shown.settings), is_recorded_control)},
                   {"frame_number", shown.frame_number},
                   {"duration", shown.duration},
                   {"speed", shown.speed},
                   {"num_marks", shown.num_marks}};
  return state.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string RunView::marks() const {
  Json marks = Json::array();
  for (const RecordedMark& mark : player_.marks()) {
    marks.push_back({{"time", mark.time}, {"text", mark.text}});
  }
  return Json{{"marks", std::move(marks)}}.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<std::string> RunView::set(const ViewCommand& command) {
  const auto key = command.text("key", 100);
  if (!key) return key.error();
  const auto value = player_.set(*key, command["value"]);
  if (!value) return value.error();
  return Json{{"value", *value}}.dump();
}

Result<std::string> RunView::command(std::string_view json) {
  const auto command = ViewCommand::parse(json);
  if (!command) return command.error();
  const std::string& name = command->name();
  if (name == "set") return set(*command);
  if (name == "marks") return marks();
  if (name == "pause") {
    player_.pause();
  } else if (name == "resume") {
    player_.resume();
  } else if (name == "step") {
    const auto num = command->number("frames", -kMaxSteps, kMaxSteps, 1);
    if (!num) return num.error();
    player_.step(static_cast<int>(std::lround(*num)));
  } else if (name == "seek") {
    const auto time = command->number("time", 0, kLongest);
    if (!time) return time.error();
    player_.seek(*time);
  } else if (name == "speed") {
    const auto factor = command->number("factor", ViewClock::kSlowest, ViewClock::kFastest);
    if (!factor) return factor.error();
    player_.set_speed(*factor);
  } else {
    return command->unknown("show, get, set, pause, resume, step, seek, speed and marks");
  }
  return std::string("{}");
}

}  // namespace

Result<std::unique_ptr<ViewSource>> view_run(const std::filesystem::path& folder) {
  std::error_code error;
  const bool is_there = !recording_parts(folder, &error).empty();
  if (error && error != std::errc::no_such_file_or_directory &&
      error != std::errc::not_a_directory) {
    return Error{Errc::io_failure, "cannot look into " + folder.string() + ": " + error.message() +
                                       "; check its name and permissions"};
  }
  if (!is_there) {
    return Error{Errc::not_found, "no recording in " + folder.string() +
                                      ": give the folder of a run that palpate touch wrote"};
  }
  auto run = open_recorded_run(folder);
  if (!run) return run.error();
  const auto name = std::filesystem::absolute(folder).lexically_normal();
  const auto title = name.has_filename() ? name.filename() : name.parent_path().filename();
  try {
    return std::unique_ptr<ViewSource>(std::make_unique<RunView>(*std::move(run), title.string()));
  } catch (const std::system_error& problem) {
    return Error{Errc::unavailable, "cannot start the thread that plays " + folder.string() + ": " +
                                        problem.what() + "; end other programs and try again"};
  }
}

}}  // namespace palpate::v0
