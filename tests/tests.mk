# The rules of `make test`, `make mutants`, `make fuzz`, `make soak`, `make hard-cases`, `make ports` and `make rivals`;
# included by the Makefile, which has their list and the variables of the build.

# Every tests/test_NAME.c is a program that includes the implementation, prints `N passed, N failed` as its last line
# and exits with 0 if none failed. It is built once for each configuration that lists it, and run in the top folder. A
# configuration whose compiler is not available is skipped, with a message. Long ones come first, since make runs them
# in this order, and what is short fills the cores at the end.
TESTS = $(patsubst tests/%.c,%,$(wildcard tests/test_*.c))
CONFIGURATIONS ?= wide_sanitized cpp plain glsl hlsl native

# Tests free and allocate large blocks often; kept by the C library, these need no new pages.
export MALLOC_MMAP_THRESHOLD_ ?= 1000000000
export MALLOC_TRIM_THRESHOLD_ ?= 4000000000

# -O2 takes 4 seconds more to compile than -O1; tests then run in a third to three quarters of the time
COMPILE_native    = gcc $(STANDARD) -O2 -march=native
comma = ,
SANITIZE = clang $(STANDARD) -O1 -gline-tables-only -fsanitize=address,undefined -fno-sanitize-recover=all
# In short tests, undefined behaviour traps, and the stack says where it was; of pointers, addresses are enough. That
# takes half of the time to compile.
TRAP = $(if $(SPLATSHADOW_LONG),,-fsanitize-trap=undefined -fno-sanitize=null,pointer-overflow,alignment,object-size)
export ASAN_OPTIONS ?= handle_sigill=1
# -Og takes half as long to compile as -O1, and few tests run there in short mode
SHORTER = $(if $(SPLATSHADOW_LONG),-O2,-Og)
COMPILE_wide_sanitized = $(SANITIZE) -march=native $(TRAP)
COMPILE_sanitized = $(SANITIZE) -DSPS_NO_SIMD
COMPILE_cpp       = g++ -x c++ -std=c++11 -D_POSIX_C_SOURCE=200809L $(SHORTER)
COMPILE_baseline  = gcc $(STANDARD) -O2
COMPILE_plain     = gcc $(STANDARD) $(SHORTER) -DSPS_NO_SIMD
COMPILE_threads   = clang $(STANDARD) -O1 -g -fsanitize=thread -march=native
# In plain C: clang 14 takes what most vector instructions answer for uninitialised if any lane of theirs is
COMPILE_memory    = clang $(STANDARD) -O1 -gline-tables-only -DSPS_NO_SIMD -fsanitize=memory
# As in the README; and the ways in which compilers contract a * b + c, which differ between these and the sanitized
# ones, except that clang is as wide_sanitized
COMPILE_readme    = cc -O3 -march=native
COMPILE_fused     = gcc $(STANDARD) -O1 -march=native -ffp-contract=fast
COMPILE_clang     = clang -O1 -march=native
# The test that runs examples/shaders/, in the shading languages instead of C
COMPILE_glsl      = $(COMPILE_cpp) -DSAMPLING_GLSL
COMPILE_hlsl      = $(COMPILE_cpp) -DSAMPLING_HLSL

# The tests of each configuration: all of them natively, with the same random scenes each time (`make fuzz-scenes` and
# `make soak` for others), except for the fuzzer's inputs, which are for sanitizers; under sanitizers, with vectors,
# those with most kinds of memory access; in C++, which has SSE2 here, and in plain C the most sensitive ones.
TESTS_native    = $(if $(SPLATSHADOW_LONG),$(TESTS),$(filter-out test_seeds,$(TESTS))) fuzz soak
MAP_TESTS = test_map_answers test_map_memory test_map_pictures test_map_states
TESTS_wide_sanitized = test_extremes test_hooks test_workers test_interface test_files test_inflate test_vdb test_nvdb test_ears test_polygons test_seeds $(MAP_TESTS) test_watertight
TESTS_cpp       = test_pictures test_arrays test_throwing test_simd
TESTS_plain     = test_transmittance test_arrays
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
# tests, a test itself is not optimised, which takes longer than it saves, unless it computes much. Natively, the object
# is, and its functions may be inlined: both take 18 seconds more to compile, and tests run in three quarters of the
# time. Where sanitizers are, calls cost little beside them, and functions are weak, as for `make mutants`.
SPLIT = native sanitized wide_sanitized cpp plain glsl hlsl threads memory baseline
SPLIT_CPP = cpp glsl hlsl
COMPUTING = test_area test_brackets test_cells test_filling test_particles test_reading test_sampling test_scattering test_spotlights test_spreading test_walls
optimize = $(if $(SPLATSHADOW_LONG)$(filter $(COMPUTING),$(1)),,-O0)
code = build/tests/$(if $(filter $(SPLIT_CPP),$(1)),cpp,$(1)).code.o
HEADER_native = build/tests/open.h
OPTIMIZE_native = -O3

