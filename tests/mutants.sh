#!/bin/sh
# make mutants: builds the deliberate errors of tests/mutants.txt into the header, one at a time, and runs the native
# tests until one of them notices. Prints a table; fails if fewer than 90 % are noticed, or if one that is not has no
# reason in the list.
#
#   sh tests/mutants.sh check     checks that every entry still applies; prints `N passed, N failed`
#   sh tests/mutants.sh run       runs all entries; run again to continue after LIMIT seconds
#   sh tests/mutants.sh show 12   shows the change of entry 12
#   sh tests/mutants.sh record    writes the tests that noticed into the list
#
# LIST=tests/blind_2.txt runs another list: entries by authors who had not read the tests, which were not written for
# them; it is the share that is noticed which counts. CHAPTER="tag tag" runs only what is in these chapters of the
# header, JOBS= is the number of parallel jobs, LIMIT= seconds after which no more are started, HANG= seconds of
# processor time after which a test counts as hanging, COMPILE= the compiler of the Makefile's native tests.
#
# One object has the whole header with every function weak, and each test is compiled once, against a header without
# bodies. A mutant is then the object of one function, which replaces the weak one: a second, while building the header
# takes seven. If the error is in a macro, a type or an inline function, everything is rebuilt.
#
# build/mutants/results has the results, keyed by a checksum of header, tests and entry; build/mutants/last the test that
# noticed an entry last, which is run first the next time, before those that the list has for it and for others of its
# function or chapter: the part of a test takes a second, while one test after the other until one notices takes ten.
# Entries of which the list has none come first, and those that no test need notice last.

set -u
cd "$(dirname "$0")/.." || exit 1
LIST=${LIST:-tests/mutants.txt}
ORDERS=tests/mutants.txt
STB=${STB:-/usr/include/stb}
COMPILE=${COMPILE:-gcc -std=c99 -D_POSIX_C_SOURCE=200809L -O2 -march=native}
JOBS=${JOBS:-2}
LIMIT=${LIMIT:-2400}
HANG=${HANG:-120}
CHAPTER=${CHAPTER:-}
OUT=build/mutants
INCLUDES="-isystem $STB -Iexamples -Itests"
TESTS=$(ls tests/test_*.c tests/fuzz.c | sed 's|tests/||; s|\.c$||')

text() { # mode, entry
    awk -v mode="$1" -v entry="${2:-0}" -v chapter="${3:-}" -v noticed=$OUT/noticed -f tests/mutants.awk \
        $LIST splatshadow.h
}

# As text(), from the list that tests were written for
orders() { (LIST=$ORDERS; text "$@"); }

checksum() { cksum | tr ' ' '-'; }

# ---- building ----

# $(compile header folder, source, object)
compile() { $COMPILE -w -I"$1" -DCHECK_HEADERS="\"$1\"" $INCLUDES -c "$2" -o "$3"; }

implementation() { # folder, header: its object
    printf '#define SPLATSHADOW_IMPLEMENTATION\n#include "%s"\n' "$2" > "$1/code.c"
    compile "$1" "$1/code.c" "$1/code.o"
}

# Objects shared by all mutants. A test that fails without a mutant cannot detect one, and is skipped.
build_common() {
    [ "$(cat $OUT/common/stamp 2>/dev/null)" = "$STATE" ] && return
    rm -rf $OUT/common && mkdir -p $OUT/common/faces
    text weak > $OUT/common/weak.h
    text faces > $OUT/common/faces/splatshadow.h
    implementation $OUT/common weak.h || return 1
    for test in $TESTS; do
        compile $OUT/common/faces tests/$test.c $OUT/common/$test.o || return 1
    done
    : > $OUT/common/failing
    for test in $TESTS; do
        link $OUT/common $test $OUT/common/code.o $OUT/common/$test.o || return 1
        run_test $OUT/common/$test $OUT/common/$test.txt || echo "$test" >> $OUT/common/failing
    done
    echo "$STATE" > $OUT/common/stamp
}

