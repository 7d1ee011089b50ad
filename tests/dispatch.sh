# sh tests/dispatch.sh FOLDER: examples/dispatch.c, compiled in FOLDER for each of VARIANTS, by FLAGS_sse2 and such.
# - A variant exports the library's functions under its name, and nothing that a linker may share among variants. The
#   same holds of the header in C++, PLAIN_cpp. It has its own vectors and no wider ones.
# - Its pictures are those of the header compiled alone, PLAIN_sse2 and such, bit for bit. Variants differ as
#   docs/ports.md says. What the processor lacks is not chosen.
# - The arguments of dispatch.c are its parameters, in their order.
# CC and these names are in the environment; a PLAIN that is not there is compiled. The last line is
# `1 passed, 0 failed`, or the error of what failed.

set -e
mkdir -p "$1"
folder=$1
COMPILE="$CC -std=c99 -D_POSIX_C_SOURCE=200809L -O0 -I."
WARN="-Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wmissing-prototypes -Werror"
[ -n "${SPLATSHADOW_LONG:-}" ] || WARN=-w # other checks of the header have them

fail() {
    echo "$*"
    exit 1
}

value_of() { eval "echo \"\$$1\""; }

# Names of an object that a linker sees, a line each: name and type
exported() { nm -P -g "$1" | awk '$2 != "U" { sub(/^_/, "", $1); print $1, $2 }' | sort; }

# The library's functions, with what follows their names
functions() {
    awk -v end="$1" '/^#ifdef SPLATSHADOW_IMPL/ { exit }
        /^SPS_API / { sub(/\(.*/, ""); sub(/.*[ *]/, ""); print $0 end }' splatshadow.h | sort
}

# Whether this processor has what a variant needs, as the system tells
supported() {
    case $1 in
    avx2) grep -qw avx2 /proc/cpuinfo && grep -qw fma /proc/cpuinfo ;;
    avx512) supported avx2 && grep -w avx512f /proc/cpuinfo | grep -w avx512dq | grep -w avx512bw | grep -qw avx512vl ;;
    *) true ;;
    esac
}

# A variant's instructions name none of the registers that are wider than its own, but its own.
check_vectors() { # variant, object
    objdump -d "$2" > "$folder/code.txt"
    case $1 in
    sse2) grep -q '%xmm' "$folder/code.txt" && ! grep -Eq '%[yz]mm|\sv[a-z0-9]+[ps][sd] ' "$folder/code.txt" ;;
    avx2) grep -q '%ymm' "$folder/code.txt" && ! grep -Eq '%zmm|%k[0-7]' "$folder/code.txt" ;;
    avx512) grep -q '%zmm' "$folder/code.txt" ;;
    esac || fail "$1 has vectors of others"
}

build_variant() { # variant
    flags=$(value_of "FLAGS_$1") object=$folder/$1.o
    $COMPILE $WARN $flags "-DVARIANT=$1" -c examples/dispatch.c -o "$object"
    functions "_$1 T" > "$folder/expected.txt"
    exported "$object" | diff "$folder/expected.txt" - || fail "$1 exports other names than the library's functions"
    check_vectors "$1" "$object"
    plain=$(value_of "PLAIN_$1")
    if ! [ -e "$plain" ]; then
        plain=$folder/plain_$1.o
        $COMPILE $flags -w -DSPLATSHADOW_IMPLEMENTATION -x c -c splatshadow.h -o "$plain"
    fi
    "$CC" "$folder/program.o" "$plain" -o "$folder/plain_$1" -lm
}

# A program for which the variants up to number `most` are there to choose from, and no other
check_choice() { # most, variant
    $COMPILE $WARN "-DDISPATCH_MOST=$1" -c examples/dispatch.c -o "$folder/choose.o"
    functions " T" > "$folder/expected.txt"
    exported "$folder/choose.o" | diff "$folder/expected.txt" - || fail "dispatch.c lacks functions"
    "$CC" "$folder/program.o" "$folder/choose.o" $objects -o "$folder/chosen_$2" -lm ||
        fail "more is wanted than $objects"
    "$folder/chosen_$2" "$folder/chosen_$2.txt"
    supported "$2" && best=$2
    [ -e "$folder/plain_$best.txt" ] || "$folder/plain_$best" "$folder/plain_$best.txt"
    cmp "$folder/chosen_$2.txt" "$folder/plain_$best.txt" || fail "up to $2, $best does not run"
    [ "${before:-$best}" = "$best" ] || check_difference "$folder/plain_$before.txt" "$folder/plain_$best.txt"
    before=$best
}

# Vectors of other widths round differently, but not by more than docs/ports.md says: with multiple scattering, by no
# more than the residual that its solver tolerates.
check_difference() { # pictures, pictures
    difference=$("$folder/plain_$best" compare "$1" "$2")
    echo "$1 and $2 differ by $difference"
    echo "$difference" | awk '{ exit !($1 + 0 > 0 && $1 + 0 <= ($0 ~ /multiple/ ? 5e-4 : 1e-5)) }' ||
        fail "it is not as ports.md says"
}

# Of all entries, names of parameters and arguments
check_arguments() {
    awk '/^(FUNCTION|PROCEDURE)\(/ { inside = 1; entry = "" } inside { entry = entry $0 } inside && /\)\)$/ {
            inside = 0
            ++entries
            split(entry, part, /, *\(|\)(, *|\)$)/) # before the parameters, parameters, (arguments
            gsub(/\[[0-9]*\]/, "", part[2])
            count = split(part[2], parameter, ",")
            names = ""
            arguments = substr(part[3], 2)
            for (i = 1; i <= count; ++i) {
                sub(/.*[ *]/, "", parameter[i])
                names = names (i > 1 ? "," : "") parameter[i]
            }
            gsub(/ /, "", arguments)
            if (names != (arguments == "" ? "void" : arguments)) { print entry; bad = 1 }
        }
        END { exit bad || entries < 20 }' examples/dispatch.c || fail "arguments are not in the order of the parameters"
}

check_arguments
if [ -e "$PLAIN_cpp" ]; then
    exported "$PLAIN_cpp" | grep -v ' [TRDB]$' && fail "the header has functions in C++ that linkers share"
fi
$COMPILE -Wall -Iexamples -Itests -DSPSI_IMPLEMENTED -c tests/dispatch.c -o "$folder/program.o"
objects= best= before= most=0
for variant in $VARIANTS; do
    build_variant "$variant"
    objects="$objects $folder/$variant.o"
    check_choice $most "$variant"
    most=$((most + 1))
done
echo "1 passed, 0 failed"
