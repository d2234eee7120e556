// Vendors' libraries inside of Python packages, where they are most often.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace palpate { inline namespace v0 {

/// Files named `stem`* in the folder `package` of every place where pip puts packages: of the
/// active virtual environment, of the user, of the machine. Longest version first.
std::vector<std::string> files_of_python_package(const std::string& package, std::string_view stem);

/// "libpython3.11.so.1.0" for ".../X.cpython-311-x86_64-linux-gnu.so"; empty if it is none such.
std::string python_library_of(std::string_view module);

}}  // namespace palpate::v0