link() { # folder, test, objects
    folder=$1 linked=$2
    shift 2
    $COMPILE "$@" -o "$folder/$linked" -pthread -lm
}

run_test() { # program, output
    (ulimit -t "$HANG"; ulimit -v 12000000; CHECK_STOP=1 "$1") > "$2" 2>&1
}

# The mutant's objects in $1: code.o, to be linked before the common one, or instead of it if `whole` exists.
build_mutant() { # folder, entry, function
    rm -rf "$1" && mkdir -p "$1/faces"
    if [ "$3" = - ]; then
        text mutated "$2" > "$1/whole.h"
        text faces "$2" > "$1/faces/splatshadow.h"
        implementation "$1" whole.h
    else
        text function "$2" > "$1/part.h"
        implementation "$1" part.h
    fi
}

link_mutant() { # folder, test
    if [ -e "$1/whole.h" ]; then
        compile "$1/faces" "tests/$2.c" "$1/$2.o" && link "$1" "$2" "$1/code.o" "$1/$2.o"
    else
        link "$1" "$2" "$1/code.o" "$OUT/common/$2.o" $OUT/common/code.o
    fi
}

# ---- running ----

# The tests that an entry is run with: the one that noticed it last, those that noticed others of its chapter, the rest.
order() { # chapter, test
    { echo "$2"; orders order 0 "$1"; echo "$TESTS"; } | awk 'NF && !seen[$1]++' |
        while read -r name; do is_test "$name" && echo "$name"; done
}

is_test() { echo "$TESTS" | grep -qx "$1"; }

# The part of a test that failed: the last that it began, or, if it does not name them, the line of the check.
part() { # output
    awk '/^running / { name = $2 } /: failed: / && !line { sub(/: failed.*/, ""); sub(/^tests\//, ""); line = $0 }
        END { print name != "" ? name : line != "" ? line : "crash" }' "$1"
}

# Prints the test that noticed, and the part of it; nothing if none did.
notice() { # folder, chapter, file with what is likely to notice
    first=
    while read -r likely part; do
        first=${first:-$likely}
        is_test "$likely" && grep -q "RUN($part)" "tests/$likely.c" || continue
        [ -e "$1/$likely" ] || link_mutant "$1" "$likely" || { echo "does not compile"; return; }
        CHECK_ONLY=$part run_test "$1/$likely" "$1/$likely.txt" || { echo "$likely $part"; return; }
    done < "$3"
    for test in $(order "$2" "$first"); do
        [ -e "$1/$test" ] || link_mutant "$1" "$test" || { echo "does not compile"; return; }
        run_test "$1/$test" "$1/$test.txt" && continue
        echo "$test $(part "$1/$test.txt")"
        return
    done
}

result_of() { # entry
    { echo "$STATE"; text entry "$1"; } | checksum
}

last_of() { # entry
    echo "$OUT/last/$(text entry "$1" | checksum)"
}

run_entry() { # worker, entry, chapter, function, line of the header
    result=$OUT/results/$(result_of "$2")
    last=$(last_of "$2")
    [ -e "$result" ] && return
    mkdir "$OUT/taken/$2" 2>/dev/null || return
    folder=$OUT/work_$1
    { cat "$last" 2> /dev/null; text likely "$2"; } | awk '!seen[$0]++' > "$folder.likely"
    if [ "$5" = 0 ]; then
        echo "does not apply" > "$result.new"
    elif build_mutant "$folder" "$2" "$4" 2> "$OUT/work_$1.txt"; then
        notice "$folder" "$3" "$folder.likely" > "$result.new" 2>> "$OUT/work_$1.txt"
    else
        echo "does not compile" > "$result.new"
    fi
    [ "$5" != 0 ] && [ -s "$result.new" ] && cp "$result.new" "$last" && echo "$2 $(cat "$last")" >> $OUT/noticed
    mv "$result.new" "$result"
    echo "$2 $3 $4: $(cat "$result")"
    rm -rf "$folder"
}

