// Vendors' libraries as the tests fake them.
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>

namespace palpate::test {

/// The control block of a fake library, by the name of the function that gives it.
template <class Fake>
Fake& fake_control(const std::string& path, const char* function) {
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  void* symbol = library == nullptr ? nullptr : dlsym(library, function);
  if (symbol == nullptr) {
    ADD_FAILURE() << path << ": " << dlerror();
    std::abort();
  }
  return *reinterpret_cast<Fake* (*)()>(symbol)();
}

/// Waits until `is_so`; false after far longer than it can take.
template <class Condition>
bool eventually(Condition is_so) {
  for (int i = 0; i < 20000; ++i) {
    if (is_so()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace palpate::test
