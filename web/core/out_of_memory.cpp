// What happens when the memory of a page is used up: nothing can be thrown here, so the module stops, and JavaScript says why.
#include <cstdlib>
#include <new>

extern "C" __attribute__((import_module("palpate"), import_name("out_of_memory"))) void palpate_tell_out_of_memory();

namespace {

struct Handler {
  Handler() {
    std::set_new_handler([] {
      palpate_tell_out_of_memory();
      std::abort();
    });
  }
} handler;

}  // namespace
