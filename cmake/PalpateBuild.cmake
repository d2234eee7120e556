# How every target of the project is built.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
if(PROJECT_IS_TOP_LEVEL)
  set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
  endif()
  find_program(PALPATE_CCACHE ccache)
  if(PALPATE_CCACHE)
    # It keeps what is compiled with precompiled headers only where it is told that times do not matter,
    # and finds it in another build folder (the Python package's) only where paths are relative.
    set(CMAKE_CXX_COMPILER_LAUNCHER
        env "CCACHE_BASEDIR=${PROJECT_SOURCE_DIR}" CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime "${PALPATE_CCACHE}")
  endif()
endif()

# Assertions stay on in every build type except Release (src/core/internal/assert.h).
string(REPLACE "-DNDEBUG" "" CMAKE_CXX_FLAGS_RELWITHDEBINFO "${CMAKE_CXX_FLAGS_RELWITHDEBINFO}")

# WebAssembly (make web-core): one thread, no files, no exceptions.
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "wasm32")
  set(PALPATE_WASM ON)
  set(CMAKE_POSITION_INDEPENDENT_CODE OFF)
  add_library(Threads::Threads INTERFACE IMPORTED GLOBAL)
else()
  find_package(Threads REQUIRED)
endif()

if(PALPATE_CUDA)
  if(NOT CMAKE_CUDA_ARCHITECTURES)
    set(CMAKE_CUDA_ARCHITECTURES 75 80 90)
  endif()
  enable_language(CUDA)
  find_package(CUDAToolkit REQUIRED)
  set(CMAKE_CUDA_STANDARD 20)
  set(CMAKE_CUDA_STANDARD_REQUIRED ON)
  if(NOT CMAKE_CUDA20_STANDARD_COMPILE_OPTION)
    # Some releases of CMake 3.25 do not know how to ask nvcc for C++20.
    set(CMAKE_CUDA20_STANDARD_COMPILE_OPTION -std=c++20)
    set(CMAKE_CUDA20_EXTENSION_COMPILE_OPTION -std=c++20)
  endif()
endif()

# How our own sources are compiled; nobody who links the library sees it. Warnings of GCC are errors. Square roots set no errno, so that they are one instruction. No fused multiply-add behind our back: scalar, wide and repeated runs must
# agree bit for bit. Baseline x86-64-v2; wider code is chosen at run time.
add_library(palpate_flags INTERFACE)
target_include_directories(palpate_flags INTERFACE "${PROJECT_SOURCE_DIR}/include"
                                                   "${PROJECT_SOURCE_DIR}")
if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang" OR PALPATE_SANITIZE)
  # Clang fuzzes, and knows other warnings; GCC warns of what sanitizers add.
  set(palpate_warnings -w)
else()
  set(palpate_warnings -Wall;-Wextra;-Wpedantic;-Wshadow;-Werror)
endif()
target_compile_options(
  palpate_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:${palpate_warnings};-ffp-contract=off;-fno-math-errno>)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  # GCC 12 warns about "literal" + std::string where nothing is wrong (GCC bug 105651).
  target_compile_options(palpate_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Wno-restrict>)
endif()
target_compile_options(palpate_flags
                       INTERFACE $<$<COMPILE_LANGUAGE:CUDA>:--Werror=all-warnings;--fmad=false>)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(palpate_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-march=x86-64-v2>)
endif()
target_link_libraries(palpate_flags INTERFACE Threads::Threads)
if(PALPATE_CUDA OR PALPATE_EMULATE_CUDA)
  target_compile_definitions(palpate_flags INTERFACE PALPATE_CUDA)
endif()
if(PALPATE_EMULATE_CUDA)
  target_compile_definitions(palpate_flags INTERFACE PALPATE_EMULATE_CUDA)
  target_compile_options(palpate_flags INTERFACE -Wno-unknown-pragmas)
