# Hard cases: from the rows that CHECK_CASE writes (see check.h), the table of docs/hard-cases.md, a line for each group,
# and all cases as CSV in the file `csv`; or, with mode=count, from the tests' sources and that page, whether the page
# has at least as many cases of each group.

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

BEGIN { FS = mode == "count" ? "|" : "\t" }

# ---- counting ----

mode == "count" && FILENAME ~ /\.md$/ && $3 + 0 > 0 {
    gsub(/^ +| +$/, "", $2)
    listed[$2] = $3 + 0
    next
}
mode == "count" { text[FILENAME] = text[FILENAME] $0 "\n"; next }

# The first two texts after each CHECK_CASE, whose parts may stand in several lines.
function count_cases(path,    source, part) {
    source = text[path]
    gsub(/"[ \n]+"/, "", source)
    while (match(source, /CHECK_CASE\([ \n]*"[^"]*",[ \n]*"[^"]*"/)) {
        split(substr(source, RSTART, RLENGTH), part, "\"")
        source = substr(source, RSTART + RLENGTH)
        if (path ~ /check\.h$/ && part[4] == "") continue
        if (!((part[2], part[4]) in found)) ++cases[part[2]]
        found[part[2], part[4]] = 1
    }
}

# ---- the page ----

{
    key = $1 FS $2
    if (!(key in worst)) {
        if (!($1 in cases)) groups[++group_count] = $1
        ++cases[$1]
        worst[key] = -1
    }
    if ($5 > $6 || $5 != $5 + 0) {
        print "failed: " $0 > "/dev/stderr"
        failed = 1
    }
    if (closeness($5, $6) < worst[key]) next
    worst[key] = closeness($5, $6)
    row[key] = sprintf("\"%s\",\"%s\",\"%s\",%.3g,%.3g,\"%s\",%s,%s", $1, $2, $3, $5, $6, $4, name_of($7), $9)
    exact[key] = $6 == 0
}

function print_group(group,    key, part, exacts, closest) {
    exacts = 0
    closest = ""
    for (key in worst) {
        split(key, part, FS)
        if (part[1] != group) continue
        print row[key] > csv
        exacts += exact[key]
        if (!exact[key] && (closest == "" || worst[key] > worst[closest])) closest = key
    }
    split(closest, part, FS)
    printf "| %s | %d | %d | %s | %.3g |\n", group, cases[group], exacts, part[2], worst[closest]
}

END {
    if (mode == "count") {
        for (path in text) count_cases(path)
        for (group in cases)
            if (cases[group] > listed[group] + 0) {
                printf "docs/hard-cases.md: %d cases of \"%s\", and tests have %d: make hard-cases\n", listed[group], group, cases[group]
                failed = 1
            }
        exit failed
    }
    print "| group | cases | exact | closest to its tolerance | measured / tolerance |\n|---|---|---|---|---|"
    for (i = 1; i <= group_count; ++i) print_group(groups[i])
    exit failed
}
