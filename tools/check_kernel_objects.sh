#!/usr/bin/env bash
# Kernel texts are compiled with wide instructions. If such an object held a weak symbol (an inline
# function that was not inlined), the linker could use it everywhere and the program would die on an
# older processor. usage: tools/check_kernel_objects.sh BUILD_DIR
set -euo pipefail
build=${1:?usage: tools/check_kernel_objects.sh BUILD_DIR}
if [ "$(uname -m)" != x86_64 ]; then
  echo "kernel objects: only one instruction set on $(uname -m), nothing to check"
  exit 0
fi
status=0
found=0
while IFS= read -r object; do
  found=$((found + 1))
  weak=$(nm -C "$object" | grep -E ' [WVu] ' || true)
  if [ -n "$weak" ]; then
    echo "$object has weak symbols; make these functions inline for good (static or always_inline):"
    echo "$weak"
    status=1
  fi
done < <(find "$build/src" -name '*_kernel_avx*.o')
[ "$found" -gt 0 ] || { echo "no kernel objects under $build: build first"; exit 1; }
[ "$status" -eq 0 ] && echo "kernel objects: $found checked, no weak symbols"
exit "$status"
