# Renames what version 0.5 has renamed, in C files that use 0.3: the table of docs/changelog.md, applied.
#   awk -f migrate.awk changelog.md file.c > new.c
# Members are renamed where the file shows whose they are: after a variable, parameter or member that it declares with
# the struct's type, and in the initialiser of one; anywhere in the file, whatever the function. Names of the table
# without a struct are renamed everywhere. Compilers name what is left.

FNR == 1 { ++file }

file == 1 && /^\| `[^`]*` \| `[^`]*` \|/ {
    split($0, part, "`")
    dot = index(part[2], ".")
    ++count
    type[count] = dot ? substr(part[2], 1, dot - 1) : ""
    old[count] = substr(part[2], dot + 1)
    new[count] = substr(part[4], index(part[4], ".") + 1)
    next
}
file == 1 { next }

{ line[++lines] = $0 }

# Replaces whole words: `before` ends where one may begin.
function replace(text, before, word, by, out, at) {
    out = ""
    while (match(text, before "(" word ")($|[^A-Za-z0-9_])")) {
        at = substr(text, RSTART, RLENGTH)
        match(at, word "($|[^A-Za-z0-9_])")
        out = out substr(text, 1, index(text, at) - 1) substr(at, 1, RSTART - 1) by
        text = substr(text, index(text, at) + RSTART - 1 + length(word))
    }
    return out text
}

# Adds the names that a line declares with a type, as an alternative of a regular expression.
function names(text, of, rest, list, n, i, found) {
    found = ""
    while (match(text, "(^|[^A-Za-z0-9_])" of "[ *]+[A-Za-z_]")) {
        rest = substr(text, RSTART + RLENGTH - 1)
        text = rest
        sub(/[;(){].*/, "", rest)
        n = split(rest, list, ",")
        for (i = 1; i <= n; ++i) {
            gsub(/^[ *]+|[ =[].*$/, "", list[i])
            if (list[i] ~ /^[A-Za-z_][A-Za-z0-9_]*$/ && list[i] != "const") found = found "|" list[i]
        }
    }
    return found
}

END {
    for (i = 1; i <= count; ++i) {
        if (type[i] == "") {
            for (n = 1; n <= lines; ++n) line[n] = replace(line[n], "(^|[^A-Za-z0-9_])", old[i], new[i])
            continue
        }
        known = ""
        for (n = 1; n <= lines; ++n) known = known names(line[n], type[i])
        inside = 0
        for (n = 1; n <= lines; ++n) {
            if (line[n] ~ ("(^|[^A-Za-z0-9_])" type[i] "[ *][^;()]*=")) inside = 1
            if (inside) line[n] = replace(line[n], "(^|[^A-Za-z0-9_)\\]])\\.", old[i], new[i])
            if (line[n] ~ /;/) inside = 0
            if (known != "")
                line[n] = replace(line[n], "(^|[^A-Za-z0-9_])(" substr(known, 2) ")(\\[[^]]*\\])?(\\.|->)", old[i], new[i])
        }
    }
    for (n = 1; n <= lines; ++n) print line[n]
}
