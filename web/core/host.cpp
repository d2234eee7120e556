// Calls of the core to the page around it: to say that its memory is used up, and to show the
// progress of a packing.
#include <cstdlib>
#include <new>

#include "palpate/c/palpate.h"

#define PALPATE_IMPORT(name) __attribute__((import_module("palpate"), import_name(name)))

extern "C" {

PALPATE_IMPORT("out_of_memory") void palpate_page_out_of_memory(void);
PALPATE_IMPORT("progress") int palpate_page_progress(int num_spheres, double fill);

static int tell_progress(void*, int32_t num_spheres, double fill) {
  return palpate_page_progress(num_spheres, fill);
}
/// Returns the progress function to give to palpate_tool_pack.
palpate_progress palpate_page_progress_function(void) { return tell_progress; }
}

namespace {

/// Nothing can be thrown here, so the module stops, and JavaScript says why.
struct NewHandler {
  NewHandler() {
    std::set_new_handler([] {
      palpate_page_out_of_memory();
      std::abort();
    });
  }
} new_handler;

}  // namespace