# The header by itself, with every warning an error: compiler_standard_variant; examples likewise. To an object in C99
# and where clang has every variant, since some misuse of vector intrinsics is only found there (gcc's plain C has
# none); otherwise a syntax check is enough, except for the object that header.link links.
CHECK_COMPILERS = gcc clang
CHECK_STANDARDS = c99 $(if $(SPLATSHADOW_LONG),c11) c++11
CHECK_VARIANTS = plain sse2 avx2 avx512 face
STATIC_CHECKS = $(if $(SPLATSHADOW_LONG),gcc_c99_static clang_c99_static)
# After the standard headers, and macros of others
HOSTILE = -include tests/hostile.h
VARIANT_plain  = -DSPLATSHADOW_IMPLEMENTATION -DSPS_NO_SIMD $(HOSTILE)
VARIANT_sse2   = -DSPLATSHADOW_IMPLEMENTATION
VARIANT_static = -DSPLATSHADOW_IMPLEMENTATION -DSPS_API=static
VARIANT_avx2   = -DSPLATSHADOW_IMPLEMENTATION -mavx2 -mfma $(HOSTILE)
# gcc 12's own AVX-512 header warns of sign conversions where its intrinsics are macros, at -O0
VARIANT_avx512 = -Wno-sign-conversion -DSPLATSHADOW_IMPLEMENTATION -mavx512f -mavx512dq -mavx512bw -mavx512vl -mfma
ifeq ($(X86),)
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
ENGINE_CHECKS = gcc_c++17_godot clang_c11_godotclang clang_c++20_unreal clang_c11_chromium \
	$(if $(SPLATSHADOW_LONG),gcc_c11_godot clang_c++17_godotclang clang_c11_unreal clang_c++20_chromium)
# In short tests, gcc has every variant in C, clang those with vectors in C++, and each some in the other. Objects are
# made of what programs link, and of what clang checks; examples/dispatch.c has two variants
EVERY_CHECK = $(foreach c,$(CHECK_COMPILERS),$(foreach s,$(CHECK_STANDARDS),$(foreach v,$(CHECK_VARIANTS),$(c)_$(s)_$(v))))
SHORT_CHECKS = gcc_c99_% $(filter-out %_plain,$(filter clang_c++11_%,$(EVERY_CHECK))) gcc_c++11_sse2 clang_c99_face
CHECKS = $(if $(SPLATSHADOW_LONG),$(EVERY_CHECK),$(filter $(SHORT_CHECKS),$(EVERY_CHECK))) $(STATIC_CHECKS) $(ENGINE_CHECKS)
SYNTAX_ONLY = gcc_c99_plain $(if $(SPLATSHADOW_LONG),,gcc_c99_avx512)
EXAMPLE_CHECKS = $(foreach c,gcc $(if $(SPLATSHADOW_LONG),clang),$(foreach e,$(EXAMPLES:build/%=%) dispatch $(MEASURES),$(c)_$(e))) $(if $(SPLATSHADOW_LONG),,clang_hello)
HELLO_RUNS = $(if $(SPLATSHADOW_LONG),gcc clang)

part = $(word $(1),$(subst _, ,$(2)))
language = $(if $(findstring ++,$(1)),-x c++ -std=$(1) $(WARNINGS),-x c -std=$(1) $(WARNINGS_C)) -Werror

test:
	@command -v clang >/dev/null && command -v gcc >/dev/null && command -v g++ >/dev/null || { $(call fetch,gcc g++ clang libc6-dev); }
	@mkdir -p build/tests && $(call can_build,wide_sanitized) || { $(call fetch,libclang-rt-$$(clang -dumpversion | cut -d. -f1)-dev); }
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

