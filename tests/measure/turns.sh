# sh tests/measure/turns.sh PART BASE [BUILD...]: rows of a part of build/measure/BASE and of other builds of bench, which
# take turns, once in each of 7: medians of a build's figure over that of the base. With the base alone: its figures.
# GOAL='<= 1.2': instead of the rows' own goals.
part=$1
shift
for turn in 1 2 3 4 5 6 7; do
    for build; do build/measure/$build $part | sed "s/^/$build /"; done
done | awk -F ' *[|] *' -v builds="$*" -v own_goal="$GOAL" '
function median(build, name,    n, i, j, list) {
    n = seen[build, name]
    for (i = 1; i <= n; ++i) {
        for (j = i; j > 1 && list[j - 1] > value[build, name, i]; --j) list[j] = list[j - 1]
        list[j] = value[build, name, i]
    }
    return list[int((n + 1) / 2)]
}
function row(build, name, goal,    ratio, over) {
    if (count == 1) return sprintf("| %s | %.3g%s | | %s with BEFORE | | |", name, median(build, name), unit[name], goal)
    ratio = median(build, name)
    over = ratio / substr(goal, 4)
    return sprintf("| %s: %s / %s | %.3g | %.3g%s by %s | %s | | %s |", name, build, base, ratio, median(base, name),
        unit[name], base, goal, goal == "" ? "" : over <= 1 ? "met" : sprintf("missed by %.0f %%", 100 * (over - 1)))
}
BEGIN {
    count = split(builds, list, " ")
    base = list[1]
}
$3 + 0 > 0 {
    n = ++seen[$1, $2]
    if ($1 == base) latest[$2] = $3
    value[$1, $2, n] = $1 == base ? $3 + 0 : $3 / latest[$2]
    if ($1 == base && n == 1) names[++rows] = $2
    unit[$2] = $3 ~ / s$/ ? " s" : ""
    goals[$2] = own_goal ? own_goal : $5
}
END {
    for (b = count > 1 ? 2 : 1; b <= count; ++b)
        for (i = 1; i <= rows; ++i)
            if (seen[list[b], names[i]]) print row(list[b], names[i], goals[names[i]])
}'
