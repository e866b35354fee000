# The targets and what they do: make help
#
#   config=release|debug|sanitize|thread|scalar   how C is compiled (lib, test-c)
#   CC=, CFLAGS=, LDFLAGS=, PYTHON=               the compiler, more flags, the Python to use
#   JOBS=                                         how much goes on at once (all cores)

CC ?= cc
config ?= release
JOBS ?= $(shell nproc 2>/dev/null || echo 2)
# The first Python that is new enough, else the one whose version the check complains about.
PYTHON ?= $(or $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; \
	done),python3)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test test-aarch64 test-blender test-blender-gui test-blender-all addon bench reproduce lib test-c \
	objects lint format env clean FORCE
# In place of -j, which a make that another one has started inherits.
AT_ONCE = $(if $(findstring jobserver,$(MAKEFLAGS)),,-j$(JOBS))

help:
	@echo 'make demo       render the soft shadows of three scenes into out/, with and without occluders'
	@echo 'make test       all tests: C (release, scalar, sanitize, thread, aarch64), lint, Blender, Python'
	@echo 'make addon      the extension for Blender, dist/*.zip'
	@echo 'make test-blender      its tests in Blender 4.5 and 5.2 (ARGS= for pytest; 1 GB each)'
	@echo 'make test-blender-gui  in a window, under Xvfb'
	@echo 'make test-blender-all  in 4.2 and 5.0 as well'
	@echo 'make bench      measure the speed (ARGS= for its arguments)'
	@echo 'make reproduce  repeat the measurements of the paper into docs/results (ARGS=--quick, ...)'
	@echo 'make lib        build/$$(config)/libvocc.a'
	@echo 'make test-c     build and run the C tests (ONLY=name for some of them)'
	@echo 'make test-aarch64      build the C tests for aarch64, run some of them in qemu (ONLY=)'
	@echo 'make lint       check the format of C and Python, and the types'
	@echo 'make format     format C and Python'
	@echo 'make env        .venv with the package and all that the other targets need'
	@echo 'make clean      remove what was built, but not .venv*'
	@echo 'config=release|debug|sanitize|thread|scalar, CC=, CFLAGS=, LDFLAGS=, PYTHON=, JOBS='

# ---- C -----------------------------------------------------------------------

WARNINGS := -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wstrict-prototypes \
	-Wmissing-prototypes -Wdouble-promotion -Werror

# What the extension module is linked of as well.
FLAGS_release := -O3 -fPIC
FLAGS_debug := -O0 -g
# -Og and -O1: at -O2 the checks in the inlined kernels take minutes to compile.
FLAGS_sanitize := -Og -g1 -fno-omit-frame-pointer -fsanitize=address,undefined \
	-fno-sanitize-recover=all
FLAGS_thread := -O1 -g1 -fsanitize=thread
FLAGS_scalar := -O2 -DVOCC_SIMD=0
ifndef FLAGS_$(config)
$(error config must be release, debug, sanitize, thread or scalar, not '$(config)')
endif