# The same scenes by this library, Cycles, POV-Ray, vdb_render and VTK. Of the page, what stands before the results and
# from the next heading of its own on is kept.
.PHONY: rivals
rivals: build/measure/rivals
	@mkdir -p build/rivals
	sh tests/measure/rivals.sh > build/rivals/results.md
	@{ sed '/^## Results/,$$d' docs/rivals.md; cat build/rivals/results.md; echo; sed -n '/^## Fairness/,$$p' docs/rivals.md; } > build/rivals/page.md
	cp build/rivals/page.md docs/rivals.md

# The page counts the cases that the tests have.
build/tests/cases.log: docs/hard-cases.md tests/cases.awk $(wildcard tests/*.c tests/*.h)
	@$(call run,cases,awk -v mode=count -f tests/cases.awk $(wildcard tests/*.c) tests/check.h tests/fuzz.h docs/hard-cases.md && $(ONE_PASSED))

# Pages name functions that exist.
build/tests/names.log: splatshadow.h README.md $(wildcard docs/*.md)
	@$(call run,names,(for name in $$(grep -oh '`spsi_[a-z0-9_]*`' README.md docs/*.md | tr -d '`' | sort -u); do \
	grep -qw "$$name" splatshadow.h || { echo "splatshadow.h has no $$name"; exit 1; }; done) && $(ONE_PASSED))

# Tests whether a configuration's compiler is available and makes programs that run.
can_build = { test -e build/tests/ready_$(1) || { echo 'int main(void) { return 0; }' > build/tests/probe_$(1).c && \
	$(COMPILE_$(1)) build/tests/probe_$(1).c -o build/tests/probe_$(1) && build/tests/probe_$(1) && \
	touch build/tests/ready_$(1); }; } >/dev/null 2>&1

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
$(if $(STB_THERE),$(if $(filter native,$(READY)),$(foreach c,$(READY),$(eval build/tests/$(c).test_command_line.log build/tests/$(c).test_files.log build/tests/$(c).test_vdb.log build/tests/$(c).test_exr.log build/tests/$(c).test_blackbody.log build/tests/$(c).test_six_way.log build/tests/$(c).test_parts.log: build/tests/render) $(eval build/tests/$(c).test_parts.log: build/tests/join) \
	$(eval build/tests/$(c).test_six_way.log build/tests/$(c).test_bake.log build/tests/$(c).test_light_volume.log: build/tests/bake))))

# The program in plain C that test_simd compares itself with, linked once for several configurations
SIMD_PLAIN_THERE = $(if $(SPLATSHADOW_LONG),,$(if $(filter plain,$(READY)),build/tests/simd_plain))
$(if $(SIMD_PLAIN_THERE),$(foreach c,$(filter native cpp,$(READY)),\
	$(eval build/tests/$(c).test_simd.log: $(SIMD_PLAIN_THERE)) \
	$(eval build/tests/$(c).test_simd.log: export SIMD_PLAIN = $(SIMD_PLAIN_THERE))))

# The test that runs the steps of the tutorial, which are linked with the native configuration's header
READY_STEPS = $(if $(STB_THERE),$(if $(filter native,$(READY)),$(STEPS:%=build/tests/step.%.log)))
$(foreach c,$(READY),$(eval build/tests/$(c).test_tutorial.log: $(READY_STEPS)))

# What tests wait for. It is built before: make comes back to a test that had to wait only after all others, although
# some of these take long. What others are linked with comes first, so that neither core waits.
.PHONY: objects run-tests
objects: $(foreach c,$(filter native,$(READY)) $(filter-out native,$(filter $(SPLIT),$(READY))),$(call code,$(c))) $(SIMD_PLAIN_THERE) \
	$(if $(STB_THERE),$(if $(filter native,$(READY)),build/tests/render build/tests/bake build/tests/join)) \
	$(foreach c,$(filter $(PRECOMPILED),$(READY)),$(call precompiled,$(c)).gch)
run-tests: $(INSTALL_CHECKS_THERE:%=build/tests/install.%.log) $(foreach c,$(READY),$(TESTS_$(c):%=build/tests/$(c).%.log)) \
	$(READY_CHECKS:%=build/tests/header.%.log) $(READY_EXAMPLES:%=build/tests/example.%.log) $(READY_STEPS) \
	$(if $(filter native cpp,$(READY)),build/tests/header.link.log) build/tests/mutants.log build/tests/cases.log build/tests/names.log \
	$(if $(filter gcc,$(THERE)),build/tests/header.fast_math.log build/tests/header.no_reference.log $(if $(STB_THERE),build/tests/header.migrate.log)) build/tests/header.empty.log $(if $(filter clang,$(THERE)),build/tests/header.bits32.log) $(if $(TCC_THERE),build/tests/header.tcc.log) \
	$(if $(filter gcc,$(THERE)),build/tests/dispatch.log) $(SHADER_COMPILERS_THERE:%=build/tests/shaders.%.log)
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

# At -O2, gcc sees variables that may be unset: it warns of more than syntax checks and -O0 do.
.PRECIOUS: build/tests/%.code.o build/tests/%.pch/check.h.gch
build/tests/%.code.o: build/tests/weak.h build/tests/open.h
	@$(COMPILE_$*) $(OPTIMIZE_$*) $(if $(filter native plain,$*),-Wall -Wextra -Werror,-w) -DSPLATSHADOW_IMPLEMENTATION $(if $(filter cpp,$*),,-x c) -c $(or $(HEADER_$*),$<) -o $@

# Where it is compiled most often, check.h is compiled before, for the tests that are not optimised.
SPLIT_FLAGS = -Wall -Ibuild/tests/faces -DCHECK_HEADERS='"build/tests/faces"' $(INCLUDES) -Iexamples -Itests
PRECOMPILED = $(if $(SPLATSHADOW_LONG),,native wide_sanitized)
precompiled = $(if $(filter $(1),$(PRECOMPILED)),build/tests/$(1).pch/check.h)
build/tests/%.pch/check.h.gch: tests/check.h build/tests/faces/splatshadow.h
	@mkdir -p $(@D) && $(COMPILE_$*) -O0 $(SPLIT_FLAGS) -pthread -x c-header $< -o $@

define split_rules
build/tests/$(1).%.log: tests/%.c $$(HEADERS) $$(wildcard tests/*.h examples/shaders/*) $(call code,$(1)) build/tests/faces/splatshadow.h $(addsuffix .gch,$(call precompiled,$(1)))
	@$(call sized,$(1))$$(call run,$(1).$$*,$$(COMPILE_$(1)) $$(call optimize,$$*) $$(if $$(filter $$(COMPUTING),$$*),,$(addprefix -include ,$(call precompiled,$(1)))) \
		$$(SPLIT_FLAGS) $$< -x none $(call code,$(1)) -o build/tests/$(1).$$* $$(LIBRARIES) && build/tests/$(1).$$*)
endef
$(foreach configuration,$(filter-out $(SPLIT),$(CONFIGURATIONS)),$(eval $(call configuration_rules,$(configuration))))
$(foreach configuration,$(filter $(SPLIT),$(CONFIGURATIONS)),$(eval $(call split_rules,$(configuration))))

build/tests/weak.h build/tests/open.h: build/tests/%.h: splatshadow.h tests/mutants.awk
	@mkdir -p $(@D) && awk -v mode=$* -f tests/mutants.awk tests/mutants.txt $< > $@

build/tests/faces/splatshadow.h: splatshadow.h tests/mutants.awk
	@mkdir -p $(@D) && awk -v mode=faces -f tests/mutants.awk tests/mutants.txt $< > $@

# Included twice, which must be possible; the implementation once.
UNIT = printf '\#include "splatshadow.h"\n\#undef SPLATSHADOW_IMPLEMENTATION\n\#include "splatshadow.h"\nint unit(void);\nint unit(void) { return sps_version(); }\n'

build/tests/header.%.log: splatshadow.h tests/hostile.h
	@$(call run,header.$*,$(UNIT) | $(call part,1,$*) $(call language,$(call part,2,$*)) -O0 $(VARIANT_$(call part,3,$*)) \
		-I. $(if $(filter-out $(SYNTAX_ONLY),$(filter gcc_c99_% clang_c99_% clang_c++11_% gcc_c++11_sse2,$*)),-c -o build/tests/header.$*.o,-fsyntax-only) - && $(ONE_PASSED))

# A compiler of plain C and little else
build/tests/header.tcc.log: splatshadow.h
	@$(call run,header.tcc,$(UNIT) > build/tests/unit_tcc.c && tcc -std=c99 -Wall -Werror -DSPLATSHADOW_IMPLEMENTATION \
		-I. -c build/tests/unit_tcc.c -o build/tests/header.tcc.o && $(ONE_PASSED))

# The shaders, by shader compilers
build/tests/shaders.%.log: tests/shaders.sh docs/shadow_maps.md $(wildcard examples/shaders/*)
	@$(call run,shaders.$*,sh $< $* build/tests)

# The implementation without sps_reference, local to its file, and without a warning
build/tests/header.no_reference.log: tests/no_reference.c tests/check.h splatshadow.h
	@$(call run,header.no_reference,gcc $(STANDARD) -O0 $(WARNINGS_C) -Werror -DSPLATSHADOW_NO_REFERENCE -DSPS_API=static -I. $< \
		-o build/tests/no_reference $(LIBRARIES) && build/tests/no_reference)

# The tutorial of 0.3 compiles after docs/migrate.awk has renamed what 0.5 has. Structs have more members since.
build/tests/header.migrate.log: docs/migrate.awk docs/changelog.md splatshadow.h $(wildcard tests/tutorial_0_3/*.c examples/*.h)
	@$(call run,header.migrate,(mkdir -p build/tests/migrated; for f in tests/tutorial_0_3/*.c; do \
		awk -f docs/migrate.awk docs/changelog.md $$f | sed '/define SPLATSHADOW_IMPLEMENTATION/d' > build/tests/migrated/$${f##*/} && \
		gcc $(STANDARD) $(WARNINGS_C) -Werror -Wno-missing-field-initializers $(INCLUDES) -Iexamples -fsyntax-only build/tests/migrated/$${f##*/} || exit 1; \
		done) && $(ONE_PASSED))

