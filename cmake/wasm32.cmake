# WebAssembly with vector instructions, by Debian's Clang with its C++ library for WASI (make web-core). Of WASI, what is
# built needs a clock and a place for messages. Exceptions are off: that library has none.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR wasm32)
set(CMAKE_C_COMPILER clang-16)
set(CMAKE_CXX_COMPILER clang++-16)
set(CMAKE_C_COMPILER_TARGET wasm32-wasi)
set(CMAKE_CXX_COMPILER_TARGET wasm32-wasi)
set(CMAKE_AR llvm-ar-16 CACHE FILEPATH "")
set(CMAKE_RANLIB llvm-ranlib-16 CACHE FILEPATH "")
# Headers of WASI alone: those of this computer would come after them.
set(headers "-nostdlibinc -isystem /usr/lib/llvm-16/include/wasm32-wasi/c++/v1 -isystem /usr/include/wasm32-wasi")
set(CMAKE_CXX_FLAGS_INIT "${headers} -msimd128 -mbulk-memory -mnontrapping-fptoint -fno-exceptions -ffunction-sections -fdata-sections")
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_SYSROOT /usr)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
