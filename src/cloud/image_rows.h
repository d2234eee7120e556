// A range of the rows of an image.
#pragma once

namespace palpate::inline v0 {

/// Rows [begin, end).
struct ImageRows {
  int begin = 0, end = 0;
};

}  // namespace palpate::inline v0
