# sh tests/install.sh CHECK FOLDER: installs into FOLDER and builds the quick start from there. CHECK is `make` (make
# install and uninstall only), `pkg-config`, or `cmake` (examples/cmake/, by itself and from a project that fetches it).
# CC and MAKE are in the environment. The last line is `1 passed, 0 failed`, or the error of what failed.

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

check_make() {
    "$MAKE" install DESTDIR="$folder/root" PREFIX=/opt/splatshadow
    cmp splatshadow.h "$folder/root/opt/splatshadow/include/splatshadow.h"
    "$MAKE" uninstall DESTDIR="$folder/root" PREFIX=/opt/splatshadow
    test -z "$(find "$folder/root" -type f)"
}

# pkg-config and the compiled library report the same version.
check_pkg_config() {
    "$MAKE" install PREFIX="$folder/prefix"
    export PKG_CONFIG_PATH="$folder/prefix/share/pkgconfig"
    write_version "$folder/version.c"
    "$CC" -std=c99 $(pkg-config --cflags splatshadow) "$folder/version.c" -o "$folder/version" $(pkg-config --libs splatshadow)
    test "$("$folder/version")" = "$(pkg-config --modversion splatshadow)"
}

build_by_cmake() { # source, folder, optimisation
    cmake -S "$1" -B "$2" -DCMAKE_C_COMPILER="$CC" -DCMAKE_BUILD_TYPE=Release -DCMAKE_C_FLAGS_RELEASE="$3"
    cmake --build "$2"
}

# The quick start is built; other tests run it. A project that fetches the library is built and run.
check_cmake() {
    build_by_cmake examples/cmake "$folder/alone" -O0
    test -x "$folder/alone/hello"
    mkdir -p "$folder/consumer"
    write_version "$folder/consumer/version.c"
    cat > "$folder/consumer/CMakeLists.txt" << CMAKE
cmake_minimum_required(VERSION 3.18)
project(consumer LANGUAGES C)
include(FetchContent)
FetchContent_Declare(splatshadow SOURCE_DIR "$top" SOURCE_SUBDIR examples/cmake)
FetchContent_MakeAvailable(splatshadow)
add_executable(version version.c)
target_link_libraries(version PRIVATE splatshadow::splatshadow)
CMAKE
    build_by_cmake "$folder/consumer" "$folder/fetched" -O0
    "$folder/fetched/version"
}

case $1 in
make) check_make ;;
pkg-config) check_pkg_config ;;
cmake) check_cmake ;;
esac
echo "1 passed, 0 failed"
