#!/bin/sh
# make ports: builds the header for each target with a compiler for it, runs the tests of test_pictures there, under an
# emulator where it takes one, and compares five pictures with those of the native build. Prints a row per target; fails
# if a test does. TARGETS="name name" runs only these. Fetches what is missing where that is possible; a target whose
# compiler or emulator is not there is left out, with a message.

set -u
cd "$(dirname "$0")/.." || exit 1
BUILD=build/ports
C99="-std=c99 -D_POSIX_C_SOURCE=200809L"
WASI="--target=wasm32-wasi -D_WASI_EMULATED_PROCESS_CLOCKS -lwasi-emulated-process-clocks"
mkdir -p $BUILD
failed=0

# What wasm programs get from node: files of the current folder, and arguments.
cat > $BUILD/wasi.mjs <<'END'
import { readFile } from 'node:fs/promises';
import { WASI } from 'node:wasi';
const args = process.argv.slice(2);
const wasi = new WASI({ version: 'preview1', args, env: process.env, preopens: { '.': process.cwd() } });
const module = await WebAssembly.compile(await readFile(args[0]));
process.exit(wasi.start(await WebAssembly.instantiate(module, wasi.getImportObject())));
END

has() { command -v "$1" > /dev/null; }

fetch() {
    [ "$(id -u)" = 0 ] && has apt-get || return 0
    { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@"; } > /dev/null 2>&1
}

# NAME|compiler and flags|emulator|packages. An empty emulator: it runs as it is.
targets() {
    cat << END
x86-64, AVX-512 or what there is|gcc $C99 -O3 -march=native||gcc
x86-64, AVX2|gcc $C99 -O2 -mavx2 -mfma||gcc
x86-64, AVX2 without contraction|gcc $C99 -O2 -mavx2 -mfma -ffp-contract=off||gcc
x86-64, SSE2|gcc $C99 -O2||gcc
x86-64, plain C|gcc $C99 -O2 -DSPS_NO_SIMD||gcc
x86-64, SSE2, -Os|gcc $C99 -Os||gcc
x86-64, clang, SSE2|clang $C99 -O2||clang
x86-64, tcc|tcc $C99||tcc
x86-64, musl|musl-gcc $C99 -static -O2||musl-tools
C11|gcc -std=c11 -D_POSIX_C_SOURCE=200809L -O2||gcc
C17|gcc -std=c17 -D_POSIX_C_SOURCE=200809L -O2||gcc
C23|gcc -std=c2x -D_POSIX_C_SOURCE=200809L -O2||gcc
C++11|g++ -x c++ -std=c++11 -O2||g++
C++14|g++ -x c++ -std=c++14 -O2||g++
C++17|g++ -x c++ -std=c++17 -O2||g++
C++20|g++ -x c++ -std=c++20 -O2||g++
C++23|g++ -x c++ -std=c++2b -O2||g++
C++11 without exceptions and RTTI|g++ -x c++ -std=c++11 -O2 -fno-exceptions -fno-rtti||g++
32-bit x86, SSE2|i686-linux-gnu-gcc -static $C99 -O2 -msse2 -mfpmath=sse||gcc-i686-linux-gnu libc6-dev-i386-cross
32-bit x86, x87, plain C|i686-linux-gnu-gcc -static $C99 -O2||gcc-i686-linux-gnu libc6-dev-i386-cross
Windows, 64 bits, mingw|x86_64-w64-mingw32-gcc -static $C99 -O2|wine|gcc-mingw-w64-x86-64 wine wine64
wasm|clang $C99 -O2 $WASI|node --no-warnings $BUILD/wasi.mjs|clang lld wasi-libc libclang-rt-14-dev-wasm32 nodejs
wasm, SIMD|clang-19 $C99 -O3 -msimd128 $WASI|node --no-warnings $BUILD/wasi.mjs|clang-19 lld-19 wasi-libc libclang-rt-19-dev-wasm32 nodejs
aarch64, NEON|aarch64-linux-gnu-gcc -static $C99 -O2|qemu-aarch64|gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user
armhf, NEON|arm-linux-gnueabihf-gcc -static $C99 -O2 -mfpu=neon|qemu-arm|gcc-arm-linux-gnueabihf libc6-dev-armhf-cross qemu-user
armhf, plain C|arm-linux-gnueabihf-gcc -static $C99 -O2 -DSPS_NO_SIMD|qemu-arm|gcc-arm-linux-gnueabihf libc6-dev-armhf-cross qemu-user
s390x, big-endian|s390x-linux-gnu-gcc -static $C99 -O2|qemu-s390x|gcc-s390x-linux-gnu libc6-dev-s390x-cross qemu-user
END
}

is_there() { has "${compile%% *}" && { [ -z "$emulator" ] || has "${emulator%% *}"; }; }

# A compiler may be there without the library of its target.
build() {
    # shellcheck disable=SC2086
    $compile -I. tests/ports.c -o "$file.exe" -lm > "$file.log" 2>&1
}

# Builds and runs a target; prints its row.
run_target() {
    name=$1 compile=$2 emulator=$3 packages=$4
    file=$BUILD/$(echo "$name" | tr -c 'a-zA-Z0-9\n' _)
    rm -f "$file.exe"
    # shellcheck disable=SC2086
    { is_there && build; } || fetch $packages
    if ! is_there; then
        echo "skipped: $name: install $packages" >&2
        return
    fi
    if ! [ -e "$file.exe" ] && ! build; then
        echo "| $name | \`${compile%% *}\` | not built, see $file.log | | |"
        failed=1
        return
    fi
    # shellcheck disable=SC2086
    WINEDEBUG=-all $emulator "$file.exe" "$file.txt" > "$file.log" 2>&1 || failed=1
    tests=$(grep -a 'passed, [0-9]* failed' "$file.log" | tail -1 | tr -d '\r')
    difference=$($BUILD/native compare $BUILD/native.txt "$file.txt" 2>&1) || difference="no pictures"
    echo "| $name | \`${compile%% *}\`${emulator:+, \`${emulator%% *}\`} | ${tests:-none} | $difference |"
}

gcc $C99 -O2 -march=native -I. tests/ports.c -o $BUILD/native -lm && $BUILD/native $BUILD/native.txt > /dev/null || exit 1
echo "| target | compiler, emulator | tests of \`test_pictures\` | largest difference of five pictures, of their maximum |"
echo "|---|---|---|---|"
targets > $BUILD/targets
while IFS='|' read -r name compile emulator packages; do
    case " ${TARGETS:-} " in "  " | *" $(echo "$name" | tr -c 'a-zA-Z0-9\n' _) "*) run_target "$name" "$compile" "$emulator" "$packages" < /dev/null ;; esac
done < $BUILD/targets
exit $failed
