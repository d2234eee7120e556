# Every command of the project by name. `make` alone lists them.
.DEFAULT_GOAL := help
SHELL := /bin/bash
JOBS ?= $(shell nproc)

# One preset of CMakePresets.json = one folder under build/. Further options for CMake follow the preset.
define build_preset
cmake --preset $(1) $(2)
cmake --build --preset $(1) -j $(JOBS)
endef

.PHONY: help setup lint format tidy build demo test long-test quick-test busy-test golden clang fuzz mutants bench bench-compare live-figures camera-figures ros2-figures sensor-figures soak pictures simulator-pictures docs packing-curves peer-times eval eval-quick eval-check asan tsan large-inputs peers-of-files cuda gpu-check view-soak arm64 wheel web-core packages try-packages try-demo try-test ci-all compile-times clean

help:  ## this list
	@grep -hE '^[a-z0-9 -]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9 -]+):.*## */\1\t/' | expand -t 16

setup:  ## install missing packages (apt; root or sudo)
	scripts/setup.sh

build: setup  ## build the release into build/release
	$(call build_preset,release)

demo:  ## set up, build, and run the main job; results in demo/
	scripts/demo.sh --build $(JOBS)

test:  ## set up, lint, build, and run all tests but those of long-test
	scripts/setup.sh --test
	$(MAKE) lint
	$(call build_preset,release,-DPALPATE_EVAL=OFF)
	tools/check_kernel_objects.sh build/release
	scripts/test.sh release -LE long

long-test: setup  ## the evaluation with its tests, and tests of more than a minute of processor whose parts have their own (label long)
	scripts/setup.sh --test
	$(call build_preset,release)
	scripts/test.sh release -L long

quick-test:  ## only rebuild and test: make quick-test [MODULE=contact]
	cmake --preset release
	cmake --build --preset release -j $(JOBS) $(if $(MODULE),--target tests/$(MODULE)/all)
	scripts/test.sh release $(MODULE)

busy-test:  ## every test that waits for something, in random order beside stress-ng --cpu 2: make busy-test [ROUNDS=5]
	scripts/setup.sh --test
	$(call build_preset,release)
	scripts/busy_test.sh release $(or $(ROUNDS),5)

golden:  ## write tests/contact/golden.txt anew: the bits of a few fixed measurements; says what moved, here and on docs/evaluation.md
	cmake --preset release
	cmake --build --preset release -j $(JOBS) --target test_golden
	build/release/bin/test_golden --renew
	tools/check_evaluation.py --mark

bench:  ## run the benchmarks: make bench [PEERS=1]
	scripts/setup.sh $(if $(PEERS),--peers)
	$(call build_preset,$(if $(PEERS),peers,bench))
	@for program in build/$(if $(PEERS),peers,bench)/bin/bench_*; do echo "== $$program"; $$program || exit 1; done

bench-compare:  ## times of this tree over those of another commit, with scatter: make bench-compare BASE=main [FILTER=REGEX] [ROUNDS=7]
	@[ -n "$(BASE)" ] || { echo "make bench-compare: say with what: BASE=COMMIT"; exit 2; }
	scripts/setup.sh
	tools/bench_compare.py $(BASE) --jobs $(JOBS) $(if $(FILTER),--filter '$(FILTER)') $(if $(ROUNDS),--rounds $(ROUNDS)) $(if $(PROGRAM),--program $(PROGRAM))

live-figures: setup  ## the live program and how late everything is, into bench/results/live-MACHINE.csv: make live-figures [BACKEND=cuda]
	cmake --preset bench $(if $(filter cuda,$(BACKEND)),-DPALPATE_CUDA=ON)
	cmake --build --preset bench -j $(JOBS) --target palpate recorded_query
	bench/live_figures.py build/bench $(if $(DATA),--data $(DATA)) $(if $(BACKEND),--backend $(BACKEND))