work() { # worker
    while read -r entry chapter function line rest; do
        [ $(($(date +%s) - BEGIN)) -ge "$LIMIT" ] && return
        case " ${CHAPTER:-$chapter} " in *" $chapter "*) ;; *) continue ;; esac
        run_entry "$1" "$entry" "$chapter" "$function" "$line"
    done < $OUT/list
}

report() {
    while read -r entry chapter function line rest; do
        case " ${CHAPTER:-$chapter} " in *" $chapter "*) ;; *) continue ;; esac
        result=$OUT/results/$(result_of "$entry")
        if [ ! -e "$result" ]; then said="not run"; elif [ -s "$result" ]; then said=$(cat "$result"); else said=-; fi
        printf '%s|%s|%s|%s|%s|%s\n' "$entry" "$chapter" "$line" "$function" "$said" "$(text reason "$entry")"
    done < $OUT/list | sort -n | awk -F'|' '
        { printf "%4d  %-14s %6d  %-32s %s\n", $1, $2, $3, $4, $5 == "-" ? "NOT NOTICED" : $5 }
        $5 == "not run" { ++waiting; next }
        $5 ~ /^does not/ { ++broken; next }
        $5 == "-" { missed[++misses] = $1 ": " ($6 == "" ? "no reason" : $6); unexplained += $6 == "" }
        $5 != "-" { ++noticed; if ($6 != "") seen = seen " " $1 }
        END {
            if (misses) print "\nNot noticed:"
            for (i = 1; i <= misses; ++i) print "  " missed[i]
            if (seen != "") print "Noticed, though the list has a reason why not:" seen
            if (broken) print broken " do not apply or compile"
            if (waiting) print waiting " not run yet: run again"
            all = noticed + misses
            printf "%d of %d noticed (%.0f %%), %d without a reason\n", noticed, all, all ? 100 * noticed / all : 0, unexplained
            exit !all || noticed < 0.9 * all || unexplained > 0 || broken > 0 || waiting > 0
        }'
}

run() {
    BEGIN=$(date +%s)
    STATE=$({ echo "$COMPILE"; cat splatshadow.h tests/*.[ch] tests/measure/*.h examples/*.h examples/shaders/*; } | checksum)
    mkdir -p $OUT/results $OUT/last && rm -rf $OUT/taken $OUT/noticed && mkdir $OUT/taken
    build_common || exit 1
    for test in $(cat $OUT/common/failing); do
        echo "$test fails without any error: it is left out"
        TESTS=$(echo "$TESTS" | grep -vx "$test")
    done
    [ -n "$TESTS" ] || exit 1
    text list | sort -n -k5,5 -k1,1 > $OUT/list
    worker=1
    while [ $worker -le "$JOBS" ]; do
        work $worker &
        worker=$((worker + 1))
    done
    wait
    report && [ ! -s $OUT/common/failing ]
}

# All lists; the last line is the sum of theirs.
check() {
    for LIST in tests/mutants.txt tests/blind_*.txt; do text check; done | awk '
        /^[0-9]+ passed, [0-9]+ failed$/ { passed += $1; failed += $3; next }
        { print }
        END { printf "%d passed, %d failed\n", passed, failed; exit failed > 0 || !passed }'
}

record() {
    text list | while read -r entry rest; do
        last=$(last_of "$entry")
        [ -s "$last" ] && ! grep -q compile "$last" && echo "$entry $(cat "$last")"
    done | text record > $OUT/recorded && cp $OUT/recorded $LIST
}

case ${1:-} in
check) check ;;
show) text entry "$2" ;;
run) run ;;
record) record ;;
*) sed -n '2,/^$/s/^# \{0,1\}//p' "$0"; exit 2 ;;
esac
