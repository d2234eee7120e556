// The setup of a run as JSON in its recording, apart from what the message of the settings has as
// fields of its own: device, revision and time origin.
#pragma once

#include <string>

#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 {

/// Writes the text.
std::string setup_json(const RunSetup& setup);

/// Reads such a text. Errors: it is none, or that of another version of the format. Objects come
/// without their shapes, regions without their labels.
Result<RunSetup> setup_from_json(const std::string& json);

}}  // namespace palpate::v0