camera-figures: setup  ## a camera through OpenNI2's own stack, cost and frames lost: make camera-figures [DURATION=600]
	scripts/setup.sh --test
	$(call build_preset,release) --target palpate fake_openni2_driver
	bench/camera_figures.py build/release --seconds $(or $(DURATION),600)

ros2-figures: setup  ## palpate ros2 beside a robot on Fast DDS, losses and lateness: make ros2-figures [DURATION=60]
	scripts/setup.sh --test
	$(call build_preset,release) --target palpate fastdds_peer
	bench/ros2_figures.py build/release --seconds $(or $(DURATION),60) --csv build/ros2-figures.csv
	bench/ros2_clouds.py build/release --seconds $(or $(DURATION),60) --csv build/ros2-clouds.csv

sensor-figures: setup  ## presets by kind of sensor on recorded frames: make sensor-figures DATA=FOLDER
	@[ -n "$(DATA)" ] || { echo "make sensor-figures: say where the recorded frames are: DATA=FOLDER"; exit 2; }
	cmake --preset bench
	cmake --build --preset bench -j $(JOBS) --target sensor_figures
	build/bench/bin/sensor_figures $(DATA)

pictures: wheel web-core  ## the pictures of README and guides, from their own runs, into docs/pictures (needs chromium, node, ffmpeg)
	scripts/setup.sh --test
	$(call build_preset,release) --target palpate palpate_component_palpate
	[ -x build/python-pictures/bin/python ] || python3 -m venv build/python-pictures
	build/python-pictures/bin/pip install -q build/wheels/palpate-*.whl matplotlib
	build/python-pictures/bin/pip install -q --force-reinstall --no-deps build/wheels/palpate-*.whl
	PATH="$(CURDIR)/build/node/bin:$$PATH" node web/make_pictures.mjs build/release/bin/palpate docs/pictures

simulator-pictures: wheel  ## the picture of docs/guide/simulators.md, into docs/pictures: MuJoCo, Newton, Drake, Isaac Teleop
	[ -x build/python-simulators/bin/python ] || python3 -m venv build/python-simulators
	build/python-simulators/bin/pip install -q matplotlib build/wheels/palpate-*.whl -r examples/simulators/requirements.txt
	cd examples/simulators && ../../build/python-simulators/bin/python pictures.py ../../docs/pictures/simulators.png

docs:  ## guides and the C++ reference as a site, into build/docs/site
	scripts/setup.sh --docs
	scripts/docs.sh

packing-curves:  ## the packing comparison page, into build/packing-curves
	scripts/setup.sh
	cmake --preset bench
	cmake --build --preset bench -j $(JOBS) --target packing_curves
	build/bench/bin/packing_curves build/packing-curves \
	  --commit "$$(git describe --always --dirty=+ --exclude '*' 2>/dev/null || echo unknown)"

# Real depth frames, and measurements of other machines and libraries that the report shows beside its own.
DATA ?= $(or $(PALPATE_DATA),$(wildcard ../shared/data))
GPU_REPORT ?= $(lastword $(sort $(wildcard bench/results/eval-gpu-*)))
# In the order in which they were measured, as far as git knows it: a figure takes the newest rows that have all it needs.
GPU_KNOWN = $(filter $(wildcard bench/results/gpu-*.csv),$(shell git log --reverse --format= --name-only --diff-filter=A -- bench/results 2>/dev/null))
GPU ?= $(GPU_KNOWN) $(filter-out $(GPU_KNOWN),$(wildcard bench/results/gpu-*.csv))
PEER_TIMES ?= $(shell ls build/peers/peers.csv 2>/dev/null || ls bench/results/peers-*.csv 2>/dev/null | tail -1)
define evaluate
cmake --preset release
cmake --build --preset release -j $(JOBS) --target eval_program
build/release/bin/palpate_eval $(FIGURE) -o build/$(1) $(if $(DATA),--data $(DATA)) $(if $(strip $(GPU)),--gpu $(GPU)) $(if $(GPU_REPORT),--gpu-report $(GPU_REPORT)) \
  $(if $(PEER_TIMES),--peers $(PEER_TIMES)) --golden "$$(tools/check_evaluation.py --hash)" \
  --commit "$$(git describe --always --dirty=+ --exclude '*' 2>/dev/null || echo unknown)"
