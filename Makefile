# make             builds every example into build/
# make demo        fetches missing packages if possible, builds, and renders all pictures into build/demo/
# make test        all tests in all configurations, under 4 minutes; ends with `N passed, N failed`
# make test-long   the same with nothing skipped natively, and in more configurations
# make fuzz        scenes, maps and files made of bytes, which libFuzzer draws, under sanitizers; SECONDS=600 JOBS=2 PLAIN=1
# make fuzz-scenes random scenes under sanitizers; COUNT=scenes SEED=first
# make soak        random scenes against the reference; COUNT=scenes SEED=first
# make mutants     deliberate errors in the header, and the test that notices each; LIMIT=2400 seconds, run again to continue
# make hard-cases  runs the tests of hard cases, and writes docs/hard-cases.md: expected, measured, tolerated, and why
# make ports       builds for other processors, systems and standards, tests under emulators, into docs/ports.md
# make rivals      the same scenes by other renderers, error and time and memory of each, into docs/rivals.md
# make bench       times, as ratios within one run, and error against time
# make speed       the goals of speed, and how time grows, into docs/speed.md and docs/speed_*.png
# make accuracy    error and time of every knob in twelve scenes, into docs/accuracy.md and docs/accuracy_*.png
# make accuracy-quick  the scenes with a closed form and two knobs of it, in half a minute; SCENE=name: all of that scene
# make prices      the README's table: error and time of six scenes in the default mode
# make headline    a scene at three settings, docs/price.png, and the error and time of each
# make accuracy-tables  that page's tables of error against time of single effects
# make budget      what budgets of time and error promise, and what they keep, into docs/budget.md; 8 minutes
# make first-flights  the error of light from small sources, scene by scene and quality by quality; FIRE=rings: that one
# make maps        transmittance maps compared with each other, into docs/maps.md and docs/maps_*.png
# make effects     what each effect costs, and that it costs nothing where it is not needed, into docs/effects.md
# make gallery     the pictures of the scene programs at full size, into build/gallery/
# make pictures    the small pictures in docs/
# make format      clang-format on examples and tests
# make install     the header and splatshadow.pc, below DESTDIR and PREFIX (/usr/local); make uninstall removes them
# make clean
# STB=dir is the folder of stb_image_write.h; SPLATSHADOW_DATA=dir that of real scans (optional, for demo and test).

STB ?= /usr/include/stb
JOBS ?= 2
CORES = $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
OPTIMIZE ?= -O3 -march=native

