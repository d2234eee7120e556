// What a report says about a path that nobody gave.
#pragma once

#include <string>

#include "palpate/cloud/depth_source.h"
#include "palpate/session/probe_choice.h"

namespace palpate {

/// "It probes pixel ..., ... It leads with ...", for people.
std::string probe_words(const ProbeChoice& probe);
/// A section of a page: these words, how to aim, and, unless `frame` has no pixels, the depth image
/// with the place in it.
std::string probe_html(const ProbeChoice& probe, const DepthFrame& frame);

}  // namespace palpate
