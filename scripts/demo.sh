#!/usr/bin/env bash
# The main job, from a generated tool to a report: a stylus feels a simulated hand, and blocks that
# fall on it, two cameras see a ball, and, where the developers' data are present, a bottle feels a recorded desk. Everything
# is written under demo/.
#
# usage: scripts/demo.sh [--build JOBS]    with --build what is missing is installed and built first
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf '\n== %d s: %s\n' "$SECONDS" "$*"; }

if [ "${1:-}" = --build ]; then
  say "Installing what is missing"
  scripts/setup.sh --program
  say "Configuring: the program alone, without tests and evaluation"
  cmake --preset release -DPALPATE_TESTS=OFF -DPALPATE_EVAL=OFF
  say "Compiling"
  cmake --build --preset release -j "${2:-$(nproc)}" --target palpate
fi

palpate=build/release/bin/palpate
data=${PALPATE_DATA:-../shared/data}
if [ ! -x "$palpate" ]; then
  echo "demo: $palpate does not exist; run 'make demo' or 'make build' first" >&2
  exit 1
fi
mkdir -p demo

say "A stylus, filled with spheres"
"$palpate" shape stylus --size 0.12 -o demo/stylus.stl
"$palpate" pack demo/stylus.stl -o demo/stylus.palp

reports=()
# Makes a run, and notes its report for the list at the end. usage: feel FOLDER TOOL [OPTION ...]
feel() {
  "$palpate" touch "${@:2}" -o "$1"
  reports+=("$1/report.html")
}

say "The stylus feels a hand in front of a simulated depth camera"
feel demo/hand demo/stylus.palp --scene hand

say "Blocks fall on the hand and on the wall behind it, which gravity makes a table, and the stylus pushes them"
"$palpate" shape box --size 0.03 -o demo/block.stl
"$palpate" pack demo/block.stl --spheres 1000 -o demo/block.palp
blocks=(--set bodies.gravity_y=0 --set bodies.gravity_z=9.81)
for place in '0.01 0 0.5' '-0.15 0.05 1.05' '-0.15 0.05 1.0' '0.15 -0.05 1.05'; do
  blocks+=(--object "demo/block.palp@$place 0 0 0 1,moving")
done
feel demo/blocks demo/stylus.palp --scene hand "${blocks[@]}"
echo "To look at them: $palpate view demo/blocks"

say "The stylus touches a ball at its side, which one camera sees and the other does not"
printf '0 0.68 0 1.5 0 0.7071 0 0.7071\n2 0.598 0 1.5 0 0.7071 0 0.7071\n' >demo/beside.tum
feel demo/two-cameras demo/stylus.palp --path demo/beside.tum \
  --camera scene:sphere-out-320 --camera 'scene:sphere-out-320?pose=1.4,0,1,0,-0.574,0,0.819'
echo "To look at it, with both cameras: $palpate view demo/two-cameras"

recording=$data/sequences/visp_rbt/depth
bottle=$data/meshes_good/fuze_bottle.obj
if [ -d "$recording" ] && [ -f "$bottle" ]; then
  say "A bottle is set down on a desk that a real camera recorded, and pushed along it"
  "$palpate" pack "$bottle" -o demo/fuze_bottle.palp
  printf '0 0.0325 0.0501 0.3262 0.7536 0.0725 0 0.6533\n1.5 0.029 0.0855 0.3315 0.7536 0.0725 0 0.6533\n2.5 0.049 0.0874 0.3315 0.7536 0.0725 0 0.6533\n' \
    >demo/set_down.tum
  feel demo/visp_rbt demo/fuze_bottle.palp --path demo/set_down.tum --depth-sequence "$recording" \
    --intrinsics 607.178,607.234,321.391,241.918
else
  say "Skipped: a real recording (no data in '$data'; set PALPATE_DATA to their folder)"
fi

say "Reports, to open in a browser:"
for report in "${reports[@]}"; do
  [ -s "$report" ] || { echo "demo: $report was not written" >&2; exit 1; }
  echo "  $PWD/$report"
done

say "Your turn: hold a pen yourself, with a mouse, a finger or a gamepad, in the page that this opens:"
echo "  $palpate try"