endif()
if(PALPATE_SANITIZE)
  target_compile_options(palpate_flags INTERFACE -fsanitize=${PALPATE_SANITIZE}
                                                 -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(palpate_flags INTERFACE -fsanitize=${PALPATE_SANITIZE})
  if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    # Libraries of device and camera makers are called by declarations of our own, whose types have other names.
    target_compile_options(palpate_flags INTERFACE -fno-sanitize=function
                           "-fsanitize-ignorelist=${PROJECT_SOURCE_DIR}/tests/foreign_undefined.txt")
  endif()
endif()

# palpate_module(NAME [COMPONENT core] SOURCES a.cpp ... DEPENDS other modules ... LIBRARIES private libraries ...)
# One static library per module, palpate_NAME, for our own programs and tests. Others link components
# (PalpateComponent.cmake), which are made of the same objects.
function(palpate_module name)
  cmake_parse_arguments(MODULE "" "COMPONENT" "SOURCES;DEPENDS;LIBRARIES" ${ARGN})
  if(NOT MODULE_COMPONENT)
    set(MODULE_COMPONENT core)
  endif()
  add_library(palpate_${name} STATIC ${MODULE_SOURCES})
  list(TRANSFORM MODULE_DEPENDS PREPEND palpate_)
  target_link_libraries(palpate_${name} PUBLIC palpate_flags ${MODULE_DEPENDS} PRIVATE ${MODULE_LIBRARIES})
  palpate_in_groups(palpate_${name})
  set_property(GLOBAL APPEND PROPERTY PALPATE_MODULES_${MODULE_COMPONENT} palpate_${name})
  set_property(GLOBAL APPEND PROPERTY PALPATE_ALL_MODULES palpate_${name})
  # A library that was found as a file is linked by its name: its place may differ where ours is
  # installed. Libraries of headers alone are in the objects already.
  foreach(library IN LISTS MODULE_LIBRARIES)
    set(type "")
    if(TARGET ${library})
      get_target_property(type ${library} TYPE)
    elseif(IS_ABSOLUTE "${library}")
      get_filename_component(library "${library}" NAME_WE)
      string(REGEX REPLACE "^lib" "" library "${library}")
    endif()
    if(NOT type STREQUAL INTERFACE_LIBRARY)
      set_property(GLOBAL APPEND PROPERTY PALPATE_LIBRARIES_${MODULE_COMPONENT} ${library})
    endif()
  endforeach()
endfunction()

# palpate_export_built(): writes what PALPATE_BUILT reads: the libraries and the program of this build folder.
function(palpate_export_built)
  get_property(modules GLOBAL PROPERTY PALPATE_ALL_MODULES)
  export(TARGETS palpate_flags palpate_io ${modules} palpate NAMESPACE built_ FILE "${PROJECT_BINARY_DIR}/palpate_built.cmake")
endfunction()

# palpate_together(a.cpp b.cpp ...): files of one target that the compiler takes as one, which halves the time
# that they take: headers are read and templates made once. Names in their anonymous namespaces must differ. A file
# that is in no group is compiled alone, and all are with PALPATE_TOGETHER=OFF, as the presets dev and tsan have it.
function(palpate_together first)
  set_source_files_properties(${ARGV} PROPERTIES UNITY_GROUP "${first}")
endfunction()

# palpate_in_groups(TARGET): the groups of palpate_together hold for this target.
function(palpate_in_groups target)
  set_target_properties(${target} PROPERTIES UNITY_BUILD ${PALPATE_TOGETHER} UNITY_BUILD_MODE GROUP)
endfunction()

# palpate_cache_apart(TARGET): what is compiled with a precompiled header of our own stays in this checkout's
# part of the compiler's cache: the header has the checkout's paths in it.
function(palpate_cache_apart target)
  if(CMAKE_CXX_COMPILER_LAUNCHER)
    set_target_properties(${target} PROPERTIES CXX_COMPILER_LAUNCHER
      "env;CCACHE_NAMESPACE=${PROJECT_SOURCE_DIR};${CMAKE_CXX_COMPILER_LAUNCHER}")
  endif()
endfunction()

# palpate_precompile(TARGET headers ...): what most files of a target include, compiled once: it saves half
# to two thirds of the time that they take. Palpate's own headers are named as in an include line.
function(palpate_precompile target)
  set(headers "")
  foreach(header IN LISTS ARGN)
    if(header MATCHES "^palpate/")
      set(header "${PROJECT_SOURCE_DIR}/include/${header}")
    elseif(header MATCHES "/.*[.]h$" AND NOT header MATCHES "^<")
      set(header "${PROJECT_SOURCE_DIR}/${header}")
    endif()
    list(APPEND headers "${header}")
  endforeach()
  target_precompile_headers(${target} PRIVATE ${headers})
  palpate_precompiled(${target})
endfunction()

# palpate_precompiled(TARGET [OTHER]): for a target with a precompiled header, its own or that of another target.
function(palpate_precompiled target)
  if(ARGN)
    target_precompile_headers(${target} REUSE_FROM ${ARGN})
  endif()
  palpate_cache_apart(${target})
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    # It warns about strings where nothing is wrong once their header is precompiled.
    target_compile_options(${target} PRIVATE -Wno-array-bounds -Wno-stringop-overflow -Wno-stringop-overread)
  endif()
endfunction()

# palpate_kernel(MODULE file.cpp) compiles one kernel text once per vector instruction set. The file
# uses the macro PALPATE_ISA_NAMESPACE for its namespace and PALPATE_LANES for the vector width. Such
# objects must hold no weak symbols: the linker could pick a copy of an inline function with wide
# instructions for everybody (tools/check_kernel_objects.sh). Three warnings are off: vectors in
# internal signatures (psabi), vectors as template arguments (ignored-attributes) and one that GCC's
# own AVX-512 header raises.
function(palpate_kernel module source)
  set(variants baseline)
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    list(APPEND variants avx2 avx512)
  endif()
  set(kernel_optimization -O3)
  if(PALPATE_SANITIZE)
    set(kernel_optimization "")  # as all else: with sanitizers they are slow in any case
  endif()
  set(flags_baseline "")
  set(flags_avx2 -mavx2 -mfma -mbmi -mbmi2 -mlzcnt)
  set(flags_avx512 ${flags_avx2} -mavx512f -mavx512dq -mavx512bw -mavx512vl -mprefer-vector-width=512)
  set(lanes_baseline 4)
  set(lanes_avx2 8)
  set(lanes_avx512 16)
  get_filename_component(stem "${source}" NAME_WE)
  foreach(variant IN LISTS variants)
    set(copy "${CMAKE_CURRENT_BINARY_DIR}/${stem}_${variant}.cpp")
    file(CONFIGURE OUTPUT "${copy}" CONTENT
         "#include \"${CMAKE_CURRENT_SOURCE_DIR}/${source}\"\n" @ONLY)
    target_sources(palpate_${module} PRIVATE "${copy}")
    set_source_files_properties(
      "${copy}" PROPERTIES
      OBJECT_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/${source}"
      COMPILE_OPTIONS "${kernel_optimization};-Wno-psabi;-Wno-ignored-attributes;-Wno-maybe-uninitialized;-Wno-uninitialized;${flags_${variant}}"
      COMPILE_DEFINITIONS "PALPATE_ISA_NAMESPACE=isa_${variant};PALPATE_LANES=${lanes_${variant}}")
  endforeach()
endfunction()

# palpate_device_code(MODULE a.cu ...) adds files with kernels to a module: compiled by nvcc in a build
# with CUDA. In one without, the tests get them compiled for the emulator (src/gpu/internal/emulator.h), as
# the library palpate_emulated.
function(palpate_device_code module)
  if(PALPATE_CUDA)
    target_sources(palpate_${module} PRIVATE ${ARGN})
    return()
  endif()
  foreach(source IN LISTS ARGN)
    get_filename_component(stem "${source}" NAME_WE)
    set(copy "${CMAKE_CURRENT_BINARY_DIR}/${stem}_emulated.cpp")
    file(CONFIGURE OUTPUT "${copy}" CONTENT
         "#include \"${CMAKE_CURRENT_SOURCE_DIR}/${source}\"\n" @ONLY)
    if(PALPATE_EMULATE_CUDA)
      target_sources(palpate_${module} PRIVATE "${copy}")
    elseif(TARGET palpate_emulated)  # a module that comes after the library's core
      target_sources(palpate_emulated PRIVATE "${copy}")
    else()
      set_property(GLOBAL APPEND PROPERTY PALPATE_EMULATED_SOURCES "${copy}")
      set_property(GLOBAL APPEND PROPERTY PALPATE_EMULATED_MODULES palpate_${module})
    endif()
  endforeach()
endfunction()

# palpate_device_test(NAME SOURCES ... LIBRARIES ...): a test of the CUDA backend: on a GPU in a build
# with CUDA, else by the emulator.
function(palpate_device_test name)
  cmake_parse_arguments(TEST "" "" "SOURCES;LIBRARIES" ${ARGN})
  if(PALPATE_CUDA)
    palpate_test(${name} SOURCES ${TEST_SOURCES} LIBRARIES ${TEST_LIBRARIES})
    return()
  endif()
  if(NOT PALPATE_EMULATE_CUDA AND NOT TARGET palpate_emulated)
    message(STATUS "${name} is left out: it needs Boost.Context or a GPU")
    return()
  endif()
  set(sources "")
  foreach(source IN LISTS TEST_SOURCES)
    if(source MATCHES "[.]cu$")
      get_filename_component(stem "${source}" NAME_WE)
      set(copy "${CMAKE_CURRENT_BINARY_DIR}/${stem}_emulated.cpp")
      file(CONFIGURE OUTPUT "${copy}" CONTENT
           "#include \"${CMAKE_CURRENT_SOURCE_DIR}/${source}\"\n" @ONLY)
      set(source "${copy}")
    endif()
    list(APPEND sources "${source}")
  endforeach()
  if(NOT PALPATE_EMULATE_CUDA)
    list(APPEND TEST_LIBRARIES palpate_emulated)
  endif()
  palpate_test(${name} SOURCES ${sources} LIBRARIES ${TEST_LIBRARIES})
endfunction()

# Tests share three slots for every core (scripts/test.sh): one that computes takes three, one that runs by the clock two,
# one that mostly waits one. So beside a test by the clock there is one that computes and one that waits, and no core is idle.
# The label clock is for what waits for something (make busy-test).
set(PALPATE_TEST_COMPUTES PROCESSORS 3)
set(PALPATE_TEST_BY_CLOCK PROCESSORS 2 RESOURCE_LOCK clock LABELS clock COST 100)

# palpate_test(NAME [LIVE] [THREADED] [LONG] SOURCES a.cpp ... [APART b.cpp ...] LIBRARIES ...): one GoogleTest program, found by
# CTest. SOURCES are compiled together, as palpate_together does; APART are those whose names are others' names, too.
# LIVE tests run by the clock of the computer: one of them at a time. They and THREADED ones are the target
# threaded_tests and have the label threads: what the thread sanitizer looks at (make tsan). LONG ones have the label
# long and are left to make long-test. Time-outs are for what hangs, on a machine that is busy with other things.
function(palpate_test name)
  cmake_parse_arguments(TEST "LIVE;THREADED;LONG" "" "SOURCES;APART;LIBRARIES" ${ARGN})
  set(properties TIMEOUT 1800 ${PALPATE_TEST_COMPUTES})
  if(TEST_LIVE)
    set(properties TIMEOUT 1800 ${PALPATE_TEST_BY_CLOCK})
  endif()
  if(TEST_LIVE OR TEST_THREADED)
    list(APPEND properties LABELS threads)
    set_property(GLOBAL APPEND PROPERTY PALPATE_THREADED_TESTS ${name})
  endif()
  if(TEST_LONG)
    list(APPEND properties LABELS long)
  endif()
  add_executable(${name} ${TEST_SOURCES} ${TEST_APART})
  set_target_properties(${name} PROPERTIES UNITY_BUILD ${PALPATE_TOGETHER} UNITY_BUILD_BATCH_SIZE 6)
  set_source_files_properties(${TEST_APART} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  target_link_libraries(${name} PRIVATE palpate_flags palpate_test_util ${TEST_LIBRARIES}
                                        GTest::gtest GTest::gtest_main)
  palpate_precompiled(${name} palpate_test_headers)
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 300 PROPERTIES ${properties})
endfunction()

# palpate_test_in_parts(NAME PARTS COMMAND ...): a test in Python that mostly waits, as NAME_1 to NAME_PARTS, side by side
# (tests/test_util/parts.py).
function(palpate_test_in_parts name parts)
  foreach(part RANGE 1 ${parts})
    add_test(NAME ${name}_${part} ${ARGN})
    set_tests_properties(${name}_${part} PROPERTIES TIMEOUT 1800 COST 50 LABELS clock ENVIRONMENT "PALPATE_PART=${part}/${parts}")
  endforeach()
endfunction()
