// Times of the stages of a loop, for pages.
#pragma once

#include <nlohmann/json.hpp>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// `stages` of the protocol.
nlohmann::ordered_json stages_json(const LoopTimes& times);
nlohmann::ordered_json stage_json(const char* name, const LatencyHistogram& times);

}}  // namespace palpate::v0