STANDARD = -std=c99 -D_POSIX_C_SOURCE=200809L
WARNINGS = -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wdouble-promotion -Wcast-qual -Wundef
WARNINGS_C = $(WARNINGS) -Wstrict-prototypes -Wmissing-prototypes
INCLUDES = -I. -isystem $(STB)
LIBRARIES = -pthread -lm
HEADERS = splatshadow.h $(wildcard examples/*.h)
EXAMPLES = $(patsubst examples/%.c,build/%,$(wildcard examples/*.c))
STEPS = $(patsubst examples/tutorial/%.c,%,$(wildcard examples/tutorial/*.c))
MEASURES = $(patsubst tests/measure/%.c,%,$(wildcard tests/measure/*.c))

.PHONY: all demo gallery scans test test-long fuzz fuzz-scenes mutants format clean
.DELETE_ON_ERROR:

all: $(EXAMPLES) $(STEPS:%=build/tutorial/%)

# hello.c is the quick start, which is written to be short: it has no strict prototypes.
build/hello: examples/hello.c splatshadow.h | build
	$(CC) $(STANDARD) $(OPTIMIZE) -Wall -I. $< -o $@ $(LIBRARIES)

# All other programs are linked with one object of the implementation.
build/splatshadow.o: splatshadow.h | build
	$(CC) $(STANDARD) $(OPTIMIZE) -DSPLATSHADOW_IMPLEMENTATION -x c -c $< -o $@

build/tutorial/6_shadow_map: $(wildcard examples/shaders/*)

build/%: examples/%.c $(HEADERS) build/splatshadow.o | build build/tutorial
	@test -f $(STB)/stb_image_write.h || { echo "stb_image_write.h is missing: install libstb-dev, or say make STB=dir"; exit 1; }
	$(CC) $(STANDARD) $(OPTIMIZE) $(WARNINGS_C) $(INCLUDES) $< build/splatshadow.o -o $@ $(LIBRARIES)

build $(GALLERY) build/tests build/tutorial:
	mkdir -p $@

# ---------------------------------------------------------------------------------------------------- pictures

SCENES = mushrooms dart tree pot smoke_room turbulence metaballs cloud_mesh fog puff turntable lamp penumbra panes steam slide textured cloud_light fog_room above_clouds
GALLERY = build/gallery
PICTURES = $(SCENES:%=$(GALLERY)/%.png)

# $(call fetch,packages): installs them if possible; silent and harmless otherwise.
fetch = if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	echo "installing $(1)"; { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y $(1); } >/dev/null 2>&1 || true; fi

demo:
	@command -v $(CC) >/dev/null || { $(call fetch,gcc libc6-dev); }
	@test -f $(STB)/stb_image_write.h || { $(call fetch,libstb-dev); }
	@command -v $(CC) >/dev/null || { echo "no C compiler: install gcc, or say make demo CC=name"; exit 1; }
	@test -f $(STB)/stb_image_write.h || { echo "stb_image_write.h is missing: install libstb-dev, or say make demo STB=dir"; exit 1; }
	@echo "Compiling the library once, and each example; pictures are written to build/demo/ as they are ready."
	@$(MAKE) -s --no-print-directory -j$(CORES) GALLERY=build/demo QUICK=1 gallery scans
	@echo "The pictures are in build/demo/."

# Hard and soft shadows side by side: scenes, and the angular diameter of the sun in each, in degrees
SOFT_mushrooms = 8
SOFT_dart = 3
SOFT_tree = 6
SOFT_bonsai = 5
SOFT_PICTURES = $(foreach scene,mushrooms dart tree,$(GALLERY)/soft_$(scene).png)

# In the demo, comparisons with random paths are smaller.
ifdef QUICK
WIDTH_cloud_light = --width 480
WIDTH_fog_room = --width 480
WIDTH_above_clouds = --width 480
WIDTH_steam = --width 480
endif

gallery: $(PICTURES) $(SOFT_PICTURES)

$(GALLERY)/soft_%.png: build/% | $(GALLERY)
	build/$* --soft $(SOFT_$*) --out $@

$(GALLERY)/%.png: build/% | $(GALLERY)
	build/$* $(WIDTH_$*) --out $@

# The pictures of the README, the manual and the tutorial. They have no prerequisites, and are always rendered again.
DOCS_PICTURES = tree smoke_room pot turntable penumbra panes slide textured cloud_light
.PHONY: pictures
pictures: $(DOCS_PICTURES:%=build/%) $(STEPS:%=build/tutorial/%)
	for scene in $(DOCS_PICTURES); do build/$$scene --out docs/$$scene.png --width 480 || exit 1; done
	for step in $(STEPS); do build/tutorial/$$step docs/tutorial_$$step.png >/dev/null || exit 1; done

# Real scans, by light that scatters once. To add one: its name and its file here, and its appearance in
# examples/looks/NAME.txt (see build/render --help). A scan whose file is not in SPLATSHADOW_DATA is skipped.
SCANS = bonsai head smoke cloud
FILE_bonsai = bonsai_256x256x256_u8.raw
FILE_head = vismale_head_ct_128x128x256_u8.raw
FILE_smoke = smoke_openvdb_111x222x112_u16.raw
FILE_cloud = wdas_cloud_sixteenth_126x86x154_u16.raw

SCANS_HERE = $(if $(SPLATSHADOW_DATA),$(foreach scan,$(SCANS),$(if $(wildcard $(SPLATSHADOW_DATA)/$(FILE_$(scan))),$(scan))))

scans: $(SCANS_HERE:%=$(GALLERY)/scan_%.png) $(if $(filter bonsai,$(SCANS_HERE)),$(GALLERY)/soft_bonsai.png)

$(GALLERY)/scan_%.png: build/render examples/looks/%.txt examples/looks/floor.obj | $(GALLERY)
	build/render --look examples/looks/$*.txt --volume $(SPLATSHADOW_DATA)/$(FILE_$*) --scattering single --out $@ --stats $(GALLERY)/scan_$*.json
	@echo $@

# --------------------------------------------------------------------------------------------------- measuring

build/measure:
	mkdir -p $@

build/measure/%: tests/measure/%.c $(HEADERS) $(wildcard tests/measure/*.h) tests/flames.h build/splatshadow.o | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(WARNINGS_C) $(INCLUDES) -Iexamples -Itests $< build/splatshadow.o -o $@ $(LIBRARIES)

# See the top of tests/measure/bench.c for its parts. bench_plain is plain C, bench_avx2 has vectors of 8 floats at most.
.PHONY: bench speed accuracy accuracy-quick accuracy-tables
X86 = $(filter x86_64 amd64 i%86,$(shell uname -m))
BENCHES = build/measure/bench $(if $(X86),build/measure/bench_avx2) build/measure/bench_plain

bench: $(BENCHES)
	build/measure/bench
	@$(COMPARE_BUILDS)
	build/measure/bench_plain maps

build/measure/bench_plain: ONLY = -DSPS_NO_SIMD
build/measure/bench_avx2: ONLY = -mno-avx512f
build/measure/bench_plain build/measure/bench_avx2: tests/measure/bench.c $(HEADERS) $(wildcard tests/measure/*.h) | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(ONLY) -DSPLATSHADOW_IMPLEMENTATION $(WARNINGS_C) $(INCLUDES) -Iexamples $< -o $@ $(LIBRARIES)

# Rows of the table of goals: time of each build's frames, with 1 worker, over that of bench; the least of turns.
COMPARE_BUILDS = for turn in 1 2 3; do for build in $(notdir $(BENCHES)); do build/measure/$$build frames | sed "s/^/$$build /"; done; done | awk ' \
	NF == 3 && (!(($$1, $$2) in least) || $$3 < least[$$1, $$2]) { least[$$1, $$2] = $$3 } \
	NF == 3 && !seen[$$1, $$2]++ && $$1 != "bench" { builds[++rows] = $$1; frames[rows] = $$2 } \
	END { for (i = 1; i <= rows; ++i) printf "| %s, medium, 1 worker: %s / bench, time | %.2f | | | |\n", \
		frames[i], builds[i], least[builds[i], frames[i]] / least["bench", frames[i]] }'

# Of the page, what stands before the first printed line and from the next heading of its own on is kept.
speed: $(BENCHES)
	{ build/measure/bench goals; $(COMPARE_BUILDS); build/measure/bench curves docs; } | tee build/speed.txt
	@{ sed '/^[0-9]* processors/,$$d' docs/speed.md; cat build/speed.txt; echo; sed -n '/^## Advice/,$$p' docs/speed.md; } > build/speed.md
	cp build/speed.md docs/speed.md

# Twelve scenes, every knob: docs/accuracy.md, of which the first lines and the sections of single effects are kept, its
# pictures, and all figures as build/price_list/prices.csv. Under 20 minutes, on a machine that does nothing else.
accuracy: build/measure/prices
	@mkdir -p build/price_list
	build/measure/prices build/price_list > build/price_list/prices.md
	@{ sed '/^## Error and time by use/,$$d' docs/accuracy.md; sed '/^## All figures/,$$d' build/price_list/prices.md; \
		sed -n '/^## Penumbrae/,/^## Bounds/p' docs/accuracy.md | sed '$$d'; \
		sed -n '/^## Bounds/,$$p' build/price_list/prices.md; } > build/accuracy.md
	cp build/price_list/accuracy_*.png docs && cp build/accuracy.md docs/accuracy.md

SCENE = quick
accuracy-quick: build/measure/prices
	@mkdir -p build/price_list/$(SCENE)
	build/measure/prices build/price_list/$(SCENE) $(SCENE)

# The README's table of prices; and a picture at three settings
.PHONY: headline prices
prices: build/measure/prices
	build/measure/prices default

headline: build/measure/prices
	build/measure/prices docs headline

# Tables of single effects that take time: build/cheapest.md, build/accuracy.txt
accuracy-tables: build/measure/bench
	build/measure/bench cheapest | tee build/cheapest.md
	build/measure/bench accuracy | tee build/accuracy.txt

# What stands before the first printed line is kept. make budget-fit prints the tables of the header's section budget.
.PHONY: budget budget-fit
# It reads what the library keeps about its own speed, so that it holds the implementation.
build/measure/budget: tests/measure/budget.c $(HEADERS) $(wildcard tests/measure/*.h) | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(WARNINGS_C) $(INCLUDES) -Iexamples $< -o $@ $(LIBRARIES)

budget: build/measure/budget
	build/measure/budget check > build/budget.txt
	@sed '/^## Kept/,$$d' build/budget.txt | $(CSV) > build/budget.csv
	@{ sed '/^## Kept/,$$d' docs/budget.md; sed -n '/^## Kept/,$$p' build/budget.txt; \
		printf '\n`make budget` writes the figures of every frame to `build/budget.csv`.\n'; } > build/budget.md
	cp build/budget.md docs/budget.md

budget-fit: build/measure/budget
	build/measure/budget fit

.PHONY: first-flights
first-flights: build/measure/fire
	build/measure/fire $(FIRE)

# The program prints all figures, of which the page has those of one size, and draws pictures into build/maps/.
.PHONY: maps
maps: build/measure/maps
	@mkdir -p build/maps && rm -f build/maps.failed
	{ build/measure/maps docs build/maps || touch build/maps.failed; } | tee build/maps.txt
	@test ! -e build/maps.failed && awk -f tests/measure/maps.awk build/maps.txt > docs/maps.md

# Of the page, what stands before the first printed line is kept. Fails if something is spent that need not be.
.PHONY: effects
effects: build/measure/effects
	@rm -f build/effects.failed
	{ build/measure/effects || touch build/effects.failed; } | tee build/effects.txt
	@$(CSV) build/effects.txt > build/effects.csv
	@{ sed '/^## With and without/,$$d' docs/effects.md; awk -f tests/measure/effects.awk build/effects.txt; } > build/effects.md
	@test ! -e build/effects.failed && cp build/effects.md docs/effects.md

# Rows of Markdown tables as lines of CSV
CSV = sed -n '/^|[^-]/{s/^| *//;s/ *|$$//;s/, /; /g;s/ *| */,/g;p}'

# ------------------------------------------------------------------------------------------------------- tests

# Every tests/test_NAME.c is a program that includes the implementation, prints `N passed, N failed` as its last line
# and exits with 0 if none failed. It is built once for each configuration that lists it, and run in the top folder. A
# configuration whose compiler is not available is skipped, with a message. Long ones come first, since make runs them
# in this order, and what is short fills the cores at the end.
TESTS = $(patsubst tests/%.c,%,$(wildcard tests/test_*.c))
CONFIGURATIONS ?= wide_sanitized sanitized readme baseline cpp glsl hlsl native

# -O2 takes 4 seconds more to compile than -O1; tests then run in a third to three quarters of the time
COMPILE_native    = gcc $(STANDARD) -O2 -march=native
comma = ,
SANITIZE = clang $(STANDARD) -O1 -gline-tables-only -fsanitize=address,undefined -fno-sanitize-recover=all
# In short tests, undefined behaviour traps, and the stack says where it was; of pointers, addresses are enough, and
# alignment with vectors. That takes two thirds of the time to compile.
TRAP = $(if $(SPLATSHADOW_LONG),,-fsanitize-trap=undefined -fno-sanitize=null,pointer-overflow$(1))
export ASAN_OPTIONS ?= handle_sigill=1
COMPILE_wide_sanitized = $(SANITIZE) -march=native $(call TRAP)
COMPILE_sanitized = $(SANITIZE) -DSPS_NO_SIMD $(call TRAP,$(comma)alignment)
COMPILE_cpp       = g++ -x c++ -std=c++11 -D_POSIX_C_SOURCE=200809L $(if $(SPLATSHADOW_LONG),-O2,-O1)
COMPILE_baseline  = gcc $(STANDARD) $(if $(SPLATSHADOW_LONG),-O2,-O1)
COMPILE_plain     = gcc $(STANDARD) -O2 -DSPS_NO_SIMD
COMPILE_threads   = clang $(STANDARD) -O1 -g -fsanitize=thread -march=native
# In plain C: clang 14 takes what most vector instructions answer for uninitialised if any lane of theirs is
COMPILE_memory    = clang $(STANDARD) -O1 -gline-tables-only -DSPS_NO_SIMD -fsanitize=memory
# As in the README, in long tests at its -O3; and the ways in which compilers contract a * b + c, which differ between
# these and the sanitized ones, except that clang is as wide_sanitized
COMPILE_readme    = cc $(if $(SPLATSHADOW_LONG),-O3,-O1) -march=native
COMPILE_fused     = gcc $(STANDARD) -O1 -march=native -ffp-contract=fast
COMPILE_clang     = clang -O1 -march=native
# The test that runs examples/shaders/, in the shading languages instead of C
COMPILE_glsl      = $(COMPILE_cpp) -DSAMPLING_GLSL
COMPILE_hlsl      = $(COMPILE_cpp) -DSAMPLING_HLSL

# The tests of each configuration: all of them natively, with the same random scenes each time (`make fuzz-scenes` and
# `make soak` for others), except for the fuzzer's inputs, which are for sanitizers; under sanitizers those with most
# kinds of memory access, the slow ones with vectors; elsewhere the most sensitive ones.
TESTS_native    = $(if $(SPLATSHADOW_LONG),$(TESTS),$(filter-out test_seeds,$(TESTS))) fuzz soak
TESTS_sanitized = test_extremes test_transmittance test_arrays
MAP_TESTS = test_map_answers test_map_memory test_map_pictures test_map_states
TESTS_wide_sanitized = test_hooks test_workers test_interface test_files test_polygons test_seeds $(MAP_TESTS) test_watertight
TESTS_cpp       = test_pictures test_arrays test_throwing
TESTS_baseline  = test_simd
TESTS_readme    = test_watertight
TESTS_fused     = test_watertight
TESTS_clang     = test_watertight
TESTS_glsl      = test_sampling
TESTS_hlsl      = test_sampling
ifdef SPLATSHADOW_LONG
# All tests where misuse of memory is found, with vectors and without, and in C++, there with SSE2 alone. In other ways
# of compiling, the tests that depend most on how floats are rounded; and those that have threads.
$(foreach configuration,sanitized wide_sanitized memory cpp,$(eval TESTS_$(configuration) = $$(TESTS) fuzz))
$(foreach configuration,plain baseline readme fused clang,\
	$(eval TESTS_$(configuration) = test_watertight test_polygons test_pictures test_filling test_shadows $(MAP_TESTS) test_simd))
TESTS_threads = test_workers test_interface test_reading
endif

# Where many tests run in one configuration, the header is compiled once, with every function visible, and each test
# against its declarations alone; tests/mutants.awk writes both out. Not where it matters what is inlined. In short
# tests, a test itself is not optimised, which takes longer than it saves, unless it computes much.
SPLIT = native sanitized wide_sanitized cpp glsl hlsl threads memory $(if $(SPLATSHADOW_LONG),plain baseline)
SPLIT_CPP = cpp glsl hlsl
COMPUTING = test_area test_brackets test_cells test_filling test_particles test_reading test_sampling test_scattering test_spreading test_walls
optimize = $(if $(SPLATSHADOW_LONG)$(filter $(COMPUTING),$(1)),,-O0)
code = build/tests/$(if $(filter $(SPLIT_CPP),$(1)),cpp,$(1)).code.o

# The header by itself, with every warning an error: compiler_standard_variant; examples likewise. In C99 to an object,
# since some misuse of vector intrinsics is only found there (gcc's plain C has none); otherwise a syntax check is
# enough, except for the object that header.link links.
CHECK_COMPILERS = gcc clang
CHECK_STANDARDS = c99 $(if $(SPLATSHADOW_LONG),c11) c++11
CHECK_VARIANTS = plain sse2 avx2 avx512 face
STATIC_CHECKS = gcc_c99_static clang_c99_static
# After the standard headers, and macros of others
HOSTILE = -include tests/hostile.h
VARIANT_plain  = -DSPLATSHADOW_IMPLEMENTATION -DSPS_NO_SIMD $(HOSTILE)
VARIANT_sse2   = -DSPLATSHADOW_IMPLEMENTATION
VARIANT_static = -DSPLATSHADOW_IMPLEMENTATION -DSPS_API=static
VARIANT_avx2   = -DSPLATSHADOW_IMPLEMENTATION -mavx2 -mfma $(HOSTILE)
# gcc 12's own AVX-512 header warns of sign conversions where its intrinsics are macros, at -O0
VARIANT_avx512 = -Wno-sign-conversion -DSPLATSHADOW_IMPLEMENTATION -mavx512f -mavx512dq -mavx512bw -mavx512vl -mfma
ifeq ($(filter x86_64 amd64 i%86,$(shell uname -m)),)
CHECK_VARIANTS = plain sse2 face
endif
# Warnings that engines and browsers switch on for their own code; those that they switch off stay on here. Godot 4:
# SConstruct, warnings=extra, for gcc and for clang. Unreal 5: UnrealBuildTool's ClangWarnings.cs, with unsafe casts.
# Chromium: chromium_code and prevent_unsafe_narrowing in build/config/compiler/BUILD.gn, and extra_warnings in
# build/config/clang/BUILD.gn. None has -Wold-style-cast.
VARIANT_godot = -DSPLATSHADOW_IMPLEMENTATION -Wall -Wextra -Wshadow -Wwrite-strings -Walloc-zero -Wduplicated-branches \
	-Wduplicated-cond -Wstringop-overflow=4 -Wattribute-alias=2 -Wlogical-op
VARIANT_godotclang = -DSPLATSHADOW_IMPLEMENTATION -Wall -Wextra -Wwrite-strings -Wimplicit-fallthrough \
	-Wshadow-field-in-constructor -Wshadow-uncaptured-local
VARIANT_unreal = -DSPLATSHADOW_IMPLEMENTATION -Wall -Wdelete-non-virtual-dtor -Wenum-conversion -Wbitfield-enum-conversion \
	-Wshadow -Wundef -Wdate-time -Wfloat-conversion -Wimplicit-float-conversion -Wimplicit-int-conversion -Wc++11-narrowing
VARIANT_chromium = -DSPLATSHADOW_IMPLEMENTATION -Wall -Wextra -Wloop-analysis -Wenum-compare-conditional -Wshadow \
	-Wimplicit-fallthrough -Wunreachable-code-aggressive -Wthread-safety -Wextra-semi -Wheader-hygiene -Wstring-conversion \
	-Wtautological-overlap-compare -Wexit-time-destructors -Wshorten-64-to-32 -Wimplicit-int-conversion -Wsign-compare \
	-Wsign-conversion -Wtautological-unsigned-zero-compare
ENGINE_CHECKS = gcc_c11_godot gcc_c++17_godot clang_c11_godotclang clang_c++17_godotclang clang_c11_unreal \
	clang_c++20_unreal clang_c11_chromium clang_c++20_chromium
CHECKS = $(foreach c,$(CHECK_COMPILERS),$(foreach s,$(CHECK_STANDARDS),$(foreach v,$(CHECK_VARIANTS),$(c)_$(s)_$(v)))) \
	$(STATIC_CHECKS) $(ENGINE_CHECKS)
EXAMPLE_CHECKS = $(foreach c,gcc $(if $(SPLATSHADOW_LONG),clang),$(foreach e,$(EXAMPLES:build/%=%) $(MEASURES),$(c)_$(e))) $(if $(SPLATSHADOW_LONG),,clang_hello)
HELLO_RUNS = $(if $(SPLATSHADOW_LONG),gcc clang)

part = $(word $(1),$(subst _, ,$(2)))
language = $(if $(findstring ++,$(1)),-x c++ -std=$(1) $(WARNINGS),-x c -std=$(1) $(WARNINGS_C)) -Werror

test:
	@command -v clang >/dev/null && command -v gcc >/dev/null && command -v g++ >/dev/null || { $(call fetch,gcc g++ clang libc6-dev); }
	@mkdir -p build/tests && $(call can_build,sanitized) || { $(call fetch,libclang-rt-$$(clang -dumpversion | cut -d. -f1)-dev); }
	@test -f $(STB)/stb_image_write.h || { $(call fetch,libstb-dev); }
	@command -v tcc >/dev/null || { $(call fetch,tcc); }
	@command -v pkg-config >/dev/null && command -v cmake >/dev/null || { $(call fetch,pkg-config cmake); }
	@rm -rf build/tests && mkdir -p build/tests
	@test -f $(STB)/stb_image_write.h || echo "skipped: all examples but hello: install libstb-dev"
	@$(MAKE) -s --no-print-directory -j$(JOBS) -k objects >/dev/null 2>&1 || true
	@$(MAKE) -s --no-print-directory -j$(JOBS) -k run-tests
	@awk '$(SUMMARY)' build/tests/*.log

test-long: export SPLATSHADOW_LONG = 1
test-long: export CONFIGURATIONS = native sanitized wide_sanitized plain cpp baseline readme fused clang glsl hlsl threads memory
test-long: test

# A log ends with `exit status S`. Its last `N passed, N failed` counts; a program whose status is not 0 although it
# reports no failure counts as one more failure.
SUMMARY = function close_log() { passed += p; failed += f; if (status != 0 && f == 0) failed++; p = f = status = 0 }; \
	FNR == 1 { close_log() }; /^exit status / { status = $$3 }; \
	/^[0-9]+ passed, [0-9]+ failed$$/ { p = $$1; f = $$3 }; \
	END { close_log(); printf "%d passed, %d failed\n", passed, failed; exit failed > 0 || passed == 0 }

# What the tests of hard cases measure, by CHECK_CASE in check.h: a line for each group into docs/hard-cases.md, all of
# them into build/hard-cases.csv. With SPLATSHADOW_LONG=1, as in the long tests. In plain C, one test compares levels of
# optimisation.
.PHONY: hard-cases
HARD_CASES = $(patsubst tests/%.c,build/tests/native.%.log,$(shell grep -l CHECK_CASE tests/*.c)) build/tests/native.fuzz.log build/tests/plain.test_simd.log
hard-cases:
	@mkdir -p build/tests && rm -f build/cases.txt $(HARD_CASES)
	@CHECK_CASES=build/cases.txt CONFIGURATIONS="native plain" $(MAKE) -s --no-print-directory -j$(JOBS) $(HARD_CASES)
	@! grep -L '^exit status 0' $(HARD_CASES) | grep .
	LC_ALL=C sort -t "$$(printf '\t')" -k7,7 -k8,8n build/cases.txt | awk -v csv=build/hard-cases.csv -f tests/cases.awk > build/cases.md
	@{ sed '/^| group/,$$d' docs/hard-cases.md; cat build/cases.md; echo; sed -n '/^## Not covered/,$$p' docs/hard-cases.md; } > build/hard-cases.md
	cp build/hard-cases.md docs/hard-cases.md

# What stands before the table is kept.
.PHONY: ports
ports:
	@mkdir -p build && rm -f build/ports.failed
	sh tests/ports.sh > build/ports.txt || touch build/ports.failed
	@{ sed '/^| target/,$$d' docs/ports.md; cat build/ports.txt; } > build/ports.md
	@test ! -e build/ports.failed && cp build/ports.md docs/ports.md

# The same scenes by this library, Cycles, POV-Ray and vdb_render. Of the page, what stands before the results and from
# the next heading of its own on is kept.
.PHONY: rivals
rivals: build/measure/rivals
	@mkdir -p build/rivals
	sh tests/measure/rivals.sh > build/rivals/results.md
	@{ sed '/^## Results/,$$d' docs/rivals.md; cat build/rivals/results.md; echo; sed -n '/^## Fairness/,$$p' docs/rivals.md; } > build/rivals/page.md
	cp build/rivals/page.md docs/rivals.md

# The page counts the cases that the tests have.
build/tests/cases.log: docs/hard-cases.md tests/cases.awk $(wildcard tests/*.c tests/*.h)
	@$(call run,cases,awk -v mode=count -f tests/cases.awk $(wildcard tests/*.c) tests/check.h tests/fuzz.h docs/hard-cases.md && $(ONE_PASSED))

# Tests whether a configuration's compiler is available and makes programs that run.
can_build = { echo 'int main(void) { return 0; }' > build/tests/probe_$(1).c && \
	$(COMPILE_$(1)) build/tests/probe_$(1).c -o build/tests/probe_$(1) && build/tests/probe_$(1); } >/dev/null 2>&1

# Only the inner makes of `test` have these targets: they test what is available after missing packages were fetched.
ifneq ($(filter objects run-tests,$(MAKECMDGOALS)),)
skipped = $(if $(filter run-tests,$(MAKECMDGOALS)),$(info skipped: $(1)))
READY := $(shell $(foreach c,$(CONFIGURATIONS),$(call can_build,$(c)) && echo $(c);))
THERE := $(foreach c,$(CHECK_COMPILERS),$(shell command -v $(c) >/dev/null && echo $(c)))
CPP_THERE := $(shell command -v g++ >/dev/null && echo gcc) $(filter clang,$(THERE))
READY_CHECKS = $(foreach k,$(CHECKS),$(if $(filter $(call part,1,$(k)),$(if $(findstring ++,$(k)),$(CPP_THERE),$(THERE))),$(k)))
STB_THERE := $(wildcard $(STB)/stb_image_write.h)
TCC_THERE := $(shell command -v tcc)
READY_EXAMPLES = $(foreach k,$(if $(STB_THERE),$(EXAMPLE_CHECKS),$(filter %_hello,$(EXAMPLE_CHECKS))),\
	$(if $(filter $(call part,1,$(k)),$(THERE)),$(k)))
SHADER_COMPILERS = glslangValidator glslc dxc
SHADER_COMPILERS_THERE := $(foreach c,$(SHADER_COMPILERS),$(shell command -v $(c) >/dev/null && echo $(c)))
$(foreach c,$(filter-out $(READY),$(CONFIGURATIONS)),$(call skipped,configuration $(c): install $(firstword $(COMPILE_$(c))) and its sanitizer runtime))
$(foreach c,$(filter-out $(THERE) $(if $(TCC_THERE),tcc),$(CHECK_COMPILERS) tcc),$(call skipped,warnings of $(c): install it))
$(foreach c,$(filter-out $(SHADER_COMPILERS_THERE),$(SHADER_COMPILERS)),$(call skipped,examples/shaders/ by $(c): install it))

INSTALL_CHECKS = $(if $(THERE),make pkg-config cmake)
INSTALL_CHECKS_THERE := $(foreach c,$(INSTALL_CHECKS),$(shell command -v $(c) >/dev/null && echo $(c))) $(if $(THERE),readme code)
$(foreach c,$(filter-out $(INSTALL_CHECKS_THERE),$(INSTALL_CHECKS)),$(call skipped,the quick start by $(c): install it))

# Tests that run the command line, which is linked with the native configuration's header
$(if $(STB_THERE),$(if $(filter native,$(READY)),$(foreach c,$(READY),$(eval build/tests/$(c).test_command_line.log build/tests/$(c).test_files.log: build/tests/render))))

# The program in plain C that test_simd compares itself with, linked once for several configurations
SIMD_PLAIN_THERE = $(if $(SPLATSHADOW_LONG),,$(if $(filter sanitized,$(READY)),build/tests/simd_plain))
$(if $(SIMD_PLAIN_THERE),$(foreach c,$(filter native baseline,$(READY)),\
	$(eval build/tests/$(c).test_simd.log: $(SIMD_PLAIN_THERE)) \
	$(eval build/tests/$(c).test_simd.log: export SIMD_PLAIN = $(SIMD_PLAIN_THERE))))

# The test that runs the steps of the tutorial, which are linked with the native configuration's header
READY_STEPS = $(if $(STB_THERE),$(if $(filter native,$(READY)),$(STEPS:%=build/tests/step.%.log)))
$(foreach c,$(READY),$(eval build/tests/$(c).test_tutorial.log: $(READY_STEPS)))

# What tests wait for. It is built before: make comes back to a test that had to wait only after all others, although
# some of these take long.
.PHONY: objects run-tests
objects: $(foreach c,$(filter $(SPLIT),$(READY)),$(call code,$(c))) $(SIMD_PLAIN_THERE) \
	$(if $(STB_THERE),$(if $(filter native,$(READY)),build/tests/render))
run-tests: $(INSTALL_CHECKS_THERE:%=build/tests/install.%.log) $(foreach c,$(READY),$(TESTS_$(c):%=build/tests/$(c).%.log)) \
	$(READY_CHECKS:%=build/tests/header.%.log) $(READY_EXAMPLES:%=build/tests/example.%.log) $(READY_STEPS) \
	$(if $(filter native cpp,$(READY)),build/tests/header.link.log) build/tests/mutants.log build/tests/cases.log \
	$(if $(filter gcc,$(THERE)),build/tests/header.fast_math.log build/tests/header.no_reference.log $(if $(STB_THERE),build/tests/header.migrate.log)) build/tests/header.empty.log $(if $(TCC_THERE),build/tests/header.tcc.log) \
	$(SHADER_COMPILERS_THERE:%=build/tests/shaders.%.log)
endif

# $(call run,name,command): the command's output and exit status in build/tests/name.log; shown if it failed.
run = { $(2); } > build/tests/$(1).log 2>&1; status=$$?; echo "exit status $$status" >> build/tests/$(1).log; \
	if [ $$status = 0 ]; then echo "ok      $(1)"; else echo "FAILED  $(1)"; sed 's/^/    /' build/tests/$(1).log; fi
ONE_PASSED = echo "1 passed, 0 failed"

# Long tests are long natively; in each of a dozen other configurations they would take an hour.
sized = $(if $(filter native,$(1)),,unset SPLATSHADOW_LONG; )

define configuration_rules
build/tests/$(1).%.log: tests/%.c $$(HEADERS) $$(wildcard tests/*.h examples/shaders/*)
	@$(call sized,$(1))$$(call run,$(1).$$*,$$(COMPILE_$(1)) -Wall $$(INCLUDES) -Iexamples -Itests $$< -o build/tests/$(1).$$* $$(LIBRARIES) && build/tests/$(1).$$*)
endef

.PRECIOUS: build/tests/%.code.o
build/tests/%.code.o: build/tests/weak.h
	@$(COMPILE_$*) -w -DSPLATSHADOW_IMPLEMENTATION $(if $(filter cpp,$*),,-x c) -c $< -o $@

define split_rules
build/tests/$(1).%.log: tests/%.c $$(HEADERS) $$(wildcard tests/*.h examples/shaders/*) $(call code,$(1)) build/tests/faces/splatshadow.h
	@$(call sized,$(1))$$(call run,$(1).$$*,$$(COMPILE_$(1)) $$(call optimize,$$*) -Wall -Ibuild/tests/faces -DCHECK_HEADERS='"build/tests/faces"' $$(INCLUDES) -Iexamples -Itests $$< -x none $(call code,$(1)) \
		-o build/tests/$(1).$$* $$(LIBRARIES) && build/tests/$(1).$$*)
endef
$(foreach configuration,$(filter-out $(SPLIT),$(CONFIGURATIONS)),$(eval $(call configuration_rules,$(configuration))))
$(foreach configuration,$(filter $(SPLIT),$(CONFIGURATIONS)),$(eval $(call split_rules,$(configuration))))

build/tests/weak.h: splatshadow.h tests/mutants.awk
	@mkdir -p $(@D) && awk -v mode=weak -f tests/mutants.awk tests/mutants.txt $< > $@

build/tests/faces/splatshadow.h: splatshadow.h tests/mutants.awk
	@mkdir -p $(@D) && awk -v mode=faces -f tests/mutants.awk tests/mutants.txt $< > $@

# Included twice, which must be possible; the implementation once.
UNIT = printf '\#include "splatshadow.h"\n\#undef SPLATSHADOW_IMPLEMENTATION\n\#include "splatshadow.h"\nint unit(void);\nint unit(void) { return sps_version(); }\n'

build/tests/header.%.log: splatshadow.h tests/hostile.h
	@$(call run,header.$*,$(UNIT) | $(call part,1,$*) $(call language,$(call part,2,$*)) -O0 $(VARIANT_$(call part,3,$*)) \
		-I. $(if $(filter-out gcc_c99_plain,$(filter gcc_c99_% clang_c99_% gcc_c++11_sse2,$*)),-c -o build/tests/header.$*.o,-fsyntax-only) - && $(ONE_PASSED))

# A compiler of plain C and little else
build/tests/header.tcc.log: splatshadow.h
	@$(call run,header.tcc,$(UNIT) > build/tests/unit_tcc.c && tcc -std=c99 -Wall -Werror -DSPLATSHADOW_IMPLEMENTATION \
		-I. -c build/tests/unit_tcc.c -o build/tests/header.tcc.o && $(ONE_PASSED))

# The shaders, by shader compilers
build/tests/shaders.%.log: tests/shaders.sh docs/shadow_maps.md $(wildcard examples/shaders/*)
	@$(call run,shaders.$*,sh $< $* build/tests)

# The implementation without sps_reference, and without a warning
build/tests/header.no_reference.log: tests/no_reference.c tests/check.h splatshadow.h
	@$(call run,header.no_reference,gcc $(STANDARD) -O0 -Wall -Wextra -Werror -DSPLATSHADOW_NO_REFERENCE -I. $< \
		-o build/tests/no_reference $(LIBRARIES) && build/tests/no_reference)

# The tutorial of 0.3 compiles after docs/migrate.awk has renamed what 0.4 has.
build/tests/header.migrate.log: docs/migrate.awk docs/changelog.md splatshadow.h $(wildcard tests/tutorial_0_3/*.c examples/*.h)
	@$(call run,header.migrate,(mkdir -p build/tests/migrated; for f in tests/tutorial_0_3/*.c; do \
		awk -f docs/migrate.awk docs/changelog.md $$f | sed '/define SPLATSHADOW_IMPLEMENTATION/d' > build/tests/migrated/$${f##*/} && \
		gcc $(STANDARD) $(WARNINGS_C) -Werror $(INCLUDES) -Iexamples -fsyntax-only build/tests/migrated/$${f##*/} || exit 1; \
		done) && $(ONE_PASSED))

