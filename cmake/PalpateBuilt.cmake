# The libraries and the program of another build folder, PALPATE_BUILT, by the names that they have there: the Python
# module is then all that is compiled (the tests make the wheel so).
foreach(package ZLIB PNG nlohmann_json Boost)
  find_package(${package} REQUIRED)
endforeach()
include("${PALPATE_BUILT}/palpate_built.cmake")
get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
foreach(target IN LISTS targets)
  get_target_property(type ${target} TYPE)
  string(REGEX REPLACE "^built_" "" name "${target}")
  if(NOT TARGET ${name} AND NOT type STREQUAL EXECUTABLE)
    add_library(${name} ALIAS ${target})
  endif()
endforeach()
add_custom_target(palpate)  # the program is there
