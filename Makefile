# make             builds every example into build/
# make demo        fetches missing packages if possible, builds, and renders all pictures into build/demo/
# make test        tests in four configurations, 4 minutes on two cores; ends with `N passed, N failed`
# make test-long   the same with nothing skipped natively, and in more configurations
# make fuzz        scenes, maps and files made of bytes, which libFuzzer draws, under sanitizers; SECONDS=600 JOBS=2 PLAIN=1
# make fuzz-scenes random scenes under sanitizers; COUNT=scenes SEED=first
# make soak        random scenes against the reference; COUNT=scenes SEED=first
# make mutants     deliberate errors in the header, and the test that notices each; LIMIT=2400 seconds, run again to continue
# make hard-cases  runs the tests of hard cases, and writes docs/hard-cases.md: expected, measured, tolerated, and why
# make ports       builds for other processors, systems and standards, tests under emulators, into docs/ports.md
# make rivals      the same scenes by other renderers, error and time and memory of each, into docs/rivals.md
# make bench       times, as ratios within one run, and error against time
# make speed       the goals of speed, and how time grows, into docs/speed.md and docs/speed_*.png; BEFORE=old header
# make accuracy    error and time of every knob in twelve scenes, into docs/accuracy.md and docs/accuracy_*.png
# make accuracy-quick  the scenes with a closed form and two knobs of it, in half a minute; SCENE=name: all of that scene
# make prices      the README's table: error and time of six scenes in the default mode
# make build/libsplatshadow.a  the library for every processor of a kind, chosen when a program runs: examples/dispatch.c
# make web         a page that renders in the browser, build/web/splatshadow.html; make test-web tries it in Chromium
# make uses        seconds and bytes of what a program compiles that calls only some functions
# make headline    a scene at three settings, docs/price.png, and the error and time of each
# make accuracy-tables  that page's tables of error against time of single effects
# make budget      what budgets of time and error promise, and what they keep, into docs/budget.md; 8 minutes
# make first-flights  the error of light from small sources, scene by scene and quality by quality; FIRE=rings: that one
# make maps        transmittance maps compared with each other, into docs/maps.md and docs/maps_*.png
# make six-way     a baked flipbook beside renders of its smoke, docs/six_way.png, and the difference of each light
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
EXAMPLES = $(patsubst examples/%.c,build/%,$(filter-out examples/dispatch.c,$(wildcard examples/*.c)))
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

# The implementation for every processor of a kind, examples/dispatch.c: once for each variant, and what chooses
X86 = $(filter x86_64 amd64 i%86,$(shell uname -m))
VARIANTS = $(if $(X86),sse2 avx2 avx512,plain $(if $(filter aarch64 arm64,$(shell uname -m)),neon))
FLAGS_plain = -DSPS_NO_SIMD
FLAGS_sse2 = -msse2 -mfpmath=sse
FLAGS_avx2 = -mavx2 -mfma
FLAGS_avx512 = -mavx512f -mavx512dq -mavx512bw -mavx512vl -mfma
build/dispatch.o $(VARIANTS:%=build/dispatch_%.o): examples/dispatch.c splatshadow.h | build
	$(CC) $(STANDARD) $(filter-out -march=%,$(OPTIMIZE)) $(if $(VARIANT),$(FLAGS_$(VARIANT)) -DVARIANT=$(VARIANT)) -I. -c $< -o $@
$(foreach variant,$(VARIANTS),$(eval build/dispatch_$(variant).o: VARIANT = $(variant)))

build/libsplatshadow.a: build/dispatch.o $(VARIANTS:%=build/dispatch_%.o)
	rm -f $@ && $(AR) rc $@ $^

build/tutorial/6_shadow_map: $(wildcard examples/shaders/*)

build/%: examples/%.c $(HEADERS) build/splatshadow.o | build build/tutorial
	@test -f $(STB)/stb_image_write.h || { echo "stb_image_write.h is missing: install libstb-dev, or say make STB=dir"; exit 1; }
	$(CC) $(STANDARD) $(OPTIMIZE) $(WARNINGS_C) $(INCLUDES) $< build/splatshadow.o -o $@ $(LIBRARIES)

build $(GALLERY) build/tests build/tutorial:
	mkdir -p $@

# ------------------------------------------------------------------------------------------------- in the browser

# clang 14 miscompiles vectors for wasm, so a newer one is taken. Another: make web WASM_CC=name
WASM_CC ?= clang-19
WASM_PACKAGES = clang-19 lld-19 libclang-rt-19-dev-wasm32 wasi-libc
WASM_LICENCES ?= /usr/share/doc/wasi-libc/copyright
WASM_FLAGS = --target=wasm32-wasi -mexec-model=reactor -O3 -msimd128 -Wl,--max-memory=1073741824,-z,stack-size=1048576,--stack-first,--strip-all

.PHONY: web test-web
web:
	@command -v $(WASM_CC) >/dev/null && test -f $(WASM_LICENCES) || { $(call fetch,$(WASM_PACKAGES)); }
	@command -v $(WASM_CC) >/dev/null || { echo "no compiler for wasm: install $(WASM_PACKAGES)"; exit 1; }
	@$(MAKE) -s --no-print-directory build/web/splatshadow.html
	@echo "Open build/web/splatshadow.html in a browser."

build/web/splatshadow.wasm: examples/web/web.c $(HEADERS)
	@mkdir -p build/web
	$(WASM_CC) $(STANDARD) $(WASM_FLAGS) -Wall -Wextra -I. $< -o $@ -lm

# The parts stand where the page names them; licences are those of the C library and what it is made of.
build/web/splatshadow.html: examples/web/page.html examples/web/page.js build/web/splatshadow.wasm
	base64 build/web/splatshadow.wasm > build/web/wasm.txt
	{ sed -n '/^.\* ==* >>licence/,$$p' splatshadow.h; cat $(WASM_LICENCES); } | sed 's/&/\&amp;/g; s/</\&lt;/g' > build/web/licences.txt
	awk 'function insert(file,  line) { while ((getline line < file) > 0) print line } \
		match($$0, /@[A-Z]+@/) { printf "%s", substr($$0, 1, RSTART - 1); part = substr($$0, RSTART, RLENGTH); \
			insert(part == "@WASM@" ? "build/web/wasm.txt" : part == "@SCRIPT@" ? "examples/web/page.js" : "build/web/licences.txt"); \
			print substr($$0, RSTART + RLENGTH); next } { print }' examples/web/page.html > $@

test-web: web
	@sh tests/web.sh

# ---------------------------------------------------------------------------------------------------- pictures

SCENES = mushrooms dart tree pot smoke_room fire turbulence metaballs cloud_mesh fog puff turntable lamp penumbra panes steam slide textured cloud_light fog_room above_clouds
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

# In the demo, comparisons with random paths are smaller, and so is what takes longest.
ifdef QUICK
WIDTH_cloud_light = --width 480
WIDTH_fog_room = --width 480
WIDTH_above_clouds = --width 480
WIDTH_steam = --width 480
WIDTH_fire = --width 320
endif

gallery: $(PICTURES) $(SOFT_PICTURES)

$(GALLERY)/soft_%.png: build/% | $(GALLERY)
	build/$* --soft $(SOFT_$*) --out $@

$(GALLERY)/%.png: build/% | $(GALLERY)
	build/$* $(WIDTH_$*) --out $@

# The pictures of the README, the manual and the tutorial. They have no prerequisites, and are always rendered again.
DOCS_PICTURES = tree smoke_room fire pot turntable penumbra panes slide textured cloud_light
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

build/measure/%: tests/measure/%.c $(HEADERS) $(wildcard tests/measure/*.h examples/shaders/*) tests/flames.h build/splatshadow.o | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(WARNINGS_C) $(INCLUDES) -Iexamples -Itests $< build/splatshadow.o -o $@ $(LIBRARIES)

# See the top of tests/measure/bench.c for its parts. bench_plain is plain C, bench_avx2 has vectors of 8 floats at most,
# and bench_dispatch chooses. BEFORE=path/splatshadow.h: bench_before is of that header, and its frames stand beside ours.
.PHONY: bench speed accuracy accuracy-quick accuracy-tables FORCE
BUILDS = bench bench_dispatch $(if $(X86),bench_avx2) bench_plain
BENCHES = $(patsubst %,build/measure/%,$(BUILDS) $(if $(BEFORE),bench_before))

bench: $(BENCHES) build/measure/files
	build/measure/bench
	build/measure/files
	@$(COMPARE_DEFAULT)
	@$(COMPARE_BUILDS)
	build/measure/bench_plain maps

build/before/splatshadow.h: FORCE
	@mkdir -p $(@D) && { cmp -s $(BEFORE) $@ || cp $(BEFORE) $@; }

build/before/splatshadow.o: build/before/splatshadow.h
	$(CC) $(STANDARD) $(OPTIMIZE) -DSPLATSHADOW_IMPLEMENTATION -x c -c $< -o $@

build/measure/bench_before: tests/measure/bench.c build/before/splatshadow.o $(HEADERS) $(wildcard tests/measure/*.h) | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(WARNINGS_C) -Ibuild/before $(INCLUDES) -Iexamples $< build/before/splatshadow.o -o $@ $(LIBRARIES)

build/measure/bench_plain: ONLY = -DSPS_NO_SIMD
build/measure/bench_avx2: ONLY = -mno-avx512f
build/measure/bench_plain build/measure/bench_avx2: tests/measure/bench.c $(HEADERS) $(wildcard tests/measure/*.h) | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(ONLY) -DSPLATSHADOW_IMPLEMENTATION $(WARNINGS_C) $(INCLUDES) -Iexamples $< -o $@ $(LIBRARIES)

build/measure/bench_dispatch: tests/measure/bench.c $(HEADERS) $(wildcard tests/measure/*.h) build/libsplatshadow.a | build/measure
	$(CC) $(STANDARD) $(OPTIMIZE) $(INCLUDES) -Iexamples $< build/libsplatshadow.a -o $@ $(LIBRARIES)

# Rows of both tables, by builds that take turns.
TURNS = sh tests/measure/turns.sh
COMPARE_DEFAULT = $(TURNS) before $(if $(BEFORE),bench_before) bench; $(if $(X86),GOAL='<= 1.2' $(TURNS) single bench bench_avx2)
COMPARE_BUILDS = $(TURNS) frames $(BUILDS)

# Of the page, what stands before the first printed line and from the next heading of its own on is kept. Charts stand
# for the tables of curves.
speed: $(BENCHES)
	{ build/measure/bench default; $(COMPARE_DEFAULT); build/measure/bench goals | sed 1d; $(COMPARE_BUILDS); \
		build/measure/bench curves docs; } | tee build/speed.txt
	@{ sed '/^[0-9]* processors/,$$d' docs/speed.md; sed '/^## Curves/,$${/^|/d;}' build/speed.txt | cat -s; echo; sed -n '/^## Advice/,$$p' docs/speed.md; } > build/speed.md
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

# What SPS_API static leaves out
.PHONY: uses
uses:
	@CC="$(CC)" sh tests/measure/uses.sh

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

# Bytes per set voxel.
.PHONY: sparse
sparse: build/measure/sparse
	build/measure/sparse

# The program prints all figures, of which the page has those of one size, and draws pictures into build/maps/.
.PHONY: maps
maps: build/measure/maps
	@mkdir -p build/maps && rm -f build/maps.failed
	{ build/measure/maps docs build/maps || touch build/maps.failed; } | tee build/maps.txt
	@test ! -e build/maps.failed && awk -f tests/measure/maps.awk build/maps.txt > docs/maps.md

# The flipbook's frames come from the program, which afterwards reads the textures baked of them.
.PHONY: six-way
SIX_WAY = build/six_way
six-way: build/measure/six_way build/bake
	@mkdir -p $(SIX_WAY)
	build/measure/six_way smoke $(SIX_WAY)
	build/bake six-way --volume $(SIX_WAY)/smoke%03d.nrrd --frames 0,1 --tile 80 --scale 12 --texels unorm8 \
		--out-a $(SIX_WAY)/a.dds --out-b $(SIX_WAY)/b.dds
	build/measure/six_way compare $(SIX_WAY) 12 docs/six_way.png

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

# Tests, and documents that are made of what they print
include $(wildcard tests/tests.mk)

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
