# sh tests/measure/turns.sh PART BASE [BUILD...]: rows of a part of build/measure/BASE and of other builds of bench, which
# take turns, once in each of 7: medians of what a build's figure is over that of the base. With the base alone: its
# figures. GOAL='<= 1.2': instead of the rows' own goals.
part=$1
shift
for turn in 1 2 3 4 5 6 7; do
    for build; do build/measure/$build $part | sed "s/^/$build /"; done
done | awk -F ' *[|] *' -v builds="$*" -v own_goal="$GOAL" '
function median(key, n,    i, j, x) {
    for (i = 2; i <= n; ++i)
        for (j = i; j > 1 && value[key, j - 1] > value[key, j]; --j)
            x = value[key, j], value[key, j] = value[key, j - 1], value[key, j - 1] = x
    return value[key, int((n + 1) / 2)]
}
function verdict(ratio, goal) {
    sub(/[^0-9]* /, "", goal)
    return goal == "" ? "" : ratio <= goal ? "met" : sprintf("missed by %.0f %%", 100 * (ratio / goal - 1))
}
BEGIN { count = split(builds, build, " ") }
$3 + 0 > 0 {
    n = ++seen[$1, $2]
    value[$1, $2, n] = $3 + 0
    if ($1 != build[1]) value[$1, $2, n] /= latest[$2]
    else latest[$2] = $3 + 0
    if ($1 == build[1] && n == 1) names[++rows] = $2, goals[rows] = own_goal ? own_goal : $5
    if ($3 ~ / s$/) unit[$2] = " s"
}
END {
    for (b = count > 1 ? 2 : 1; b <= count; ++b)
        for (i = 1; i <= rows; ++i) {
            n = seen[build[b], names[i]]
            if (!n) continue
            m = median(build[b] SUBSEP names[i], n)
            m0 = median(build[1] SUBSEP names[i], seen[build[1], names[i]])
            if (count > 1)
                printf "| %s: %s / %s | %.3g | %.3g%s with %s | %s | | %s |\n", names[i], build[b], build[1], m, m0,
                    unit[names[i]], build[1], goals[i], verdict(m, goals[i])
            else
                printf "| %s | %.3g%s | | %s of `BEFORE` | | |\n", names[i], m, unit[names[i]], goals[i]
        }
}'
