// A cache of the last used depth frames of a recording.
#pragma once

#include <list>
#include <map>
#include <memory>

#include "src/viewer/sources/recorded_run.h"

namespace palpate { inline namespace v0 {

class FrameCache {
 public:
  explicit FrameCache(RecordedRun& run);

  /// Error: the frame cannot be read.
  Result<std::shared_ptr<const RecordedFrame>> get(std::size_t index);

 private:
  RecordedRun& run_;
  std::size_t max_frames_;
  std::list<std::pair<std::size_t, std::shared_ptr<const RecordedFrame>>> frames_;
  std::map<std::size_t, Error> lost_;  // missing frames are looked for once
};

}}  // namespace palpate::v0
