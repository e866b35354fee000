# Builds the programs that `python -m bench` runs:  make -f bench/build.mk
# run_embree is built only where Embree 3's headers are.
BUILD := build/bench
CC ?= cc
OPT ?= -O3
WARN := -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wstrict-prototypes \
        -Wmissing-prototypes -Wdouble-promotion
# -ffp-contract=off: the workload is defined with one rounding an operation.
BENCH_CFLAGS := -std=c99 $(OPT) -g -ffp-contract=off \
                -pthread -MMD -MP -Icsrc $(WARN) $(CFLAGS)
EMBREE := $(shell mkdir -p $(BUILD); \
            echo 'int main(void) { return rtcNewDevice(0) == 0; }' \
            | $(CC) -include embree3/rtcore.h -x c - -o $(BUILD)/probe \
              -lembree3 2>/dev/null && echo yes)

LIBRARY := $(patsubst csrc/%.c,$(BUILD)/csrc/%.o,$(wildcard csrc/*.c))
HARNESS := $(BUILD)/driver.o $(BUILD)/workload.o
PROGRAMS := $(BUILD)/run_vocc $(if $(EMBREE),$(BUILD)/run_embree)

.DELETE_ON_ERROR:
.PHONY: all list FORCE
all: $(PROGRAMS)
list:
	@echo $(PROGRAMS)

$(BUILD)/run_vocc: $(BUILD)/run_vocc.o $(HARNESS) $(LIBRARY)
	$(CC) $(BENCH_CFLAGS) $(LDFLAGS) -o $@ $^ -lm

$(BUILD)/run_embree: $(BUILD)/run_embree.o $(HARNESS)
	$(CC) $(BENCH_CFLAGS) $(LDFLAGS) -o $@ $^ -lembree3 -lm

# Changes when the command does, so that objects of other flags are not linked.
$(BUILD)/flags: FORCE
	@mkdir -p $(@D)
	@echo '$(CC) $(BENCH_CFLAGS)' | cmp -s - $@ || echo '$(CC) $(BENCH_CFLAGS)' > $@

$(BUILD)/csrc/%.o: csrc/%.c $(BUILD)/flags
	@mkdir -p $(@D)
	$(CC) $(BENCH_CFLAGS) -c -o $@ $<

$(BUILD)/%.o: bench/%.c $(BUILD)/flags
	@mkdir -p $(@D)
	$(CC) $(BENCH_CFLAGS) -c -o $@ $<

-include $(wildcard $(BUILD)/*.d $(BUILD)/csrc/*.d)
