// Being on time: what a thread asks of the scheduler and of the memory.
#pragma once

#include <string>

namespace palpate {

/// SCHED_FIFO for the calling thread, unless a driver has given it a real-time class already. 0 or
/// the error number. No allocation.
int ask_for_real_time(int priority) noexcept;

/// Keeps all memory of the program that exists now from being paged out. 0 or the error number.
int lock_memory() noexcept;
void unlock_memory() noexcept;

/// One sentence for people: what was refused, and what to do.
std::string scheduler_refused(const char* which_thread, int error_number);
std::string memory_lock_refused(int error_number);

}  // namespace palpate
