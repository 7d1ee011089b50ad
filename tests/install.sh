# sh tests/install.sh CHECK FOLDER: what the README says about building, in FOLDER. CHECK is `make` (make install and
# uninstall only), `pkg-config`, `cmake` (examples/cmake/, by itself and from a project that fetches it), `readme` (the
# quick start's command, and that every make target that the documents name exists), or `code` (the C of the documents
# but for the tutorial, which a test of its own compares with its programs). Commands and code are read from the
# documents themselves. CC and MAKE are in the environment. The last line is `1 passed, 0 failed`, or the error of what
# failed.

set -ex
unset MAKEFLAGS MFLAGS MAKELEVEL MAKEOVERRIDES
mkdir -p "$2"
folder=$(cd "$2" && pwd) top=$(pwd)

# A program that prints the version of the compiled library, and fails if its header has another one
write_version() {
    cat > "$1" << 'C'
#define SPLATSHADOW_IMPLEMENTATION
#include <splatshadow.h>
#include <stdio.h>
int main(void) {
    printf("%d.%d.%d\n", sps_version() / 10000, sps_version() / 100 % 100, sps_version() % 100);
    return sps_version() != SPS_VERSION;
}
C
}

# The README's indented command that has these words; its compiler is ours.
command_with() {
    awk -v words="$1" '/^    / && index($0, words) { print substr($0, 5); exit }' "$top/README.md" | sed "s|^cc |$CC |" | grep .
}

# Code of a document in the language given, from the fence to the next
code_of() { # language, document
    awk -v begin="\`\`\`$1" '$0 == begin { inside = 1; next } /^```/ { inside = 0 } inside' "$2" | grep . # fails if empty
}

check_make() {
    "$MAKE" install DESTDIR="$folder/root" PREFIX=/opt/splatshadow
    cmp splatshadow.h "$folder/root/opt/splatshadow/include/splatshadow.h"
    "$MAKE" uninstall DESTDIR="$folder/root" PREFIX=/opt/splatshadow
    test -z "$(find "$folder/root" -type f)"
}

# pkg-config and the compiled library report the same version. The long tests build the quick start by it.
check_pkg_config() {
    "$MAKE" install PREFIX="$folder/prefix"
    export PKG_CONFIG_PATH="$folder/prefix/share/pkgconfig"
    write_version "$folder/version.c"
    "$CC" -std=c99 $(pkg-config --cflags splatshadow) "$folder/version.c" -o "$folder/version" $(pkg-config --libs splatshadow)
    test "$("$folder/version")" = "$(pkg-config --modversion splatshadow)"
    cd "$folder" && ln -sfn "$top/examples" examples
    command_with pkg-config
    [ -n "${SPLATSHADOW_LONG:-}" ] || return 0
    eval "$(command_with pkg-config | sed 's/-O3/-O0/')"
    test -x hello
}

build_by_cmake() { # source, folder
    cmake -S "$1" -B "$2" -DCMAKE_C_COMPILER="$CC" -DCMAKE_BUILD_TYPE=Release -DCMAKE_C_FLAGS_RELEASE=-O0
    [ -z "${SPLATSHADOW_LONG:-}" ] || cmake --build "$2"
}

# The quick start, and a project that fetches the library: both are configured; in the long tests, they are also built
# and run, and the project once more with the library for every processor. Other tests run the quick start.
check_cmake() {
    build_by_cmake examples/cmake "$folder/alone"
    mkdir -p "$folder/consumer"
    write_version "$folder/consumer/version.c"
    {
        echo 'cmake_minimum_required(VERSION 3.18)'
        echo 'project(consumer LANGUAGES C)'
        echo 'add_executable(program version.c)'
        code_of cmake README.md | sed "s|path/to/this/tree|\"$top\"|"
    } > "$folder/consumer/CMakeLists.txt"
    build_by_cmake "$folder/consumer" "$folder/fetched"
    [ -n "${SPLATSHADOW_LONG:-}" ] || return 0
    test -x "$folder/alone/hello"
    "$folder/fetched/program"
    sed -i 's/splatshadow::splatshadow/splatshadow::dispatch/' "$folder/consumer/CMakeLists.txt"
    sed -i '/IMPLEMENTATION/d' "$folder/consumer/version.c"
    build_by_cmake "$folder/consumer" "$folder/dispatched"
    "$folder/dispatched/program"
}