BUILD := build/$(config)
# -ffp-contract=off: every operation rounds once, as the code says, on every machine.
COMPILE := $(CC) -std=c99 $(FLAGS_$(config)) -ffp-contract=off -pthread $(WARNINGS) $(CFLAGS)
LIB_OBJECTS := $(patsubst %.c,$(BUILD)/%.o,$(wildcard csrc/*.c))
TEST_OBJECTS := $(patsubst %.c,$(BUILD)/%.o,$(wildcard tests/c/*.c))

# The thread sanitizer needs its addresses where it expects them.
RUN_thread := $(if $(filter thread,$(config)),$(shell setarch -R true 2>/dev/null && echo setarch -R))

# What names a number of threads: in others there is nothing for it to find.
TESTS_thread := api alloc.build_threaded alloc.queries progress region.winding_numbers region.same_tree \
	tree.limit_by_threads oracle.closest_hits_identical identical.threads light.threads light.neighbours \
	light.verify light_types.all_ways light_types.several_scenes threads classify_rays hostile.all_identical

lib: $(BUILD)/libvocc.a

test-c: $(BUILD)/vocc_tests
	$(RUN_thread) $< $(foreach name,$(or $(ONLY),$(TESTS_$(config))),--only $(name))

$(BUILD)/libvocc.a: $(LIB_OBJECTS)
	rm -f $@
	$(AR) rcs $@ $^

$(BUILD)/vocc_tests: $(TEST_OBJECTS) $(LIB_OBJECTS)
	$(COMPILE) $(LDFLAGS) -o $@ $^ -lm -lpthread

$(BUILD)/%.o: %.c $(BUILD)/flags
	@mkdir -p $(@D)
	$(COMPILE) -MMD -MP -c -o $@ $<

# Changes when the command does, so that objects of other flags are not linked.
$(BUILD)/flags: FORCE
	@$(CC) --version >/dev/null 2>&1 || { \
		echo "no C compiler '$(CC)': install gcc or clang (Debian: apt install build-essential), or set CC"; \
		exit 1; }
	@mkdir -p $(@D)
	@echo '$(COMPILE)' | cmp -s - $@ || echo '$(COMPILE)' > $@

# For the extension module and the add-on; one make at a time may make them.
objects:
	@$(MAKE) --no-print-directory -s $(AT_ONCE) config=release BUILD=build/release build/release/libvocc.a

-include $(wildcard $(BUILD)/csrc/*.d $(BUILD)/tests/c/*.d)

# ---- C for aarch64 -----------------------------------------------------------

# For the NEON kernels: a cross compiler, and qemu, which takes some ten times as long; so fewer rays,
# and not the tests that are about other things than lanes.
AARCH64_CC ?= aarch64-linux-gnu-gcc
AARCH64_RUN ?= qemu-aarch64
AARCH64_TESTS := api isa wide oracle.occluded_exact oracle.grids oracle.magnitudes \
	oracle.closest_hits_identical identical.all_modes identical.at_occluders identical.layouts \
	identical.far_away light.all_options light_types.all_ways

# NEON is optimised as ever; the plain kernels, which release tests as they are, would take most of the time.
build/aarch64/csrc/traverse_plain4.o build/aarch64/csrc/beam_plain.o: private COMPILE += -Og

test-aarch64:
	@skip() { echo "C tests for aarch64: skipped: $$1" \
		"(Debian: apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user)"; exit 0; }; \
	for program in $(firstword $(AARCH64_CC)) $(firstword $(AARCH64_RUN)); do \
		command -v $$program >/dev/null || skip "there is no $$program"; \
	done; \
	echo '#include <stdio.h>' | $(AARCH64_CC) -E -x c - >/dev/null 2>&1 || \
		skip "$(AARCH64_CC) has no C library"; \
	$(MAKE) --no-print-directory config=release BUILD=build/aarch64 CC='$(AARCH64_CC)' LDFLAGS=-static \
		build/aarch64/vocc_tests && \
	VOCC_TEST_SCALE=$${VOCC_TEST_SCALE:-0.05} $(AARCH64_RUN) build/aarch64/vocc_tests \
		$(foreach name,$(or $(ONLY),$(AARCH64_TESTS)),--only $(name))

# ---- Python ------------------------------------------------------------------

BIN := .venv/bin
C_SOURCES := $(wildcard csrc/*.c csrc/*.h csrc/*.inc csrc/cffi_build.py)

env: .venv/installed

# The packages at their pinned versions.
.venv/ready: requirements-dev.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "needs Python 3.11 or newer; '$(PYTHON)' is not (set PYTHON)"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' || { \
		echo "$(PYTHON) lacks venv (Debian: apt install python3-venv)"; exit 1; }
	@$(PYTHON) -c 'import os, sys, sysconfig; \
		sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' || { \
		echo "$(PYTHON) lacks its headers (Debian: apt install python3-dev)"; exit 1; }
	@$(CC) --version >/dev/null 2>&1 || { \
		echo "no C compiler '$(CC)': install gcc or clang (Debian: apt install build-essential), or set CC"; \
		exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip --disable-pip-version-check install --quiet -r requirements-dev.txt
	@touch $@

OBJECTS := VOCC_OBJECTS='$(CURDIR)/build/release/csrc'

# The package itself, in place: Python files count at once, C is compiled again when it changes.
.venv/installed: .venv/ready setup.py pyproject.toml $(C_SOURCES) | objects
	CC='$(CC)' $(OBJECTS) $(BIN)/python -m pip --disable-pip-version-check install --quiet --no-build-isolation \
		--no-deps --editable .
	@touch $@

demo: .venv/installed
	$(BIN)/python scenes/demo.py

bench: .venv/installed
	$(BIN)/python -m bench $(ARGS)

reproduce: .venv/installed
	$(BIN)/pyvocc reproduce -o docs/results $(ARGS)

# ---- Blender -----------------------------------------------------------------

# Compiles only what changed, which the script itself knows.
addon: .venv/ready | objects
	CC='$(CC)' $(OBJECTS) $(BIN)/python -m tools.build_addon

# Builds the extension first; a Blender that cannot be had here is skipped, and the end says why.
test-blender: .venv/ready | objects
	@CC='$(CC)' $(OBJECTS) $(BIN)/python -m tests.blender.run 4.5 5.2 -- $(ARGS)

test-blender-all: .venv/ready | objects
	@CC='$(CC)' $(OBJECTS) $(BIN)/python -m tests.blender.run 4.2 4.5 5.0 5.2 -- $(ARGS)

# In a window, with Debian's Blender under Xvfb, where they are installed.
test-blender-gui: .venv/ready | objects
	@CC='$(CC)' $(OBJECTS) $(BIN)/python -m tests.blender.gui_smoke || [ $$? -eq 77 ]

# ---- checks ------------------------------------------------------------------

C_FILES := $(wildcard csrc/*.c csrc/*.h csrc/*.inc tests/c/*.c tests/c/*.h tests/c/*.inc bench/*.c bench/*.h)

lint: .venv/ready
	$(BIN)/clang-format --dry-run --Werror $(C_FILES)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: .venv/ready
	$(BIN)/clang-format -i $(C_FILES)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# ---- all tests ---------------------------------------------------------------

# In this order as far as there are cores; what one prints comes when it ends. pytest has all cores.
STAGES := release scalar blender blender-gui aarch64 sanitize thread lint python
.PHONY: $(STAGES:%=stage-%)

SYNC := $(if $(filter-out 1,$(JOBS)),$(if $(filter output-sync,$(.FEATURES)),-Orecurse))

test:
	@rm -rf build/test; mkdir -p build/test
	@$(MAKE) --no-print-directory -s -k $(AT_ONCE) $(SYNC) $(STAGES:%=stage-%) || true
	@tests/stage.sh sum $(STAGES)

stage-release stage-scalar stage-sanitize stage-thread: stage-%:
	@tests/stage.sh run $* $(MAKE) --no-print-directory -s config=$* test-c

stage-aarch64:
	@tests/stage.sh run aarch64 $(MAKE) --no-print-directory -s test-aarch64

stage-lint stage-blender stage-blender-gui: .venv/ready
stage-release stage-blender: | objects
# Two of them at once would build the extension in one place; the window wants it built.
stage-blender: | .venv/installed
stage-blender-gui: | stage-blender

stage-lint:
	@tests/stage.sh run lint $(MAKE) --no-print-directory -s lint

stage-blender stage-blender-gui: stage-%:
	@tests/stage.sh run $* $(MAKE) --no-print-directory -s test-$* ARGS=

stage-python: .venv/installed | $(patsubst %,stage-%,$(filter-out python,$(STAGES)))
	@CC='$(CC)' $(OBJECTS) tests/stage.sh run python $(BIN)/python -m pytest $(if $(filter 1,$(JOBS)),,-n $(JOBS) --dist loadfile)

clean:
	rm -rf build dist out *.egg-info pyvocc/_vocc*.so .pytest_cache .mypy_cache .ruff_cache .hypothesis
	rm -f .venv/installed
	find pyvocc tests bench scenes csrc tools blender_addon -name __pycache__ -type d -prune -exec rm -rf {} +
