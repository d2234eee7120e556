// True in a build with sanitizers, which take memory and threads of their own.
#pragma once

namespace palpate::test {

inline constexpr bool kIsSanitized =
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // GCC
    true;
#elif defined(__has_feature)  // Clang
    __has_feature(address_sanitizer) || __has_feature(thread_sanitizer);
#else
    false;
#endif

}  // namespace palpate::test