# Where size_t has 32 bits, it is another type than uint64_t. Of glibc, a header of 32-bit stubs may be missing.
build/tests/header.bits32.log: splatshadow.h
	@$(call run,header.bits32,(mkdir -p build/tests/bits32/gnu && : > build/tests/bits32/gnu/stubs-32.h && \
		clang --target=i686-linux-gnu $(STANDARD) -msse2 -Wall -Wextra -Wpedantic -Werror -Ibuild/tests/bits32 \
		-isystem /usr/include/$$(gcc -print-multiarch) -DSPLATSHADOW_IMPLEMENTATION -x c -fsyntax-only $<) && $(ONE_PASSED))

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

build/tests/render build/tests/bake build/tests/join: build/tests/%: examples/%.c $(HEADERS) build/tests/native.code.o
	@$(COMPILE_native) $(call optimize,$@) $(INCLUDES) $< build/tests/native.code.o -o $@ $(LIBRARIES)

build/tests/simd_plain: tests/test_simd.c tests/check.h $(call code,plain) build/tests/faces/splatshadow.h
	@$(COMPILE_plain) -ffp-contract=off -w -Ibuild/tests/faces -I. $< $(call code,plain) -o $@ $(LIBRARIES)

# The implementation in one object, C as well as C++, and a plain user of it in another.
LINK_USER = printf '\#include "splatshadow.h"\nint main(void) { return sps_version() != SPS_VERSION; }\n' > link_user.c