endef

# Other libraries, measured once per build of the benchmark. What cannot be installed here is no error.
peer-times: setup
	@scripts/setup.sh --peers && cmake --preset peers && \
	cmake --build --preset peers -j $(JOBS) --target bench_peers && \
	{ [ build/peers/peers.csv -nt build/peers/bin/bench_peers ] || build/peers/bin/bench_peers --csv build/peers/peers.csv \
	  --commit "$$(git describe --always --dirty=+ --exclude '*' 2>/dev/null || echo unknown)"; } && \
	{ grep -q ^octree/ build/peers/peers.csv || ! [ -x build/python-peers/bin/python ] || \
	  build/python-peers/bin/python bench/coal_peer.py build/peers/peers.csv; } || \
	echo "make: other libraries cannot be measured here; going on without"

eval: setup $(if $(filter file,$(origin PEER_TIMES)),peer-times)  ## make all figures of the thesis again: make eval [FIGURE=5.1] [DATA=DIR]; at most 45 minutes
	$(call evaluate,eval) --write-docs docs README.md

eval-quick: setup  ## the same with fewer steps, in two minutes; leaves docs/ alone
	$(call evaluate,eval-quick) --quick

eval-check:  ## is docs/evaluation.md of today's arithmetic (golden.txt), with all its figures?
	tools/check_evaluation.py

lint:  ## all checks that need no build
	tools/lint.sh

format:  ## lay out the source text
	tools/check_format.sh --fix

# Files that are compiled together are looked at together: a third of the time. Kernels are looked at once.
tidy:  ## clang-tidy over library, scenes and program: make tidy [MODULE=contact]; slow
	scripts/setup.sh --tidy
	cmake --preset tidy
	run-clang-tidy-16 -quiet -j $(JOBS) -p build/tidy '^$(CURDIR)/(build/tidy/)?$(if $(MODULE),src/$(MODULE),(src|scenes|apps))/(?!.*_avx)'

clang:  ## the library and its tests built by Clang as users build it: golden.txt and all tests hold for its bits, too
	scripts/setup.sh --fuzz
	$(call build_preset,clang)
	tools/check_kernel_objects.sh build/clang
	scripts/test.sh clang

# In the build of the fuzz targets: the library is compiled once for both.
asan:  ## tests with the address and undefined behavior sanitizers; not evaluation, pages, guides, figures of ROS 2, fault plans, Python and packages
	scripts/setup.sh --fuzz
	$(call build_preset,fuzz)
	scripts/test.sh fuzz -E '^(page_|docs_|ros_interop)'

# GCC's thread sanitizer cannot live with much address space randomisation.
tsan: setup  ## the thread sanitizer: all tests with threads, and the live program with all that can happen for a minute
	cmake --preset tsan
	run=$$(setarch -R true 2>/dev/null && echo setarch -R); \
	  $$run cmake --build --preset tsan -j $(JOBS) --target palpate threaded_tests && \
	  PALPATE_LIVE_SECONDS=$(or $(LIVE_SECONDS),60) TSAN_OPTIONS="suppressions=$(CURDIR)/tests/foreign_races.txt history_size=4 die_after_fork=0" \
	  $$run scripts/test.sh tsan -L threads

fuzz:  ## feed every reader with damaged input: a minute a target, or make fuzz HOURS=8 [TARGET=obj]
	scripts/setup.sh --fuzz
	cmake --preset fuzz
	cmake --build --preset fuzz -j $(JOBS) --target tests/fuzz/all
	scripts/fuzz.sh $(or $(HOURS),0) $(TARGET)

