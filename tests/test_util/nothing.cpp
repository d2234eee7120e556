// A program for the sake of the headers that are compiled with it (tests/CMakeLists.txt).
int main() {}
