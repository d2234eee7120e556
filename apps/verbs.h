// The verbs of the command line. Each file verb_*.cpp adds one: it declares its options, and, once
// the command line is parsed, puts the work to do into `action`.
#pragma once

#include <functional>

#include "palpate/core/core.h"

namespace CLI {
class App;
}

namespace palpate::apps {

/// Returns the text of THIRD_PARTY.md.
const char* license_notices();

/// The work of a verb. An Error means exit status 1; wrong usage is found before, while parsing.
using Action = std::function<Status()>;

void add_help(CLI::App& program, Action& action);
void add_try(CLI::App& program, Action& action);
void add_shape(CLI::App& program, Action& action);
void add_pack(CLI::App& program, Action& action);
void add_info(CLI::App& program, Action& action);
void add_export(CLI::App& program, Action& action);
void add_query(CLI::App& program, Action& action);
void add_touch(CLI::App& program, Action& action);
void add_replay(CLI::App& program, Action& action);
void add_report(CLI::App& program, Action& action);
void add_view(CLI::App& program, Action& action);
void add_scenes(CLI::App& program, Action& action);
void add_ros2(CLI::App& program, Action& action);
void add_record(CLI::App& program, Action& action);
void add_calibrate(CLI::App& program, Action& action);
void add_cameras(CLI::App& program, Action& action);
void add_devices(CLI::App& program, Action& action);
void add_eval(CLI::App& program, Action& action);

}  // namespace palpate::apps
