// Feeds every reader with large inputs, each in a process of its own, and says how long it took and
// how much memory: no more than 10 s of computing for 100 MB, and 256 MiB + 2000 n for n bytes.
//
// usage: large_inputs [--megabytes 100] [--only TEXT] [--csv FILE] [--timeless]
//   --only      inputs whose name contains this
//   --timeless  not the time, but that it grows no faster than the input: for tests
#include "tests/fuzz/large_inputs.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>

#include "palpate/cameras/cameras.h"
#include "tests/test_util/sanitized.h"

namespace palpate::fuzz {

namespace fs = std::filesystem;

void write_pieces(const fs::path& path, std::size_t num_bytes, const std::string& head,
                  const std::function<std::string(std::size_t)>& each, const std::string& tail) {
  std::ofstream file(path, std::ios::binary);
  file << head;
  std::size_t num = head.size() + tail.size();
  for (std::size_t i = 0; num < num_bytes; ++i) {
    const std::string piece = each(i);
    file << piece;
    num += piece.size();
  }
  file << tail;
}

std::string file_bytes(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

Status read_camera(const std::string& uri) {
  const auto camera = open_camera(uri, {.in_real_time = false});
  if (!camera) return camera.error();
  DepthFrame frame;
  for (;;) {
    const auto got = (*camera)->next(frame);
    if (!got) return got.error();
    if (!*got) return Done{};
  }
}

namespace {

constexpr double kMinMegabytes = 10;  // least size whose time is reported
constexpr double kMaxMegabytes = 256 * 1.048576, kMaxPerByte = 2000;
constexpr int kTaken = 0, kRefused = 1;
std::size_t size_on_disk(const fs::path& path) {
  if (!fs::is_directory(path)) return fs::file_size(path);
  std::size_t size = 0;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) size += entry.file_size();
  }
  return size;
}

struct Outcome {
  int status = 0;
  double seconds = 0, megabytes = 0;  // of computing; of memory at most
};

/// Limits time and memory, so that a broken reader ends only its own process.
void limit_this_process() {
  constexpr rlim_t kMaxTime = 60;  // s
  const rlimit time{kMaxTime, kMaxTime}, memory{rlim_t{8} << 30, rlim_t{8} << 30};
  ::setrlimit(RLIMIT_CPU, &time);
  if (!test::kIsSanitized) ::setrlimit(RLIMIT_AS, &memory);
}

/// Runs `task` in a process of its own; its value is the exit status.
template <class Task>
Outcome alone(const Task& task) {
  std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    limit_this_process();
    const int status = task();
    std::fflush(nullptr);
    ::_exit(status);
  }
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status),
          seconds(usage.ru_utime) + seconds(usage.ru_stime),
          static_cast<double>(usage.ru_maxrss) * 1024e-6};
}

struct Options {
  double megabytes = 100;
  std::string only, csv;
  bool is_timeless = false;
};

struct Reading {
  Outcome outcome;
  double size = 0;  // of the input, MB
};

/// Makes an input of that many bytes, or as many as its format takes, and reads it.
Reading read_alone(const LargeInput& input, double num_bytes) {
  const fs::path folder =
      fs::temp_directory_path() / ("palpate-large-" + std::to_string(::getpid()));
  const fs::path path = folder / ("input" + input.extension);
  fs::create_directories(folder);
  alone([&] {
    input.make(path, static_cast<std::size_t>(num_bytes));
    return 0;
  });
  const double size = 1e-6 * static_cast<double>(size_on_disk(path));
  const double before = alone([] { return 0; }).megabytes;
  Outcome outcome = alone([&] {
    const Status status = input.read(path);
    if (!status) std::printf("    %.200s\n", status.error().message.c_str());
    return status ? kTaken : kRefused;
  });
  outcome.megabytes -= before;
  fs::remove_all(folder);
  return {outcome, size};
}

/// True if half of the input takes less than a third of the time, if it takes long at all. Holds on
/// a busy computer, too.
bool grows_faster_than_input(const LargeInput& input, double num_bytes, double seconds) {
  constexpr double kLong = 2;  // s
  return seconds > kLong && read_alone(input, num_bytes / 2).outcome.seconds < seconds / 3;
}

/// Measures reading of an input; returns the complaint, empty if none.
std::string measure(const LargeInput& input, const Options& options, std::FILE* csv) {
  const double num_bytes = 1e6 * options.megabytes;
  const auto [outcome, size] = read_alone(input, num_bytes);
  const double per_100 = outcome.seconds * 100 / size;
  std::printf("%-12s %-42s %8.1f MB %8.2f s %8.2f s/100 MB %8.0f MB  %s\n", input.reader.c_str(),
              input.what.c_str(), size, outcome.seconds, per_100, outcome.megabytes,
              outcome.status == kTaken     ? "taken"
              : outcome.status == kRefused ? "refused"
                                           : "BROKEN");
  if (csv != nullptr) {
    std::fprintf(csv, "%s,\"%s\",%.1f,%.2f,%.2f,%.0f,%s\n", input.reader.c_str(),
                 input.what.c_str(), size, outcome.seconds, per_100, outcome.megabytes,
                 outcome.status == kTaken ? "taken" : "refused");
  }
  if (outcome.status != kTaken && outcome.status != kRefused) return "ends the program";
  const bool is_taken = outcome.status == kTaken;
  if (input.is_taken.value_or(is_taken) != is_taken) return is_taken ? "is taken" : "is refused";
  if (!test::kIsSanitized && outcome.megabytes > kMaxMegabytes + kMaxPerByte * size)
    return "takes too much memory";
  if (!options.is_timeless &&
      outcome.seconds > 0.01 * input.max_seconds * std::max(size, kMinMegabytes)) {
    return "takes too long";
  }
  if (grows_faster_than_input(input, num_bytes, outcome.seconds)) {
    return "takes three times as long as half of it";
  }
  return "";
}

int run(const Options& options) {
  std::FILE* const csv = options.csv.empty() ? nullptr : std::fopen(options.csv.c_str(), "w");
  if (csv != nullptr)
    std::fprintf(csv, "reader,input,megabytes,seconds,seconds_per_100_mb,memory_mb,answer\n");
  int num = 0, num_bad = 0;
  for (const auto& list :
       {large_meshes(), large_images(), large_texts(), large_recordings(), large_streams()}) {
    for (const LargeInput& input : list) {
      const std::string name = input.reader + ": " + input.what;
      if (name.find(options.only) == std::string::npos) continue;
      const std::string fault = measure(input, options, csv);
      ++num;
      if (fault.empty()) continue;
      ++num_bad;
      std::printf("large_inputs: %s %s\n", name.c_str(), fault.c_str());
    }
  }
  if (csv != nullptr) std::fclose(csv);
  std::printf("%d inputs, %d of them not as they must be\n", num, num_bad);
  return num_bad > 0 || num == 0 ? 1 : 0;
}

}  // namespace
}  // namespace palpate::fuzz

int main(int argc, char** argv) {
  palpate::fuzz::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] { return i + 1 < argc ? std::string(argv[++i]) : std::string(); };
    if (word == "--megabytes") {
      options.megabytes = std::atof(value().c_str());
    } else if (word == "--only") {
      options.only = value();
    } else if (word == "--csv") {
      options.csv = value();
    } else if (word == "--timeless") {
      options.is_timeless = true;
    } else {
      std::fprintf(stderr, "large_inputs: unknown option %s\n", word.c_str());
      return 2;
    }
  }
  return palpate::fuzz::run(options);
}
