// The arc tangent of WASI's library is another one than glibc's, in the last bit. In 113 bits and
// rounded, it is the nearest number to the true one, as glibc's is but for one in many thousands;
// so cuts at edges have the bits of golden.txt.
#include <cmath>

extern "C" double atan2(double y, double x) { return static_cast<double>(atan2l(y, x)); }
