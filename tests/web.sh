# make test-web: the page of make web in headless Chromium, its pictures beside a native build's. Fetches what is missing
# where that is possible; skipped, with a sentence, without a browser or node. The last line is `N passed, N failed`.
has() { command -v "$1" > /dev/null; }
if ! has chromium || ! has node; then
    [ "$(id -u)" = 0 ] && has apt-get &&
        { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends chromium nodejs; } > /dev/null 2>&1
fi
if ! has chromium || ! has node; then
    echo "skipped: the page in a browser: install chromium and nodejs"
    echo "0 passed, 0 failed"
    exit 0
fi
# Of four lanes, as wasm has: wider ones may take a sweep of cells more or less, and differ by 1e-3.
CC="cc -std=c99 -D_POSIX_C_SOURCE=200809L -O2 -I. -Iexamples"
build=build/web
rm -f $build/map_*.bin $build/got_*.bin
if ! { $CC tests/web_pictures.c -o $build/pictures -lm -pthread && $build/pictures $build/native.bin &&
    $CC -Itests tests/test_map_shaders.c -o $build/maps -lm -pthread &&
    $build/maps write $build > $build/maps.log; }; then
    echo "0 passed, 1 failed"
    exit 1
fi
{ node tests/web.mjs $build; $build/maps judge $build; } 2>&1 | awk '
    /^[0-9]+ passed, [0-9]+ failed$/ { passed += $1; failed += $3; ends++; next }
    { print }
    END { failed += ends < 2; print passed " passed, " failed " failed"; exit failed > 0 }'