large-inputs: setup  ## how long every reader takes for 100 MB, and how much memory, into build/large-inputs.csv
	cmake --preset release
	cmake --build --preset release -j $(JOBS) --target large_inputs
	build/release/bin/large_inputs --csv build/large-inputs.csv

peers-of-files: setup  ## files that trimesh, rosbags, mcap, yourdfpy and Open3D write in every variant, read as they read them
	scripts/setup.sh --files
	$(call build_preset,release) --target palpate palpate_component_palpate
	build/python-files/bin/python tests/apps/file_peers.py $(CURDIR)/build/release/bin/palpate

compile-times:  ## the longest steps of the last build and their shares: make compile-times [PRESET=release]
	tools/compile_times.py build/$(or $(PRESET),release)

mutants: setup  ## do the tests notice? 200 small changes to contact, field and haptics, for hours; goes on where it was
	tools/mutants.py --count $(or $(COUNT),200)

cuda:  ## compile the library with the CUDA backend; needs nvcc, no GPU
	@command -v nvcc >/dev/null || { echo "make cuda: nvcc is not in PATH; install the CUDA toolkit"; exit 1; }
	$(call build_preset,cuda)

gpu-check:  ## on a machine with a GPU: build, test, compute-sanitizer, benchmark
	scripts/gpu_check.sh

soak: setup  ## a live run with faults, changes, pages and a recording in parts: make soak [HOURS=24]
	cmake --preset release
	cmake --build --preset release -j $(JOBS) --target soak
	build/release/bin/soak --minutes $$(awk 'BEGIN { print 60 * $(or $(HOURS),24) }')

view-soak: setup  ## ten minutes of the viewer in a browser: does its memory stand still?
	cmake --preset release
	cmake --build --preset release -j $(JOBS) --target page_server
	PATH="$(CURDIR)/build/node/bin:$$PATH" PALPATE_SOAK_SECONDS=600 node tests/viewer/page/soak_test.mjs

# qemu itself needs more address space than the one test left out grants.
arm64:  ## the library for 64-bit Arm, cross-compiled; under qemu it gives the bits of golden.txt
	scripts/setup.sh --arm64
	cmake --preset arm64
	cmake --build --preset arm64 -j $(JOBS) --target palpate_component_palpate test_core test_golden
	@for test in core golden; do \
	  qemu-aarch64-static -L /usr/aarch64-linux-gnu build/arm64/bin/test_$$test --gtest_brief=1 \
	    --gtest_filter=-ThreadPoolDeathTest.WorksWithAsManyThreadsAsTheSystemStarts || exit 1; done

wheel:  ## the Python package with the program inside, into build/wheels: make wheel [CUDA=1]
	scripts/setup.sh --wheel
	scripts/make_wheel.sh $(JOBS) $(if $(CUDA),-DPALPATE_CUDA=ON)

# Sources are the library's; Debian's Clang has a C++ library for WASI.
web-core:  ## the library as WebAssembly with its package for npm and the page without a program, into build/web; the same bits?
	scripts/setup.sh --web
	$(call build_preset,web)
	scripts/web_core.sh build/web

packages:  ## Debian packages and an archive, into build/packages/packages; make try-packages uses them in a fresh Debian 12
	scripts/setup.sh --packages
	scripts/make_packages.sh $(JOBS)

try-packages: packages  ## install the packages in a fresh Debian 12 and use them
	scripts/try_fresh.sh packages

try-demo try-test:  ## make demo or make test in a fresh Debian 12, each line with its second
	scripts/setup.sh --packages
	scripts/try_fresh.sh $(@:try-%=%)

ci-all:  ## all that needs no special hardware: tests, sanitizers, Clang, fuzzing, large inputs, files of other libraries and clang-tidy, Arm, packages, the page of the evaluation; hours
	for check in test long-test clang asan tsan fuzz large-inputs peers-of-files tidy arm64 web-core try-packages eval-check; do $(MAKE) $$check || exit 1; done

clean:  ## remove build/ and demo/
	rm -rf build demo
