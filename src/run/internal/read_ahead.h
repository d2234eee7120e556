// Depth frames that are read before they are due.
#pragma once

#include <memory>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

/// The same frames, read by a thread of its own up to `num_ahead` frames before they are requested:
/// one that takes long to be made, by a simulated camera or from a compressed file, is there when
/// it is due as long as frames on average take no longer than they are apart. Not for sensors,
/// whose frames would get old. Its end waits for the frame that is being read, unless the source
/// can be cancelled. Memory: `num_ahead`
/// + 1 frames. Error: the system starts no thread.
Result<std::unique_ptr<DepthSource>> read_ahead(std::unique_ptr<DepthSource> source,
                                                int num_ahead = 8);

}}  // namespace palpate::v0
