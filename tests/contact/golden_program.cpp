// Prints the names and hashes of golden.txt as this machine computes them: for machines without
// GoogleTest, as WebAssembly.
#include "tests/contact/golden_cases.h"

int main() {
  for (const palpate::golden::Case& c : palpate::golden::cases())
    std::printf("%s %s\n", c.name.c_str(), palpate::golden::run(c).hash.c_str());
}
