# Text processing for tests/mutants.sh. Files: a list such as tests/mutants.txt, then the header. `mode` is one of
#   check     prints the entries that do not apply, and ends with `N passed, N failed`
#   list      a line for each entry: number, section, function (- outside functions), line of the header, rank(entry)
#   entry     the text of entry number `entry`
#   likely    tests, and the parts of them, that noticed entry number `entry` last, or others of its function or section
#   record    the list, with the last tests read from standard input, a line for each entry: number, test, part
#   order     the tests that can notice errors in section `section_name`, likeliest first
#   named     all tests that any section names
#   weak      the header with every function weak, so that another object can replace it
#   mutated   the same with entry number `entry` applied to it
#   faces     the header without its functions' bodies; with `entry`, of the mutated header
#   function  the same, except for the function that entry number `entry` is in, which has its body
# Inline functions are complete in all of them.

FNR == 1 { ++file }

# ---- the list ----

file == 1 && mode == "record" { listed[FNR] = $0; listed_lines = FNR }
file == 1 && /^(#|$)/ { next }
file == 1 && /^tests / {
    at = substr($2, 1, length($2) - 1)
    sub(/^tests [^:]*: */, "")
    order[at] = $0
    named = named " " $0
    next
}
file == 1 && /^- / { old[count] = substr($0, 3); next }
file == 1 && /^\+/ { new[count] = substr($0, 3); end_of[count] = FNR; next }
file == 1 && /^! / { reason[count] = substr($0, 3); end_of[count] = FNR; next }
file == 1 && /^= / { last[count] = substr($0, 3); last_line[count] = FNR; next }
file == 1 {
    line_of[++count] = FNR
    section[count] = $1
    owner[count] = $1 ~ /:$/ ? "" : substr($2, 1, length($2) - 1)
    sub(/:$/, "", section[count])
    why[count] = substr($0, index($0, ":") + 2)
    next
}

# ---- the header ----

/^\/\* =+ >>/ { here = $0; sub(/^.*>>/, "", here); sub(/ .*$/, "", here) }
/^(static|SPS_API) [^=;]*\(/ { inside = $0; sub(/\(.*/, "", inside); sub(/.*[ *]/, "", inside) }
{ text[FNR] = $0; section_at[FNR] = here; owner_at[FNR] = inside; lines = FNR }
/^\}/ || /^(static|SPS_API) .*\}$/ { inside = "" }
/^#ifdef SPLATSHADOW_IMPLEMENTATION/ { implementation = FNR }

# Whether a line begins a function that is not inline. A definition's first line has its name and the opening parenthesis
# of its parameters; declarations without a body are the public ones, which come before the implementation.
function begins(line) {
    return line > implementation && text[line] ~ /^(static|SPS_API) [^=]*\(/ && text[line] !~ /^static inline / &&
        text[line] !~ /;$/
}

# A function ends with a brace at the start of a line, or with the line that opens its body.
function find_functions(line, name, inside, opened) {
    for (line = implementation + 1; line <= lines; ++line) {
        if (!inside && begins(line)) {
            name = text[line]
            sub(/\(.*/, "", name)
            sub(/.*[ *]/, "", name)
            first[name] = line
            inside = 1
            opened = 0
        }
        if (!inside) continue
        function_at[line] = name
        if (opened ? text[line] ~ /^\}/ : text[line] ~ /\{.*\}$/) inside = 0
        if (text[line] ~ /\{/) opened = 1
    }
}

# Finds the text that an entry replaces; 0: it does not occur exactly once. Sets `places` to the number of occurrences.
function find(n, line, rest, found) {
    places = 0
    for (line = 1; line <= lines; ++line) {
        if (section_at[line] != section[n] || !index(text[line], old[n])) continue
        if (owner[n] != "" && owner_at[line] != owner[n]) continue
        for (rest = text[line]; index(rest, old[n]); rest = substr(rest, index(rest, old[n]) + 1)) ++places
        found = line
    }
    return places == 1 ? found : 0
}

function apply(n, line) {
    line = find(n)
    if (!line) exit 1
    text[line] = substr(text[line], 1, index(text[line], old[n]) - 1) new[n] \
        substr(text[line], index(text[line], old[n]) + length(old[n]))
    return line
}

function check(n, failed) {
    for (n = 1; n <= count; ++n)
        if (old[n] == "" || old[n] == new[n] || why[n] == "") {
            printf "%s:%d: an entry needs a section, a reason, and two texts that differ\n", ARGV[1], line_of[n]
            ++failed
        } else if (!find(n)) {
            printf "%s:%d: %d places in %s have: %s\n", ARGV[1], line_of[n], places, owner[n] != "" ? owner[n] : section[n], old[n]
            ++failed
        }
    printf "%d passed, %d failed\n", count - failed, failed
    exit failed > 0 || count == 0
}

# The beginning of a function in the output: weak, or without its body and with external linkage.
function opening(line, faces) {
    if (!faces) return line ~ /^static/ ? "__attribute__((weak)) " substr(line, 8) : "__attribute__((weak)) " line
    sub(/^static /, "", line)
    return line
}

function print_header(faces, whole, line, name) {
    for (line = 1; line <= lines; ++line) {
        name = function_at[line]
        if (name == "" || !faces && line != first[name]) { print text[line]; continue }
        if (!faces) { print opening(text[line], 0); continue }
        if (name == whole) { print line == first[name] ? opening(text[line], 1) : text[line]; continue }
        # a face: the lines up to the one that opens the body
        if (line == first[name]) open = 0
        if (open) continue
        open = text[line] ~ /\{/
        sub(/ *\{.*/, ";", text[line])
        print line == first[name] ? opening(text[line], 1) : text[line]
    }
}

# 1 for entries that no test is known to notice, 2 for those that one does, 3 for those that none need notice.
function rank(n) { return n in reason ? 3 : n in last_line ? 2 : 1 }

function place(n) { return function_at[find(n)] }

# The entry's own first, then those that noticed most: one of the same function counts as ten of the same section.
# `noticed` is a file of such lines as record() reads, newer than the list.
function likely(n, k, best, seen, line) {
    while ((getline line < noticed) > 0) {
        n = line + 0
        sub(/^[0-9]+ /, "", line)
        last[n] = line
    }
    if (entry in last) { print last[entry]; seen[last[entry]] = 1 }
    for (n = 1; n <= count; ++n)
        if (section[n] == section[entry] && last[n] ~ / /) weight[last[n]] += place(n) == place(entry) ? 10 : 1
    for (k = 0; k < 6; ++k) {
        best = ""
        for (n in weight)
            if (!(n in seen) && (best == "" || weight[n] > weight[best])) best = n
        if (best == "") return
        print best
        seen[best] = 1
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
    if (mode == "check") check()
    if (mode == "record") record()
    if (mode == "order") print order[section_name]
    if (mode == "named") print named
    if (mode == "entry") printf "%s%s: %s\n- %s\n+ %s\n", section[entry], owner[entry] == "" ? "" : " " owner[entry], why[entry], old[entry], new[entry]
    if (mode == "reason") print reason[entry]
    find_functions()
    if (mode == "likely") likely()
    if (mode == "list")
        for (n = 1; n <= count; ++n) {
            line = find(n)
            print n, section[n], line && function_at[line] != "" ? function_at[line] : "-", line, rank(n)
        }
    if (mode == "weak") print_header(0)
    if (mode == "mutated") { apply(entry); print_header(0) }
    if (mode == "faces") { if (entry) apply(entry); print_header(1) }
    if (mode == "function") print_header(1, function_at[apply(entry)])
}
