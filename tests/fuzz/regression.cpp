// A fuzz target without a fuzzer: its seeds, the inputs that once broke it, and some thousand
// mutations of them, the same on every run. Watches how much memory an input takes.
//
// usage: fuzz_NAME_regression CORPUS_FOLDER [NUM_MUTATIONS]
#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstring>
#include <fstream>
#include <iterator>
#include <new>

#include "tests/fuzz/target.h"
#include "tests/test_util/random.h"

namespace {

using palpate::test::Random;

/// An input of n bytes may take this much memory: the constant is two of the largest depth images,
/// each as counts, PNG rows and cloud.
constexpr std::size_t kMaxBytes = std::size_t(256) << 20, kMaxBytesPerByte = 2000;

std::atomic<std::size_t> g_bytes = 0, g_peak = 0;

void* allocate(std::size_t size) {
  void* const memory = std::malloc(std::max<std::size_t>(size, 1));
  if (memory == nullptr) throw std::bad_alloc();
  const std::size_t now = g_bytes += malloc_usable_size(memory);
  for (std::size_t peak = g_peak; now > peak && !g_peak.compare_exchange_weak(peak, now);) {
  }
  return memory;
}

void release(void* memory) noexcept {
  if (memory != nullptr) g_bytes -= malloc_usable_size(memory);
  std::free(memory);
}

std::size_t below(Random& random, std::size_t n) {
  return n == 0 ? 0 : static_cast<std::size_t>(random.bits() % n);
}

/// Numbers that programs stumble over, as bytes and as text.
std::string odd_number(Random& random) {
  static const char* const kTexts[] = {
      "-1",   "0",      "1e308",      "nan", "4294967296",
      "-0.0", "1e-320", "2147483648", "inf", "99999999999999999999"};
  if (below(random, 2) == 0) return kTexts[below(random, std::size(kTexts))];
  static const std::uint64_t kBits[] = {0,
                                        0xffffffffffffffff,
                                        0x7fffffff,
                                        0x80000000,
                                        0x7fffffffffffffff,
                                        0x7ff0000000000000,
                                        1u << 30,
                                        0x10000};
  const std::uint64_t bits = kBits[below(random, std::size(kBits))];
  std::string bytes(sizeof bits, '\0');
  std::memcpy(bytes.data(), &bits, sizeof bits);
  return bytes.substr(0, std::size_t(1) << below(random, 4));
}

std::string mutated(const std::vector<std::string>& corpus, Random& random) {
  std::string text = corpus[below(random, corpus.size())];
  for (std::size_t i = below(random, 5) + 1; i > 0; --i) {
    const std::size_t at = below(random, text.size() + 1);
    switch (below(random, 9)) {
      case 0:
        if (at < text.size()) text[at] = static_cast<char>(random.bits());
        break;
      case 1:
        if (at < text.size()) text[at] = static_cast<char>(text[at] ^ (1 << below(random, 8)));
        break;
      case 2: text.erase(at, below(random, 20) + 1); break;
      case 3:
        text.insert(at, text.substr(below(random, text.size()), below(random, 60) + 1));
        break;
      case 4: text.resize(at); break;
      case 5: text.insert(at, odd_number(random)); break;
      case 6: {
        const std::string number = odd_number(random);
        text.replace(at, std::min(number.size(), text.size() - at), number);
        break;
      }
      case 7: {
        const std::string& other = corpus[below(random, corpus.size())];
        text = text.substr(0, at) + other.substr(below(random, other.size() + 1));
        break;
      }
      default: text.insert(at, 1, "{}[]()\",:;#/\\ \n\0-+.e0"[below(random, 22)]); break;
    }
  }
  return text;
}

/// Input that is running, for the file that is written if it does not return.
const std::string* g_input = nullptr;

void run(const std::string& input) {
  g_input = &input;
  const std::size_t before = g_peak = g_bytes.load();
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(input.data()), input.size());
  const std::size_t taken = g_peak - before;
  if (taken <= kMaxBytes + kMaxBytesPerByte * input.size()) return;
  std::fprintf(stderr, "fuzz: an input of %zu bytes took %zu bytes of memory\n", input.size(),
               taken);
  std::abort();
}

/// Keeps the input that brought the program down, for the corpus.
void on_fault(int signal) {
  if (g_input != nullptr) {
    std::ofstream("fuzz-crash", std::ios::binary) << *g_input;
    std::fprintf(stderr, "fuzz: the input is in ./fuzz-crash\n");
  }
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

}  // namespace

void* operator new(std::size_t size) { return allocate(size); }
void* operator new[](std::size_t size) { return allocate(size); }
void operator delete(void* memory) noexcept { release(memory); }
void operator delete[](void* memory) noexcept { release(memory); }
void operator delete(void* memory, std::size_t) noexcept { release(memory); }
void operator delete[](void* memory, std::size_t) noexcept { release(memory); }

int main(int argc, char** argv) {
  for (const int signal : {SIGABRT, SIGSEGV, SIGFPE, SIGBUS}) std::signal(signal, on_fault);
  std::vector<std::string> corpus = palpate::fuzz::seeds();
  const std::size_t num_seeds = corpus.size();
  if (argc > 1 && std::filesystem::is_directory(argv[1])) {
    std::vector<std::filesystem::path> paths;
    for (const auto& entry : std::filesystem::directory_iterator(argv[1])) {
      paths.push_back(entry.path());
    }
    std::sort(paths.begin(), paths.end());
    for (const auto& path : paths) {
      std::ifstream file(path, std::ios::binary);
      corpus.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
    }
  }
  for (const std::string& input : corpus) run(input);
  const int num_mutations = argc > 2 ? std::atoi(argv[2]) : 2000;
  Random random(20);
  for (int i = 0; i < num_mutations; ++i) run(mutated(corpus, random));
  std::printf("%zu seeds, %zu inputs of the corpus, %d mutations\n", num_seeds,
              corpus.size() - num_seeds, num_mutations);
}