# The picture of the quick start has a header and 3 numbers, 0 to 255, for each pixel, and is not black.
check_readme() {
    targets=$(grep -oh '`make [a-z-]*' README.md docs/*.md | sed 's/.* //' | sort -u)
    test -n "$targets"
    known=$("$MAKE" -pRrq : 2> /dev/null | awk -F: '/^[a-z-]+:/ { print $1 }' | sort -u)
    for target in $targets; do echo "$known" | grep -qx "$target"; done
    cd "$folder" && ln -sfn "$top/examples" examples && ln -sfn "$top/splatshadow.h" splatshadow.h
    eval "$(command_with examples/hello.c | sed 's/-O3/-O0/')"
    awk 'NR == 1 { good = $0 == "P3 256 256 255"; next }
        { for (i = 1; i <= NF; ++i) { ++n; bright += $i > 99; good = good && $i >= 0 && $i <= 255 } }
        END { exit !(good && n == 3 * 256 * 256 && bright >= 256) }' blob.ppm
}

# Indented C of a document, each piece a block; a piece that begins a function is one, and what follows it a block.
# Indented formulas have no semicolon.
pieces_of() { # document
    awk 'function end() {
            if (piece ~ /;/ && piece ~ /^static int /) sub(/\n}\n/, "\n}\nvoid piece" ++n "(void);\nvoid piece" n "(void) {\n", piece)
            else if (piece ~ /;/) piece = "void piece" ++n "(void);\nvoid piece" n "(void) {\n" piece
            if (piece ~ /;/) print piece "}"
            piece = ""
        }
        /^```/ { fenced = !fenced }
        /^    / && !fenced { piece = piece substr($0, 5) "\n"; next }
        { end() }
        END { end() }' "$1" | grep .
}

# What the manual's pieces speak of
write_surroundings() {
    cat << 'C'
#include "splatshadow.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
static sps_context *context;
static sps_scene scene;
static sps_view view;
static sps_image image;
static sps_volume volume, smoke;
static sps_light sun, lamp, lights[1];
static sps_mesh mesh, pane;
static unsigned short scan[1];
static int n, my_image, my_texture;
static size_t width, height;
static float *lower, *upper;
static float *sky, *l0, *l1, *through;
static double *positions;
static size_t count;
int my_read(void *user, const int lo[3], const int size[3], float *out);
int my_range(void *user, const int lo[3], const int size[3], float out_min_max[2]);
int my_color(void *user, size_t count, const float *uv, float *out);
void my_texture_sample(void *user, const double uv[2], const float dx[2], const float dy[2], float color[3]);
C
}

# Each piece inside a function that has what the text around it speaks of.
check_code() {
    {
        printf '#include "splatshadow.h"\n#include <stdio.h>\n'
        printf 'double now(void *user);\nvoid glNamedBufferStorage(unsigned buffer, size_t size, const void *data, unsigned flags);\n'
        printf 'int budget(sps_context *context, sps_config config, sps_scene scene, sps_view view, sps_image image, sps_stats_report stats);\n'
        printf 'int budget(sps_context *context, sps_config config, sps_scene scene, sps_view view, sps_image image, sps_stats_report stats) {\n'
        code_of c docs/budget.md
        printf '(void)config; return 0;\n}\nvoid upload(sps_tmap *map, unsigned block, unsigned texels, unsigned surfaces, unsigned fronts, unsigned planes, unsigned starts);\n'
        printf 'void upload(sps_tmap *map, unsigned block, unsigned texels, unsigned surfaces, unsigned fronts, unsigned planes, unsigned starts) {\n'
        code_of c docs/shadow_maps.md
        printf '}\n'
    } > "$folder/code.c"
    "$CC" -std=c99 -Wall -Wextra -Werror -I. -fsyntax-only "$folder/code.c"
    for page in docs/*.md; do # fences elsewhere would be read by nothing
        case $page in docs/budget.md | docs/shadow_maps.md | docs/tutorial.md) continue ;; esac
        if grep '^```c$' "$page"; then exit 1; fi
        { write_surroundings && pieces_of "$page"; } > "$folder/page.c" || continue # it has none
        "$CC" -std=c99 -Wall -Wextra -Werror -Wno-unused -I. -fsyntax-only "$folder/page.c"
        read=$((${read:-0} + $(grep -c '(void);$' "$folder/page.c")))
    done
    test "$read" -ge 10
}

case $1 in
make) check_make ;;
pkg-config) check_pkg_config ;;
cmake) check_cmake ;;
readme) check_readme ;;
code) check_code ;;
esac
echo "1 passed, 0 failed"
