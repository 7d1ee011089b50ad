#!/bin/sh
# make uses: what a program that calls only some functions compiles of the header, with SPS_API static: seconds of
# processor time of the compiler and bytes of code, in Markdown. CC=gcc FLAGS="-O2"
set -eu
cd "$(dirname "$0")/../.."
mkdir -p build
CC=${CC:-gcc}
FLAGS=${FLAGS:--O3 -march=native}
unit=build/uses.c object=build/uses.o

# row NAME FLAG FUNCTIONS...: functions are called through a table, so that nothing is left out
row() {
    name=$1 flag=$2
    shift 2
    {
        [ $# = 0 ] || echo '#define SPS_API static'
        printf '#define SPLATSHADOW_IMPLEMENTATION\n#include "splatshadow.h"\n'
        [ $# = 0 ] || { echo 'extern void (*const used[])(void);' && echo 'void (*const used[])(void) = {'; }
        for function in "$@"; do echo "(void (*)(void))$function,"; done
        [ $# = 0 ] || echo '};'
    } > $unit
    # shellcheck disable=SC2086
    seconds=$({ time -p $CC $flag $FLAGS -w -I. -c $unit -o $object; } 2>&1 | awk '$1 == "user" { print $2 }')
    bytes=$(size $object | awk 'NR == 2 { print $1 }')
    printf '| %s | %.1f s | %d KB |\n' "$name" "$seconds" $((bytes / 1000))
}

maps="sps_create sps_destroy sps_error sps_tmap_create sps_tmap_add sps_tmap_finish sps_tmap_destroy sps_tmap_query sps_tmap_texels sps_tmap_get_info sps_tmap_get_constants"
render="sps_create sps_destroy sps_error sps_render"
printf '`%s %s`\n\n| calls | compiler | code |\n|---|---|---|\n' "$CC" "$FLAGS"
row "everything" ""
row "everything, \`SPLATSHADOW_NO_REFERENCE\`" -DSPLATSHADOW_NO_REFERENCE
# shellcheck disable=SC2086
row "\`sps_render\`" "" $render
# shellcheck disable=SC2086
row "maps alone" "" $maps