build/tests/header.link.log: splatshadow.h build/tests/header.gcc_c99_sse2.log build/tests/header.gcc_c++11_sse2.log
	@$(call run,header.link,(cd build/tests && $(LINK_USER) && gcc -std=c99 -I../.. -c link_user.c && \
		gcc link_user.o header.gcc_c99_sse2.o -o link_c -lm && ./link_c && \
		gcc link_user.o header.gcc_c++11_sse2.o -o link_cpp -lm -lstdc++ && ./link_cpp) && $(ONE_PASSED))

# examples/dispatch.c, beside the objects of other rows, in C with the same flags, and in C++
DISPATCHED = $(if $(SPLATSHADOW_LONG),$(VARIANTS),$(filter-out avx512,$(VARIANTS)))
DISPATCH_PLAIN = $(if $(X86),$(DISPATCHED:%=gcc_c99_%)) $(if $(filter gcc,$(CPP_THERE)),gcc_c++11_sse2)
build/tests/dispatch.log: tests/dispatch.sh tests/dispatch.c tests/port_pictures.h tests/check.h examples/dispatch.c splatshadow.h $(DISPATCH_PLAIN:%=build/tests/header.%.log)
	@$(call run,dispatch,CC=gcc VARIANTS="$(DISPATCHED)" $(foreach v,$(DISPATCHED),FLAGS_$(v)="$(FLAGS_$(v))" \
		PLAIN_$(v)=build/tests/header.gcc_c99_$(v).o) PLAIN_cpp=build/tests/header.gcc_c++11_sse2.o sh $< build/tests/dispatch)

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
