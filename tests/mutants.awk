# Text processing for tests/mutants.sh. Files: a list such as tests/mutants.txt, then the header. `mode` is one of
#   check     prints the entries that do not apply, and ends with `N passed, N failed`
#   list      a line for each entry: number, chapter, function (- outside functions), line of the header, rank(entry)
#   entry     the text of entry number `entry`
#   likely    tests, and the parts of them, that noticed entry number `entry` last, or others of its function or chapter
#   record    the list, with the last tests read from standard input, a line for each entry: number, test, part
#   order     the tests that noticed errors in chapter `chapter`, most of them first
#   weak      the header with every function weak, so that another object can replace it
#   open      the header with every function of external linkage, so that tests can call it; compilers may inline it
#   mutated   the same with entry number `entry` applied to it
#   faces     the header without its functions' bodies; with `entry`, of the mutated header
#   function  the same, except for the function that entry number `entry` is in, which has its body
# Inline functions are complete in all of them.

FNR == 1 { ++file }

# ---- the list ----

file == 1 && mode == "record" { listed[FNR] = $0; listed_lines = FNR }
file == 1 && /^(#|$)/ { next }
file == 1 && /^- / { old[count] = substr($0, 3); next }
file == 1 && /^\+/ { new[count] = substr($0, 3); end_of[count] = FNR; next }
file == 1 && /^! / { reason[count] = substr($0, 3); end_of[count] = FNR; next }
file == 1 && /^= / { last[count] = substr($0, 3); last_line[count] = FNR; next }
file == 1 {
    line_of[++count] = FNR
    owner[count] = $1
    sub(/:$/, "", owner[count])
    why[count] = substr($0, index($0, ":") + 2)
    next
}

# ---- the header ----

{ text[++lines] = $0 }

function name_before(line, mark) {
    sub(mark ".*", "", line)
    sub(/.*[ *]/, "", line)
    return line
}

# Finds what each line belongs to: a function, a macro, a table of constants, or a type; `body_of` has the functions that
# are not inline.
function read_header(line, here, chapter, implementation) {
    for (line = 1; line <= lines; ++line) {
        here = text[line]
        if (here ~ /^\/\* =+ >>/) { chapter = here; sub(/^.*>>/, "", chapter); sub(/ .*$/, "", chapter) }
        if (here ~ /^#ifdef SPLATSHADOW_IMPLEMENTATION/) implementation = 1
        if (begun == "") {
            begin_owner(here)
            begins[line] = 1
        }
        if (begins[line] && !(begun in chapter_of)) chapter_of[begun] = chapter
        owner_at[line] = begun
        if (implementation && plain) body_of[line] = begun
        if (here ~ ending) begun = ""
    }
}

# Sets `begun` to the name of what begins on a line, `ending` to how its last line looks, and `plain` to 1 for a
# function that is not inline.
function begin_owner(here) {
    begun = ""
    plain = 0
    ending = "."
    if (here ~ /^#define /) {
        begun = here
        sub(/^#define /, "", begun)
        sub(/[ (].*/, "", begun)
        ending = "[^\\\\]$"
    } else if (here ~ /^(static|SPSI_COLD|SPSI_NOINLINE|SPS_API) [^=;]*\(/ && here !~ /;$/) {
        begun = name_before(here, "\\(")
        plain = here !~ /^static inline /
        ending = here ~ /\{.*\}$/ ? "." : "^\\}"
    } else if (here ~ /^static const .*=/) {
        begun = name_before(here, "(\\[.*)? =")
        ending = here ~ /;/ ? "." : "; *(/\\*.*)?$"
    } else if (here ~ /^typedef (struct|enum|union) .*\{$/) {
        begun = here
        sub(/ \{$/, "", begun)
        sub(/.* /, "", begun)
        ending = "^\\}"
    }
}

# A regular expression for a text in which white space, also the end of a line, stands for any other.
function pattern_of(n, pattern) {
    pattern = old[n]
    gsub(/^ +| +$/, "", pattern)
    gsub(/[][\\.*+?(){}|^$\/]/, "\\\\&", pattern)
    gsub(/ +/, "[ \n]+", pattern)
    gsub(/\\[({]/, "&[ \n]*", pattern)
    return pattern
}

# Finds the text that an entry replaces, which must occur once in its owner. Returns the line on which it begins, and
# sets `at` to its place there and `span` to its length; 0 if `places`, the number of occurrences, is not 1.
function find(n, line, first, whole, before, found) {
    places = found = 0
    for (line = 1; line <= lines; ++line) {
        if (owner_at[line] != owner[n]) continue
        first = line
        whole = text[line]
        while (owner_at[line + 1] == owner[n]) whole = whole "\n" text[++line]
        for (before = 0; match(substr(whole, before + 1), pattern_of(n)); before += RSTART)
            if (++places == 1) { found = first; at = before + RSTART; span = RLENGTH }
    }
    if (places != 1) return 0
    for (; at > length(text[found]); ++found) at -= length(text[found]) + 1
    return found
}

# Puts an entry's text into the header. Lines that the old one spanned become one, and empty ones.
function apply(n, line, end) {
    line = end = find(n)
    if (!line) exit 1
    while (length(text[line]) < at + span - 1) {
        text[line] = text[line] "\n" text[++end]
        text[end] = ""
    }
    text[line] = substr(text[line], 1, at - 1) new[n] substr(text[line], at + span)
    return line
}

function check(n, failed) {
    for (n = 1; n <= count; ++n)
        if (old[n] == "" || old[n] == new[n] || why[n] == "") {
            printf "%s:%d: an entry needs a function, a reason, and two texts that differ\n", ARGV[1], line_of[n]
            ++failed
        } else if (!find(n)) {
            printf "%s:%d: %d places in %s have: %s\n", ARGV[1], line_of[n], places, owner[n], old[n]
            ++failed
        }
    printf "%d passed, %d failed\n", count - failed, failed
    exit failed > 0 || count == 0
}

# The beginning of a function in the output: weak, or without its body and with external linkage.
function opening(line, faces) {
    if (mode == "open" && sub(/^SPSI_COLD /, "", line)) return "__attribute__((cold)) " line
    if (mode == "open" && sub(/^SPSI_NOINLINE /, "", line)) return "__attribute__((noinline)) " line
    if (!faces && sub(/^SPSI_COLD /, "", line)) return "__attribute__((weak, cold)) " line
    sub(/^(static|SPSI_COLD|SPSI_NOINLINE) /, "", line)
    return faces || mode == "open" ? line : "__attribute__((weak)) " line
}

function print_header(faces, whole, line, name) {
    for (line = 1; line <= lines; ++line) {
        name = body_of[line]
        if (name == "" || !faces && !begins[line]) { print text[line]; continue }
        if (!faces) { print opening(text[line], 0); continue }
        if (name == whole) { print begins[line] ? opening(text[line], 1) : text[line]; continue }
        # a face: the lines up to the one that opens the body
        if (begins[line]) open = 0
        if (open) continue
        open = text[line] ~ /\{/
        sub(/ *\{.*/, ";", text[line])
        print begins[line] ? opening(text[line], 1) : text[line]
    }
}

# 1 for entries that no test is known to notice, 2 for those that one does, 3 for those that none need notice.
function rank(n) { return n in reason ? 3 : n in last_line ? 2 : 1 }

# The function that an entry changes, - outside functions, and its chapter, - if the header has no such owner
function place(line) { return body_of[line] == "" ? "-" : body_of[line] }
function chapter_at(n) { return owner[n] in chapter_of ? chapter_of[owner[n]] : "-" }

# The entry's own first, then those that noticed most: one of the same function counts as ten of the same chapter.
# `noticed` is a file of such lines as record() reads, newer than the list.
function likely(n, k, best, seen, line, weight) {
    while ((getline line < noticed) > 0) {
        n = line + 0
        sub(/^[0-9]+ /, "", line)
        last[n] = line
    }
    if (entry in last) { print last[entry]; seen[last[entry]] = 1 }
    for (n = 1; n <= count; ++n)
        if (last[n] ~ / / && chapter_at(n) == chapter_at(entry)) weight[last[n]] += owner[n] == owner[entry] ? 10 : 1
    for (k = 0; k < 6; ++k) {
        best = ""
        for (n in weight)
            if (!(n in seen) && (best == "" || weight[n] > weight[best])) best = n
        if (best == "") return
        print best
        seen[best] = 1
    }
}

# Tests that noticed an entry of a chapter, most of its entries first
function order(n, test, weight, best) {
    for (n = 1; n <= count; ++n)
        if (n in last && chapter_at(n) == chapter) {
            test = last[n]
            sub(/ .*/, "", test)
            ++weight[test]
        }
    for (;;) {
        best = ""
        for (test in weight)
            if (best == "" || weight[test] > weight[best]) best = test
        if (best == "") return
        print best
        delete weight[best]
    }
}

# The recorded line of an entry comes last.
function record(n, line) {
    while ((getline line < "/dev/stdin") > 0) {
        n = line + 0
        sub(/^[0-9]+ /, "", line)
        sub(/ (crash|.*:[0-9]+)$/, "", line) # not a part that can be run by itself
        if (n in last_line) listed[last_line[n]] = "= " line
        else listed[end_of[n]] = listed[end_of[n]] "\n= " line
    }
    for (n = 1; n <= listed_lines; ++n) print listed[n]
}

END {
    if (mode == "record") record()
    if (mode == "entry") printf "%s: %s\n- %s\n+ %s\n", owner[entry], why[entry], old[entry], new[entry]
    if (mode == "reason") print reason[entry]
    if (mode == "record" || mode == "entry" || mode == "reason") exit
    read_header()
    if (mode == "check") check()
    if (mode == "order") order()
    if (mode == "likely") likely()
    if (mode == "list")
        for (n = 1; n <= count; ++n) {
            line = find(n)
            print n, chapter_at(n), place(line), line, rank(n)
        }
    if (mode == "weak" || mode == "open") print_header(0)
    if (mode == "mutated") { apply(entry); print_header(0) }
    if (mode == "faces") { if (entry) apply(entry); print_header(1) }
    if (mode == "function") print_header(1, body_of[apply(entry)])
}