# Every public struct is initialised empty, in the manner of C++ and of C, without a warning.
EMPTY = printf '\#include "splatshadow.h"\n'; awk '/^typedef struct sps_[a-z_]* [{]/ { \
	print "void take_" $$3 "(const " $$3 " *); void make_" $$3 "(void);"; \
	print "void make_" $$3 "(void) { " $$3 " made = {$(1)}; take_" $$3 "(&made); }" }' splatshadow.h

build/tests/header.empty.log: splatshadow.h
	@$(call run,header.empty,(for c in $(filter gcc clang,$(THERE)); do \
		{ $(call EMPTY,0); } | $$c -x c -std=c99 -Wall -Wextra -Werror -I. -fsyntax-only - || exit 1; done; \
		for c in $(if $(filter gcc,$(CPP_THERE)),g++) $(if $(filter clang,$(CPP_THERE)),clang++); do \
		{ $(call EMPTY,); } | $$c -x c++ -std=c++11 -Wall -Wextra -Wmissing-field-initializers -Werror -I. -fsyntax-only - || \
		exit 1; done) && $(ONE_PASSED))

# Fast-math is an error unless it is explicitly allowed.
build/tests/header.fast_math.log: splatshadow.h
	@$(call run,header.fast_math,(for option in -ffast-math -ffinite-math-only; do \
		$(UNIT) | gcc -x c $$option -DSPLATSHADOW_IMPLEMENTATION -I. -E - -o /dev/null && exit 1; \
		$(UNIT) | gcc -x c $$option -DSPLATSHADOW_IMPLEMENTATION -DSPS_ALLOW_FAST_MATH -I. -E - -o /dev/null || exit 1; \
		done) && $(ONE_PASSED))

