// Checks for programmer errors. They stay on in every build type except Release.
#pragma once

#include <cstdio>
#include <cstdlib>

#if defined(NDEBUG)
#define PALPATE_ASSERT(condition) ((void)0)
#else
/// Aborts with file and line when `condition` is false. For mistakes of the caller, never for bad
/// input data: those get a `Result` with an `Error`.
#define PALPATE_ASSERT(condition)                                                                \
  ((condition)                                                                                   \
       ? (void)0                                                                                 \
       : (std::fprintf(stderr, "%s:%d: assertion failed: %s\n", __FILE__, __LINE__, #condition), \
          std::abort()))
#endif
