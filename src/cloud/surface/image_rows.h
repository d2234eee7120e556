// A range of the rows of an image.
#pragma once

namespace palpate { inline namespace v0 {

/// Rows [begin, end).
struct ImageRows {
  int begin = 0, end = 0;
};

}}  // namespace palpate::v0