# Examples and programs that measure are checked for syntax and warnings, against the header's declarations. The long
# tests also run the quick start: its picture must have 256 * 256 * 3 numbers, not all of them 0. The short tests run it
# by the README's command, in tests/install.sh.
build/tests/example.%.log: $(HEADERS) $(wildcard tests/measure/*.h)
	@$(call run,example.$*,$(call part,1,$*) $(if $(filter %_hello,$*),-std=c99 -Wall -Werror,$(call language,c99)) \
		-D_POSIX_C_SOURCE=200809L $(INCLUDES) -Iexamples -Itests \
		$(firstword $(wildcard $(foreach folder,examples tests/measure,$(folder)/$(patsubst $(call part,1,$*)_%,%,$*).c))) -fsyntax-only && $(ONE_PASSED))

$(HELLO_RUNS:%=build/tests/example.%_hello.log): build/tests/example.%_hello.log: examples/hello.c splatshadow.h
	@$(call run,example.$*_hello,$* $(STANDARD) -O1 -Wall -Werror -I. $< -o build/tests/example.$*_hello $(LIBRARIES) && \
		build/tests/example.$*_hello | awk 'NR > 1 { for (i = 1; i <= NF; ++i) { ++numbers; bright += $$i > 99 } } \
		END { exit numbers != 256 * 256 * 3 || bright < 256 }' && $(ONE_PASSED))

# Steps of the tutorial, linked with the tests' object of the implementation; tests/test_tutorial.c runs them.
build/tests/step.%.log: examples/tutorial/%.c $(HEADERS) $(wildcard examples/shaders/*) build/tests/native.code.o
	@mkdir -p build/tests/tutorial
	@$(call run,step.$*,$(COMPILE_native) $(WARNINGS_C) -Werror $(INCLUDES) $< build/tests/native.code.o \
		-o build/tests/tutorial/$* $(LIBRARIES) && $(ONE_PASSED))

build/tests/render: examples/render.c $(HEADERS) build/tests/native.code.o
	@$(COMPILE_native) $(INCLUDES) $< build/tests/native.code.o -o $@ $(LIBRARIES)

build/tests/simd_plain: tests/test_simd.c tests/check.h $(call code,sanitized) build/tests/faces/splatshadow.h
	@$(COMPILE_sanitized) -ffp-contract=off -w -Ibuild/tests/faces -I. $< $(call code,sanitized) -o $@ $(LIBRARIES)

# The implementation in one object, C as well as C++, and a plain user of it in another.
LINK_USER = printf '\#include "splatshadow.h"\nint main(void) { return sps_version() != SPS_VERSION; }\n' > link_user.c

build/tests/header.link.log: splatshadow.h build/tests/header.gcc_c99_sse2.log build/tests/header.gcc_c++11_sse2.log
	@$(call run,header.link,(cd build/tests && $(LINK_USER) && gcc -std=c99 -I../.. -c link_user.c && \
		gcc link_user.o header.gcc_c99_sse2.o -o link_c -lm && ./link_c && \
		gcc link_user.o header.gcc_c++11_sse2.o -o link_cpp -lm -lstdc++ && ./link_cpp) && $(ONE_PASSED))

# The quick start, built from the installed files, and by CMake
build/tests/install.%.log: tests/install.sh splatshadow.h Makefile README.md $(wildcard docs/*.md examples/cmake/*)
	@$(call run,install.$*,CC="$(or $(firstword $(THERE)),$(CC))" MAKE="$(MAKE)" sh $< $* build/tests/install_$*)

# Prints the deliberate errors whose text the header no longer has; in long tests, as in make mutants, each is a failure.
build/tests/mutants.log: splatshadow.h $(wildcard tests/mutants.* tests/blind_*)
	@$(if $(SPLATSHADOW_LONG),$(call run,mutants,sh tests/mutants.sh check),sh tests/mutants.sh check | sed '$$d')

# make mutants CHAPTER="splat shading" LIMIT=600: see tests/mutants.sh
mutants: $(if $(wildcard $(STB)/stb_image_write.h),build/tests/render)
	@COMPILE="$(COMPILE_native)" STB="$(STB)" JOBS="$(JOBS)" sh tests/mutants.sh run

# make fuzz SECONDS=3600 JOBS=1: what is new is kept in build/fuzz_corpus, from which the next run goes on. An input that
# fails is left in build/found-*, and `build/fuzz build/found-...` says why. Once it is mended, such a file belongs into
# tests/seeds/, named after what it is: tests/test_seeds.c reads these in every `make test`. PLAIN=1 is plain C.
FUZZ = build/fuzz$(if $(PLAIN),_plain)
FUZZ_LIMITS = -max_len=1024 -len_control=20 -timeout=100 -rss_limit_mb=4096

fuzz: $(FUZZ)
	@mkdir -p build/fuzz_corpus
	$(FUZZ) build/fuzz_corpus tests/seeds $(FUZZ_LIMITS) -artifact_prefix=build/found- -max_total_time=$(or $(SECONDS),600) \
		-print_final_stats=1 $(if $(filter-out 1,$(JOBS)),-fork=$(JOBS))

# Comparisons in the header are not traced, which would take half of the time: those of the readers of files tell more.
build/fuzz_plain build/fuzz_plain.code.o: ONLY = -DSPS_NO_SIMD
.PRECIOUS: build/fuzz%.code.o
build/fuzz.code.o build/fuzz_plain.code.o: build/tests/weak.h
	$(SANITIZE) -march=native $(ONLY) -fsanitize-coverage=inline-8bit-counters,pc-table -w -DSPLATSHADOW_IMPLEMENTATION -x c -c $< -o $@

build/fuzz build/fuzz_plain: %: %.code.o tests/test_seeds.c examples/render.c $(HEADERS) $(wildcard tests/*.h) build/tests/faces/splatshadow.h
	$(SANITIZE) -march=native -fsanitize=fuzzer $(ONLY) -DFUZZER -Wall -Ibuild/tests/faces $(INCLUDES) -Iexamples -Itests \
		tests/test_seeds.c $< -o $@ $(LIBRARIES) || { echo "libFuzzer comes with clang and libclang-rt-dev"; exit 1; }

# make fuzz-scenes SEED=7 COUNT=5000: random scenes under sanitizers, vectors on
fuzz-scenes: tests/fuzz.c $(HEADERS) $(wildcard tests/*.h) | build
	$(SANITIZE) -march=native -Wall $(INCLUDES) -Iexamples -Itests $< -o build/fuzz_scenes $(LIBRARIES)
	build/fuzz_scenes $(or $(SEED),1) $(or $(COUNT),1000)

# make soak SEED=7 COUNT=1000: random scenes against the reference; FIRST is the number of the first of them
.PHONY: soak
soak: tests/soak.c $(HEADERS) $(wildcard tests/*.h) | build
	$(COMPILE_native) -O2 -Wall $(INCLUDES) -Iexamples -Itests $< -o build/soak $(LIBRARIES)
	build/soak $(or $(SEED),1) $(or $(COUNT),200) $(or $(FIRST),0)

# -------------------------------------------------------------------------------------------------- installing

PREFIX ?= /usr/local
VERSION = $(shell awk '/^\#define SPS_VERSION / { printf "%d.%d.%d", $$3 / 10000, $$3 / 100 % 100, $$3 % 100 }' splatshadow.h)
PKG_CONFIG_FILE = prefix=$(PREFIX)\nincludedir=$${prefix}/include\n\nName: splatshadow\nDescription: volumes, particles and \
polygons with correct shadows, and shadow maps of them\nVersion: $(VERSION)\nCflags: -I$${includedir}\nLibs: -lm\n

.PHONY: install uninstall
install:
	install -d "$(DESTDIR)$(PREFIX)/include" "$(DESTDIR)$(PREFIX)/share/pkgconfig"
	install -m 644 splatshadow.h "$(DESTDIR)$(PREFIX)/include"
	printf %b '$(PKG_CONFIG_FILE)' > "$(DESTDIR)$(PREFIX)/share/pkgconfig/splatshadow.pc"

uninstall:
	rm -f "$(DESTDIR)$(PREFIX)/include/splatshadow.h" "$(DESTDIR)$(PREFIX)/share/pkgconfig/splatshadow.pc"

# ---------------------------------------------------------------------------------------------------- the rest

# hello.c keeps its form in the header; the header's tables are formatted by hand.
format:
	clang-format -i $(filter-out examples/hello.c,$(wildcard examples/*.[ch] examples/shaders/* examples/tutorial/* tests/*.[ch] tests/measure/*.[ch]))

clean:
	rm -rf build
