# Hard cases: from the rows that CHECK_CASE writes (see check.h), sorted by file and line, the tables of
# docs/hard-cases.md; or, with mode=missing, from the tests' sources and that page the cases that it lacks.

function number(x) { return x == 0 ? "0" : sprintf("%.3g", x) }

# How close a measured value comes to its tolerance, 1: it is at it.
function closeness(measured, tolerance) {
    if (tolerance == 0) return measured > 0 ? 1e300 : measured
    return tolerance > 0 ? measured / tolerance : 2 - measured / tolerance
}

function name_of(path) {
    sub(/^.*\//, "", path)
    sub(/\.c$/, "", path)
    return path
}

function print_group(group,    i) {
    if (!(group in seen)) return
    printf "## %s\n\n| case | expectation | measured | tolerance | why that | where |\n|---|---|---|---|---|---|\n", group
    for (i = 1; i <= count; ++i)
        if (group_of[i] == group) print row_of[i]
    print ""
}

BEGIN { FS = "\t" }

mode == "missing" {
    if (FILENAME != last) text[FILENAME] = ""
    last = FILENAME
    text[FILENAME] = text[FILENAME] $0 "\n"
    next
}

{
    key = $1 FS $2
    if (!(key in place)) {
        place[key] = ++count
        group_of[count] = $1
        seen[$1] = 1
        worst[key] = closeness($5, $6)
    }
    if ($5 > $6 || $5 != $5 + 0) {
        print "failed: " $0 > "/dev/stderr"
        failed = 1
    }
    if (closeness($5, $6) < worst[key]) next
    worst[key] = closeness($5, $6)
    row_of[place[key]] = "| " $2 " | " $3 " | " number($5) " | " number($6) " | " $4 " | `" name_of($7) "`, `" $9 "` |"
}

# The first two texts after each CHECK_CASE, whose parts may stand in several lines.
function report_missing(path,    source, part) {
    source = text[path]
    gsub(/"[ \n]+"/, "", source)
    while (match(source, /CHECK_CASE\([ \n]*"[^"]*",[ \n]*"[^"]*"/)) {
        split(substr(source, RSTART, RLENGTH), part, "\"")
        source = substr(source, RSTART + RLENGTH)
        if (path ~ /check\.h$/ && part[4] == "") continue
        if (!index(text[page], "| " part[4] " |")) {
            print path ": not in " page ": " part[4]
            failed = 1
        }
    }
}

END {
    if (mode == "missing") {
        for (path in text)
            if (path != page) report_missing(path)
    } else {
        print_group("Transport")
        print_group("Shadows")
        print_group("Scattering")
        print_group("Extremes")
        print_group("Engineering")
        print_group("Found in review")
        print_group("What users of other renderers complain of")
    }
    exit failed
}
