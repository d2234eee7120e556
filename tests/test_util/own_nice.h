// The nice value of a thread, as Linux says it.
#pragma once

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace palpate::test {

/// Returns the nice value of the calling thread.
inline int own_nice() { return getpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid))); }

}  // namespace palpate::test
